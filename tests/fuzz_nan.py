"""No silent NaN: `python tests/fuzz_nan.py [--runs N] [NAME ...]`.

For each system of the registry so many valid inputs, and so many with one number that is not valid:
not finite, outside the range that its field declares, or far out. Every run has to end finite, with
its invariants kept and its model never left, or with a `Status` that says why it did not. What it
counts it keeps in `fuzz_nan.json`, from which it writes the page
`docs/explanation/no_silent_nan.md` of the manual; with names it renews the rows of these systems
alone. It ends with status 1 where a run ends good and is not finite, or not right."""

import argparse
import dataclasses
import json
import sys
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxspace import Scene
from jaxspace.attitude import PendulumState, RollingDisk
from jaxspace.core import InputError
from jaxspace.core.quantities import quantities
from jaxspace.mechanics import AbstractLagrangian
from jaxspace.orbits import PowerLawForce
from jaxspace.rotations import Quaternion
from jaxspace.simulation import Accuracy, Status, simulate_batch

RUNS = 10_000
# A run that needs more is one that fails.
ACCURACY = Accuracy(rtol=1e-8, max_steps=512)
# The invariants of a good run are kept to this share of their usual size: a thousand tolerances.
KEPT = 1e-5
# How often the states on the way are compared with the range of the model.
SAVED = 9
NOT_FINITE = (np.nan, np.inf, -np.inf)
FAR_OUT = (1e300, -1e300)
PAGE = Path(__file__).parents[1] / "docs" / "explanation" / "no_silent_nan.md"
RECORD = Path(__file__).parent / "fuzz_nan.json"


class Counts(NamedTuple):
    """How the runs of one system ended.

    - `refused`: those that construction or start refuse in a sentence, where they see the number.
    - `good`: finite and right; `wrong`: finite, and an invariant is not kept; `silent`: good, and
      not finite; `failed`: by their status."""

    name: str
    kind: str
    runs: int
    refused: int
    good: int
    failed: dict[str, int]
    wrong: int
    silent: int


def valid_inputs(sample, runs: int, key: np.random.Generator):
    """System and states with the runs on the last axis: every parameter times a factor from a half
    to two, every component of the state moved by a third of its block; any attitude."""

    def parameter(x):
        if not eqx.is_inexact_array_like(x):
            return x
        return np.asarray(x)[..., None] * 2.0 ** key.uniform(-1.0, 1.0, runs)

    def component(x):
        if isinstance(x, Quaternion):
            wxyz = key.normal(size=(4, runs))
            return Quaternion(wxyz / np.linalg.norm(wxyz, axis=0))
        size = float(jnp.max(jnp.abs(x)))
        return np.asarray(x)[..., None] + size / 3.0 * key.uniform(-1.0, 1.0, (*x.shape, runs))

    system = jax.tree.map(parameter, sample.system)
    state = jax.tree.map(component, sample.state, is_leaf=lambda x: isinstance(x, Quaternion))
    return _same_force(sample.system, system), _constrained(system, state)


def _same_force(example, system):
    """The system with the powers of the distance as strong as those of the example: with half the
    exponent the same coefficient is that of a force 1e7 times as strong."""
    if not isinstance(system, Scene):
        return system
    for number, (one, drawn) in enumerate(zip(example.effects, system.effects, strict=True)):
        if isinstance(drawn, PowerLawForce):
            strength = np.asarray(one.zero_at) ** (drawn.exponent - np.asarray(one.exponent))
            system = eqx.tree_at(
                lambda s, k=number: s.effects[k].coefficient, system, drawn.coefficient * strength
            )
    return system


def _constrained(system, state):
    """The states, held to what binds them."""
    if isinstance(state, PendulumState):
        # The rod has its length.
        u, rate = state.direction, state.direction_rate
        u = u / np.linalg.norm(u, axis=0)
        return PendulumState(u, rate - np.sum(u * rate, axis=0) * u)
    if isinstance(system, RollingDisk):
        # The rim stays on the plane, and the disk above it.
        cosine = np.asarray(state.attitude.matrix())[2, 2]
        height = system.radius * np.sqrt(1.0 - cosine**2)
        place = np.concatenate([np.asarray(state.position)[:2], height[None]])
        return eqx.tree_at(lambda y: y.position, state, place)
    if isinstance(system, AbstractLagrangian):
        # Rates that the constraints allow.
        consistent = jax.vmap(lambda s, y: s.consistent(y), in_axes=-1, out_axes=-1)
        return jax.tree.map(np.asarray, eqx.filter_jit(consistent)(system, state))
    return state


