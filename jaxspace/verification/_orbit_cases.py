"""Hard cases of orbits: every conic, its elements, and transfers. Units with mu = 1."""

import math

import jax.numpy as jnp
from jaxtyping import Array

from ..orbits import ClassicalElements
from ..orbits.elements import (
    apoapsis_radius,
    elements_from_state,
    inclination,
    periapsis_radius,
    semi_major_axis,
    state_from_elements,
)
from ..orbits.kepler import kepler_flow
from ..orbits.lambert import lambert, least_duration
from ..orbits.oblateness import oblateness
from ._case import Case


def kepler(x: Array) -> Array:
    """Position and velocity from position, velocity, duration and mu."""
    return jnp.concatenate(kepler_flow(x[:3], x[3:6], x[6], x[7]))


def elements(x: Array) -> Array:
    """p, e, i, node, argument and anomaly from position, velocity and mu."""
    result = elements_from_state(x[:3], x[3:6], x[6])
    angles = (result.inclination, result.node, result.argument_of_periapsis, result.true_anomaly)
    return jnp.stack([result.semi_latus_rectum, result.eccentricity, *angles])


def state(x: Array) -> Array:
    """Position and velocity from p, e, i, node, argument, anomaly and mu."""
    return jnp.concatenate(state_from_elements(ClassicalElements(*x[:6]), x[6]))


def radii(x: Array) -> Array:
    """Radius of periapsis from position, velocity and mu."""
    return periapsis_radius(x[:3], x[3:6], x[6])[None]


def sizes(x: Array) -> Array:
    """Semi-major axis and radius of apoapsis from position, velocity and mu."""
    given = x[:3], x[3:6], x[6]
    return jnp.stack([semi_major_axis(*given), apoapsis_radius(*given)])


def tilt(x: Array) -> Array:
    """Inclination from position and velocity."""
    return inclination(x[:3], x[3:6])[None]


def transfer(x: Array) -> Array:
    """Both velocities from both places, duration and mu; the short way."""
    normal = jnp.cross(x[:3], x[3:6])
    return jnp.concatenate(lambert(x[:3], x[3:6], x[6], x[7], normal=normal))


def late_transfer(x: Array) -> Array:
    """The same after one whole revolution."""
    normal = jnp.cross(x[:3], x[3:6])
    return jnp.concatenate(lambert(x[:3], x[3:6], x[6], x[7], normal=normal, revolutions=1))


def shortest(x: Array) -> Array:
    """The least duration with one revolution from both places and mu."""
    return least_duration(x[:3], x[3:6], x[6], 1, normal=jnp.cross(x[:3], x[3:6]))[None]


def bulge(x: Array) -> Array:
    """The acceleration by J2 from position, mu, J2 and radius."""
    return oblateness(x[:3], x[3], x[4], x[5])


def on_conic(e: float, f: float, tilt: float = 0.0) -> tuple[float, ...]:
    """Position and velocity at the anomaly f of a conic whose periapsis is 1, turned by `tilt`
    about the line of apsides."""
    # By Python's numbers, so that the inputs are the same on every device.
    r = (1.0 + e) / (1.0 + e * math.cos(f))
    s = 1.0 / math.sqrt(1.0 + e)
    c, n = math.cos(tilt), math.sin(tilt)
    y, v = r * math.sin(f), s * (e + math.cos(f))
    return (r * math.cos(f), y * c, y * n, -s * math.sin(f), v * c, v * n)


CIRCLE = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
WIDE = "the inputs, whose roundings the motion amplifies; the slopes once more"
ANGLES = "angles that are quotients of small numbers"
LOST = "the inputs round onto the singular place"
FAR = "the terms leave the digits of float32"

