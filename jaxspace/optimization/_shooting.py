"""Steering by direct shooting: the best thrust angles, by gradients through the simulated flight.

    maximise   u_b(theta_0, phi_1, ..., phi_n)
    subject to y_b + w_b^2/(2g) = Y        the apex has the height Y
               w_b >= 0                    the apex is not before burnout

No optimality condition is used: with more nodes the result approaches linear-tangent steering, and
it is valid where that is not.

    symbol    meaning                                                    unit
    phi_i     thrust angle at the time t_i, straight lines in between    rad
    and the symbols of `ascent.py`

Source: Thomson 8.3 for the problem. Without the bound w_b >= 0 a descent ends at false optima whose
apex is before burnout.
"""

from typing import TypeAlias, final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PyTree

from ..core import AbstractSystem, InputError, Scalar
from ..core.formula import POSITIVE, formula
from ..core.jit import quick_jit
from ..core.printing import printed
from ..core.types import as_float
from ..minimisation import Criterion, minimise
from ..minimisation.optimiser import Optimiser
from ..simulation import Accuracy, simulate
from .ascent import (
    AbstractThrustAcceleration,
    Ascent,
    FlightState,
    apex,
    release_state,
    velocity_gain,
)
from .laws import Law, SteeringProfile, corners, free_numbers
from .optimisers import lbfgs

Unknowns: TypeAlias = dict[str, PyTree[Float[Array, "..."]]]


@final
class SteeredFlight(AbstractSystem):
    """Powered flight over a flat earth under constant gravity. State: `FlightState`.

    - `thrust`: F/m, the thrust acceleration over time.
    - `steering`: angle of the thrust above the horizontal, rad, as a function of time.
    - `gravity`: g, m/s^2, (*runs,).
    """

    thrust: AbstractThrustAcceleration
    steering: Law
    gravity: Float[Array, "*#runs"] = eqx.field(converter=as_float)

    def vector_field(self, t: Scalar, y: FlightState) -> FlightState:
        a = self.thrust(t)
        phi = self.steering(t)
        return FlightState(x=y.u, y=y.w, u=a * jnp.cos(phi), w=a * jnp.sin(phi) - self.gravity)

    def invariants(self, t: Scalar, y: FlightState) -> dict[str, Array]:
        del t, y
        return {}  # The thrust does work, and changes the momentum.

    def breaks(self) -> Float[Array, "times *#runs"] | None:
        # Splines and tables declare their breaks themselves.
        return corners(self.steering) if isinstance(self.steering, SteeringProfile) else None


@final
@printed(release_angle="rad", apex_time="s", final_velocity="m/s", height_derivative="1/s")
class SteeringOptimum(eqx.Module):
    """The result of `optimise_steering`.

    - `release_angle`, rad: the optimal direction of the release velocity.
    - `steering`: the optimal thrust angles.
    - `burnout`: the state at burnout.
    - `apex_time`, s: the time of the apex.
    - `final_velocity`, m/s: U, at the apex.
    - `height_derivative`, 1/s: dU/dY, from the multiplier of the constraint.
    - `violation`: |y(T) - Y| over (v_0 + V)^2/(2g), the height of the best vertical impulse, or of
      w_b < 0 over v_0 + V.
    - `gradient`: the largest derivative of U/(v_0 + V) by an angle that the constraint leaves free.
    - `converged`: whether both met the tolerance."""

    release_angle: Float[Array, ""]
    steering: SteeringProfile
    burnout: FlightState
    apex_time: Float[Array, ""]
    final_velocity: Float[Array, ""]
    height_derivative: Float[Array, ""]
    violation: Float[Array, ""]
    gradient: Float[Array, ""]
    converged: Bool[Array, ""]


@formula(tolerance=POSITIVE)
def optimise_steering(
    ascent: Ascent,
    start: SteeringProfile,
    release_angle: Scalar,
    *,
    accuracy: Accuracy | Scalar = 1e-10,
    tolerance: Scalar = 1e-8,
    optimiser: Optimiser | None = None,
) -> SteeringOptimum:
    """The steering and the release angle with the greatest velocity at the apex, for one run.

    **Arguments**

    - `ascent`: the data of the ascent, without runs.
    - `start`: the nodes, and the angles at which the search begins.
    - `release_angle`: at which the search begins, rad.
    - `accuracy`: of the flight, as in `simulate`.
    - `tolerance`: for the scaled `violation` and `gradient` of the result.
    - `optimiser`: as in `minimise`; by default `optax.lbfgs()`.

    **Returns** a `SteeringOptimum`, which is not differentiable.

    **Raises** `InputError` where `ascent` or `start` has runs.
    """
    batched = any(jnp.ndim(leaf) > 0 for leaf in jax.tree.leaves(ascent))
    if batched or jnp.ndim(start(ascent.burn_time)) > 0:
        raise InputError(
            "optimise_steering does not accept a batch: pass scalars and a single list of nodes."
        )
    return _search(
        ascent,
        start,
        as_float(release_angle),
        as_float(accuracy),
        as_float(tolerance),
        lbfgs() if optimiser is None else optimiser,
    )


@quick_jit
def _search(
    ascent: Ascent,
    start: Law,
    release_angle: Scalar,
    accuracy: Accuracy | Scalar,
    tolerance: Scalar,
    optimiser: Optimiser,
) -> SteeringOptimum:
    # Units of the problem, so that objective and constraints are of order one.
    speed = ascent.release_speed + velocity_gain(ascent)
    height = 0.5 * speed * speed / ascent.gravity

    profile, made = free_numbers(start)

    def burnout(x: Unknowns) -> FlightState:
        flight = SteeredFlight(ascent.thrust, made(x["profile"]), ascent.gravity)
        ts = jnp.stack([0.0 * ascent.burn_time, ascent.burn_time])
        # A flight that fails raises no error: its objective turns the line search back.
        return simulate(
            flight, release_state(ascent, x["release"]), ts, accuracy=accuracy, throw=False
        ).final

    def problem(x: Unknowns) -> Criterion:
        end = burnout(x)
        miss = (apex(ascent, end)[1] - ascent.apex_height) / height
        return Criterion(
            objective=-end.u / speed, equal_zero=miss, non_negative=end.w / speed, report=end
        )

    # The corners of the steering are breaks: its gradient needs no check.
    minimum = minimise(
        problem,
        {"release": release_angle, "profile": profile},
        optimiser=optimiser,
        tolerance=tolerance,
        check_gradient=False,
    )
    end = minimum.criterion.report
    return SteeringOptimum(
        release_angle=minimum.x["release"],
        steering=made(minimum.x["profile"]),
        burnout=end,
        apex_time=apex(ascent, end)[0],
        final_velocity=end.u,
        height_derivative=minimum.multipliers.equal_zero * speed / height,
        violation=minimum.violation,
        gradient=minimum.gradient,
        converged=minimum.converged,
    )
