"""Stormer's method of any order: one acceleration a step, for smooth motion that is nearly uniform.

    w_{n+1} = w_n + h sum_j b_j a_{n-j}          w: velocity between the steps, (r_n - r_{n-1}) / h
    r_{n+1} = r_n + h w_{n+1}                    sum_j b_j p(-j) = int_0^1 (1 - x) (p(x) + p(-x)) dx
    v_n     = w_n + h sum_j g_j a_{n-j}          sum_j g_j p(-j) = int_0^1 (1 - x) p(-x) dx

for every polynomial p of a degree below the order k; j runs from 0 to k - 1. Positions and
velocities are sums of small terms (the summed form), so that rounding errors grow slowly, and the
rounded weights cause no secular force along the motion: over 3e5 steps of circular orbits the
relative energy error grows as a random walk, to 5e-14. The first k - 1 steps are those of DOP853 as
a Runge-Kutta-Nystrom method; at such short steps a higher order would change nothing. The local
error is estimated at some of the steps, by the difference to the same step of order k - 1.

    symbol  meaning                       unit
    h       step                          s
    a_n     acceleration at the step n    m/s^2

Dense output integrates the polynomial through the accelerations at the k nearest steps twice.

Sources: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, III.10; Berry, Healy
(2004), Implementation of Gauss-Jackson integration for orbit propagation, Journal of the
Astronautical Sciences 52, 331 (summed form). Order 12 requires about 60 steps a revolution to be
stable, and 90 for nine digits over a day of a low orbit. Higher orders are stable only with steps
so short that order 12 is accurate to rounding as well.
"""

from typing import ClassVar, final

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import InputError, State
from ._polynomials import integrals_of
from ._stormer_steps import StepRecord, StormerSteps
from .dense_output import AbstractDenseOutput
from .protocol import AbstractFieldSolver, AbstractFixedStep, Advance, SolverTraits, check_steps
from .second_order import Parts, Vectors, second_order
from .tolerances import Tolerance
from .vector_field import StepField


class _InterpolatedAccelerations(AbstractDenseOutput):
    """States between the steps, from the `record` of all of them.

    `dt_ds` is the rate of the position for a velocity of ones, `integrals` those of the polynomials
    through k nodes."""

    t0: Float[Array, ""]
    t1: Float[Array, ""]
    y0: State
    record: StepRecord
    dt_ds: Vectors
    integrals: Float[Array, "2 powers k"]

    def state(self, t: Float[Array, "*#runs"]) -> State:
        steps = self.record.r.shape[0]
        k = self.integrals.shape[2]
        h = (self.t1 - self.t0) / steps
        x = steps * self.fraction(t)
        j = jnp.clip(jnp.floor(x).astype(int), 0, steps - 1)
        # The k steps around this one, shifted at both ends of the segment.
        first = jnp.clip(j - (k - 1) // 2, 0, steps + 1 - k)
        near = jax.lax.dynamic_slice_in_dim(self.record.a, first, k)
        h = h.astype(near.dtype)
        x = (x - j.astype(x.dtype)).astype(near.dtype)
        # Start and end of the step, and the requested time, from the middle of the nodes.
        positions = jnp.stack([jnp.zeros_like(x), jnp.ones_like(x), x])
        places = positions + (j - first).astype(near.dtype) - 0.5 * (k - 1)
        powers = jnp.vander(places, k + 2, increasing=True)
        once, twice = h * jnp.tensordot(powers @ self.integrals, near, 1)
        r = self.record.r[j]
        w = self.record.w[j]
        # The polynomial passes through both ends of the step: w is the mean velocity along it.
        mean = twice[1] - twice[0]
        change = h * (x * (w - mean) + twice[2] - twice[0])
        parts = Parts.of(self.y0)
        assert parts is not None
        return parts.state(r + self.dt_ds * change, w + once[2] - mean)


@final
class Stormer(AbstractFieldSolver, AbstractFixedStep):
    """Stormer's explicit multistep method with `steps` equal steps in each segment, one
    acceleration each.

    For states of a position and a velocity whose acceleration does not depend on the velocity;
    where it does, the status reports that the tolerance was missed. Several times as fast as DOP853
    on nearly circular orbits, and slower above an eccentricity of about 0.2, where equal steps are
    inefficient. It has dense output, so that a segment lasts as long as the run, unless the vector
    field jumps.

    **Arguments**

    - `order`: from 5 to 12.
    - `steps`: in each segment; at least twice the order.
    - `run_axes`: number of trailing axes of the state carry runs; by default all but the first.
      `simulate` sets it.

    **Raises** `InputError` for an order or a number of steps out of range, and in its first step
    for a state with further parts.
    """

    k: int = eqx.field(static=True)
    steps: int = eqx.field(static=True)
    run_axes: int | None = eqx.field(static=True)
    term_structure: ClassVar = diffrax.ODETerm
    interpolation_cls: ClassVar = _InterpolatedAccelerations

    def __init__(self, order: int = 12, *, steps: int, run_axes: int | None = None):
        self.k = order
        self.steps = steps
        self.run_axes = run_axes

    def __check_init__(self):
        if not 5 <= self.k <= 12:
            raise InputError(f"Stormer.order is {self.k}: it must be from 5 to 12.")
        least = 2 * self.k
        check_steps("Stormer.steps", self.steps, least, f"at least twice the order, {least}")

    @property
    def traits(self) -> SolverTraits:
        # Each of the k - 1 steps of DOP853 at the start takes eleven further evaluations. Two more
        # are at the step that both methods share, and at the end.
        return SolverTraits(
            fixed_step=True,
            evaluations=self.steps + 11 * (self.k - 1) + 2,
            steps=self.steps,
        )

    def bind(
        self,
        *,
        tolerance: Tolerance,
        save_ts: Float[Array, "times *#runs"] | None,
        run_axes: int,
        searched: bool = False,
    ) -> "Stormer":
        del tolerance, save_ts, searched
        return Stormer(self.k, steps=self.steps, run_axes=run_axes)

    def refined(self, factor: int) -> "Stormer":
        return Stormer(self.k, steps=factor * self.steps, run_axes=self.run_axes)

    def order(self, terms: diffrax.AbstractTerm | None) -> int:
        return self.k

    def advance(
        self, f: StepField, t0: Float[Array, ""], t1: Float[Array, ""], y0: State, carried: None
    ) -> Advance:
        del carried
        system = second_order(f.terms, t0, t1, y0, f.args, "Stormer")
        steps = StormerSteps(system, t0, (t1 - t0) / self.steps, self.k, self.steps)
        state, first = steps.start()
        state, v_error, others = steps.integrate(state)
        y1, a1 = steps.final(state)
        v_error = jnp.where(system.velocity_matters(self.run_axes), jnp.inf, v_error)
        error = system.state(steps.h * system.position_rate(v_error), v_error)
        # With the acceleration at the end, the record has one more acceleration than steps.
        last = StepRecord(state.r[None][:0], state.w[None][:0], a1[None])
        record = jax.tree.map(lambda *x: jnp.concatenate(x), first, *others, last)
        dense = dict(
            y0=y0,
            record=record,
            dt_ds=system.dt_ds,
            integrals=jnp.asarray(integrals_of(self.k), state.r.dtype),
        )
        return Advance(y1, error, dense)
