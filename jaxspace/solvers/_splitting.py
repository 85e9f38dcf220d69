"""Splitting: alternating exact drifts and exact kicks, for motion that is close to the drift.

    S(h) = K(h/2) D(h) K(h/2)            order 2 (Strang); others in `_split_schemes.py`

The error is of the size of the kick times h^p, so that steps are long where the perturbation is
small. The maps conserve the volume and the symplectic form, so that the energy oscillates without a
secular drift.

    symbol  meaning                                          unit
    D, K    flow of the drift and of the kick
    h       step                                             s
    p       order                                            1

Source: Wisdom, Holman (1991), Symplectic maps for the N-body problem, Astronomical Journal 102,
1528.
"""

import functools
import math
from typing import ClassVar, final

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import InputError, State
from ..core.barrier import barrier
from ..core.safe import safe_divide
from ._split_schemes import SCHEMES, Scheme
from .protocol import AbstractFieldSolver, AbstractFixedStep, Advance, SolverTraits, check_steps
from .second_order import estimate_by_coarsening
from .vector_field import ScaledField, StepField, just_before

# Where the steps do not resolve the motion, the order is lost: the error estimate is four times the
# difference.
UNRESOLVED_FACTOR = 0.25


@final
class Splitting(AbstractFieldSolver, AbstractFixedStep):
    """Splitting with `steps` equal steps in each segment, of order 2, 4 or 6, or of the generalised
    order (8, 2) or (8, 6, 4) for a small kick.

    For systems with a drift and a kick: a scene of `PointGravity`, free rotation, and loads that
    depend on position and attitude; or a `Top`. Steps land on every save time, so that a segment
    lasts from one to the next.

    The error of each segment is estimated by a second solution with 0.62 times as many steps. Steps
    longer than a radian of the orbit, or two of the rotation, have their kicks at effectively
    random places: the order is lost there, and the estimate is four times the difference.

    Order 6 steps back and forth beyond the ends of a segment. A kick that depends on the time is
    there that of the end.

    **Arguments**

    - `order`: 2, 4 or 6; or (8, 2), whose error is the kick times h^8 and its square times h^2, or
      (8, 6, 4), in which its square has h^6 and its cube h^4. A step requires 1, 5, 7, 4 and 7
      kicks. The estimate assumes the lowest of the orders.
    - `steps`: in each segment; even, and at least 2.
    - `estimate`: whether the error is estimated. Without it no status reports too few steps.

    **Raises** `InputError` for another order or number of steps.
    """

    p: int | tuple[int, ...] = eqx.field(static=True)
    steps: int = eqx.field(static=True)
    estimate: bool = eqx.field(static=True)
    term_structure: ClassVar = diffrax.ODETerm
    interpolation_cls: ClassVar = diffrax.LocalLinearInterpolation

    def __init__(self, order: int | tuple[int, ...] = 4, *, steps: int, estimate: bool = True):
        self.p = order
        self.steps = steps
        self.estimate = estimate

    def __check_init__(self):
        if self.p not in SCHEMES:
            names = ", ".join(str(order) for order in SCHEMES)
            raise InputError(f"Splitting.order is {self.p}: it must be one of {names}.")
        check_steps("Splitting.steps", self.steps, 2, "even, at least 2")
        if self.steps % 2:
            raise InputError(f"Splitting.steps is {self.steps}: it must be even, and at least 2.")

    @property
    def traits(self) -> SolverTraits:
        scheme = SCHEMES[self.p]
        # With the kicks outside, the first step has one more.
        first = 0 if scheme.kicks_inside else 1
        evaluations = scheme.kicks * self.steps + first
        if self.estimate:
            # One more for the angular rate of the state.
            evaluations += scheme.kicks * _fewer(self.steps) + first + 1
        return SolverTraits(
            lands_on_save_times=True,
            fixed_step=True,
            needs="split",
            evaluations=evaluations,
            steps=self.steps,
        )

    def refined(self, factor: int) -> "Splitting":
        return Splitting(self.p, steps=factor * self.steps, estimate=self.estimate)

    def order(self, terms: diffrax.AbstractTerm | None) -> int:
        return self.p if isinstance(self.p, int) else self.p[-1]

    def advance(
        self, f: StepField, t0: Float[Array, ""], t1: Float[Array, ""], y0: State, carried: None
    ) -> Advance:
        del carried
        field: ScaledField = f.args
        fewer = _fewer(self.steps)
        turn = (t1 - t0) / self.steps * _angular_rate(field, t0, y0)
        resolved = (self.steps / fewer) ** self.order(None) - 1.0
        error_reduction = jnp.where(turn < 1.0, resolved, UNRESOLVED_FACTOR)

        def integrate(steps: int) -> State:
            return _integrate(field, t0, t1, y0, SCHEMES[self.p], steps)

        y1, error = estimate_by_coarsening(
            integrate, self.steps, fewer, error_reduction, self.estimate
        )
        return Advance(y1, error, dict(y0=y0, y1=y1))


