"""A peer in a process of its own, because its libraries and those of jax now and then break each
other's end: `python _pykep.py propagate_lagrangian GIVEN.npz FOUND.npz` moves every position and
velocity, a and b, along by the duration t; `python _pykep.py lambert_problem GIVEN.npz FOUND.npz`
finds the velocity at a that leads to b in the time t.

The wheel lacks a data file that its `trajopt` opens on import; what is called here is compiled and
does not need it."""

import sys
import time
import types

import numpy as np

REPEATS = 5


def main(work: str, given: str, found: str) -> None:
    """Wall and CPU seconds of repeats from prepared lists with the results dropped; then the
    vectors found."""
    empty = types.ModuleType("pykep.trajopt")
    empty.__getattr__ = lambda name: None
    sys.modules["pykep.trajopt"] = empty
    import pykep

    kept = np.load(given)
    pairs, durations = (
        np.moveaxis(np.stack([kept["a"], kept["b"]]), -1, 0).tolist(),
        kept["t"].tolist(),
    )
    solve, arguments, vector = {
        "propagate_lagrangian": (
            pykep.propagate_lagrangian,
            [(pair, t, 1.0, False) for pair, t in zip(pairs, durations, strict=True)],
            lambda end: end[0],
        ),
        "lambert_problem": (
            pykep.lambert_problem,
            [(*pair, t, 1.0, False, 0) for pair, t in zip(pairs, durations, strict=True)],
            lambda transfer: transfer.v0[0],
        ),
    }[work]
    seconds = []
    for _ in range(REPEATS + 1):
        wall, cpu = time.perf_counter(), time.process_time()
        for some in arguments:
            solve(*some)
        seconds.append((time.perf_counter() - wall, time.process_time() - cpu))
    np.savez(
        found,
        seconds=seconds[1:],
        vectors=np.transpose([vector(solve(*some)) for some in arguments]),
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
