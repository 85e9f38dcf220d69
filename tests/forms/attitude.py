"""Closed forms of attitude and gyros."""

from types import SimpleNamespace

import jax.numpy as jnp
import twins

from jaxspace.attitude import SphericalPendulum, Top, YoYo
from jaxspace.attitude.despin import zero_spin_cord_length
from jaxspace.attitude.gravity_gradient import gravity_gradient_energy
from jaxspace.attitude.initial import attitude_along, attitude_from_angles
from jaxspace.attitude.nutation import Nutation
from jaxspace.attitude.outputs import (
    attitude_error,
    attitude_error_x,
    attitude_error_y,
    attitude_error_z,
    cone_angle,
    pointing,
)
from jaxspace.attitude.polhode import Polhode
from jaxspace.attitude.torque_free import (
    body_precession_rate,
    coning_omega,
    precession_rate,
    symmetric_flow,
)
from jaxspace.bodies import BodyState, PrincipalInertia, RigidBody
from jaxspace.gyros import TwoGimbalGyro
from jaxspace.gyros.gimbal_walk import GimbalWalk
from jaxspace.rotations import Quaternion

from .form import Form


def symmetric(x):
    """Turn and rate from quaternion, rate, both moments and duration; and the rates of the cone."""
    y = BodyState(attitude=Quaternion(x[:4]), omega=x[4:7])
    later = symmetric_flow(x[9], y, x[7], x[8])
    rates = body_precession_rate(x[6], x[7], x[8]), precession_rate(x[4:7], x[7], x[8])
    return later.attitude.wxyz, later.omega, *(rate[None] for rate in rates)


def coning(x):
    """The rate from angle, precession and both moments."""
    return coning_omega(*x)


def pointings(x):
    """The cone angle and that from the z axis meant, from quaternion, rate and moments."""
    body = RigidBody(x[10], PrincipalInertia(x[7:10]))
    meant = SimpleNamespace(attitude=Quaternion([1.0, 0.0, 0.0, 0.0]), omega=x[4:7])
    attitude, omega = Quaternion(x[:4]), x[4:7]
    angle = pointing(attitude, omega, None, body, meant)
    return cone_angle(omega, None, body)[None], angle[None]


def missed_by(x):
    """The angle and the rotation vector from the nominal quaternion to that of the run."""
    attitude, nominal = Quaternion(x[:4]), SimpleNamespace(attitude=Quaternion(x[4:]))
    errors = (attitude_error, attitude_error_x, attitude_error_y, attitude_error_z)
    return jnp.stack([error(attitude, nominal) for error in errors])


def laid_along(x):
    """The matrix of an attitude along the velocity, from position, velocity, lead and tilt."""
    return attitude_along("velocity", x[:3], x[3:6], x[6], x[7:]).matrix().reshape(-1)


def laid_by_angles(x):
    return attitude_from_angles(x[:3], x[3:]).wxyz


def tidal_energy(x):
    """From place, attitude, moments and mu."""
    return gravity_gradient_energy(x[:3], Quaternion(x[3:7]), PrincipalInertia(x[7:10]), x[10])[
        None
    ]


def release(x):
    """Of a yo-yo, from I, R, m, cord, angle and first spin."""
    yoyo = YoYo(x[0], x[1], x[2], x[3])
    lengths = zero_spin_cord_length(x[0], x[1], x[2]), yoyo.inertia_ratio
    return tuple(
        f[None] for f in (*lengths, yoyo.mass_speed(x[4], x[5]), yoyo.unwinding_time(x[5]))
    )


def herpolhode(x):
    """Radii, plane and rate from moments and omega."""
    found = Polhode.of(x[:3], x[3:6])
    return (
        *(r[None] for r in found.herpolhode_radii),
        found.plane_distance[None],
        *found.vertices,
    )


def pendulum(x):
    """Conical rate and state from length, gravity, angles and rates."""
    one = SphericalPendulum(x[0], x[1])
    y = one.state(*x[2:])
    return one.conical_rate(x[2])[None], y.direction, y.direction_rate