CASES = (
    # Every conic, close to the parabola from both sides; long and short times.
    Case("orbits: zero time", kepler, (*on_conic(0.3, 1.0, 0.2), 0.0, 1.0)),
    Case("orbits: circle, a quarter turn", kepler, (*CIRCLE, 1.5707963267948966, 1.0)),
    Case("orbits: circle, half a turn", kepler, (*CIRCLE, 3.1415926535897931, 1.0)),
    Case(
        "orbits: ten thousand turns",
        kepler,
        (*on_conic(0.1, 0.5), 62831.0, 1.0),
        WIDE,
        8.0,
        1e6,
        single=FAR,
    ),
    Case("orbits: ellipse of e = 1e-9", kepler, (*on_conic(1e-9, 2.0, 1.0), -2.5, 1.0)),
    Case(
        "orbits: ellipse of e = 0.999 through periapsis",
        kepler,
        (*on_conic(0.999, -2.9), 60.0, 1.0),
        WIDE,
        8.0,
        512.0,
    ),
    Case(
        "orbits: ellipse of e = 1 - 1e-10",
        kepler,
        (*on_conic(1.0 - 1e-10, -2.0), 30.0, 1.0),
        WIDE,
        8.0,
        256.0,
    ),
    Case("orbits: parabola", kepler, (1.0, 0.0, 0.0, 0.0, math.sqrt(2.0), 0.0, 5.0, 1.0)),
    Case("orbits: parabola, exact", kepler, (2.0, 0.0, 0.0, 0.0, 1.0, 0.0, -4.0, 1.0)),
    Case("orbits: hyperbola of e = 1 + 1e-12", kepler, (*on_conic(1.0 + 1e-12, 1.0), 40.0, 1.0)),
    Case(
        "orbits: hyperbola of e = 100 from afar",
        kepler,
        (*on_conic(100.0, -1.57), 120.0, 1.0),
        WIDE,
        16.0,
        1e6,
        single=FAR,
    ),
    Case(
        "orbits: flyby from 1e4 radii",
        kepler,
        (*on_conic(1.5, -2.3004), 14000.0, 1.0),
        WIDE,
        16.0,
        64.0,
        single=FAR,
    ),
    Case("orbits: a short time", kepler, (*on_conic(0.7, 2.0, 0.4), 1e-7, 1.0)),
    # At the circle and over the equator angles lose their meaning.
    Case(
        "orbits: elements of an inclined ellipse",
        elements,
        (*on_conic(0.4, 1.2, 0.7), 1.0),
        ANGLES,
        8.0,
        64.0,
    ),
    Case(
        "orbits: elements, i = 1e-6",
        elements,
        (*on_conic(0.4, 1.2, 1e-6), 1.0),
        ANGLES,
        8.0,
        64.0,
        single=LOST,
    ),
    Case(
        "orbits: elements, e = 1e-6",
        elements,
        (*on_conic(1e-6, 1.2, 0.7), 1.0),
        ANGLES,
        8.0,
        1e6,
        single=LOST,
    ),
    Case(
        "orbits: elements, retrograde by 1e-5",
        elements,
        (*on_conic(0.4, 1.2, math.pi - 1e-5), 1.0),
        ANGLES,
        8.0,
        64.0,
        single=LOST,
    ),
    Case(
        "orbits: elements of a parabola",
        elements,
        (*on_conic(1.0, 1.9, 0.7), 1.0),
        ANGLES,
        8.0,
        64.0,
    ),
    # From elements there is no singular place but the asymptote, where the distance is infinite.
    Case(
        "orbits: state on the circle over the equator", state, (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    ),
    Case("orbits: state, e and i of 1e-12", state, (1.0, 1e-12, 1e-12, 0.3, 0.4, 0.5, 1.0)),
    Case(
        "orbits: state beside the asymptote",
        state,
        (2.5, 1.5, 0.4, 0.3, 0.2, 2.3, 1.0),
        WIDE,
        8.0,
        4096.0,
    ),
    Case(
        "orbits: state far out on the parabola",
        state,
        (2.0, 1.0, 0.4, 0.3, 0.2, 3.1, 1.0),
        WIDE,
        8.0,
        512.0,
    ),
    # 1/a vanishes on the parabola, and |e| has a corner on the circle.
    Case("orbits: periapsis of a parabola", radii, (2.0, 0.0, 0.0, 0.6, 0.8, 0.0, 1.0)),
    Case(
        "orbits: periapsis of a circle",
        radii,
        (*CIRCLE, 1.0),
        "|e| has no derivative at zero: the mean of both sides",
        value=(1.0,),
        slopes=((2.0, 0.0, 0.0, 0.0, 2.0, 0.0, -1.0),),
    ),
    Case(
        *("orbits: size of a parabola", sizes, (2.0, 0.0, 0.0, 0.6, 0.8, 0.0, 1.0), "exact"),
        value=(math.inf, math.inf),
        slopes=((0.0,) * 7,) * 2,
        single="0.6 and 0.8 are no parabola in float32",
    ),
    # The arc cosine has lost half of the digits at both ends.
    Case("orbits: inclination of 1e-12", tilt, on_conic(0.4, 1.2, 1e-12)),
    Case(
        "orbits: inclination beside half a turn",
        tilt,
        on_conic(0.4, 1.2, math.pi - 1e-7),
        single=LOST,
    ),
    # The plane is undefined at no turn and at half a turn; the conic is a root to find.
    Case(
        "orbits: transfer over 1e-6 rad",
        transfer,
        (1.0, 0.0, 0.0, 1.0, 1e-6, 1e-7, 1e-6, 1.0),
        WIDE,
        16.0,
        1e6,
        single="",
    ),
    Case(
        "orbits: transfer beside half a turn",
        transfer,
        (1.0, 0.0, 0.0, -1.2, 1e-5, 3e-6, 3.0, 1.0),
        "the plane is a quotient of numbers of 1e-5",
        8.0,
        64.0,
        single=LOST,
    ),
    Case(
        "orbits: transfer on the parabola",
        transfer,
        (1.0, 0.0, 0.0, 0.0, 2.0, 0.0, 1.4868, 1.0),
        WIDE,
        8.0,
        64.0,
    ),
    Case(
        "orbits: fast transfer",
        transfer,
        (1.0, 0.0, 0.0, -0.5, 1.7, 0.3, 1e-3, 1.0),
        WIDE,
        8.0,
        64.0,
    ),
    Case(
        "orbits: slow transfer",
        transfer,
        (1.0, 0.0, 0.0, -0.5, 1.7, 0.3, 300.0, 1.0),
        WIDE,
        16.0,
        128.0,
    ),
    Case(
        "orbits: transfer after one revolution",
        late_transfer,
        (1.0, 0.0, 0.0, 0.2, 1.1, 0.1, 15.0, 1.0),
        WIDE,
        16.0,
        128.0,
    ),
    Case(
        "orbits: least duration of one revolution",
        shortest,
        (1.0, 0.0, 0.0, 0.2, 1.1, 0.1, 1.0),
        WIDE,
        16.0,
        128.0,
    ),
    # No longitude over the pole; units in which the terms differ by many powers of ten.
    Case("orbits: J2 over the pole", bulge, (0.0, 0.0, 1.1, 1.0, 1e-3, 1.0)),
    Case(
        "orbits: J2 in metres",
        bulge,
        (4.1e7, 3.0e6, -8.0e6, 3.986004418e14, 1.08262668e-3, 6378137.0),
    ),
)
