"""A flexible stage that flies: bending, a swivelling engine, slosh and an autopilot as one effect.

    axes: z forward, x and y across; both planes (z, x) and (z, y) are equal
    (d, q, s)~ = (d, q, s)' + W z x (d, q, s)          rates in axes that do not roll
    (d, q, s)~~ as in the plane: see `jaxspace.mechanics.missile_loop.MissileLoop`
    F_B = m F/(m + m_s) z + (F [(1 - C_2) d + y_h'] + f),   M_B = z x I_0 (th + C_2 d)~~

    symbol       meaning                                                     unit
    d, q, s      angle of the engine, bending, slosh: each along x and y     rad, m, m
    W            rate of roll, about z                                       rad/s
    F            thrust, along the engine                                    N
    th           inclination of the straight beam from the target            rad
    C_2 d        angle from the straight beam to the mean axis               rad

The attitude and the position of the scene are those of the mean axis, about which deformation has
neither momentum nor angular momentum. So the body of the scene moves as a rigid one under the
thrust where the bent beam has it, and to first order in the deformation no inertia changes. For
small angles and without roll each plane is the loop of `jaxspace.mechanics`.

Source: Thomson 9.12; Likins (1967), AIAA Journal 5, 1301 (mean axes).
Valid for a uniform beam, deformations of first order, and engine angles so small that F z is the
thrust along the axis. Gravity bends nothing; other forces of the scene are taken as spread like the
mass, so that they bend nothing either. The sloshing mass is not part of the body's mass; it is
accelerated along the axis by the share m_s / (m + m_s) of the thrust.
"""

from typing import final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load, RigidBody
from ..core import InputError, Scalar, State, Vector, output, quantity
from ..core.checks import is_concrete
from ..core.shapes import with_rank
from ..core.types import follow_precision
from ..core.vectors import norm, unit
from ..mechanics import MissileState
from ..mechanics.missile_loop import MissileLoop, MissileLoopState

Two = Float[Array, "2 *#runs"]
# Of the body's moments and mass, against those of the beam.
AGREE = 1e-6