def top_angles(x):
    """Angles and rates of a top, and its state, from quaternion and omega."""
    y = BodyState(attitude=Quaternion(x[:4]), omega=x[4:7])
    return Top.angles(y), Top.rates(y)


def top_state(x):
    y = Top.state(x[:3], x[3:])
    return y.attitude.wxyz, y.omega


def by_momentum(x):
    """Both precessions from A, C, W l, the angle and h_Z."""
    return tuple(f[None] for f in Top(x[0], x[1], x[2]).precession_rates_from_momentum(x[3], x[4]))


def growth(x):
    """From A, C, W l and n."""
    return Top(x[0], x[1], x[2]).sleeping_growth_rate(x[3])[None]


def pseudo_potential(x):
    """From A, C, W l, the angle, h_Z and n."""
    return Top(x[0], x[1], x[2]).pseudo_potential(*x[3:])[None]


def pseudo_potential_minimum(x):
    """From A, C, W l, h_Z and n."""
    return Top(x[0], x[1], x[2]).pseudo_potential_minimum(x[3], x[4])[None]


def steady(x):
    """Moment, angle and precession per nutation from A, C, W l, angle, precession and spin."""
    top, given = Top(x[0], x[1], x[2]), x[3:]
    found = top.precession_moment(*given), top.momentum_angle(*given)
    return tuple(f[None] for f in (*found, top.precession_per_nutation(*given)))


def small_nutation(x):
    """Its frequency from A, C, W l, angle, precession and spin."""
    return Top(x[0], x[1], x[2]).nutation_frequency(*x[3:])[None]


def large_nutation(x):
    """Third root, mean precession and turning points from N, alpha, beta and gamma."""
    found = Nutation.of(*x)
    numbers = found.third_root, found.mean_precession_rate, *found.turning_points
    return tuple(f[None] for f in numbers)


def second_order(x):
    """Drift, offset and limits of the walk from theta, its rate, H, J, I_1 and I_2."""
    walk = GimbalWalk(*x)
    found = walk.drift_to_second_order, walk.offset_to_second_order, walk.frequency
    found = *found, *walk.second_harmonic, walk.greatest_rate, walk.outer_inertia(x[0])
    return tuple(f[None] for f in found)


def walk_offset(x):
    return GimbalWalk(*x).offset[None]


def gyro_rates(x):
    """State, rate and frequency from A, C, n, B_i, C_i, C_0, theta and both rates."""
    gyro = TwoGimbalGyro(x[0], x[1], x[2], 0.0, x[3], x[4], x[5])
    y = gyro.state(x[6], 0.0 * x[6], x[7], x[8])
    found = gyro.outer_rate(y), gyro.nutation_frequency(x[6]), gyro.outer_inertia(x[6])
    drift = gyro.walk(x[6], x[7]).drift_to_second_order
    numbers = (*found, gyro.inner_inertia, gyro.spin_momentum(), drift)
    return tuple(f[None] for f in (*numbers, y.angular_momentum))


def responses(x):
    """To an impulse and a step, from A, C, n, moment, time and impulse."""
    zero = 0.0 * x[0]
    gyro = TwoGimbalGyro(x[0], x[1], x[2], zero, zero, zero, zero, x[3])
    return tuple(f[None] for f in (*gyro.impulse_response(x[4], x[5]), *gyro.step_response(x[4])))


def swings(x):
    """Angle after a time and time to an angle from C, n, M_Z, theta, time and last angle."""
    one, zero = jnp.ones_like(x[0]), 0.0 * x[0]
    gyro = TwoGimbalGyro(one, x[0], x[1], zero, zero, zero, zero, zero, x[2])
    return gyro.swing(x[4], x[3])[None], gyro.swing_time(x[3], x[5])[None]


ONES = (1.0, 0.0, 0.0, 0.0)
GENERAL = (0.6, -0.3, 0.7, 0.2)
TOP = (1.0, 0.5, 1.0)


def names(of, *methods):
    """ "of.method" for each."""
    return tuple(f"{of}.{method}" for method in methods)


