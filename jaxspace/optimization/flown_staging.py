"""Staging with the losses of gravity, by simulated flights: propellants and kick angle of a rocket
with engines of given thrust, for the least initial mass.

    ln(m_1/P) least at   v = v_m,  psi = pi/2 (and y = Y)        at the last burnout
    S_i: stage without its fixed mass, b_i S_i of it structure   t_i = (1 - b_i) S_i u_i/F_i

A rocket rises vertically for a while, is tilted by the angle of the kick, and flies a gravity turn
through the burns of its stages. Longer burns have larger losses: the lower stages become smaller
than in `optimal_staging`, which has no losses, and the path flatter.

    symbol   meaning                                                      unit
    S_i      mass of stage i without its fixed mass, at least zero        kg
    F_i      thrust of stage i                                            N
    t_i      its burn time                                                s
    v, psi   speed, angle of the path from the vertical                   m/s, rad
    y        height                                                       m
    and the symbols of `staging.py` and `rockets/gravity_turn.py`

Source: Thomson 8.2 with the flight of 8.5. Valid without air, over flat ground or a round earth
that does not turn. A vertical flight has neither the constraint on psi nor the kick.
"""

__all__ = ["FlownStaging", "staging_with_losses"]

import dataclasses
from collections.abc import Callable
from typing import TypeAlias, final

import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float

from ..core import InputError, Scalar
from ..core.checks import check_positive
from ..core.formula import formula
from ..core.jit import quick_jit
from ..core.printing import printed
from ..core.roots import increasing_root
from ..core.structure import HashedModule
from ..core.tracing import is_traced
from ..core.types import as_float
from ..minimisation import Criterion, Minimum, minimise
from ..minimisation.optimiser import SQP, Optimiser
from ..rockets import GravityTurnState
from .staged_flight import FIRST_SPEED, Goal, StageDesign, run_stages
from .staging import optimal_staging

# Thrust over weight at lift-off: the least, and that at which the search for the greatest speed
# begins.
LEAST_LIFT, WELL_LIFTED = 1.05, 1.6

Unknowns: TypeAlias = dict[str, Array]


@final
@printed(
    stage_mass="kg",
    propellant="kg",
    kick="rad",
    initial_mass="kg",
    burn_times="s",
    ideal_velocity="m/s",
    losses="m/s",
    velocity_price="s/m",
    height_price="1/m",
    greatest_speed="m/s",
)
class FlownStaging(HashedModule):
    """The result of `staging_with_losses`.

    - `stage_mass`, kg: S_i, (stages,).
    - `propellant`, kg: of each stage, (stages,).
    - `used`: whether the mass of a stage is above zero, (stages,).
    - `kick`, rad: angle of the tilt; zero for a vertical flight.
    - `initial_mass`, kg: m_1, of the rocket.
    - `burnout`: the state at the burnout of the last stage.
    - `burn_times`, s: of each stage, (stages,).
    - `ideal_velocity`, m/s: the sum of u ln mu.
    - `losses`, m/s: the ideal velocity minus the speed at burnout.
    - `velocity_price`, s/m: d ln m_1/dv_m, from the multiplier.
    - `height_price`, 1/m: d ln m_1/dY, from the multiplier; zero where no height is prescribed.
    - `greatest_speed`, m/s: where the speed is out of reach, the most that these stages reach at
      the burnout; the other fields are then of that flight, and the price is infinite. NaN
      elsewhere, and under `jit`.
    - `converged`: whether the search converged.
    - `minimum`: the result of the search."""

    stage_mass: Float[Array, " stages"]
    propellant: Float[Array, " stages"]
    used: Bool[Array, " stages"]
    kick: Float[Array, ""]
    initial_mass: Float[Array, ""]
    burnout: GravityTurnState
    burn_times: Float[Array, " stages"]
    ideal_velocity: Float[Array, ""]
    losses: Float[Array, ""]
    velocity_price: Float[Array, ""]
    height_price: Float[Array, ""]
    greatest_speed: Float[Array, ""]
    converged: Bool[Array, ""]
    # Last, because its many numbers are truncated in printed results.
    minimum: Minimum

    def sentence(self) -> str:
        """Why the search ended, and the greatest speed of these stages where the speed is out of
        reach."""
        if bool(jnp.isnan(self.greatest_speed)):
            return self.minimum.sentence()
        return (
            f"The speed is unreachable: these stages reach at most {self.greatest_speed:.5g} m/s "
            f"at the required burnout, with an initial mass of {self.initial_mass:.5g} kg. "
            "Increase a thrust, or reduce the required speed."
        )


