"""Functions of the edge cases of rotating bodies: flips, tops, pendulums, yo-yos, gyros.

Each maps the inputs of a case, (inputs,), to its outputs, (outputs,)."""

import jax.numpy as jnp
from jaxtyping import Array

from ..attitude import SphericalPendulum, Top, YoYo
from ..attitude.despin import cord_length
from ..attitude.gravity_gradient import gravity_gradient_torque, pitch_libration_period
from ..attitude.nutation import Nutation
from ..attitude.polhode import Polhode
from ..attitude.torque_free import cone_angles
from ..bodies import PrincipalInertia
from ..bodies.principal_frame import free_turn
from ..gyros.gimbal_walk import GimbalWalk
from ..rotations import Quaternion


def free_flight(x: Array) -> Array:
    """The matrix of the turn and the later rate from moments, rate and duration."""
    turn, omega = free_turn(x[6], PrincipalInertia(x[:3]), x[3:6])
    # The matrix, because a quaternion may have either sign.
    return jnp.concatenate([turn.matrix().reshape(-1), omega])


def polhode_period(x: Array) -> Array:
    """The period of the polhode, from moments and rate."""
    return Polhode.of(x[:3], x[3:6]).period[None]


def cones(x: Array) -> Array:
    """The angles with h and with omega, from the rate and both moments."""
    return jnp.stack(cone_angles(x[:3], x[3], x[4]))


def nutation(x: Array) -> Array:
    """Turning points, period and precession of a top, from A, C, W l, the nutation angle, its rate,
    psi' and n."""
    # The azimuth and the spin angle do not enter.
    y = Top.state(jnp.stack([0.0 * x[3], x[3], 0.0 * x[3]]), jnp.stack([x[5], x[4], x[6]]))
    motion = Top(x[0], x[1], x[2]).nutation(y)
    return jnp.stack([*motion.turning_points, motion.period, motion.precession])


def cubic_period(x: Array) -> Array:
    """The period from N, beta, alpha - beta and gamma - N."""
    n, beta, up, gamma = x
    # The sums alpha + beta and gamma + N follow from the differences, which are the inputs because
    # they cancel: taken from the sums they would have lost their digits.
    return Nutation(n, beta, up, up + 2.0 * beta, gamma, gamma + 2.0 * n).period[None]


def steady_rates(x: Array) -> Array:
    """Steady precession rates from A, C, W l, the angle and n."""
    return jnp.stack(Top(x[0], x[1], x[2]).steady_precession_rates(x[3], x[4]))


def least_spin(x: Array) -> Array:
    """The least spin, from A, C, W l and the angle."""
    # Zero for a top that hangs, where the formula would take the root of a negative number.
    return Top(x[0], x[1], x[2]).least_spin(x[3])[None]


def pendulum_period(x: Array) -> Array:
    """The period of a swing, from length, gravity and amplitude."""
    return SphericalPendulum(x[0], x[1]).plane_period(x[2])[None]


def libration_period(x: Array) -> Array:
    """The period of the libration, from amplitude, three moments and mean motion."""
    return pitch_libration_period(x[0], x[1:4], x[4])[None]


def tide(x: Array) -> Array:
    """The torque of gravity from place, attitude, moments and mu."""
    return gravity_gradient_torque(x[:3], Quaternion(x[3:7]), PrincipalInertia(x[7:10]), x[10])


def cord(x: Array) -> Array:
    """The length of the cord, from both spins, I, R and m."""
    return cord_length(*x)[None]


def unwound(x: Array) -> Array:
    """Spin and tension from I, R, m, cord, angle and initial spin."""
    yoyo = YoYo(x[0], x[1], x[2], x[3])
    return jnp.stack([yoyo.spin_rate(x[4], x[5]), yoyo.tension(x[4], x[5])])


def gimbal_walk(x: Array) -> Array:
    """Period and drift from theta, its rate, H, J, I_1 and I_2."""
    walk = GimbalWalk(*x)
    return jnp.stack([walk.period, walk.drift])
