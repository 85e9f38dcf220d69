"""Staging with the losses of gravity, by flying it: propellants and kick of a rocket whose engines
have a given thrust, for the least initial mass.

    ln(m_1/P) least at   v = v_m,  psi = pi/2 (and y = Y)        at the last burnout
    S_i: stage without its fixed mass, b_i S_i of it structure   t_i = (1 - b_i) S_i u_i/F_i

A rocket rises vertically for a while, is tilted by the angle of the kick, and flies a gravity turn
through the burns of its stages. A thrust that lasts longer loses more: the stages become smaller
below and the path flatter than in `optimal_staging`, whose velocity has no losses.

    symbol   meaning                                                      unit
    S_i      mass of stage i without its fixed mass, at least zero        kg
    F_i      thrust of stage i                                            N
    t_i      its burn time                                                s
    v, psi   speed, angle of the path from the vertical                   m/s, rad
    y        height                                                       m
    and the symbols of `_staging.py` and `_gravity_turn.py`

Source: Thomson 8.2 with the flight of 8.5. Valid without air, over flat ground or a round earth
that does not turn. For a vertical flight the constraint on psi and the kick fall away.
"""

from collections.abc import Callable
from typing import TypeAlias, final

import equinox as eqx
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float

from ..core import (
    AbstractParameters,
    AbstractSystem,
    InputError,
    Scalar,
    as_float,
    check_positive,
    increasing_root,
    quantity,
)
from ..rockets import GravityTurn, GravityTurnState
from ..simulation import Mission, Phase, fly_compact
from ._criterion import Criterion, Minimum
from ._minimise import minimise
from ._staging import optimal_staging

# The turn has no direction at rest: the flight starts with this speed, m/s.
FIRST_SPEED = 0.1
# Thrust over weight at the lift-off, at least.
LEAST_LIFT = 1.05

Flying: TypeAlias = tuple[GravityTurnState, Scalar]
Jump: TypeAlias = Callable[[Scalar, Flying], Flying]


@final
class StageDesign(AbstractParameters):
    """What is given of the stages of a rocket, the first one first; each (stages,)."""

    exhaust_velocity: Float[Array, " stages"] = quantity("m/s", positive=True, doc="u")
    structural_factor: Float[Array, " stages"] = quantity(
        "", low=0.0, high=1.0, doc="b, structure over the stage without its fixed mass"
    )
    thrust: Float[Array, " stages"] = quantity("N", positive=True, doc="F, while it burns")
    fixed_mass: Float[Array, " stages"] = quantity(
        "kg", non_negative=True, doc="dropped with the stage beside its structure"
    )


@final
class Burn(AbstractSystem):
    """A stage in flight. State: `GravityTurnState` and the mass, kg, as a pair; with `straight` the
    angle of the path stays as it is."""

    thrust: Scalar
    exhaust_velocity: Scalar
    gravity: Scalar
    radius: Scalar | None
    straight: bool = eqx.field(static=True, default=False)

    def vector_field(self, t: Scalar, y: Flying) -> Flying:
        state, mass = y
        turn = GravityTurn(self.thrust / (mass * self.gravity), self.gravity, radius=self.radius)
        rate = turn.vector_field(0.0 * t, state)
        if self.straight:
            rate = eqx.tree_at(lambda r: r.angle, rate, 0.0 * rate.angle)
        return rate, -self.thrust / self.exhaust_velocity + 0.0 * mass

    def invariants(self, t: Scalar, y: Flying) -> dict[str, Array]:
        del t, y
        return {}  # The thrust does work.