@formula
def staging_with_losses(
    design: StageDesign,
    payload: ArrayLike,
    speed: ArrayLike,
    height: ArrayLike | None = None,
    *,
    vertical: bool = False,
    gravity: ArrayLike = 9.80665,
    radius: ArrayLike | None = 6378137.0,
    rise_time: ArrayLike = 10.0,
    steps: int = 12,
    tolerance: Scalar = 1e-6,
    optimiser: Optimiser = SQP,
) -> FlownStaging:
    """The stages with the least initial mass that bring a payload to a speed at burnout, with the
    losses of gravity, by gradients through the simulated flight; for one run.

    **Arguments**

    - `design`: the stages, with their thrusts.
    - `payload`: kg; `speed`: at the last burnout, m/s; `height`: there, m, free by default.
    - `vertical`: whether the flight is straight up; else it is horizontal at the last burnout.
    - `gravity`: at the ground, m/s^2; `radius`: of the planet, m, `None` for flat ground.
    - `rise_time`: before the kick, s; the first stage burns for longer.
    - `steps`: of the integration of each burn; `tolerance`: of the search.
    - `optimiser`: as in `minimise`.

    **Returns** a `FlownStaging`, which is not differentiable. If the stages cannot reach the speed,
    for example because the thrust of an upper stage is far below its weight, it is the flight of
    the greatest speed, and `sentence()` reports this.

    **Raises** `InputError` for values out of range, and for a height where nothing is free to meet
    it: a vertical flight of one stage."""
    payload, speed, g, rise = (as_float(x) for x in (payload, speed, gravity, rise_time))
    given = {"payload": payload, "speed": speed, "gravity": g, "rise_time": rise}
    for name, x in given.items():
        check_positive(name, x)
        if x.ndim > 0:
            raise InputError(f"{name} has the shape {x.shape}: the search does not accept a batch.")
    stages = design.exhaust_velocity.shape[0]
    if height is not None and vertical and stages == 1:
        raise InputError(
            "height is given for a vertical flight of one stage, which leaves no design variable."
        )
    top, round_earth = (None if x is None else as_float(x) for x in (height, radius))
    goal = Goal(design, payload, speed, g, rise, top, round_earth, vertical, steps)
    limit = as_float(tolerance)
    minimum = _search(goal, limit, optimiser)
    # A traced search cannot decide whether another one must follow it.
    if is_traced(minimum.converged) or bool(minimum.minimum.violation <= limit):
        return minimum
    fastest = _search(goal, limit, optimiser, fastest=True)
    if not bool(fastest.converged):
        return minimum
    if bool(fastest.burnout.speed >= speed):
        # The speed is within reach, but far from the first guess: the fastest flight is a nearer
        # start.
        return _search(goal, limit, optimiser, (fastest.stage_mass, fastest.minimum.x))
    return dataclasses.replace(
        fastest,
        converged=minimum.converged,
        minimum=minimum.minimum,
        velocity_price=jnp.inf + 0.0 * speed,
        greatest_speed=fastest.burnout.speed,
    )


@quick_jit
def _search(
    goal: Goal,
    tolerance: Scalar,
    optimiser: Optimiser,
    begin: tuple[Array, Unknowns] | None = None,
    *,
    fastest: bool = False,
) -> FlownStaging:
    """The lightest rocket for the speed, or the `fastest`, whatever its mass; from the masses and
    the unknowns of another search, if given."""
    sizes = _first_masses(goal, fastest)
    if begin is not None:
        # A stage that vanished there may grow again.
        sizes = jnp.maximum(begin[0], 0.01 * sizes)
    b = goal.design.structural_factor
    none = jnp.zeros_like(goal.speed)
    start, low, high, scale = _unknowns(goal, sizes)
    if begin is not None and not goal.vertical:
        start["kick"] = begin[1]["kick"]
    minimum = minimise(
        _problem(goal, sizes, fastest),
        start,
        optimiser=optimiser,
        bounds=(low, high),
        scale=scale,
        tolerance=tolerance,
        # The phases end where steps do: a gradient cannot miss kinks.
        check_gradient=False,
        # A flight in so few steps is cheap to differentiate twice.
        exact_hessian=optimiser == SQP,
        max_steps=200 if optimiser == SQP else 1000,
    )
    masses, flight = minimum.criterion.report
    prices = minimum.multipliers.equal_zero
    speed_price = height_price = none
    if prices is not None and not fastest:
        speed_price = -prices[0] / goal.speed
        height_price = none if goal.height is None else -prices[-1] / goal.height
    return FlownStaging(
        stage_mass=masses,
        propellant=(1.0 - b) * masses,
        used=masses > 1e-6 * flight.initial_mass,
        kick=_kick(goal, minimum.x),
        initial_mass=flight.initial_mass,
        burnout=flight.end,
        burn_times=flight.burn_times,
        ideal_velocity=flight.ideal_velocity,
        losses=flight.ideal_velocity - (flight.end.speed - FIRST_SPEED),
        velocity_price=speed_price,
        height_price=height_price,
        converged=minimum.converged,
        minimum=minimum,
        greatest_speed=jnp.nan * goal.speed,
    )


