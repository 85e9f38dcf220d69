"""Closed forms of bodies and rotations."""

import jax.numpy as jnp

from jaxspace import bodies as b
from jaxspace import rotations as r
from jaxspace.rotations import Quaternion

from .form import Form


def _numbers(part):
    return part.mass[None], part.centre, part.tensor.reshape(-1)


def boxes(x):
    """A box, an ellipsoid, a hollow sphere: mass, three lengths, inner radius."""
    found = (
        b.solids.box(x[0], x[1:4]),
        b.solids.ellipsoid(x[0], x[1:4]),
        b.solids.sphere(x[0], x[1], x[4]),
    )
    return tuple(part.tensor.reshape(-1) for part in found)


def round_solids(x):
    """A tube, a frustum and its shell: mass, radius, height, second radius."""
    found = b.solids.cylinder(*x), b.solids.cone(*x), b.solids.conical_shell(*x)
    return tuple(y for part in found for y in (part.centre, part.tensor.reshape(-1)))


def points(x):
    """Two particles and a triangle: masses, six and nine coordinates."""
    set_of_two = b.solids.particles(x[:2], x[2:8].reshape(3, 2))
    return *_numbers(set_of_two), *_numbers(b.solids.simplex(x[0], x[2:11].reshape(3, 3)))


def put_together(x):
    """Two boxes, one moved and turned, and the moment about an axis."""
    one, other = b.solids.box(x[0], x[1:4]), b.solids.box(x[4], x[5:8])
    turned = other.turned(Quaternion.from_rotation_vector(x[11:14])).moved(x[8:11])
    whole = b.mass_properties.combined(one, turned)
    moment = whole.moment_about(x[14:17], x[17:20])
    about, moments = whole.about(x[17:20]), whole.inertia.matrix()
    rest = b.mass_properties.combined(whole, turned.hole())
    return *_numbers(whole), about.reshape(-1), moment[None], moments.reshape(-1), rest.mass[None]


def held(x):
    """The motion after a stop of one point: moments, mass, arm, velocity, rate."""
    found = b.mass_properties.pivot_impact(
        b.PrincipalInertia(x[:3]), x[3], x[4:7], x[7:10], x[10:13]
    )
    return found.omega, found.velocity, found.impulse, found.energy_loss[None]


def standard_air(x):
    """Temperature, pressure and density of the standard atmosphere, and both heights."""
    air = b.standard_atmosphere.standard_atmosphere(x[0])
    high = b.standard_atmosphere.geopotential_height(x[0])
    parts = air.temperature, air.pressure, air.density, air.sound_speed
    return tuple(f[None] for f in (*parts, high, b.standard_atmosphere.geometric_height(high)))


def between(x):
    """The orientation on the way between two: two rotation vectors and a share."""
    start, end = (Quaternion.from_rotation_vector(v) for v in (x[:3], x[3:6]))
    return r.interpolation.slerp(start, end, x[6]).matrix().reshape(-1)


def between_rates(x):
    """Orientation and rate between two with their rates."""
    start, end = (Quaternion.from_rotation_vector(v) for v in (x[2:5], x[8:11]))
    found = r.interpolation.interpolate_attitude(x[0], x[1], start, x[5:8], end, x[11:14])
    return found[0].matrix().reshape(-1), found[1]


def vector_rates(x):
    """The rate of a rotation vector, and the angular velocity from a rate."""
    return r.rotation_vector.rotation_vector_rate(
        x[:3], x[3:]
    ), r.rotation_vector.omega_from_rotation_vector_rate(x[:3], x[3:])


def moving(x):
    """Position, velocity and acceleration out of a moving frame, and back."""
    attitude = Quaternion.from_rotation_vector(x[:3])
    frame = r.MovingFrame(attitude, x[3:6], x[6:9], x[9:12], x[12:15], x[15:18])
    out = frame.to_inertial(x[18:21], x[21:24], x[24:27])
    return *out, *frame.from_inertial(x[18:21], x[21:24], x[24:27])


def at_rest(x):
    """The instantaneous centre from position, velocity and rate about z."""
    flat, up = jnp.array([[1.0, 1.0, 0.0], [0.0, 0.0, 1.0]], x.dtype)
    return r.moving_frame.instantaneous_centre(x[:3], x[3:6] * flat, x[6] * up)


def along_the_path(x):
    """Polar components, and those along the path with the curvature."""
    polar = r.moving_frame.polar_components(*x[:5])
    path = r.moving_frame.path_components(x[5:8], x[8:11])
    return tuple(jnp.atleast_1d(f) for f in (*polar, *path))


def axis_and_angle(x):
    """The matrix of a turn about an axis, and axis times angle of a rotation vector."""
    turn = Quaternion.from_axis_angle(x[:3], x[3])
    axis, angle = Quaternion.from_rotation_vector(x[4:7]).axis_angle()
    return turn.matrix().reshape(-1), axis * angle


