"""Closed forms of gyros in gimbals: friction of bearings, motors, blows and arrests."""

import jax.numpy as jnp

from jaxspace import gyros as g

from .form import Form
from .instruments import of
from .mechanics import numbers


def rubbing(x):
    """Moments and margins of a smooth and of a dry bearing, and of a motor: viscous and dry
    friction, creep, rate, acting moment, gain, speed."""
    smooth, dry = g.bearing.BearingFriction(*x[:3]), g.bearing.BearingFriction(*x[:2])
    moments = smooth.moment(x[3], None), dry.moment(x[3], jnp.sign(x[3]))
    margins = dry.margin(x[3], x[4], 0.0), dry.margin(x[3], x[4], jnp.sign(x[3]))
    motor = g.bearing.RotorMotor(x[5], x[6]).torque(x[3])
    return numbers(*moments, *margins, dry.slip_at_rest(x[4]), motor)


def blows(x):
    """A gyro after a blow, after an arrest and after a bearing has stopped; its energy, margins and
    the impulses of a turn: 7 numbers, angles, rate, momentum, two impulses and the turn."""
    rubbed = g.bearing.BearingFriction(0.01, 0.02), g.bearing.BearingFriction(0.02, 0.03)
    gyro = g.TwoGimbalGyro(*x[:7], inner_bearing=rubbed[0], outer_bearing=rubbed[1])
    slips = jnp.sign(x[9]), jnp.ones_like(x[9])
    y = g.GimbalState(*x[7:11], None, *slips)
    struck = gyro.struck(y, x[11], x[12])
    still, *impulses = gyro.arrested(struck)
    stopped = gyro.stick_or_slip(0.0, y)
    states = numbers(*(f for s in (struck, still, stopped) for f in _moving(s)))
    figures = (
        gyro.energy(struck),
        gyro.friction_margin(0.0, y),
        g.gimbal_state.near_gimbal_lock(0.0, y),
    )
    return *states, *numbers(*figures, *impulses, *gyro.attitude_change(x[13]))


def _moving(y):
    return y.theta_rate, y.angular_momentum, y.slip_inner, y.slip_outer


GYRO = (0.002, 0.0008, 500.0, 0.0006, 0.0005, 0.0004, 0.0015)

FORMS = (
    Form(
        rubbing,
        (
            *of("BearingFriction", "moment", "margin", "slip_at_rest"),
            "gyros.RotorMotor.torque",
        ),
        [
            (0.01, 0.02, 0.5, 0.3, 0.015, 1e-3, 450.0),
            (0.01, 0.02, 0.5, -30.0, -0.03, 1e-3, 450.0),
            (0.0, 0.02, 0.5, 0.0, 0.02, 1e-3, 0.0),
        ],
    ),
    Form(
        blows,
        (
            *of("TwoGimbalGyro", "arrested", "attitude_change", "energy", "friction_margin"),
            *of("TwoGimbalGyro", "stick_or_slip", "struck"),
            "gyros.near_gimbal_lock",
        ),
        [
            (*GYRO, 1.05, 0.1, 2.0, 0.2, 1e-3, -2e-3, 0.4),
            (*GYRO, 1.5707963267948966, 0.0, 0.0, 0.0, 0.0, 0.0, 1e-9),
            (*GYRO, 1e-3, 0.1, 0.1, 0.4, 1e-3, 0.0, 3.1),
        ],
    ),
)
