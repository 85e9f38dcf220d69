"""Thomson, chapter 5, and Harrison and Nettleton, chapters 4 and 5: rotation of rigid bodies."""

import jax
import jax.numpy as jnp

from jaxspace.attitude import Top
from jaxspace.attitude.forced_rotation import bank_angle, bearing_reactions, required_torque
from jaxspace.attitude.polhode import Polhode
from jaxspace.bodies import InertiaTensor, PrincipalInertia
from jaxspace.bodies.mass_properties import moment_along, pivot_impact
from jaxspace.bodies.solids import box, particles
from jaxspace.bodies.solids import cylinder as solid_cylinder
from jaxspace.core.vectors import cross, dot, norm
from jaxspace.orbits.elements import angular_momentum, inclination
from jaxspace.rotations import Quaternion, from_euler_angles
from jaxspace.rotations.euler_angles import omega_from_euler_rates

from .case import DEG, LINEAR, Case, rates, vec

G = 32.2  # ft/s^2
X, Y, Z = vec(1, 0, 0), vec(0, 1, 0), vec(0, 0, 1)


def landing(m, arm, moments, product, velocity):
    """Angular velocity about a boulder that a vehicle hits with one foot."""
    tensor = jnp.diag(vec(*moments)) - product * (jnp.outer(Y, Z) + jnp.outer(Z, Y))
    r = vec(0.0, *arm)
    # The case lists the moments about the pivot.
    inertia = InertiaTensor(tensor - particles(vec(m), r[:, None]).about(0.0 * r))
    return (pivot_impact(inertia, m, r, vec(*velocity), 0.0 * r).omega,)


def propeller(m, l, spin, turn, blade):
    """Momentum of two slender blades on a turning airplane, over their moment of inertia."""
    I = m * l**2 / 12.0
    axes = Quaternion.about(0, jnp.asarray(blade))
    # Along the blade, y, the moment of inertia is nothing.
    inertia = PrincipalInertia([I, 0.0, I])
    omega = vec(spin, 0.0, turn)
    return axes.rotate(inertia.times(axes.rotate_back(omega))) / I, I


def skewed_plate(m, a, b, alpha, omega, l):
    """Bearing force of a plate whose sides stand askew to the shaft."""
    plate = box(m, vec(a, b, 0.0))
    shaft = vec(jnp.cos(alpha), jnp.sin(alpha), 0.0)
    held = bearing_reactions(plate.inertia, m, plate.centre, shaft, (0.0, l), omega)
    return (norm(held.first),)


def banked_turn(V, R, A, B, C):
    """Bank and rolling moment; x lateral, y longitudinal, z up."""
    bank = bank_angle(V, R, G)
    rate = V / R * vec(jnp.sin(bank), 0.0, jnp.cos(bank))
    return bank / DEG, jnp.abs(required_torque(PrincipalInertia([A, B, C]), rate)[1])


def welded_rod(m, l, theta, omega, c):
    """Bearing reactions of a rod that is welded to a shaft at a third of its length."""
    # About its own axis a slender rod has no moment of inertia. The tensor about a point of this
    # axis must be positive definite: not zero, but less than rounding.
    inertia = PrincipalInertia(m * l**2 / 12.0 * vec(1.0, 1.0, 1e-16))
    shaft = vec(jnp.sin(theta), 0.0, jnp.cos(theta))
    held = bearing_reactions(inertia, m, l / 6.0 * Z, shaft, (c, -c), omega)
    return norm(held.first), norm(held.second)


def flat_spin(I_roll, I_yaw, rate, alpha):
    moments = PrincipalInertia([I_roll, I_yaw, I_yaw])
    omega = rate * vec(jnp.sin(alpha), 0.0, jnp.cos(alpha))
    return (norm(required_torque(moments, omega)),)


def cylinder(m, R):
    """Moments of a cylinder of the length 2 R, and that about a line to the rim of an end."""
    tensor = solid_cylinder(m, R, 2.0 * R).tensor
    return tuple(moment_along(tensor, line) for line in (Z, X, X + Z))


def crusher(R, l, theta, rate):
    """Velocity and acceleration of the top of a wheel that rolls on the wall of a crusher.

    The wheel stands at the end of an axle through a fixed point, and rolls on its lowest point."""
    spin = -(l * jnp.sin(theta) + R * jnp.cos(theta)) * rate / R

    def path(t):
        # The axle points outwards; the top of the wheel is the place opposite of the contact.
        turned = 0.5 * jnp.pi + spin * t
        axes = from_euler_angles(jnp.stack([0.5 * jnp.pi + rate * t, theta + 0.0 * t, turned]))
        return axes.rotate(vec(R, 0.0, l))

    v, a = rates(path)
    return v, a


