"""The laws that the motion of any system obeys, checked on a system and a state of the user.

    law                    what is compared
    invariants             each one at the end, and at the start
    reversibility          the start, and where the way back from the end leads
    closed form            its flow, and steps
    modes of derivatives   reverse and forward, of the final state along a random direction
    differences            forward derivatives, and central differences
    batch                  a run among others, and alone
    float32                the vector field in both precisions

Every error is relative to the largest number of the block (position, attitude, ...) that it is
found in.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeVar, final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..core import AbstractSystem, InputError, Scalar, State
from ..core.checks import check_positive
from ..core.jit import compiled
from ..core.text import aligned
from ..simulation import Accuracy, Status, Trajectory, simulate, simulate_batch
from ..solvers import DOP853

Tree = TypeVar("Tree")

RTOL = 1e-11
# Central differences at this share of each block: truncation and rounding are both about 1e-9.
STEP = 1e-4
# Enough that the run that is compared has neighbours with other steps.
RUNS = 3


@final
@dataclass(frozen=True)
class Law:
    """One law of motion, and its measured error.

    - `name`: of the law.
    - `error`: measured.
    - `allowed`: the greatest allowed error.
    - `note`: the reason, where the law does not apply."""

    name: str
    error: float
    allowed: float
    note: str = ""

    @property
    def holds(self) -> bool:
        """Whether the error is allowed, or the law does not apply."""
        return bool(self.note) or self.error <= self.allowed


@final
@dataclass(frozen=True)
class LawReport:
    """Result of `verify`.

    - `system`: its name.
    - `laws`: a `Law` for each row."""

    system: str
    laws: tuple[Law, ...]

    @property
    def passed(self) -> bool:
        """Whether every law is satisfied."""
        return all(law.holds for law in self.laws)

    def __repr__(self) -> str:
        rows: list[tuple[str, ...]] = [("law", "error", "allowed", "verdict")]
        for law in self.laws:
            shown = ("-", "-") if law.note else (f"{law.error:.1e}", f"{law.allowed:.1e}")
            rows.append((law.name, *shown, law.note or ("holds" if law.holds else "FAILS")))
        return (
            f"{self.system}: {'all laws are satisfied' if self.passed else 'a law is violated'}\n"
            + aligned(rows)
        )


def verify(
    system: AbstractSystem,
    y0: State,
    duration: Scalar | float,
    *,
    tolerance: float = 1e-6,
    accuracy: Accuracy | None = None,
    seed: int = 0,
) -> LawReport:
    """Check the laws on a system or a scene.

    **Arguments**

    - `system`, `y0`: the system, and a state with representative motion, in float64.
    - `duration`: s; short enough that errors do not grow too far.
    - `tolerance`: allowed deviation of each run, relative to the size of each block. The field is
      held to rounding.
    - `accuracy`: of the runs; by default 1e-11 with the method that `simulate` chooses.
    - `seed`: of the random directions and neighbours.

    **Returns** a `LawReport`, whose `passed` reports whether every law is satisfied, and which
    prints as a table.

    **Raises** `InputError` for a state that is not in float64, and as `simulate` does.
    """
    check_positive("tolerance", tolerance)
    y0 = jax.tree.map(jnp.asarray, y0)
    # In float32 the central differences below would be rounding alone.
    if any(x.dtype != jnp.float64 for x in jax.tree.leaves(y0)):
        raise InputError("y0 is not in float64: call jaxspace.enable_x64() before creating it.")
    check = _Check(
        system,
        y0,
        jnp.asarray(duration, jnp.float64),
        Accuracy(rtol=RTOL) if accuracy is None else accuracy,
        tolerance,
        jax.random.key(seed),
    )
    laws = (
        *check.invariants(),
        check.reversibility(),
        check.closed_form(),
        *check.derivatives(),
        check.batch(),
        check.single_precision(),
    )
    return LawReport(type(system).__name__, laws)


@final
class _Check(eqx.Module):
    """The system and the run on which the laws are checked."""

    system: AbstractSystem
    y0: State
    duration: Float[Array, ""]
    accuracy: Accuracy
    tolerance: float
    key: Array

    def run(self, y0: State, start: ArrayLike, end: ArrayLike) -> Trajectory:
        ts = jnp.stack([jnp.asarray(start, jnp.float64), jnp.asarray(end, jnp.float64)])
        return simulate(self.system, y0, ts, accuracy=self.accuracy)

    def invariants(self) -> Iterator[Law]:
        drift = self.run(self.y0, 0.0, self.duration).drift()
        if not drift:
            yield Law("invariants", 0.0, 0.0, "none is declared")
        for name, change in drift.items():
            yield Law(f"invariants: {name}", float(jnp.max(change)), self.tolerance)

    def reversibility(self) -> Law:
        end = self.run(self.y0, 0.0, self.duration).final
        back = self.run(end, self.duration, 0.0).final
        # Two runs, and what the way back makes of the error of the first.
        return Law("reversibility", distance(back, self.y0), 10.0 * self.tolerance)

    def closed_form(self) -> Law:
        motion = self.system.closed_form()
        if motion is None:
            return Law("closed form", 0.0, 0.0, "has none")
        # By its name, because the rules would choose the closed form itself.
        steps = Accuracy(rtol=RTOL, method=DOP853())
        ts = jnp.stack([0.0 * self.duration, self.duration])
        stepped = simulate(self.system, self.y0, ts, accuracy=steps).final
        return Law(
            "closed form", distance(motion.flow(self.duration, self.y0), stepped), self.tolerance
        )

    def derivatives(self) -> tuple[Law, Law]:
        """Check the derivative of a random sum of the final state along a random initial change.

        Both modes must agree with each other, and with a central difference."""
        one, two = jax.random.split(self.key)
        final = self.run(self.y0, 0.0, self.duration).final
        # Each block counts by its own size: in a sum of metres and radians only the metres would be
        # checked.
        weights = jax.tree.map(jnp.divide, random_like(one, final), sizes(final))
        direction = jax.tree.map(jnp.multiply, random_like(two, self.y0), sizes(self.y0))

        def measure(y: State) -> Scalar:
            return inner(weights, self.run(y, 0.0, self.duration).final)

        _, forward = compiled(lambda y, d: jax.jvp(measure, (y,), (d,)))(self.y0, direction)
        reverse = inner(compiled(jax.grad(measure))(self.y0), direction)
        ahead, behind = (
            measure(jax.tree.map(lambda y, d, h=h: y + h * d, self.y0, direction))
            for h in (STEP, -STEP)
        )
        difference = (ahead - behind) / (2.0 * STEP)
        # The weights make every term of size one: a smaller derivative is a difference of such
        # terms, and as uncertain as they are.
        scale = max(abs(float(forward)), 1.0)
        # The rounding of the steps leaves the one; the truncation of a difference the other, whose
        # bend is not known.
        return (
            Law("modes of derivatives", float(abs(forward - reverse)) / scale, self.tolerance),
            Law("differences", float(abs(forward - difference)) / scale, 100.0 * self.tolerance),
        )

    def batch(self) -> Law:
        """Neighbouring runs as a batch, and one of them individually."""
        leaves, tree = jax.tree.flatten(self.y0)
        keys = jax.random.split(self.key, len(leaves))
        states = jax.tree.unflatten(
            tree,
            [
                # Near enough to move as the given state does, far enough to take other steps.
                x[..., None] + 1e-3 * _size(x) * jax.random.normal(k, (*x.shape, RUNS))
                for x, k in zip(leaves, keys, strict=True)
            ],
        )
        ts = jnp.stack([0.0 * self.duration, self.duration])
        runs = simulate_batch(self.system, states, ts, accuracy=self.accuracy)
        # Beyond EVENT every status is a failure, also that of a run which is not compared below.
        if np.any(np.asarray(runs.status) > Status.EVENT):
            return Law("batch", math.inf, self.tolerance)
        last = jax.tree.map(lambda x: x[..., -1], (states, runs.final))
        alone = self.run(last[0], 0.0, self.duration).final
        return Law("batch", distance(last[1], alone), self.tolerance)

    def single_precision(self) -> Law:
        """The vector field in both precisions: a few hundred roundings, because terms cancel."""
        # In the middle, because a force that depends on the time may be zero at the start.
        t = 0.5 * self.duration
        rate = self.system.vector_field(t, self.y0)
        single = in_float32(self.system).vector_field(in_float32(t), in_float32(self.y0))
        kinds = {str(x.dtype) for x in jax.tree.leaves(single)}
        # A single array of 64 bits in a formula makes all that follows run in double precision.
        if kinds != {"float32"}:
            return Law("float32: the rate stays in it", math.inf, 0.0)
        return Law("float32", distance(single, rate), 1e-4)


def in_float32(tree: Tree) -> Tree:
    """The tree with its numbers in float32."""
    return jax.tree.map(lambda x: x.astype(jnp.float32) if eqx.is_inexact_array(x) else x, tree)


def _size(x: Array) -> Array:
    """The largest number of a block; one where all are zero."""
    largest = jnp.max(jnp.abs(x))
    return jnp.where(largest > 0.0, largest, 1.0)


def sizes(tree: State) -> State:
    """The size of every block."""
    return jax.tree.map(_size, tree)


def random_like(key: Array, tree: State) -> State:
    """Normal numbers in the place of those of a tree."""
    leaves, structure = jax.tree.flatten(tree)
    keys = jax.random.split(key, len(leaves))
    drawn = [jax.random.normal(k, x.shape, x.dtype) for k, x in zip(keys, leaves, strict=True)]
    return jax.tree.unflatten(structure, drawn)


def inner(a: State, b: State) -> Scalar:
    """The sum of the products of two trees, number by number."""
    products = jax.tree.map(lambda x, y: jnp.sum(x * y), a, b)
    return jnp.sum(jnp.stack(jax.tree.leaves(products)))


def distance(computed: State, truth: State) -> float:
    """The largest difference of two trees, relative to the size of its block; infinite for NaN."""
    apart = jax.tree.map(
        # In the precision of the truth, in which the difference itself does not round.
        lambda a, b: jnp.max(jnp.abs(a.astype(b.dtype) - b)) / _size(b),
        computed,
        truth,
    )
    worst = float(jnp.max(jnp.stack(jax.tree.leaves(apart))))
    return worst if math.isfinite(worst) else math.inf
