"""Hard cases of bodies that turn: flips, tops, pendulums, gravity gradient, yo-yos, gyros."""

import math

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
from ._case import Case


def free_flight(x: Array) -> Array:
    """The matrix of the turn and the later rate from moments, rate and duration."""
    turn, omega = free_turn(x[6], PrincipalInertia(x[:3]), x[3:6])
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
    y = Top.state(jnp.stack([0.0 * x[3], x[3], 0.0 * x[3]]), jnp.stack([x[5], x[4], x[6]]))
    motion = Top(x[0], x[1], x[2]).nutation(y)
    return jnp.stack([*motion.turning_points, motion.period, motion.precession])


def cubic_period(x: Array) -> Array:
    """The period from N, beta, alpha - beta and gamma - N."""
    n, beta, up, gamma = x
    return Nutation(n, beta, up, up + 2.0 * beta, gamma, gamma + 2.0 * n).period[None]


def steady_rates(x: Array) -> Array:
    """Both steady precessions from A, C, W l, the angle and n."""
    return jnp.stack(Top(x[0], x[1], x[2]).steady_precession_rates(x[3], x[4]))


def least_spin(x: Array) -> Array:
    """The least spin, from A, C, W l and the angle."""
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
    """Spin and tension from I, R, m, cord, angle and first spin."""
    yoyo = YoYo(x[0], x[1], x[2], x[3])
    return jnp.stack([yoyo.spin_rate(x[4], x[5]), yoyo.tension(x[4], x[5])])


def gimbal_walk(x: Array) -> Array:
    """Period and drift from theta, its rate, H, J, I_1 and I_2."""
    walk = GimbalWalk(*x)
    return jnp.stack([walk.period, walk.drift])


# Three moments well apart: about the middle axis the body flips.
BODY = (3.0, 2.0, 1.0)
TOP = (1.0, 0.5, 1.0)
FLIP = "elliptic functions and the angle about h"
TIMED = "the roundings of the time of a flip, which grows with ln(1/tilt)"
RESTING = "an output near its extreme has small derivatives, differences of those of the others"
LOST = "the inputs round onto the singular place"
CUBIC = "the root of a cubic, and elliptic integrals of it"
ENDLESS = ((0.0,) * 6,)