def poisoned(system, state, key: np.random.Generator):
    """Of every run one number made invalid; and which runs the border refuses in a sentence."""
    tree = jax.tree.map(lambda x: np.array(x) if eqx.is_array(x) else x, (system, state))
    places = []
    for path, x in jax.tree_util.tree_flatten_with_path(tree)[0]:
        if not isinstance(x, np.ndarray):
            # A function of the user.
            continue
        owner = tree
        for step in path[:-1]:
            owner = getattr(owner, step.name) if hasattr(step, "name") else owner[_place(step)]
        places.append((owner, _place(path[-1]), x))
    runs = places[0][2].shape[-1]
    refused = np.zeros(runs, bool)
    for run in range(runs):
        owner, name, x = places[key.integers(len(places))]
        place = (*(key.integers(n) for n in x.shape[:-1]), run)
        x[place] = key.choice(_invalid(owner, name, x[place]))
        refused[run] = _refuses(owner, run)
    return _arrays(tree), refused


def _arrays(tree):
    return jax.tree.map(lambda x: jnp.asarray(x) if isinstance(x, np.ndarray) else x, tree)


def _place(step):
    """The name of a field, the key of a part or the number of an item."""
    return next(getattr(step, kind) for kind in ("name", "key", "idx") if hasattr(step, kind))


def _invalid(owner, name: str, x: float) -> tuple[float, ...]:
    """Numbers that the declaration of a field does not allow, or that no computation can hold."""
    declared = quantities(type(owner)).get(name)
    outside = () if declared is None else tuple(p for p in (0.0, -x) if not declared.contains(p))
    return (*NOT_FINITE, *FAR_OUT, *outside)


def _refuses(owner, run: int) -> bool:
    """Whether the part refuses its numbers of this run, when it is constructed or a run starts."""
    one = jax.tree.map(lambda x: x[..., run] if isinstance(x, np.ndarray) else x, owner)
    checks = [vars(kind).get("__check_init__") for kind in type(one).__mro__]
    try:
        for check in (*checks, getattr(type(one), "check_start", None)):
            if check is not None:
                check(one)
    except InputError:
        return True
    return False


@eqx.filter_jit
def run(system, states, ts, rtol=ACCURACY.rtol):
    """Traced, so that what the border refuses when it sees the numbers gets in."""
    accuracy = dataclasses.replace(ACCURACY, rtol=rtol)
    ts = jnp.linspace(ts[0], ts[-1], SAVED)
    found = simulate_batch(system, states, ts, in_axes=(-1, -1), accuracy=accuracy, throw=False)
    finite = [
        jnp.all(jnp.isfinite(x), axis=tuple(range(x.ndim - 1)))
        for x in jax.tree.leaves(found.final)
    ]
    ends = zip((ts[0], ts[-1]), (states, found.final), strict=True)
    kept = [system.invariants(t, y) for t, y in ends]
    changes = [
        jnp.abs(after - before)
        / jnp.nanmedian(jnp.max(jnp.abs(before), axis=range(before.ndim - 1)))
        for before, after in zip(*map(jax.tree.leaves, kept), strict=True)
    ]
    none = jnp.zeros_like(finite[0], float)
    worst = [jnp.max(change, axis=range(change.ndim - 1)) for change in changes]
    # A run that is outside of its model on the way, and ends well, is as wrong as can be.
    worst += [jnp.where(left, jnp.inf, 0.0) for left in _outside(system, ts, found.states)]
    return found.status, jnp.all(jnp.stack(finite), axis=0), jnp.max(jnp.stack([none, *worst]), 0)


def _outside(system, ts, states):
    """Whether each run is outside of its model at the saved times but the first; empty for a system
    whose states are all inside."""
    flags = [
        system.outside(ts[k], jax.tree.map(lambda x, k=k: x[..., k, :], states))
        for k in range(1, SAVED)
    ]
    return [flag for flag in flags if flag is not None]