def _first_masses(goal: Goal, fastest: bool) -> Float[Array, " stages"]:
    """Masses of the stages, kg, for the speed and the usual losses, within the limit of these
    stages. For the fastest rocket the first stage is as heavy as its thrust lifts well."""
    design = goal.design
    u, b = design.exhaust_velocity, design.structural_factor
    # Below the limit, at which masses grow without bound; farther below for the fastest rocket,
    # whose search begins at the mass that its thrust lifts.
    speed = jnp.minimum(1.05 * goal.speed, -(0.6 if fastest else 0.9) * jnp.sum(u * jnp.log(b)))
    ratio = jnp.maximum(optimal_staging(u, b, speed).mass_ratio, 1.05)
    size = []
    above = goal.payload
    for i in reversed(range(u.shape[0])):
        above = above + design.fixed_mass[i]
        size.append(above * (ratio[i] - 1.0) / (1.0 - b[i] * ratio[i]))
        above = above + size[-1]
    if fastest:
        heavy = design.thrust[0] / (WELL_LIFTED * goal.gravity)
        size[-1] = jnp.maximum(size[-1] + heavy - above, 0.1 * heavy)
    return jnp.stack(size[::-1])


def _kick(goal: Goal, x: Unknowns) -> Scalar:
    """The angle, rad, from its unknown: ln tan(psi/2), which gravity raises by nearly the same for
    every kick."""
    if goal.vertical:
        return jnp.zeros_like(goal.speed)
    return 2.0 * jnp.arctan(jnp.exp(x["kick"]))


def _unknowns(goal: Goal, sizes: Array) -> tuple[Unknowns, Unknowns, Unknowns, Unknowns]:
    """Start, lowest and highest, and size of each unknown; masses are in units of `sizes`."""
    unknown = {"masses": tuple(jnp.full_like(sizes, x) for x in (1.0, 0.0, jnp.inf, 1.0))}
    if not goal.vertical:

        def tilt(k: Scalar) -> Scalar:
            angle = run_stages(goal, sizes, _kick(goal, {"kick": k})).end.angle
            return jnp.log(jnp.tan(0.5 * angle))

        # The kick with which the first masses end horizontally; with a larger one the flight falls.
        low, high = (jnp.asarray(x, sizes.dtype) for x in (-15.0, -0.5))
        half = jnp.asarray(0.5, sizes.dtype)
        unknown["kick"] = (increasing_root(tilt, low, high), low, high, half)
    start, low, high, scale = ({k: x[i] for k, x in unknown.items()} for i in range(4))
    return start, low, high, scale


def _problem(goal: Goal, sizes: Array, fastest: bool) -> Callable[[Unknowns], Criterion]:
    """The objective and the constraints."""
    height, vertical = goal.height, goal.vertical
    tall = 1e5 if height is None else height

    def problem(x: Unknowns) -> Criterion:
        masses = sizes * x["masses"]
        flight = run_stages(goal, masses, _kick(goal, x))
        end, mass = flight.end, flight.initial_mass
        faster = end.speed / goal.speed - 1.0
        zero = [] if fastest else [faster]
        zero += [] if vertical else [jnp.log(jnp.tan(0.5 * end.angle))]
        zero += [] if height is None else [(end.height - height) / tall]
        # The rocket lifts off, and the first stage outlasts the rise.
        positive = [1.0 - LEAST_LIFT * mass * goal.gravity / goal.design.thrust[0]]
        positive += [] if vertical else [flight.burn_times[0] / goal.rise - 1.0]
        # A fall towards the centre of the planet would be faster than every ascent.
        positive += [end.height / tall] if fastest else []
        objective = -faster if fastest else jnp.log(mass / goal.payload)
        equal = jnp.stack(zero) if zero else None
        return Criterion(objective, equal, jnp.stack(positive), (masses, flight))

    return problem
