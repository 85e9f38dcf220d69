"""Small librations of a body about the local vertical, and the invariant of its motion in a
circular orbit.

    I_2 th_2'' + 3 n^2 (I_1 - I_3) th_2 = 0                                            pitch
    I_1 th_1'' + (I_1 + I_3 - I_2) n th_3' + 4 n^2 (I_2 - I_3) th_1 = 0                roll
    I_3 th_3'' - (I_1 + I_3 - I_2) n th_1' + n^2 (I_2 - I_1) th_3 = 0                  yaw
    x^2 + (1 + 3 k_1 + k_1 k_3) x + 4 k_1 k_3 = 0,  x = (s/n)^2      k_1 = (I_2 - I_3)/I_1
    stable for k_1 > k_3,  k_1 k_3 > 0,  1 + 3 k_1 + k_1 k_3 > 4 sqrt(k_1 k_3)
                                                                     k_3 = (I_2 - I_1)/I_3
    w . J w/2 + 3 n^2/2 r^ . J r^ - n^2/2 z^ . J z^ = const          w = omega - n z^

    th_2 = 2 e/(3 (I_1 - I_3)/I_2 - 1) sin(f)                        forced, in an elliptic orbit

    symbol        meaning                                                             unit
    I_1, I_2, I_3 moments about the axes along the velocity, the normal, outwards     kg m^2
    th_1 ... th_3 roll, pitch and yaw: small turns from these axes                    rad
    n             mean motion of the circular orbit                                   rad/s
    s             rate of a mode e^(s t)                                              1/s
    z^, r^        normal of the orbit and outward direction, in body axes             1
    e, f          eccentricity, true anomaly                                          1, rad

Source: Thomson 7.4, Problems 14 and 15; Hughes, Spacecraft Attitude Dynamics, 9.2 (stability,
Jacobi's integral) and 9.3 (elliptic orbit, to first order in e).
Stable bodies occupy two regions of the plane of k_1 and k_3: k_1 > k_3 > 0, where I_2 > I_1 > I_3
(Lagrange), where the energy has a minimum; and a small one of negative ratios (DeBra and Delp),
stabilised by the gyroscopic terms only: damping makes it unstable.
"""

__all__ = [
    "LibrationModes",
    "forced_pitch",
    "inertia_ratios",
    "jacobi_integral",
    "libration_is_stable",
    "libration_modes",
]

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..bodies import BodyState
from ..bodies.inertia import AbstractInertia
from ..core import Flag, Scalar, Vector
from ..core.formula import NOT_NEGATIVE, POSITIVE, formula
from ..core.printing import printed
from ..core.safe import end_sqrt, safe_divide
from ..core.shapes import check_components
from ..core.squares import quotient
from ..core.vectors import cross as cross_product
from ..core.vectors import dot, unit
from ._state import attitude_and_omega
from .gravity_gradient import gravity_gradient_energy


@printed(frequency="rad/s", growth="1/s")
class LibrationModes(NamedTuple):
    """Modes of small librations: pitch, and the slow and the fast one of roll and yaw.

    - `frequency`: rad/s, (3, *runs); zero where a mode grows without turning.
    - `growth`: rate of the growing solution, 1/s, (3, *runs); zero of a stable mode."""

    frequency: Float[Array, "3 *#runs"]
    growth: Float[Array, "3 *#runs"]


@formula(moments=POSITIVE)
def inertia_ratios(moments: Vector) -> tuple[Scalar, Scalar]:
    """k_1 = (I_2 - I_3)/I_1 and k_3 = (I_2 - I_1)/I_3, each within (-1, 1) and (*runs,), from the
    moments I_1, I_2 and I_3, kg m^2, (3, *runs)."""
    check_components("inertia_ratios: moments", moments, 3)
    along, across, outwards = moments
    return (across - outwards) / along, (across - along) / outwards


@formula
def libration_is_stable(k1: Scalar, k3: Scalar) -> Flag:
    """Whether small librations of a body with these ratios of inertia stay small, without damping.

    **Arguments**

    - `k1`, `k3`: of `inertia_ratios`, (*runs,): the plane of the map of stability.

    **Returns** the flag, (*runs,): in the region of Lagrange, or of DeBra and Delp. On their edges
    it is false: there a mode does not swing, or two coincide and grow slowly.
    """
    product = k1 * k3
    # The flag below is false for a negative product, of which the root here must not be NaN.
    root = jnp.sqrt(jnp.maximum(product, 0.0))
    return (k1 > k3) & (product > 0.0) & (1.0 + 3.0 * k1 + product > 4.0 * root)