def forced_precession(I1, I3, mgh, omega_z, rate, angles):
    top = Top(I1, I3, mgh)
    theta = vec(*angles) * DEG
    moment = top.precession_moment(theta, rate, omega_z)
    return moment - mgh * jnp.sin(theta), moment, omega_z - rate * jnp.cos(theta)


def node_moment(I1, I3, angles, first, second):
    """Moment in node axes for a prescribed motion; psi is the spin here."""

    def rates(t):
        """Angular velocity of the body and of the node axes, which do not spin, in node axes."""
        at, rate = vec(*angles) + t * vec(*first), vec(*first) + t * vec(*second)
        node = at * vec(1, 1, 0)
        return omega_from_euler_rates(node, rate), omega_from_euler_rates(node, rate * vec(1, 1, 0))

    (w, axes_rate), (w_rate, _) = jax.jvp(rates, (jnp.zeros(()),), (jnp.ones(()),))
    return (required_torque(PrincipalInertia([I1, I1, I3]), w, w_rate, axes_rate),)


def satellite_impulse(m, V, impulse):
    """Turn of the orbit's plane by an impulse along its normal."""

    def tilt(change):
        return inclination(X, V * Y + change * Z)

    gain = impulse / m
    # At zero the inclination is a corner: its slope is that of a small change.
    small = 1e-9
    return tilt(jnp.asarray(gain)), tilt(jnp.asarray(small)) * gain / small


def binet(semi_axes, sphere):
    """Squares L_i^2 where the curve meets its two planes of symmetry, and the axis it encloses."""
    s = vec(*semi_axes)
    order = jnp.argsort(s)
    low, high = order[0], order[2]
    # A point of the curve in the plane of the least and the greatest axis; 2T = 1.
    a, b = s[low] ** -2, s[high] ** -2
    share = (1.0 - b * sphere**2) / (a - b)
    L = jnp.zeros(3).at[low].set(jnp.sqrt(share)).at[high].set(jnp.sqrt(sphere**2 - share))
    polhode = Polhode.of(s**2, L / s**2)
    first, second = (vertex**2 * s**4 for vertex in polhode.vertices)
    return first, second, jnp.where(polhode.about_least, low, high) + 1


def two_body(m1, m2, s, omega):
    """Moment of momentum about the common centre, and the force on each."""
    m = m1 + m2
    r1, r2 = m2 * s / m * X, -m1 * s / m * X
    h = sum(k * angular_momentum(r, omega * cross(Z, r)) for k, r in ((m1, r1), (m2, r2)))
    force = -m1 * omega**2 * cross(Z, cross(Z, r1))
    return h[2], dot(force, X)


