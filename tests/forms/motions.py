"""Motions whose forms iterate or step, against written twins: a top, turning points, a turn."""

import jax.numpy as jnp
import twins

from jaxspace.attitude import Top
from jaxspace.bodies import BodyState
from jaxspace.orbits.radial_motion import turning_points
from jaxspace.rockets import GravityTurnState
from jaxspace.rockets.gravity_turn import gravity_turn_after
from jaxspace.rotations import Quaternion

from .form import Form
from .mechanics import numbers
from .paths import yukawa


def top_motion(x):
    """Attitude and rate of a top later: A, C and W l, attitude, rate and time."""
    later = (
        Top(*x[:3]).closed_form().flow(x[10], BodyState(attitude=Quaternion(x[3:7]), omega=x[7:10]))
    )
    return later.attitude.wxyz, later.omega


def top_turns(x):
    """Euler's angles of it, with all turns."""
    y = BodyState(attitude=Quaternion(x[3:7]), omega=x[7:10])
    return numbers(*Top(*x[:3]).closed_form().angles(x[10], y))


def turning_radii(x):
    """Of a motion in a fading attraction, from position and velocity."""
    return numbers(*turning_points(yukawa, x[:3], x[3:]))


def turned_by_gravity(x):
    """The state of a gravity turn later: time, thrust ratio, gravity, speed and angle."""
    zero = 0.0 * x[0]
    y = gravity_turn_after(*x[:3], GravityTurnState(x[3], x[4], zero, zero))
    return jnp.stack([y.range, y.height]), *numbers(y.speed, y.angle)


TOP = (1.0, 0.6, 0.8)
LEANING = (0.9, 0.3, 0.2, -0.1)
TURNED = (
    (*TOP, *LEANING, 0.3, -0.2, 2.0, 1.5),
    # A slow one that loops; one that hangs; one without spin.
    (*TOP, *LEANING, 0.0, 0.0, 2.0, 2.0),
    (1.0, 0.6, -0.8, *LEANING, 0.1, 0.4, 1.0, 1.5),
    (*TOP, *LEANING, 0.3, -0.2, 0.0, 1.5),
)
UPRIGHT = (
    # Upright at the critical spin and below it, next to the separatrix, and at rest.
    (*TOP, 1.0, 0.0, 0.0, 0.0, 1e-3, 0.0, 2.981423969999719, 2.0),
    (*TOP, 1.0, 1e-6, 0.0, 0.0, 0.0, 0.0, 1.0, 2.0),
    (*TOP, *LEANING, 0.3, -0.2, 2.0, 0.0),
)

FORMS = (
    Form(top_motion, ("attitude.TopMotion.flow",), (*TURNED, *UPRIGHT), exact=twins.top_motion),
    Form(top_turns, ("attitude.TopMotion.angles",), TURNED, exact=twins.top_turns),
    Form(
        turning_radii,
        ("orbits.turning_points",),
        [
            (1.1, 0.2, 0.3, 0.1, 0.8, -0.2),
            (1.0, 0.0, 0.0, 0.0, 0.9, 0.0),
            (1.0, 0.0, 0.0, 1e-7, 1.0, 0.0),
            (1.0, 0.0, 0.0, 0.9, 0.01, 0.0),
        ],
        exact=twins.turning_radii,
    ),
    Form(
        turned_by_gravity,
        ("rockets.gravity_turn_after",),
        [
            (10.0, 1.5, 9.81, 100.0, 0.2),
            (10.0, 1.0, 9.81, 100.0, 0.2),
            (10.0, 0.5, 9.81, 100.0, 1e-6),
            (-2.0, -1.2, 9.81, 100.0, 0.0),
            (0.0, 2.0, 9.81, 100.0, 0.2),
        ],
        exact=twins.turned_by_gravity,
    ),
)