@final
class FlexibleStage(AbstractEffect):
    """A flexible stage under thrust.

    `Scene.start` adds the part `flexible` to a state: angle of the engine, bending and slosh, each
    with its rate in axes that do not roll; components along x and y first.

    - `loop`: the stage in a plane, with autopilot and slosh; its command acts in both planes."""

    loop: MissileLoop = eqx.field(metadata={"doc": "its missile, autopilot and slosh"})
    target: Vector = quantity(
        "", default=(0.0, 0.0, 1.0), doc="inertial direction, to which the autopilot turns z"
    )
    command: Two = quantity(
        "rad", default=(0.0, 0.0), doc="of the actuators, besides the autopilot's"
    )
    engine: Two = quantity("rad", default=(0.0, 0.0), doc="angle of the engine at the start")
    part: str = eqx.field(
        static=True, default="flexible", metadata={"doc": "name of its part of the state"}
    )

    def body(self, roll_moment: Scalar) -> RigidBody:
        """The rigid body of a scene with this stage; `roll_moment`: about the axis, kg m^2."""
        across = self.loop.missile.inertia
        moments = jnp.stack(jnp.broadcast_arrays(across, across, jnp.asarray(roll_moment)))
        return RigidBody(self.loop.missile.mass, moments)

    def start(self, y: BodyState, body: AbstractBody) -> dict[str, State]:
        """The stage straight and at rest, but for the engine's angle.

        **Raises** `InputError` where the body is another one than the beam."""
        self._check(body)
        like = jnp.zeros_like(y.omega[:2])
        still = jnp.zeros((2, self.loop.missile.modes, *like.shape[1:]), like.dtype)
        engine = with_rank(self.engine, like.ndim - 1) + like
        values = {"engine": engine, "bending": still, "slosh": like}
        return {self.part: values | {f"{name}_rate": 0.0 * x for name, x in values.items()}}

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del body
        self = follow_precision(self, y)
        part = y.part(self.part)
        spin = y.omega[2]
        # Rates in the body, which rolls.
        rates = {
            name: part[f"{name}_rate"] - _rolled(spin, part[name])
            for name in ("engine", "bending", "slosh")
        }
        loop = eqx.tree_at(
            lambda s: s.missile.command,
            self.loop,
            self.loop.missile.command + with_rank(self.command, y.omega.ndim - 1),
        )
        state = self._in_planes(y, rates)
        result = loop.vector_field(t, state)
        change = {
            "engine": result.missile.engine_rate,
            "bending": jnp.swapaxes(result.missile.bending_rate, 0, 1),
            "slosh": result.slosh_rate,
        }
        accelerations = {
            f"{name}_rate": x - _rolled(spin, part[f"{name}_rate"]) for name, x in change.items()
        }
        force, torque = _force_and_torque(loop, state)
        return Load(
            force_N=y.attitude.rotate(force),
            torque_B=torque,
            parts_rate={self.part: rates | accelerations},
        )

    def _in_planes(self, y: BodyState, rates: dict[str, Array]) -> MissileLoopState:
        """The state of the loop in the planes of x and y, from that of the stage and the `rates` of
        its parts in the body."""
        part = y.part(self.part)
        turn = self.loop.missile.engine["turn"]
        leaning, leaning_rate = self._inclination(y)
        # Both planes pass through the loop as two runs: of the bending the modes come first there.
        missile = MissileState(
            part["engine"],
            jnp.swapaxes(part["bending"], 0, 1),
            # From the mean axis, which the scene has, to the straight beam, of which the loop is.
            leaning - turn * part["engine"],
            rates["engine"],
            jnp.swapaxes(rates["bending"], 0, 1),
            leaning_rate - turn * rates["engine"],
        )
        return MissileLoopState(missile, part["slosh"], rates["slosh"])

    @output("rad")
    def lean(self, y: BodyState) -> Scalar:
        """Angle between the mean axis and the target as the autopilot counts it (sines for rad),
        rad."""
        return _size(self._inclination(y)[0])

    @output("rad/s")
    def lean_rate(self, y: BodyState) -> Scalar:
        """Magnitude of the angular rate of the mean axis, rad/s."""
        return _size(self._inclination(y)[1])

    @output("rad")
    def engine_angle(self, y: BodyState) -> Scalar:
        """Angle of the engine to the straight beam, whichever way it swivels, rad."""
        return _size(y.part(self.part)["engine"])

    def _inclination(self, y: BodyState) -> tuple[Two, Two]:
        """Inclination of the mean axis to x and y from the target, sines for rad, and its rate."""
        target = y.attitude.rotate_back(with_rank(unit(self.target), y.omega.ndim - 1))
        # A turn about y inclines z to x, one about x away from y.
        return -target[:2], jnp.stack([y.omega[1], -y.omega[0]])

    def _check(self, body: AbstractBody) -> None:
        missile = self.loop.missile
        mass = body.constant_mass()
        pairs = {"mass": (mass, missile.mass, "kg")}
        if mass is not None and body.has_inertia():
            moment = body.inertia(mass).matrix()[0, 0]
            pairs["moment of inertia across its axis"] = (moment, missile.inertia, "kg m^2")
        for name, (given, expected, kg) in pairs.items():
            if given is None or not (is_concrete(given) and is_concrete(expected)):
                continue
            if jnp.any(jnp.abs(given - expected) > AGREE * expected):
                raise InputError(
                    f"The {name} of the body is {given} {kg}: it must be that of the beam of "
                    f"FlexibleStage, {expected} {kg}."
                )


def _force_and_torque(loop: MissileLoop, state: MissileLoopState) -> tuple[Vector, Vector]:
    """Force, N, and torque, N m, on the rigid body in its axes, from a loop in both planes."""
    missile = loop.missile
    turning = missile.inertia * loop.mean_turn(state)
    across = missile.mass * loop.sideways(state)
    # The body carries the sloshing mass along the axis, which takes its share of the thrust.
    along = missile.thrust * missile.mass / (missile.mass + loop.slosh_mass)
    still = jnp.zeros_like(across[:1])
    # z x (x, y, 0).
    torque = jnp.concatenate([-turning[1:], turning[:1], still])
    return jnp.concatenate([across, along + still]), torque


def _size(x: Two) -> Scalar:
    """Length of a vector of components along x and y."""
    return norm(jnp.concatenate([x, jnp.zeros_like(x[:1])]))


def _rolled(spin: Scalar, x: Array) -> Array:
    """W z x v of components along x and y."""
    return spin * jnp.stack([-x[1], x[0]])
