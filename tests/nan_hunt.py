"""No silent NaN: `python tests/nan_hunt.py [RUNS]`.

For each system of the registry so many legal inputs, and so many with one number that is not
legal: not finite, of the wrong sign, zero, or far out of range. Every run has to end finite, or
with a `Status` that says why it did not. Writes the page `docs/explanation/no_silent_nan.md` of
the manual; ends with status 1 where a run ends good and is not finite."""

import sys
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxspace.rotations import Quaternion
from jaxspace.simulation import Accuracy, Status, simulate_batch

RUNS = 10_000
# A run that needs more is one that fails.
ACCURACY = Accuracy(rtol=1e-8, max_steps=512)
POISONS = (np.nan, np.inf, -np.inf, 0.0, -1.0, 1e300, -1e300, 1e-300)
PAGE = Path(__file__).parents[1] / "docs" / "explanation" / "no_silent_nan.md"


class Counts(NamedTuple):
    """How the runs of one system ended; `silent`: good, and not finite."""

    name: str
    kind: str
    runs: int
    good: int
    failed: dict[str, int]
    silent: int


def legal_inputs(sample, runs: int, key: np.random.Generator):
    """System and states with the runs on the last axis: every parameter times a factor from a half
    to two, every component of the state moved by a third of its block; any attitude."""

    def parameter(x):
        if not eqx.is_inexact_array(x):
            return x
        return x[..., None] * 2.0 ** key.uniform(-1.0, 1.0, runs)

    def component(x):
        if isinstance(x, Quaternion):
            wxyz = key.normal(size=(4, runs))
            return Quaternion(wxyz / np.linalg.norm(wxyz, axis=0))
        size = float(jnp.max(jnp.abs(x)))
        return x[..., None] + size / 3.0 * key.uniform(-1.0, 1.0, (*x.shape, runs))

    system = jax.tree.map(parameter, sample.system)
    state = jax.tree.map(component, sample.state, is_leaf=lambda x: isinstance(x, Quaternion))
    return system, state


def poisoned(tree, key: np.random.Generator):
    """Of every run one number, of the system or the state, made illegal."""
    leaves, structure = jax.tree.flatten(tree)
    arrays = [
        k for k, x in enumerate(leaves) if eqx.is_inexact_array(x) or isinstance(x, np.ndarray)
    ]
    leaves = [np.array(x) if k in arrays else x for k, x in enumerate(leaves)]
    for run in range(leaves[arrays[0]].shape[-1]):
        x = leaves[key.choice(arrays)]
        place = tuple(key.integers(n) for n in x.shape[:-1])
        poison = key.choice(POISONS)
        x[(*place, run)] = -x[(*place, run)] if poison == -1.0 else poison
    back = [jnp.asarray(x) if k in arrays else x for k, x in enumerate(leaves)]
    return jax.tree.unflatten(structure, back)


@eqx.filter_jit
def run(system, states, ts):
    """Traced, so that what the border refuses when it sees the numbers gets in."""
    found = simulate_batch(system, states, ts, accuracy=ACCURACY, throw=False)
    finite = [
        jnp.all(jnp.isfinite(x), axis=tuple(range(x.ndim - 1)))
        for x in jax.tree.leaves(found.final)
    ]
    return found.status, jnp.all(jnp.stack(finite), axis=0)


def count(sample, runs: int, seed: int = 0) -> list[Counts]:
    """How legal and illegal inputs of one system end."""
    key = np.random.default_rng(seed)
    legal = jax.tree.map(jnp.asarray, legal_inputs(sample, runs, key))
    ts = jnp.asarray([0.0, 0.3 * sample.span])
    rows = []
    for kind, inputs in (("legal", legal), ("illegal", poisoned(legal, key))):
        status, finite = (np.asarray(x) for x in run(*inputs, ts))
        good = status <= Status.EVENT
        failed = {s.name: int(np.sum(status == s)) for s in Status if not s.good}
        silent = int(np.sum(good & ~finite))
        failed = {name: number for name, number in failed.items() if number}
        rows.append(Counts(sample.name, kind, runs, int(np.sum(good & finite)), failed, silent))
    return rows


HEAD = """# No silent NaN

`make hunt` runs each system of the registry on random legal inputs, and on inputs with one illegal
number: not finite, of the wrong sign, zero or far out of range, which gets in under `jit`, where
the border does not see it. A run that ends well is finite; every other has a `Status` and NaN. An
illegal number may leave a finite motion, such as a velocity of zero or a mass of the wrong sign
that no force divides by.

| System | Inputs | Runs | End well | End with a status | NaN without a status |
|---|---|---|---|---|---|
"""


def page(rows: list[Counts]) -> str:
    lines = []
    for r in rows:
        failed = ", ".join(f"{number} {name}" for name, number in r.failed.items()) or "none"
        lines.append(f"| {r.name} | {r.kind} | {r.runs} | {r.good} | {failed} | {r.silent} |")
    return HEAD + "\n".join(lines) + "\n"


def main() -> int:
    jax.config.update("jax_enable_x64", True)
    from systems import SAMPLES

    runs = int(sys.argv[1]) if len(sys.argv) > 1 else RUNS
    rows = []
    for sample in SAMPLES:
        for row in count(sample, runs):
            rows.append(row)
            print(row, flush=True)
    PAGE.write_text(page(rows))
    return int(any(row.silent for row in rows))


if __name__ == "__main__":
    sys.exit(main())
