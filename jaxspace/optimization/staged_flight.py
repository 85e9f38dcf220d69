"""A rocket of several stages without air: the data of the stages, and the mission from the vertical
rise through the kick to the last burnout, in the symbols of `flown_staging.py`."""

__all__ = ["StageDesign"]

from collections.abc import Callable
from typing import NamedTuple, TypeAlias, final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import AbstractParameters, AbstractSystem, Scalar, quantity
from ..rockets import GravityTurn, GravityTurnState
from ..simulation import Mission, Phase, simulate_compact

# The turn has no direction at rest: the flight starts with this speed, m/s.
FIRST_SPEED = 0.1

Flying: TypeAlias = tuple[GravityTurnState, Scalar]
Jump: TypeAlias = Callable[[Scalar, Flying], Flying]


@final
class StageDesign(AbstractParameters):
    """The data of the stages of a rocket, the first one first; each (stages,)."""

    exhaust_velocity: Float[Array, " stages"] = quantity("m/s", positive=True, doc="u")
    structural_factor: Float[Array, " stages"] = quantity(
        "", low=0.0, high=1.0, doc="b, structure over the stage without its fixed mass"
    )
    thrust: Float[Array, " stages"] = quantity("N", positive=True, doc="F, while it burns")
    fixed_mass: Float[Array, " stages"] = quantity(
        "kg", non_negative=True, doc="dropped with the stage in addition to its structure"
    )


@final
class Burn(AbstractSystem):
    """The burn of a stage. State: `GravityTurnState` and the mass, kg, as a pair; with `straight`
    the angle of the path is constant."""

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


class Goal(NamedTuple):
    """The requirements of the flight: the arguments of `staging_with_losses` by their names."""

    design: StageDesign
    payload: Scalar
    speed: Scalar
    gravity: Scalar
    rise: Scalar
    height: Scalar | None
    radius: Scalar | None
    vertical: bool
    steps: int


class StagedRun(NamedTuple):
    """The result of a flight: the state at the last burnout, the initial mass, kg, burn times, s,
    and the ideal velocity, m/s."""

    end: GravityTurnState
    initial_mass: Scalar
    burn_times: Float[Array, " stages"]
    ideal_velocity: Scalar


def run_stages(goal: Goal, masses: Float[Array, " stages"], kick: Scalar) -> StagedRun:
    """The flight of stages with these `masses`, kg, their fixed masses not included, and with a
    `kick`, rad."""
    design = goal.design
    g = goal.gravity
    vertical = goal.vertical
    u, F, b = design.exhaust_velocity, design.thrust, design.structural_factor
    whole = masses + design.fixed_mass
    # The mass at each ignition: the stage and all above it.
    carried = jnp.cumsum(whole[::-1])[::-1] + goal.payload
    burnt = (1.0 - b) * masses
    times = burnt * u / F
    # By the burnt fraction, which is accurate where a stage vanishes.
    ideal = -jnp.sum(u * jnp.log1p(-burnt / carried))

    def burn(i: int, duration: Scalar, straight: bool, jump: Jump, name: str) -> Phase:
        return Phase(Burn(F[i], u[i], g, goal.radius, straight), duration, jump, name)

    def tilted(t: Scalar, y: Flying) -> Flying:
        del t
        return eqx.tree_at(lambda s: s.angle, y[0], y[0].angle + kick), y[1]

    def dropping(i: int) -> Jump:
        # Without the propellant, which left during the burn.
        return lambda t, y: (y[0], y[1] - (whole - burnt)[i])

    phases = []
    for i in range(masses.shape[0]):
        duration = times[i]
        if i == 0 and not vertical:
            phases.append(burn(0, goal.rise, True, tilted, "rise"))
            duration = duration - goal.rise
        phases.append(burn(i, duration, vertical, dropping(i), f"stage {i + 1}"))
    zero = jnp.zeros_like(goal.payload)
    start = GravityTurnState(FIRST_SPEED + zero, zero, zero, zero)
    end = simulate_compact(Mission(phases), (start, carried[0]), steps=goal.steps).final[0]
    return StagedRun(end, carried[0], times, ideal)
