"""A flexible missile in its autopilot's loop, with propellant that sloshes in one tank.

    d_A = k_p th_g + k_r th_g',      th_g = th + sum phi_i'(x_g) q_i
    s'' + 2 zeta w s' + w^2 s = -A,     f = m_s (w^2 s + 2 zeta w s')
    A = [F ((1 - C_2) d + y_h') + f] / m + x_s (th + C_2 d)'' + g d'' + sum phi_i(x_s) q_i''

    symbol        meaning                                                     unit
    th_g, x_g     pitch that a gyro measures; its place                       rad, m
    k_p, k_r      gains of the autopilot on pitch and its rate                1, s
    s, m_s, w     slosh across the missile, its mass, its frequency           m, kg, rad/s
    x_s, zeta     place of the tank, damping ratio of the slosh               m, 1
    f, A          force of the slosh; acceleration of its place               N, m/s^2
    g             C_1 - C_2 x_s, see `FlexibleMissile.across`                 m

Places are counted forwards from the mass centre. A pendulum of the length l in a missile that
accelerates by a is a slosh with w^2 = a / l. The sloshing mass adds to that of the missile.

Source: Thomson 9.12; Bauer (1964), Fluid oscillations in the containers of a space vehicle, NASA TR
R-187 (mechanical model).
Stability in the gains: `studies.modes` and its `root_locus`.
"""

__all__ = ["MissileLoop", "MissileLoopState"]

from typing import final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from ..core import AbstractSystem, NumberField, Scalar, quantity
from ..core.printing import printed
from ..core.shapes import with_rank
from ..core.types import follow_precision
from ._flexible_missile import FlexibleMissile, MissileState


@final
@printed()
class MissileLoopState(eqx.Module):
    """State of the missile and of the slosh; also its rates.

    - `missile`: the state of the missile."""

    missile: MissileState
    slosh: NumberField = quantity("m", doc="s, across the missile")
    slosh_rate: NumberField = quantity("m/s", doc="rate of s")


@final
class MissileLoop(AbstractSystem):
    """A flexible missile with autopilot and slosh; without slosh by default. State:
    `MissileLoopState`, created with `state`.

    - `missile`: the missile whose actuator receives the command; its `command` is added."""

    missile: FlexibleMissile = eqx.field(metadata={"doc": "the missile that the autopilot steers"})
    pitch_gain: NumberField = quantity("", default=0.0, doc="k_p, on the pitch")
    rate_gain: NumberField = quantity("s", default=0.0, doc="k_r, on the rate of pitch")
    gyro_place: NumberField = quantity("m", default=0.0, doc="x_g, before the mass centre")
    slosh_mass: NumberField = quantity(
        "kg", non_negative=True, default=0.0, doc="m_s, sloshing mass"
    )
    slosh_frequency: NumberField = quantity("rad/s", positive=True, default=1.0, doc="w")
    slosh_damping: NumberField = quantity(
        "", non_negative=True, default=0.0, doc="zeta, damping ratio of the slosh"
    )
    tank_place: NumberField = quantity("m", default=0.0, doc="x_s, before the mass centre")

    def vector_field(self, t: Scalar, y: MissileLoopState) -> MissileLoopState:
        del t
        self = follow_precision(self, y)
        missile, state = self.missile, y.missile
        pitch, pitch_rate = self.felt_pitch(state)
        command = missile.command + self.pitch_gain * pitch + self.rate_gain * pitch_rate
        pull = self._pull(y)
        # The slosh acts on the missile through spring and damper, and not through its acceleration:
        # the missile is computed first, and no coupled system has to be solved.
        rate, turn = missile.accelerations(state, command, self.slosh_mass * pull, self.tank_place)
        across = with_rank(missile.across(self.tank_place), state.engine.ndim)
        place = (
            self.sideways(y) + self.tank_place * self.mean_turn(y) + jnp.sum(across * rate, axis=0)
        )
        rates = MissileState(
            *(state.engine_rate, state.bending_rate, state.pitch_rate), rate[0], rate[1:], turn
        )
        return MissileLoopState(rates, y.slosh_rate, -pull - place)

    def sideways(self, y: MissileLoopState) -> Scalar:
        """Acceleration of the mass centre across the mean axis, m/s^2, without gravity."""
        missile, state = self.missile, y.missile
        _, slopes, _ = (with_rank(x, state.engine.ndim) for x in missile.hinge)
        thrust = (1.0 - missile.engine["turn"]) * state.engine
        thrust = thrust + jnp.sum(slopes * state.bending, axis=0)
        return (missile.thrust * thrust + self.slosh_mass * self._pull(y)) / missile.mass

    def mean_turn(self, y: MissileLoopState) -> Scalar:
        """Angular acceleration of the mean axis, rad/s^2."""
        return self.missile.mean_turn(y.missile, self.slosh_mass * self._pull(y), self.tank_place)

    def _pull(self, y: MissileLoopState) -> Scalar:
        """w^2 s + 2 zeta w s', m/s^2."""
        w = self.slosh_frequency
        return w * w * y.slosh + 2.0 * self.slosh_damping * w * y.slosh_rate

    def invariants(self, t: Scalar, y: MissileLoopState) -> dict[str, Array]:
        """Nothing is conserved under thrust."""
        del t, y
        return {}

    def state(self, engine: Scalar = 0.0, pitch: Scalar = 0.0) -> MissileLoopState:
        """A straight missile at rest, with the engine and the pitch at these angles, rad."""
        missile = self.missile.state(engine, pitch)
        # Times zero, for the shape and the precision of the runs.
        return MissileLoopState(missile, 0.0 * missile.pitch, 0.0 * missile.pitch)

    def felt_pitch(self, y: MissileState) -> tuple[Scalar, Scalar]:
        """The pitch, rad, and its rate, rad/s, at the gyro."""
        slopes = with_rank(self.missile.slopes(self.gyro_place), y.engine.ndim)
        bent = jnp.sum(slopes * y.bending, axis=0)
        return y.pitch + bent, y.pitch_rate + jnp.sum(slopes * y.bending_rate, axis=0)
