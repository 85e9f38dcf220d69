"""The tasks of a landing and of a rendezvous: a point under thrust comes to rest at the origin.

landing      v' = g + T/m,  m' = -|T|/u_e                 flat ground, uniform gravity
rendezvous   Clohessy and Wiltshire's equations + a       relative to a body on a circle
"""

__all__ = ["PushedRelativeMotion"]

from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from ..bodies import BodyState, RigidBody
from ..core import AbstractSystem, Scalar, quantity
from ..core.shapes import with_rank
from ..core.types import SingleNumberField, as_float
from ..core.vectors import dot, norm
from ..orbits import ClohessyWiltshire, UniformGravity
from ..scene import Scene
from ._actuators import CommandedEngine
from ._step import ONE_STEP, FixedSteps, step
from .environment import AbstractEnvironment, Box


@final
class PushedRelativeMotion(AbstractSystem):
    """Motion relative to a body on a circle under a commanded acceleration, in the rotating axes.

    `motion`: that without it."""

    motion: ClohessyWiltshire = eqx.field(
        metadata={"doc": "of the free chaser relative to its target"}
    )
    command: Float[Array, "3 *#runs"] = quantity(
        "m/s^2", default=(0.0, 0.0, 0.0), doc="acceleration before the first command"
    )

    def vector_field(self, t: Scalar, y: BodyState) -> BodyState:
        free = self.motion.vector_field(t, y)
        push = with_rank(self.command, y.velocity.ndim - 1)
        return BodyState(position=free.position, velocity=free.velocity + push)

    def invariants(self, t: Scalar, y: BodyState) -> dict[str, Array]:
        del t, y
        return {}


def _lander() -> Scene:
    """A lander of 2 t on the Moon, a third of it propellant, with twice its weight of thrust."""
    engine = CommandedEngine(*map(as_float, (6500.0, 3050.0, 1300.0)))
    return Scene([UniformGravity(as_float([0.0, 0.0, -1.62])), engine], RigidBody())


@final
class LandingTask(AbstractEnvironment):
    """Land a body of variable mass softly at the origin of a plane.

    Observations: position over `distance`, velocity over `speed`, and the share of propellant left.
    Actions: thrust over its limit, in inertial axes. An episode ends on the ground, with a cost of
    the squares of the speed over `speed` and of the miss over `distance`; `soft` then reports
    whether the touchdown is below 2 m/s."""

    scene: Scene = eqx.field(
        default_factory=_lander, metadata={"doc": "the lander, with its gravity and thrust"}
    )
    mass: SingleNumberField = quantity("kg", positive=True, default=2000.0, doc="initial mass")
    distance: SingleNumberField = quantity(
        "m", positive=True, default=1000.0, doc="initial distance, also the scale of positions"
    )
    speed: SingleNumberField = quantity(
        "m/s", positive=True, default=50.0, doc="scale of velocities"
    )
    period: SingleNumberField = quantity("s", positive=True, default=0.5, doc="duration of a step")
    horizon: SingleNumberField = quantity(
        "s", positive=True, default=120.0, doc="maximum duration of an episode"
    )
    effort: SingleNumberField = quantity(
        "", non_negative=True, default=0.05, doc="weight of the propellant in the reward"
    )
    method: FixedSteps = eqx.field(
        static=True, default=ONE_STEP, metadata={"doc": "integration of one period"}
    )

    @property
    def _engine(self) -> CommandedEngine:
        return [e for e in self.scene.effects if isinstance(e, CommandedEngine)][0]

    @property
    def action_space(self) -> Box:
        return Box(-1.0, 1.0, (3,))

    @property
    def observation_space(self) -> Box:
        return Box(-jnp.inf, jnp.inf, (7,))

    def start(self, key: PRNGKeyArray, runs: tuple[int, ...]) -> BodyState:
        draws = jax.random.uniform(key, (6, *runs), minval=-1.0, maxval=1.0)
        rank = len(runs)
        place = with_rank(jnp.array([0.0, 0.0, 1.0]), rank) + 0.3 * draws[:3]
        falling = with_rank(jnp.array([0.0, 0.0, -0.6]), rank) + 0.3 * draws[3:]
        mass = jnp.full(runs, self.mass)
        return BodyState(self.distance * place, self.speed * falling, mass=mass)

    def advance(self, y: BodyState, action: Array, time: Scalar) -> tuple[BodyState, Scalar]:
        del time
        thrust = self._engine.max_thrust * action
        return step(self.scene, y, thrust, self.period, method=self.method), self.period

    def observe(self, y: BodyState, time: Scalar) -> Array:
        del time
        dry = self._engine.burnout_mass
        left = (y.mass - dry) / (self.mass - dry)
        return jnp.concatenate([y.position / self.distance, y.velocity / self.speed, left[None]])

    def judge(
        self, before: BodyState, action: Array, after: BodyState
    ) -> tuple[Scalar, Bool[Array, "*runs"], dict[str, Array]]:
        del action
        down = after.position[2] <= 0.0
        # Interpolated to the ground, because at the end of the step the body may be metres below
        # it.
        fall = before.position[2] - after.position[2]
        share = jnp.where(down, before.position[2] / jnp.where(down, fall, 1.0), 1.0)
        velocity = before.velocity + share * (after.velocity - before.velocity)
        place = before.position + share * (after.position - before.position)
        miss = dot(place, place) / self.distance**2 + dot(velocity, velocity) / self.speed**2
        burnt = (before.mass - after.mass) / self.mass
        # Place and speed count at touchdown alone: on the way down any path is as good, but for its
        # propellant.
        reward = -self.effort * burnt - jnp.where(down, miss, 0.0)
        return reward, down, {"soft": down & (norm(velocity) < 2.0)}