@final
class FlownStaging(eqx.Module):
    """The result of `staging_with_losses`.

    - `stage_mass` S_i and `propellant`, kg, (stages,); `used`: whether a stage is more than zero.
    - `kick`: angle of the tilt, rad; zero of a vertical flight.
    - `initial_mass`: kg; `burnout`: the state at the end; `burn_times`: s, (stages,).
    - `ideal_velocity`: sum of u ln mu, m/s; `losses`: what it exceeds the speed at burnout by.
    - `velocity_price`, s/m, and `height_price`, 1/m: d ln m_1/dv_m and d ln m_1/dY, from the
      multipliers; the latter zero where no height is asked for.
    - `converged`; `minimum`: of the search, whose `sentence()` says why it ended."""

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
    converged: Bool[Array, ""]
    minimum: Minimum


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
) -> FlownStaging:
    """The stages with the least initial mass that bring a payload to a speed at burnout, with the
    losses of gravity, by gradients through the simulated flight; for one run.

    **Arguments**

    - `design`: of the stages, whose thrusts are given.
    - `payload`: kg; `speed`: at the last burnout, m/s; `height`: there, m, free by default.
    - `vertical`: whether the flight is straight up; else it is horizontal at the last burnout.
    - `gravity`: at the ground, m/s^2; `radius`: of the planet, m, `None` for flat ground.
    - `rise_time`: before the kick, s; the first stage burns for longer.
    - `steps`: of the integration of each burn; `tolerance`: of the search.

    **Returns** a `FlownStaging`, which is not differentiable. A velocity that the stages cannot
    reach ends with the best that they can: `minimum.sentence()`.

    **Raises** `InputError` for values out of range, and for a height where nothing is free to meet
    it: a vertical flight of one stage."""
    payload, speed, g, rise = (as_float(x) for x in (payload, speed, gravity, rise_time))
    given = {"payload": payload, "speed": speed, "gravity": g, "rise_time": rise}
    for name, x in given.items():
        check_positive(name, x)
        if x.ndim > 0:
            raise InputError(f"{name} has the shape {x.shape}: the search takes one run.")
    stages = design.exhaust_velocity.shape[0]
    if height is not None and vertical and stages == 1:
        raise InputError("height is given for a vertical flight of one stage: nothing is free.")
    goal, round_earth = (None if x is None else as_float(x) for x in (height, radius))
    return _search(
        design, payload, speed, g, rise, goal, round_earth, vertical, steps, as_float(tolerance)
    )


def _flight(
    design: StageDesign,
    masses: Float[Array, " stages"],
    kick: Scalar,
    payload: Scalar,
    g: Scalar,
    rise: Scalar,
    radius: Scalar | None,
    vertical: bool,
    steps: int,
) -> tuple[GravityTurnState, Scalar, Float[Array, " stages"], Scalar]:
    """State at the last burnout, initial mass, burn times and ideal velocity."""
    u, F, b = design.exhaust_velocity, design.thrust, design.structural_factor
    whole = masses + design.fixed_mass
    # What each stage moves at its ignition: itself and all above it.
    carried = jnp.cumsum(whole[::-1])[::-1] + payload
    burnt = (1.0 - b) * masses
    times = burnt * u / F
    ideal = -jnp.sum(u * jnp.log1p(-burnt / carried))

    def burn(i: int, duration: Scalar, straight: bool, jump: Jump, name: str) -> Phase:
        return Phase(Burn(F[i], u[i], g, radius, straight), duration, jump, name)

    def tilted(t: Scalar, y: Flying) -> Flying:
        del t
        return eqx.tree_at(lambda s: s.angle, y[0], y[0].angle + kick), y[1]

    def dropping(i: int) -> Jump:
        return lambda t, y: (y[0], y[1] - (whole - burnt)[i])

    phases = []
    for i in range(masses.shape[0]):
        duration = times[i]
        if i == 0 and not vertical:
            phases.append(burn(0, rise, True, tilted, "rise"))
            duration = duration - rise
        phases.append(burn(i, duration, vertical, dropping(i), f"stage {i + 1}"))
    zero = jnp.zeros_like(payload)
    start = GravityTurnState(FIRST_SPEED + zero, zero, zero, zero)
    end = fly_compact(Mission(phases), (start, carried[0]), steps=steps).final[0]
    return end, carried[0], times, ideal