def _fewer(steps: int) -> int:
    """The golden section of the steps.

    This ratio is the farthest from all simple ones: where the steps are in resonance with the
    drift, the steps of the second solution are not."""
    return max(1, round(0.5 * (math.sqrt(5.0) - 1.0) * steps))


def _angular_rate(field: ScaledField, s: Float[Array, ""], y: State) -> Float[Array, "*runs"]:
    """Angular rate of the state of each run, in radians of normalised time: the largest rate of a
    vector over its length."""
    y = jax.lax.stop_gradient(y)

    def length(x: Array) -> Array:
        return jnp.sqrt(jnp.sum(x * x, axis=0))

    rates = jax.tree.map(lambda x, v: safe_divide(length(v), length(x)), y, field(s, y))
    return functools.reduce(jnp.maximum, jax.tree.leaves(rates))


def _integrate(
    field: ScaledField,
    t0: Float[Array, ""],
    t1: Float[Array, ""],
    y0: State,
    scheme: Scheme,
    steps: int,
) -> State:
    """The state after equal steps in normalised time.

    **Arguments**

    - `field`: the system in normalised time.
    - `t0`, `t1`: start and end of the segment, in normalised time.
    - `y0`: the state at `t0`.
    - `scheme`: the parts of each step.
    - `steps`: their number.

    **Returns** the state at `t1`.
    """
    split = field.split()
    h = (t1 - t0) / steps
    end = just_before(t0, t1)
    rows = jnp.asarray(scheme.rows(), h.dtype)

    def drift(s: Array, ds: Array, y: State) -> State:
        return barrier(split.drift(field.duration(s, ds), y))

    def kick(s: Array, ds: Array, y: State) -> State:
        return barrier(split.kick(field.time(s), field.duration(s, ds), y))

    def at(steps_done: Array) -> Array:
        # Clipped to the segment, because a composition with negative parts passes its ends.
        return jnp.clip(t0 + steps_done * h, t0, end)

    inside, outside = (kick, drift) if scheme.kicks_inside else (drift, kick)

    def part(n: Array, y: State, row: Float[Array, "5"]) -> tuple[State, None]:
        weight, passed, next_weight, after, joined = row
        y = inside(at(n + passed), weight * h, y)
        # The last part of the last step has no successor to join.
        next_weight = next_weight + jnp.where(n == steps - 1, 0.0, joined)
        return outside(at(n + after), next_weight * h, y), None

    def step(y: State, n: Array) -> tuple[State, None]:
        # A loop, so that drift and kick are compiled once.
        return jax.lax.scan(lambda y, row: part(n, y, row), y, rows)

    y = outside(t0, scheme.outside[0] * h, y0)
    # Reverse mode stores the state before each step, and repeats the operations within the step.
    return jax.lax.scan(jax.checkpoint(step), y, jnp.arange(steps, dtype=h.dtype))[0]