@final
class RendezvousTask(AbstractEnvironment):
    """Come to rest at a body on a circle, by accelerations in its rotating axes.

    Observations: position over `distance`, velocity over `speed`. Actions: acceleration over
    `thrust`. An episode ends within a hundredth of both, which `met` reports, and beyond four times
    the distance."""

    motion: ClohessyWiltshire = eqx.field(
        default_factory=lambda: ClohessyWiltshire(as_float(1.1e-3)),
        metadata={"doc": "the relative motion"},
    )
    thrust: SingleNumberField = quantity(
        "m/s^2", positive=True, default=0.01, doc="greatest acceleration along an axis"
    )
    distance: SingleNumberField = quantity(
        "m", positive=True, default=1000.0, doc="initial distance, also the scale of positions"
    )
    speed: SingleNumberField = quantity(
        "m/s", positive=True, default=1.0, doc="scale of velocities"
    )
    period: SingleNumberField = quantity("s", positive=True, default=10.0, doc="duration of a step")
    horizon: SingleNumberField = quantity(
        "s", positive=True, default=6000.0, doc="maximum duration of an episode"
    )
    effort: SingleNumberField = quantity(
        "", non_negative=True, default=0.05, doc="weight of the actions in the reward"
    )
    method: FixedSteps = eqx.field(
        static=True, default=ONE_STEP, metadata={"doc": "integration of one period"}
    )

    @property
    def action_space(self) -> Box:
        return Box(-1.0, 1.0, (3,))

    @property
    def observation_space(self) -> Box:
        return Box(-jnp.inf, jnp.inf, (6,))

    def start(self, key: PRNGKeyArray, runs: tuple[int, ...]) -> BodyState:
        draws = jax.random.uniform(key, (6, *runs), minval=-1.0, maxval=1.0)
        return BodyState(self.distance * draws[:3], self.speed * draws[3:])

    def advance(self, y: BodyState, action: Array, time: Scalar) -> tuple[BodyState, Scalar]:
        del time
        system = PushedRelativeMotion(self.motion)
        push = self.thrust * action
        return step(system, y, push, self.period, method=self.method), self.period

    def observe(self, y: BodyState, time: Scalar) -> Array:
        del time
        return jnp.concatenate([y.position / self.distance, y.velocity / self.speed])

    def judge(
        self, before: BodyState, action: Array, after: BodyState
    ) -> tuple[Scalar, Bool[Array, "*runs"], dict[str, Array]]:
        del before
        x = dot(after.position, after.position) / self.distance**2
        v = dot(after.velocity, after.velocity) / self.speed**2
        # Squares: a hundredth of both scales here, and four times the distance below.
        met = (x < 1e-4) & (v < 1e-4)
        # As a share of the episode, so that its sum does not depend on the length of a step.
        share = self.period / self.horizon
        reward = -share * (x + v + self.effort * jnp.sum(action * action, axis=0))
        return reward + jnp.where(met, 1.0, 0.0), met | (x > 16.0), {"met": met}