CASES = (
    # Moments that agree, or no rate: the axes of the closed form are then arbitrary.
    Case("bodies: at rest", free_flight, (*BODY, 0.0, 0.0, 0.0, 2.0), FLIP),
    Case("bodies: sphere", free_flight, (2.0, 2.0, 2.0, 0.3, -0.4, 0.5, 3.0), FLIP),
    Case("bodies: disc", free_flight, (1.0, 1.0, 2.0, 0.3, -0.4, 0.5, 3.0), FLIP),
    Case(
        "bodies: moments 1e-9 apart",
        free_flight,
        (2.0, 2.0 + 1e-9, 2.0 - 1e-9, 0.3, -0.4, 0.5, 3.0),
        FLIP,
        16.0,
        1e3,
        single=LOST,
    ),
    # Beside the separatrix the time of a flip grows as a logarithm, and amplifies roundings.
    Case(
        "bodies: about the middle axis exactly",
        free_flight,
        (*BODY, 0.0, 1.0, 0.0, 3.0),
        FLIP,
        16.0,
        1e3,
    ),
    Case(
        "bodies: flip from a tilt of 1e-3",
        free_flight,
        (*BODY, 1e-3, 1.0, 0.0, 20.0),
        FLIP,
        64.0,
        4096.0,
    ),
    Case(
        "bodies: flip from a tilt of 1e-8",
        free_flight,
        (*BODY, 1e-8, 1.0, 0.0, 40.0),
        TIMED,
        64.0,
        1024.0,
    ),
    Case(
        "bodies: rest between two flips from a tilt of 1e-8",
        free_flight,
        (*BODY, 1e-8, 1.0, 0.0, 58.5),
        RESTING,
        64.0,
        2e6,
    ),
    Case(
        "bodies: flip from a tilt of 1e-15",
        free_flight,
        (*BODY, 1e-15, 1.0, 1e-16, 70.0),
        TIMED,
        64.0,
        1024.0,
    ),
    # The modulus is one on the separatrix, where the period is infinite.
    Case(
        "bodies: polhode in its plane",
        polhode_period,
        (*BODY, 0.4, 0.9, 1.1),
        slope_roundings=256.0,
    ),
    Case(
        "bodies: polhode beside the separatrix",
        polhode_period,
        (*BODY, 0.57735, 1.0, 1.0),
        "2TB - h^2 is a difference",
        16.0,
        1e6,
        single=LOST,
    ),
    Case(
        "bodies: polhode about the middle axis",
        polhode_period,
        (*BODY, 0.0, 1.0, 0.0),
        "exact",
        value=(math.inf,),
        slopes=ENDLESS,
    ),
    Case(
        "bodies: polhode of a sphere",
        polhode_period,
        (2.0, 2.0, 2.0, 0.3, 0.4, 0.5),
        "exact",
        value=(math.inf,),
        slopes=ENDLESS,
    ),
    # The angles are zero, where an arc cosine has lost half of the digits.
    Case(
        "attitude: cones of a pure spin",
        cones,
        (0.0, 0.0, 2.0, 1.0, 0.5),
        "exact",
        value=(0.0, 0.0),
        slopes=((0.0,) * 5,) * 2,
    ),
    Case("attitude: cones of 1e-12 rad", cones, (1e-12, 2e-12, 2.0, 1.0, 0.5)),
    # Two of three roots of the cubic coincide for fast tops, and on the separatrix.
    Case("attitude: top let go", nutation, (*TOP, 0.5, 0.0, 0.0, 8.0), CUBIC, 16.0, 64.0),
    Case(
        "attitude: fast top",
        nutation,
        (*TOP, 1.0, 0.01, 0.0, 400.0),
        "a double root but for 1e-5, whose width the start holds",
        16.0,
        64.0,
        single="the small nutation of a fast top is below float32",
    ),
    Case(
        "attitude: top from 1e-6 rad",
        nutation,
        (*TOP, 1e-6, 0.0, 0.0, 2.0),
        CUBIC,
        16.0,
        64.0,
        single=LOST,
    ),
    Case(
        "attitude: swing through the bottom", cubic_period, (0.0, 2.0, -0.4, 0.0), CUBIC, 16.0, 64.0
    ),
    Case(
        "attitude: top that hangs",
        nutation,
        (1.0, 0.5, -1.0, 2.4, 0.1, 0.3, 1.0),
        CUBIC,
        16.0,
        64.0,
    ),
    Case(
        "attitude: nutation 1e-12 beside its separatrix",
        cubic_period,
        (1.0, 2.0, 1e-12, 0.0),
        CUBIC,
        16.0,
        64.0,
    ),
    Case(
        "attitude: nutation on its separatrix",
        cubic_period,
        (1.0, 2.0, 0.0, 0.0),
        "exact",
        value=(math.inf,),
        slopes=((0.0,) * 4,),
    ),
    # The slow root is a difference of two large numbers, unless it is taken from their product.
    Case(
        "attitude: steady precession of a fast top",
        steady_rates,
        (*TOP, 0.7, 1e5),
        slope_roundings=64.0,
    ),
    Case(
        "attitude: steady precession beside the horizontal",
        steady_rates,
        (*TOP, 1.570796, 3.0),
        slope_roundings=256.0,
        single=LOST,
    ),
    # A square root that ends: a hanging top needs no spin.
    Case("attitude: least spin upright", least_spin, (*TOP, 0.0)),
    Case(
        "attitude: least spin, hanging",
        least_spin,
        (*TOP, 2.0),
        "exact",
        value=(0.0,),
        slopes=((0.0,) * 4,),
    ),
    # The period is infinite at the top; its modulus there is a difference from one.
    Case("attitude: pendulum of no amplitude", pendulum_period, (1.2, 9.8, 0.0)),
    Case(
        "attitude: pendulum 1e-7 rad from the top",
        pendulum_period,
        (1.2, 9.8, 3.1415925535897933),
        single=LOST,
    ),
    Case(
        "attitude: libration beside a right angle",
        libration_period,
        (1.5707963, 3.0, 3.5, 1.0, 1e-3),
        single=LOST,
    ),
    Case(
        "attitude: libration of equal moments",
        libration_period,
        (0.3, 2.0, 2.5, 2.0, 1e-3),
        "exact",
        value=(math.inf,),
        slopes=((0.0,) * 5,),
    ),
    # A torque that is zero by symmetry, though each of its terms is large.
    Case(
        "attitude: gravity along an axis",
        tide,
        (7e6, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 3.0, 2.0, 1.0, 3.986e14),
        single="",
    ),
    # A square root that ends, with an infinite slope.
    Case(
        "attitude: no cord for no change",
        cord,
        (5.0, 5.0, 2.0, 0.5, 0.1),
        "exact",
        value=(0.0,),
        slopes=((math.inf, -math.inf, 0.0, 0.0, 0.0),),
    ),
    Case("attitude: cord for no spin", cord, (5.0, 0.0, 2.0, 0.5, 0.1)),
    Case(
        "attitude: yo-yo beside the full stop",
        unwound,
        (2.0, 0.5, 0.1, 4.5, 9.0553851381374173, 5.0),
    ),
    # The drift is of second order: a difference of averages that nearly cancel.
    Case(
        "gyros: walk of a small nutation",
        gimbal_walk,
        (1.1, 1e-6, 1.0, 1.0, 0.6, 1.3),
        "48 nodes and six steps of Newton",
        64.0,
        256.0,
    ),
    Case(
        "gyros: walk at half the greatest rate",
        gimbal_walk,
        (1.1, 0.35, 1.0, 1.0, 0.6, 1.3),
        "48 nodes and six steps of Newton",
        64.0,
        256.0,
    ),
    Case(
        "gyros: no walk across",
        gimbal_walk,
        (1.5707963267948966, 0.4, 1.0, 1.0, 0.6, 1.3),
        "48 nodes and six steps of Newton",
        64.0,
        256.0,
    ),
)