@eqx.filter_jit
def _search(
    design: StageDesign,
    payload: Scalar,
    speed: Scalar,
    g: Scalar,
    rise: Scalar,
    height: Scalar | None,
    radius: Scalar | None,
    vertical: bool,
    steps: int,
    tolerance: Scalar,
) -> FlownStaging:
    u, b = design.exhaust_velocity, design.structural_factor
    # The search begins with stages for the speed and the usual losses, within what they can give.
    wanted = jnp.minimum(1.05 * speed, -0.9 * jnp.sum(u * jnp.log(b)))
    first = optimal_staging(u, b, wanted)
    ratio = jnp.maximum(first.mass_ratio, 1.05)
    size, above = [], payload
    for i in reversed(range(u.shape[0])):
        above = above + design.fixed_mass[i]
        size.append(above * (ratio[i] - 1.0) / (1.0 - b[i] * ratio[i]))
        above = above + size[-1]
    sizes = jnp.stack(size[::-1])
    tall = 1e5 if height is None else height

    def problem(x: dict[str, Array]) -> Criterion:
        masses = sizes * x["masses"]
        # In ln tan(psi/2), which gravity raises by nearly the same for every kick.
        kick = 0.0 if vertical else 2.0 * jnp.arctan(jnp.exp(x["kick"]))
        end, mass, times, ideal = _flight(
            design, masses, kick, payload, g, rise, radius, vertical, steps
        )
        wanted = [end.speed / speed - 1.0]
        wanted += [] if vertical else [jnp.log(jnp.tan(0.5 * end.angle))]
        wanted += [] if height is None else [(end.height - height) / tall]
        # The rocket lifts off, and the first stage outlasts the rise.
        lifting = 1.0 - LEAST_LIFT * mass * g / design.thrust[0]
        lasting = [lifting] if vertical else [lifting, times[0] / rise - 1.0]
        report = (masses, end, mass, times, ideal)
        return Criterion(jnp.log(mass / payload), jnp.stack(wanted), jnp.stack(lasting), report)

    def tilt(k: Scalar) -> Scalar:
        kick = 2.0 * jnp.arctan(jnp.exp(k))
        given = (design, sizes, kick, payload, g, rise, radius, vertical, steps)
        return jnp.log(jnp.tan(0.5 * _flight(*given)[0].angle))

    # Start, lowest and highest, size of each unknown.
    unknown = {"masses": tuple(jnp.full_like(u, x) for x in (1.0, 0.0, jnp.inf, 1.0))}
    if not vertical:
        # The kick with which the first masses end horizontally; a flight that falls had too much.
        low, high = (jnp.asarray(x, u.dtype) for x in (-15.0, -0.5))
        unknown["kick"] = (increasing_root(tilt, low, high), low, high, jnp.asarray(0.5, u.dtype))
    start, low, high, scale = ({k: x[i] for k, x in unknown.items()} for i in range(4))
    options = {"method": "sqp", "tolerance": tolerance, "check_gradient": False}
    options["exact_hessian"] = True
    found = minimise(problem, start, bounds=(low, high), scale=scale, **options)
    masses, end, mass, times, ideal = found.criterion.report
    dual = found.multipliers.equal_zero
    assert dual is not None
    none = jnp.zeros_like(speed)
    return FlownStaging(
        stage_mass=masses,
        propellant=(1.0 - b) * masses,
        used=masses > 1e-6 * mass,
        kick=none if vertical else 2.0 * jnp.arctan(jnp.exp(found.x["kick"])),
        initial_mass=mass,
        burnout=end,
        burn_times=times,
        ideal_velocity=ideal,
        losses=ideal - (end.speed - FIRST_SPEED),
        velocity_price=-dual[0] / speed,
        height_price=none if height is None else -dual[-1] / tall,
        converged=found.converged,
        minimum=found,
    )