def count(sample, runs: int, seed: int = 0) -> list[Counts]:
    """How valid and invalid inputs of one system end."""
    key = np.random.default_rng(seed)
    valid = valid_inputs(sample, runs, key)
    ts = jnp.asarray([0.0, 0.3 * sample.span])
    rows = []
    invalid, refused = poisoned(*valid, key)
    for kind, inputs in (("valid", _arrays(valid)), ("invalid", invalid)):
        status, finite, change = (np.asarray(x) for x in run(*inputs, ts))
        good = status <= Status.EVENT
        failed = {s.name: int(np.sum(status == s)) for s in Status if not s.good}
        failed = {name: number for name, number in failed.items() if number}
        # What a number far out makes of an invariant says nothing about the run.
        wrong = good & finite & (change > KEPT) if kind == "valid" else np.zeros(runs, bool)
        if np.any(wrong):
            wrong[wrong] = _remains(*inputs, ts, wrong, change)
        ends = (int(np.sum(good & finite & ~wrong)), failed, int(np.sum(wrong)))
        sentences = int(np.sum(refused)) if kind == "invalid" else 0
        silent = int(np.sum(good & ~finite))
        rows.append(Counts(sample.name, kind, runs, sentences, *ends, silent))
    return rows


def _remains(system, states, ts, chosen, change):
    """Whether the changes of these runs do not fall with the tolerance. Those of a sensitive motion
    do: an orbit that falls from 5000 km to 30 km has more than a thousand times its energy there,
    and a tolerance of that is more than a thousand tolerances of its own."""
    few = jax.tree.map(lambda x: x[..., chosen] if eqx.is_array(x) else x, (system, states))
    finer = np.asarray(run(*few, ts, jnp.asarray(0.01 * ACCURACY.rtol))[2])
    return ~(finer < 0.1 * change[chosen])


HEAD = """# NaN handling

The states of a successful run are finite, and a failed run has a `Status` that gives the cause.
`make fuzz` searches for exceptions, and writes this page: the columns *Silent NaN* and *Wrong* must
be zero.

Each system in the registry of the tests is simulated with random valid inputs (parameters from half
to twice those of an example, states changed by a third), and with the same number of inputs that
contain one invalid value each: not finite, very large (1e300), or outside the declared range of its
field. Concrete invalid parameters raise an error; the column *Rejected if concrete* counts them.
All runs below are made under `jit`, where values are not known during tracing, so that the
invalid values are used. The motion may be finite nevertheless, for example with a moment of inertia
of 1e300.

The maximum number of steps is 512. Extreme inputs therefore lead to the status `MAX_STEPS`, for
example a planet of twice the radius, whose atmosphere the orbit enters, or a stage that starts far
below the ground. With an attraction that decreases faster than 1/r^3 (`central_forces`), some
orbits reach the centre in finite time, which cannot be resolved with any number of steps.

*Wrong* counts successful runs with valid inputs that were outside the range of validity of their
model at one of eight times, or whose invariants changed by more than 1e-5. Runs in which a hundred
times smaller tolerance reduces this change by nine tenths are not counted: their motion is
sensitive, as for an orbit that falls from 5000 km to 30 km.

| System | Inputs | Runs | Silent NaN | Wrong | Rejected if concrete | Successful | Failed |
|---|---|--:|--:|--:|--:|--:|---|
"""


def page(rows: list[Counts]) -> str:
    lines = []
    for r in rows:
        failed = ", ".join(f"{number} `{name}`" for name, number in r.failed.items()) or "0"
        ends = f"{r.silent} | {r.wrong} | {r.refused} | {r.good} | {failed}"
        lines.append(f"| {r.name} | {r.kind} | {r.runs} | {ends} |")
    return HEAD + "\n".join(lines) + "\n"


def stored() -> dict[str, list[Counts]]:
    """The record: the rows of each system."""
    found = json.loads(RECORD.read_text()) if RECORD.exists() else {}
    return {name: [Counts(*row) for row in rows] for name, rows in found.items()}


def keep(name: str, rows: list[Counts]) -> None:
    """Put the rows of one system into the record."""
    lines = (f"{json.dumps(n)}: {json.dumps(r)}" for n, r in {**stored(), name: rows}.items())
    RECORD.write_text("{\n" + ",\n".join(lines) + "\n}\n")


def main() -> int:
    jax.config.update("jax_enable_x64", True)
    from more_systems import MORE
    from systems import SAMPLES

    every = (*SAMPLES, *MORE)
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("names", nargs="*", help="systems; all without any")
    parser.add_argument("--runs", type=int, default=RUNS, help="of each kind and system")
    asked = parser.parse_args()
    defect = False
    for sample in every:
        if asked.names and sample.name not in asked.names:
            continue
        rows = count(sample, asked.runs)
        print(*rows, sep="\n", flush=True)
        keep(sample.name, rows)
        defect = defect or any(row.silent or row.wrong for row in rows)
    record = stored()
    PAGE.write_text(page([row for s in every for row in record.get(s.name, ())]))
    return int(defect)


if __name__ == "__main__":
    sys.exit(main())