STILL = (0.0, 0.0, 0.0)
PLACE = (0.3, -0.2, 0.7)

FORMS = (
    Form(
        boxes,
        ("bodies.box", "bodies.ellipsoid", "bodies.sphere"),
        [(2.0, 1.0, 2.0, 3.0, 0.5), (1.0, 1.0, 1e-9, 0.0, 0.9999999), (1.0, 1.0, 1.0, 1.0, 0.0)],
    ),
    Form(
        round_solids,
        ("bodies.cylinder", "bodies.cone", "bodies.conical_shell"),
        [(2.0, 1.0, 2.0, 0.5), (1.0, 1.0, 1e-9, 0.9999999), (1.0, 1.0, 3.0, 0.0)],
    ),
    Form(
        points,
        ("bodies.particles", "bodies.simplex"),
        [(1.0, 2.0, 1.0, 2.0, 3.0, 0.5, 0.1, 0.2, 0.3, 0.4, 0.9), (1.0, 1e-12, *(1.0,) * 9)],
    ),
    Form(
        put_together,
        (
            "bodies.combined",
            "bodies.turned_tensor",
            "bodies.moment_along",
            *(
                f"bodies.MassProperties.{name}"
                for name in ("about", "hole", "inertia", "moment_about", "moved", "turned")
            ),
        ),
        [
            (2.0, 1.0, 2.0, 3.0, 1.0, 0.5, 0.6, 0.7, *PLACE, 0.1, 0.2, 0.3, 1.0, 2.0, 3.0, *PLACE),
            (2.0, 1.0, 2.0, 3.0, 1.0, 0.5, 0.6, 0.7, *STILL, *STILL, 0.0, 0.0, 1.0, *STILL),
        ],
    ),
    Form(
        held,
        ("bodies.pivot_impact", "bodies.PivotImpact"),
        [
            (1.0, 2.0, 2.5, 2.0, *PLACE, 1.0, 2.0, 3.0, 0.1, 0.2, 0.3),
            (1.0, 1.0, 1.0, 1.0, *STILL, 1.0, 0.0, 0.0, 0.1, 0.0, 0.0),
        ],
    ),
    Form(
        standard_air,
        (
            "bodies.standard_atmosphere",
            "bodies.geopotential_height",
            "bodies.geometric_height",
            "bodies.Air",
            "bodies.StandardAtmosphere.density_at",
        ),
        [(5e3,), (1.1e4,), (1.5e4,), (4e4,), (8.6e4,), (9.1e4,), (1.1e5,), (2e5,), (9e5,), (0.0,)],
    ),
    Form(
        between,
        ("rotations.slerp",),
        [(*PLACE, 0.1, 0.2, -0.3, 0.4), (*PLACE, *PLACE, 0.3), (*STILL, 3.14, 0.0, 0.0, 0.5)],
    ),
    Form(
        between_rates,
        ("rotations.interpolate_attitude",),
        [
            (0.3, 1.0, *PLACE, 0.1, 0.2, 0.3, 0.4, 0.5, -0.3, 0.2, 0.1, 0.0),
            (0.5, 1.0, *PLACE, *STILL, *PLACE, *STILL),
        ],
    ),
    Form(
        vector_rates,
        ("rotations.rotation_vector_rate", "rotations.omega_from_rotation_vector_rate"),
        [
            (*PLACE, 1.0, 2.0, 3.0),
            (*STILL, 1.0, 2.0, 3.0),
            (1e-9, 0.0, 0.0, 1.0, 2.0, 3.0),
            (3.1415926, 0.0, 0.0, 1.0, 2.0, 3.0),
        ],
    ),
    Form(
        moving,
        ("rotations.MovingFrame.to_inertial", "rotations.MovingFrame.from_inertial"),
        [
            tuple(0.1 * (k + 1) * (-1.0) ** k for k in range(27)),
            (*STILL, *STILL, *STILL, *STILL, *STILL, *STILL, *PLACE, *PLACE, *PLACE),
        ],
    ),
    Form(
        at_rest,
        ("rotations.instantaneous_centre",),
        [(*PLACE, 1.0, 2.0, 0.0, 0.5), (*PLACE, 0.0, 0.0, 0.0, 1e-9)],
    ),
    Form(
        along_the_path,
        ("rotations.polar_components", "rotations.path_components"),
        [
            (1.0, 0.1, 0.2, 0.3, 0.4, 1.0, 2.0, 3.0, 0.1, 0.2, 0.5),
            (1.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1e-9, 0.0),
        ],
    ),
    Form(
        axis_and_angle,
        ("rotations.Quaternion.from_axis_angle", "rotations.Quaternion.axis_angle"),
        [
            (*PLACE, 1.0, 0.1, 0.2, 0.3),
            (*PLACE, 1e-9, 1e-9, 0.0, 0.0),
            (*PLACE, 3.1415926, 3.1415926, 0.0, 0.0),
        ],
    ),
)
