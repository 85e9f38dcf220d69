"""The task of a slew: reaction wheels turn a body from any attitude to a target, and stop it there.

reward = -(phi^2 + s omega^2 + w |u|^2) dt        phi: rotation angle to the target
"""

from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, PRNGKeyArray

from ..attitude import ReactionWheels
from ..bodies import BodyState, RigidBody
from ..core import Scalar, quantity
from ..core.types import SingleNumberField, as_float
from ..core.vectors import dot
from ..rotations import Quaternion
from ..scene import Scene
from ._actuators import CommandedMotor
from ._step import ONE_STEP, FixedSteps, step
from .attitude_laws import error_vector
from .environment import AbstractEnvironment, Box


def _satellite() -> Scene:
    """A small satellite, 100 kg, with three wheels along its axes."""
    wheels = ReactionWheels(
        jnp.eye(3),
        jnp.full(3, 0.002),
        jnp.zeros(3),
        torque_limit=as_float(0.02),
        speed_limit=as_float(600.0),
        motor=CommandedMotor(),
    )
    return Scene([wheels], RigidBody(inertia=[8.0, 10.0, 6.0]))


@final
class SlewTask(AbstractEnvironment):
    """Rotate a satellite with its wheels to the attitude (1, 0, 0, 0) and keep it there.

    Observations: twice the vector part of the error quaternion, the rates over `rate_scale`, the
    speeds of the wheels over their limit. Actions: torques over the limit of the motors. An episode
    ends early where the body spins up to `rate_limit`."""

    scene: Scene = eqx.field(
        default_factory=_satellite, metadata={"doc": "the satellite, with its wheels"}
    )
    period: SingleNumberField = quantity("s", positive=True, default=0.5, doc="duration of a step")
    horizon: SingleNumberField = quantity(
        "s", positive=True, default=300.0, doc="maximum duration of an episode"
    )
    rate_scale: SingleNumberField = quantity(
        "rad/s", positive=True, default=0.05, doc="scale of the rates in the observations"
    )
    rate_limit: SingleNumberField = quantity(
        "rad/s", positive=True, default=0.5, doc="rate of the body at which an episode ends"
    )
    effort: SingleNumberField = quantity(
        "", non_negative=True, default=0.01, doc="w, weight of the actions in the reward"
    )
    method: FixedSteps = eqx.field(
        static=True, default=ONE_STEP, metadata={"doc": "integration of one period"}
    )

    @property
    def _wheels(self) -> ReactionWheels:
        result = [e for e in self.scene.effects if isinstance(e, ReactionWheels)]
        return result[0]

    @property
    def action_space(self) -> Box:
        return Box(-1.0, 1.0, (self._wheels.inertia.shape[0],))

    @property
    def observation_space(self) -> Box:
        return Box(-jnp.inf, jnp.inf, (6 + self._wheels.inertia.shape[0],))

    def start(self, key: PRNGKeyArray, runs: tuple[int, ...]) -> BodyState:
        turn, spin = jax.random.split(key)
        # Four normal numbers are uniform over the directions of the sphere of quaternions.
        attitude = Quaternion(jax.random.normal(turn, (4, *runs))).normalised()
        omega = 0.2 * self.rate_scale * jax.random.normal(spin, (3, *runs))
        return self.scene.start(BodyState(attitude=attitude, omega=omega))

    def advance(self, y: BodyState, action: Array, time: Scalar) -> tuple[BodyState, Scalar]:
        del time
        limit = self._wheels.torque_limit
        assert limit is not None  # of the wheels of this task
        return step(self.scene, y, limit * action, self.period, method=self.method), self.period

    def observe(self, y: BodyState, time: Scalar) -> Array:
        del time
        limit = self._wheels.speed_limit
        assert limit is not None
        wheels = self._wheels.speeds(y) / limit
        error = error_vector(y.attitude, jnp.array([1.0, 0.0, 0.0, 0.0], y.omega.dtype))
        return jnp.concatenate([error, y.omega / self.rate_scale, wheels])

    def judge(
        self, before: BodyState, action: Array, after: BodyState
    ) -> tuple[Scalar, Bool[Array, "*runs"], dict[str, Array]]:
        del before
        rate = dot(after.omega, after.omega)
        # 4 (1 - q_0^2) = 4 sin^2(phi / 2) is phi^2 for small angles, and smooth for all.
        angle = 4.0 * (1.0 - after.attitude.normalised().wxyz[0] ** 2)
        cost = angle + rate / self.rate_scale**2 + self.effort * jnp.sum(action * action, axis=0)
        settled = (angle < 1e-4) & (rate < (0.02 * self.rate_scale) ** 2)
        return -self.period * cost, rate > self.rate_limit**2, {"settled": settled}