FORMS = (
    Form(
        symmetric,
        names("attitude", "symmetric_flow", "body_precession_rate", "precession_rate"),
        [(*GENERAL, 0.1, -0.2, 2.0, 1.0, 0.5, 3.0), (*ONES, 0.0, 0.0, 2.0, 1.0, 0.5, 3.0),
         (*ONES, 0.3, 0.4, 0.5, 1.0, 1.0, 3.0), (*GENERAL, 0.0, 0.0, 0.0, 1.0, 1.5, 3.0)],
    ),
    Form(coning, ("attitude.coning_omega",),
         [(0.3, 2.0, 1.0, 0.5), (0.0, 2.0, 1.0, 0.5), (1.5707963, 2.0, 1.0, 0.5)]),
    Form(
        pointings,
        names("attitude", "cone_angle", "pointing"),
        [(*GENERAL, 0.1, -0.2, 2.0, 3.0, 2.0, 1.0, 5.0), (*ONES, 0.0, 0.0, 2.0, 3.0, 2.0, 1.0, 5.0),
         (*ONES, 1e-9, 0.0, -2.0, 3.0, 2.0, 1.0, 5.0)],
    ),
    Form(
        missed_by,
        names("attitude", *(f"attitude_error{part}" for part in ("", "_x", "_y", "_z"))),
        [(*GENERAL, *ONES), (*GENERAL, 0.6, -0.3, 0.7, 0.2000001), (1e-9, 1.0, 0.0, 0.0, *ONES)],
    ),
    Form(
        laid_along,
        ("attitude.attitude_along",),
        [(1.0, 0.0, 0.2, 0.1, 1.0, 0.3, 0.4, 0.01, -0.02),
         (1.0, 0.0, 0.0, 1.0, 1e-9, 0.0, 0.0, 0.0, 0.0)],
    ),
    Form(laid_by_angles, ("attitude.attitude_from_angles",),
         [(0.3, 1.1, -0.7, 0.01, 0.02), (0.0, 0.0, 0.0, 0.0, 0.0)]),
    Form(
        tidal_energy,
        ("attitude.gravity_gradient_energy",),
        [(7e6, 1e5, 0.0, *GENERAL, 3.0, 2.0, 1.0, 3.986e14),
         (7e6, 0.0, 0.0, *ONES, 3.0, 2.0, 1.0, 3.986e14)],
    ),
    Form(
        release,
        ("attitude.zero_spin_cord_length",
         *names("attitude.YoYo", "inertia_ratio", "mass_speed", "unwinding_time")),
        [(2.0, 0.5, 0.1, 4.5, 3.0, 5.0), (2.0, 0.5, 0.1, 4.5, 0.0, 5.0),
         (2.0, 0.5, 0.1, 4.5, 9.0553851381374173, 5.0)],
    ),
    Form(
        herpolhode,
        names("attitude.Polhode", "of", "herpolhode_radii"),
        [(3.0, 2.0, 1.0, 0.4, 0.9, 1.1), (3.0, 2.0, 1.0, 1.0, 1e-9, 1e-9),
         (3.0, 2.0, 1.0, 0.57735, 1.0, 1.0), (2.0, 2.0, 1.0, 0.1, 0.2, 1.0)],
    ),
    Form(
        pendulum,
        names("attitude.SphericalPendulum", "conical_rate", "state"),
        [(1.2, 9.8, 0.7, 0.2, 0.3, 1.1), (1.2, 9.8, 0.0, 0.0, 0.0, 0.0),
         (1.2, 9.8, 1.5707963, 0.2, 0.3, 1.1)],
    ),
    Form(
        top_angles,
        names("attitude.Top", "angles", "rates"),
        [(*GENERAL, 0.1, 0.2, 3.0), (1.0, 1e-7, -1e-7, 0.3, 0.1, 0.2, 3.0),
         (1e-7, 1.0, 0.3, 1e-7, 0.1, 0.2, 3.0)],
    ),
    Form(top_state, ("attitude.Top.state",),
         [(0.2, 0.7, 0.1, 1.0, 0.3, 149.0), (0.2, 0.0, 0.1, 1.0, 0.0, -1.0)]),
    Form(
        by_momentum,
        ("attitude.Top.precession_rates_from_momentum",),
        [(*TOP, 0.7, 2.0), (*TOP, 0.7, 1e5), (*TOP, 0.0, 2.0), (*TOP, 1.5707963, 2.0),
         (1.0, 0.5, -1.0, 0.7, -0.1)],
    ),
    Form(growth, ("attitude.Top.sleeping_growth_rate",),
         [(*TOP, 1.0), (*TOP, 4.0), (*TOP, 0.0), (1.0, 0.5, 1.0, 3.9999999)]),
    Form(pseudo_potential, ("attitude.Top.pseudo_potential",),
         [(*TOP, 0.7, 1.5, 4.0), (*TOP, 0.0, 2.0, 4.0), (*TOP, 1e-8, 2.0, 4.0),
          (*TOP, 3.1415926, -2.0, 4.0)]),
    Form(pseudo_potential_minimum, ("attitude.Top.pseudo_potential_minimum",),
         [(*TOP, 1.5, 4.0), (*TOP, 1.9999, 4.0), (*TOP, -1.5, 4.0), (1.0, 0.5, -1.0, 1.5, 4.0)],
         exact=twins.pseudo_potential_minimum),
    Form(
        steady,
        names("attitude.Top", "precession_moment", "momentum_angle", "precession_per_nutation"),
        [(*TOP, 0.7, 0.3, 8.0), (*TOP, 1e-6, 0.3, 8.0), (*TOP, 0.7, 5.0, 0.0)],
    ),
    Form(
        small_nutation,
        ("attitude.Top.nutation_frequency",),
        [(*TOP, 0.7, 0.3, 8.0), (*TOP, 0.0, 0.3, 4.0), (*TOP, 1.0, 0.0, 2.9402),
         (*TOP, 2.0, 1.0, 0.0)],
    ),
    Form(
        large_nutation,
        names("attitude.Nutation", "of", "third_root", "mean_precession_rate"),
        [(4.0, 1.5, 2.0, 3.0), (0.0, 0.5, 2.0, 0.0), (4.0, 2.0, 2.0, 4.0), (1.0, 1.0, -2.0, 0.3)],
    ),
    Form(
        second_order,
        names("gyros.GimbalWalk", "drift_to_second_order", "offset_to_second_order", "frequency",
              "second_harmonic",
              "greatest_rate", "outer_inertia"),
        [(1.1, 0.3, 1.0, 1.0, 0.6, 1.3), (1.5707963, 0.3, 1.0, 1.0, 0.6, 1.3),
         (1e-6, 1e-9, 1.0, 1.0, 0.6, 1.3), (1.1, 0.3, 1.0, 1.0, 1.3, 1.3)],
    ),
    Form(walk_offset, ("gyros.GimbalWalk.offset",),
         [(1.1, 0.3, 1.0, 1.0, 0.6, 1.3), (1.1, 1e-6, 1.0, 1.0, 0.6, 1.3)]),
    Form(
        gyro_rates,
        names("gyros.TwoGimbalGyro", "state", "outer_rate", "nutation_frequency", "outer_inertia",
              "inner_inertia", "spin_momentum", "walk"),
        [(0.002, 0.0008, 500.0, 5e-4, 4e-4, 1.5e-3, 1.05, 0.1, 2.0),
         (0.002, 0.0008, 500.0, 5e-4, 4e-4, 1.5e-3, 1e-6, 0.1, 2.0)],
    ),
    Form(
        responses,
        names("gyros.TwoGimbalGyro", "impulse_response", "step_response"),
        [(0.002, 0.0008, 500.0, 1e-3, 0.01, 1e-3), (0.002, 0.0008, 500.0, 1e-3, 0.0, 1e-3),
         (0.002, 0.0008, 500.0, 1e-3, 1e-6, 1e-3)],
    ),
    Form(
        swings,
        names("gyros.TwoGimbalGyro", "swing", "swing_time"),
        [(0.0008, 500.0, 1e-3, 1.0, 20.0, 0.9), (0.0008, 500.0, 1e-3, 1.0, 0.0, 1.0),
         (0.0008, 500.0, 1e-3, 1e-4, 0.0, 1e-4)],
    ),
)  # fmt: skip
