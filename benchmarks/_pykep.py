"""A peer in a process of its own, because its libraries and those of jax now and then break each other's end:
`python _pykep.py STATES.npz RESULTS.npz` moves every pair of state and duration along by `propagate_lagrangian`.

The wheel lacks a data file that its `trajopt` opens on import; the propagation is compiled and does not need it."""

import sys
import time
import types

import numpy as np

REPEATS = 5


def main(states: str, results: str) -> None:
    """Wall and CPU seconds of repeats from prepared lists with the results dropped; then the positions."""
    empty = types.ModuleType("pykep.trajopt")
    empty.__getattr__ = lambda name: None
    sys.modules["pykep.trajopt"] = empty
    from pykep import propagate_lagrangian

    kept = np.load(states)
    pairs, durations = np.moveaxis(np.stack([kept["r"], kept["v"]]), -1, 0).tolist(), kept["t"].tolist()
    seconds = []
    for _ in range(REPEATS + 1):
        wall, cpu = time.perf_counter(), time.process_time()
        for state, duration in zip(pairs, durations, strict=True):
            propagate_lagrangian(state, duration, 1.0, False)
        seconds.append((time.perf_counter() - wall, time.process_time() - cpu))
    found = [propagate_lagrangian(state, duration, 1.0, False)[0] for state, duration in zip(pairs, durations, strict=True)]
    np.savez(results, seconds=seconds[1:], positions=np.transpose(found))


if __name__ == "__main__":
    main(*sys.argv[1:])
