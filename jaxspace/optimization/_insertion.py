"""A burn into an orbit in an inverse-square field, by the best angles of the thrust.

    r' = w,   w' = v^2/r - mu/r^2 + a sin phi,   v' = -w v/r + a cos phi

    "time"       least T with     r(T) = R,  w(T) = W,  v(T) = V
    "velocity"   greatest v(T) with   r(T) = R,  w(T) = W   at a given T

    symbol   meaning                                                         unit
    r        distance from the centre                                        m
    w, v     velocity along the local vertical and across it                 m/s
    a, phi   thrust acceleration over time, its angle above the horizontal   m/s^2, rad
    R, W, V  r, w and v of the orbit at the end; by default a circle         m, m/s
    T        duration of the burn                                            s

phi is a law of the fraction t/T of the burn (`laws.py`). Over a flat earth the linear tangent is
the optimum; here the bilinear tangent comes near it, and a free profile reaches it. With a constant
flow the least time is the greatest mass.

Source: Bryson and Ho, Applied Optimal Control, 2.5, 2.7 (orbit injection); Thomson 8.3.
Valid in the plane of the flight and without air.
"""

from typing import Any, final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree

from ..core import AbstractParameters, AbstractSystem, InputError, Scalar, quantity
from ..core.formula import POSITIVE, formula
from ..core.jit import quick_jit
from ..core.printing import printed
from ..core.types import SingleNumberField, as_float
from ..minimisation import Criterion, Minimum, minimise
from ..minimisation.optimiser import SQP, Optimiser
from ..simulation import Mission, Phase, simulate_compact
from .ascent import AbstractThrustAcceleration
from .laws import Law, corners, free_numbers

FORMS = ("time", "velocity")


@final
@printed(radius="m", radial="m/s", across="m/s")
class InsertionState(eqx.Module):
    """State of the burn into an orbit; each field is (*runs,).

    - `radius`, m: r, distance from the centre of the planet.
    - `radial`, m/s: w, radial velocity.
    - `across`, m/s: v, horizontal velocity."""

    radius: Float[Array, "*#runs"] = eqx.field(converter=as_float)
    radial: Float[Array, "*#runs"] = eqx.field(converter=as_float)
    across: Float[Array, "*#runs"] = eqx.field(converter=as_float)


@final
class Insertion(AbstractParameters):
    """The data of a burn into an orbit.

    - `thrust`: the thrust acceleration over time.
    - `start`: the state at the start of the burn."""

    thrust: AbstractThrustAcceleration
    start: InsertionState
    mu: SingleNumberField = quantity("m^3/s^2", positive=True, doc="of the planet")
    radius: SingleNumberField = quantity("m", positive=True, doc="R, at the end")
    radial: SingleNumberField = quantity("m/s", default=0.0, doc="W, at the end")
    across: Float[Array, ""] | None = quantity(
        "m/s", optional=True, doc="V, at the end; circular speed by default"
    )

    def target(self) -> InsertionState:
        """The state at the end."""
        across = jnp.sqrt(self.mu / self.radius) if self.across is None else self.across
        return InsertionState(self.radius, self.radial, across)


@final
class SteeredBurn(AbstractSystem):
    """A burn steered by a law of the fraction of its `duration`. State: `InsertionState`."""

    thrust: AbstractThrustAcceleration
    law: Law
    mu: Scalar
    duration: Scalar

    def vector_field(self, t: Scalar, y: InsertionState) -> InsertionState:
        a, phi = self.thrust(t), self.law(t / self.duration)
        r, w, v = y.radius, y.radial, y.across
        up = v * v / r - self.mu / (r * r) + a * jnp.sin(phi)
        return InsertionState(w, up, a * jnp.cos(phi) - w * v / r)

    def invariants(self, t: Scalar, y: InsertionState) -> dict[str, Array]:
        del t, y
        return {}  # The thrust does work.

    def breaks(self) -> Float[Array, " times"] | None:
        inner = corners(self.law)
        return None if inner is None else self.duration * inner