FORCED = (required_torque, PrincipalInertia)
HELD = (bearing_reactions, PrincipalInertia)
CASES = [
    Case(
        "T5.5-P3",
        "Momentum of a propeller with two blades on a turning airplane, over I",
        (PrincipalInertia, Quaternion),
        {"m": 0.5, "l": 6.0, "spin": 150.0, "turn": 0.3, "blade": 0.6},
        propeller,
        {
            "h / I (rad/s)": [150.0, -0.13980586289508395, 0.20435366317150103],
            "I (slug ft^2)": 1.5,
        },
    ),
    Case(
        "T5.5-P10",
        "Landing vehicle that pivots about a boulder",
        (pivot_impact, particles),
        {
            **{"m": 50.0, "arm": (1.2, 0.9), "moments": (180.0, 120.0, 150.0)},
            **{"product": 60.0, "velocity": (-4.0, 0, -6.0)},
        },
        landing,
        {"omega (rad/s)": [-2.0, -0.875, 1.25]},
    ),
    Case(
        "T5.9-P9",
        "Plate that stands askew on its shaft",
        (bearing_reactions, box),
        {"m": 4.0, "a": 0.2, "b": 0.5, "alpha": 25 * DEG, "omega": 100.0, "l": 0.6},
        skewed_plate,
        {"F (N)": 446.85925848607053},
    ),
    Case(
        "T5.9-P10",
        "Banked turn: gyroscopic rolling moment",
        (*FORCED, bank_angle),
        {"V": 300.0, "R": 3000.0, "A": 9000.0, "B": 25000.0, "C": 31000.0},
        banked_turn,
        {"bank (deg)": 42.97430562187732, "moment (lbf ft)": 109.72511926643398},
    ),
    Case(
        "T5.9-P11",
        "Flat spin with the nose 25 deg below the horizontal",
        FORCED,
        {"I_roll": 9000.0, "I_yaw": 31000.0, "rate": 1.5, "alpha": 25 * DEG},
        flat_spin,
        {"moment (lbf ft)": 18959.599967194707},
    ),
    Case(
        "T5.9-P13",
        "Rod that is welded to a shaft at a third of its length",
        HELD,
        {"m": 4.0, "l": 0.9, "theta": 50 * DEG, "omega": 30.0, "c": 0.4},
        welded_rod,
        {"near the long end (N)": 406.2555696270962, "far (N)": 7.408429657151937},
    ),
    Case(
        "T5.12-P2",
        "Cylinder of the length 2 R about a line to the rim of an end",
        (solid_cylinder, moment_along),
        {"m": 1.0, "R": 1.0},
        cylinder,
        {
            "axis (kg m^2)": 0.5,
            "transverse (kg m^2)": 0.5833333333333334,
            "line (kg m^2)": 0.5416666666666666,
        },
    ),
    Case(
        "T5.14-P17",
        "Top point of a crusher's wheel",
        (from_euler_angles,),
        {
            **{"R": 1.5, "l": 3.0, "theta": 53.095695815405826 * DEG},
            "rate": 100.0 * 2.0 * jnp.pi / 60.0,
        },
        crusher,
        {
            "v (ft/s)": [0.0, 50.2428348006169, 0.0],
            "a (ft/s^2)": [-410.02097356638035, 0.0, -636.4922593458547],
        },
    ),
    Case(
        "H4.12",
        "Forced precession of a top at 30, 90 and 120 deg",
        (Top.precession_moment,),
        {
            **{"I1": 0.002, "I3": 0.0008, "mgh": 0.3, "omega_z": 150.0},
            **{"rate": 5.0, "angles": (30, 90, 120)},
        },
        forced_precession,
        {
            "Q_x (N m)": [0.12834936490538904, 0.3, 0.2814582562299426],
            "M_x (N m)": [0.27834936490538903, 0.6, 0.5412658773652742],
            "spin about the axle (rad/s)": [145.66987298107782, 150.0, 152.5],
        },
    ),
    Case(
        "H4.13",
        "Satellite that receives an impulse along the normal of its orbit",
        (inclination,),
        {"m": 10.0, "V": 7500.0, "impulse": 100.0},
        satellite_impulse,
        {"turn (rad)": 0.0013333325432107193, "to first order (rad)": 0.0013333333333333333},
        why=LINEAR,
    ),
    Case(
        "H4.14",
        "Binet's diagram, semi-axes 1, 2, 3, sphere 1.95",
        (Polhode.of,),
        {"semi_axes": (1.0, 2.0, 3.0), "sphere": 1.95},
        binet,
        {
            "L^2, plane 1-3": [0.6496875, 0.0, 3.1528125],
            "L^2, plane 1-2": [0.06583333333333333, 3.736666666666667, 0.0],
            "axis": 1,
        },
    ),
    Case(
        "H4.15",
        "Binet's diagram, semi-axes 1, 2, 3, sphere 2.05",
        (Polhode.of,),
        {"semi_axes": (1.0, 2.0, 3.0), "sphere": 2.05},
        binet,
        {
            "L^2, plane 1-3": [0.5996875, 0.0, 3.6028125],
            "L^2, plane 2-3": [0.0, 3.838, 0.3645],
            "axis": 3,
        },
    ),
    Case(
        "H4.16",
        "Binet's diagram, semi-axes 3, 2, 1, sphere 2.6",
        (Polhode.of,),
        {"semi_axes": (3.0, 2.0, 1.0), "sphere": 2.6},
        binet,
        {
            "L^2, plane 1-3": [6.48, 0.0, 0.28],
            "L^2, plane 1-2": [4.968, 1.792, 0.0],
            "axis": 1,
        },
    ),
    Case(
        "H4.78",
        "Body rates from the rates of Euler's angles",
        (omega_from_euler_rates,),
        {"angles": (0.4, 0.9, 1.3), "rates": (0.5, -0.3, 7.0)},
        lambda angles, rates: (omega_from_euler_rates(vec(*angles), vec(*rates)),),
        {"omega (rad/s)": [0.29714087922718146, 0.39383697100289283, 7.310804984135332]},
    ),
    Case(
        "H4.81",
        "Moments of a symmetric body for a prescribed motion, in node axes",
        (omega_from_euler_rates, required_torque),
        {
            **{"I1": 0.002, "I3": 0.0008, "angles": (0.4, 0.9, 1.3)},
            **{"first": (0.5, -0.3, 7.0), "second": (-0.2, 0.7, 0.1)},
        },
        node_moment,
        {"M (N m)": [0.0034472382023252243, 0.0010682964513790878, 7.454163423199169e-05]},
    ),
    Case(
        "H5.17",
        "Two bodies that circle each other: moment of momentum and force",
        (angular_momentum, cross),
        {"m1": 3.0, "m2": 1.0, "s": 2.0, "omega": 0.7},
        two_body,
        {"L (N m s)": 2.1, "F (N)": 0.735},
    ),
]