@formula(moments=POSITIVE, mean_motion=POSITIVE)
def libration_modes(moments: Vector, mean_motion: Scalar) -> LibrationModes:
    """Frequencies and growth rates of small librations in a circular orbit (Thomson 7.4, Problem
    15).

    **Arguments**

    - `moments`: I_1 along the velocity, I_2 along the normal, I_3 outwards, kg m^2, (3, *runs).
    - `mean_motion`: n, rad/s, (*runs,).

    **Returns** the modes. At a stability boundary the slopes are infinite (endpoint derivative
    convention).
    """
    # Roll and yaw are coupled by the turn of the orbit, and obey s^4 + b s^2 + c = 0; pitch does
    # not depend on them.
    k1, k3 = inertia_ratios(moments)
    pitch = -3.0 * (moments[0] - moments[2]) / moments[1]
    b = 1.0 + 3.0 * k1 + k1 * k3
    c = 4.0 * k1 * k3
    discriminant = b * b - 4.0 * c
    swinging = discriminant >= 0.0
    # The greater root first, and the other from the product: nothing cancels.
    root = end_sqrt(_positive, jnp.where(swinging, discriminant, 0.0))
    fast = -0.5 * (b + jnp.where(b < 0.0, -root, root))
    slow = safe_divide(c, fast)
    real = [_mode(x) for x in (pitch, slow, fast)]
    # Of complex roots x both modes turn and grow at equal rates: s^2 = x, |x| = sqrt(c).
    size = jnp.sqrt(jnp.where(swinging, 1.0, c))
    turning = end_sqrt(_positive, jnp.where(swinging, 0.0, 0.5 * size + 0.25 * b))
    growing = end_sqrt(_positive, jnp.where(swinging, 0.0, 0.5 * size - 0.25 * b))
    frequency = [real[0][0], *(jnp.where(swinging, x[0], turning) for x in real[1:])]
    growth = [real[0][1], *(jnp.where(swinging, x[1], growing) for x in real[1:])]
    return LibrationModes(mean_motion * jnp.stack(frequency), mean_motion * jnp.stack(growth))


def _mode(x: Scalar) -> tuple[Scalar, Scalar]:
    """Frequency and growth of s^2 = x."""
    return end_sqrt(_positive, -x), end_sqrt(_positive, x)


def _positive(x: Scalar) -> Scalar:
    return jnp.maximum(x, 0.0)


@formula(eccentricity=NOT_NEGATIVE, moments=POSITIVE)
def forced_pitch(eccentricity: Scalar, true_anomaly: Scalar, moments: Vector) -> Scalar:
    """The pitch that an elliptic orbit forces on a body, to first order (Hughes 9.3).

    **Arguments**

    - `eccentricity`: e, (*runs,), small.
    - `true_anomaly`: f, rad, (*runs,).
    - `moments`: as in `libration_modes`.

    **Returns** th_2, rad, (*runs,), positive in the sense of the orbit; infinite at the resonance
    3 (I_1 - I_3) = I_2.
    """
    check_components("forced_pitch: moments", moments, 3)
    stiffness = 3.0 * (moments[0] - moments[2]) / moments[1]
    return 2.0 * eccentricity / (stiffness - 1.0) * jnp.sin(true_anomaly)


@formula(mu=POSITIVE)
def jacobi_integral(y: BodyState, inertia: AbstractInertia, mu: Scalar) -> Scalar:
    """Jacobi's integral of a body in a circular orbit, J, (*runs,) (Hughes 9.2).

    **Arguments**

    - `y`: a state with position, velocity, attitude and omega, also along a trajectory.
    - `inertia`: about the mass centre, kg m^2.
    - `mu`: gravitational parameter of the centre, m^3/s^2, (*runs,).

    **Returns** the integral, which the motion conserves where the orbit is a circle.

    **Raises** `InputError` for a state without attitude and omega."""
    attitude, omega = attitude_and_omega(y)
    moment = cross_product(y.position, y.velocity)
    rate = quotient(jnp.sqrt(dot(moment, moment)), dot(y.position, y.position))
    turning = attitude.rotate_back(rate * unit(moment))
    relative = omega - turning
    kinetic = dot(relative, inertia.times(relative)) - dot(turning, inertia.times(turning))
    return 0.5 * kinetic + gravity_gradient_energy(y.position, attitude, inertia, mu)