@final
@printed(duration="s")
class InsertionOptimum(eqx.Module):
    """The result of `optimise_insertion`.

    - `law`: the best steering law of its kind.
    - `duration`, s: T, of the burn.
    - `end`: the state at the end of the burn.
    - `radius_price`: derivative of the best T, s/m, or of the best v, 1/s, by the radius R, from
      the multiplier.
    - `error`: the relative error as the steps estimate it.
    - `converged`: whether the search converged.
    - `minimum`: the result of the search, whose `sentence()` explains why it ended."""

    law: Law
    duration: Float[Array, ""]
    end: InsertionState
    radius_price: Float[Array, ""]
    error: Float[Array, ""]
    converged: Any
    minimum: Minimum


@formula(duration=POSITIVE, tolerance=POSITIVE)
def optimise_insertion(
    insertion: Insertion,
    law: Law,
    duration: Scalar,
    *,
    form: str = "time",
    steps: int = 24,
    tolerance: Scalar = 1e-7,
    max_steps: int = 200,
    optimiser: Optimiser = SQP,
) -> InsertionOptimum:
    """The steering of a burn into an orbit, by gradients through the flight; for one run.

    **Arguments**

    - `insertion`: the data of the burn.
    - `law`: the first guess, a function of the fraction of the burn: a `TangentLaw`, a
      `SteeringProfile`, a `core.Spline`, a `SteeringNetwork` or any `equinox.Module`.
    - `duration`: of the burn, s; for "time" the first guess.
    - `form`: "time" for the least time to the orbit, "velocity" for the greatest velocity across at
      its radius in the given time.
    - `steps`: of the integration; `tolerance`, `max_steps`: of the search.
    - `optimiser`: as in `minimise`.

    **Returns** an `InsertionOptimum`, which is not differentiable. An orbit out of reach ends with
    the least miss: `minimum.sentence()`.

    **Raises** `InputError` for another form, or a duration that is not positive.
    """
    if form not in FORMS:
        raise InputError(f"form is {form!r}: it must be one of {', '.join(FORMS)}.")
    T = as_float(duration)
    return _search(insertion, law, T, form, steps, as_float(tolerance), max_steps, optimiser)


@quick_jit
def _search(
    insertion: Insertion,
    law: Law,
    first: Scalar,
    form: str,
    steps: int,
    tolerance: Scalar,
    max_steps: int,
    optimiser: Optimiser,
) -> InsertionOptimum:
    target, (profile, made) = insertion.target(), free_numbers(law)
    radius, speed = target.radius, target.across

    def problem(x: dict[str, PyTree]) -> Criterion:
        T = first * x["duration"] if form == "time" else first
        burn = SteeredBurn(insertion.thrust, made(x["law"]), insertion.mu, T)
        flight = simulate_compact(Mission(Phase(burn, T)), insertion.start, steps=steps)
        end = flight.final
        # In units of the target, so that one tolerance applies to lengths and speeds.
        miss = [end.radius / radius - 1.0, (end.radial - target.radial) / speed]
        if form == "time":
            objective, miss = x["duration"], [*miss, end.across / speed - 1.0]
        else:
            objective = -end.across / speed
        return Criterion(objective, jnp.stack(miss), report=(T, end, flight.error))

    start = {"law": profile}
    if form == "time":
        # As a fraction of the first guess, of order one like the other unknowns.
        start["duration"] = jnp.ones_like(first)
    # The corners of the law are breaks of the burn: its gradient needs no check.
    minimum = minimise(
        problem,
        start,
        optimiser=optimiser,
        tolerance=tolerance,
        max_steps=max_steps,
        check_gradient=False,
    )
    T, end, error = minimum.criterion.report
    dual = minimum.multipliers.equal_zero
    assert dual is not None
    # The objective in its unit: T or, with the opposite sign, v.
    unit = first if form == "time" else -speed
    return InsertionOptimum(
        law=made(minimum.x["law"]),
        duration=T,
        end=end,
        radius_price=-unit * dual[0] / radius,
        error=error,
        converged=minimum.converged,
        minimum=minimum,
    )
