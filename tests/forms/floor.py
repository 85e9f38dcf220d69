"""Closed forms of core, rotations and bodies."""

import jax.numpy as jnp
import twins

from jaxspace.bodies import BurningBody, InertiaTensor, PrincipalInertia
from jaxspace.bodies.inertia import kinetic_energy, parallel_axes
from jaxspace.bodies.newton_euler import angular_acceleration, linear_acceleration
from jaxspace.bodies.principal_axes import principal_axes, tensor_function
from jaxspace.core import Spline, Table
from jaxspace.core.elliptic import complete_first
from jaxspace.core.safe import phi2, safe_divide
from jaxspace.core.special import stumpff_near
from jaxspace.core.vectors import cross, dot, inverse_norm, matvec, scale, solve3
from jaxspace.rotations import Quaternion
from jaxspace.rotations.euler_angles import euler_rates_from_omega, omega_from_euler_rates

from .form import Form


def products(x):
    """Of two vectors."""
    a, b = x[:3], x[3:6]
    return dot(a, b)[None], cross(a, b), inverse_norm(a, 3)[None], scale(x[6], a)


def linear(x):
    """Product and solution from a matrix and a vector."""
    m = x[:9].reshape(3, 3)
    return matvec(m, x[9:]), solve3(m, x[9:])


def quotient(x):
    return safe_divide(x[0], x[1])[None]


def first_kind(x):
    """R_F(0, y, z) from sum and product of the roots."""
    return complete_first(x[0], x[1])[None]


def second_exponential_quotient(x):
    return phi2(x[0])[None]


def stumpff_within(x):
    return tuple(stumpff_near(x))


def polygon(x):
    """A table of four values at the time of the last input."""
    return Table([0.0, 1.0, 2.5, 3.0], x[:4])(x[4])[None]


def cubic(x):
    """The same nodes, by a spline."""
    return Spline([0.0, 1.0, 2.5, 3.0], x[:4])(x[4])[None]


def turned_vectors(x):
    """Of a quaternion and a vector."""
    q, v = Quaternion(x[:4]), x[4:]
    return q.rotate(v), q.rotate_back(v), q.rate(v).wxyz


def quaternion_products(x):
    """Of two quaternions."""
    q, p = Quaternion(x[:4]), Quaternion(x[4:])
    ones = q.norm_squared[None], q.normalised().wxyz, q.inverse().wxyz
    return q.then(p).wxyz, q.matrix().reshape(-1), *ones


def about_an_axis(x):
    return Quaternion.about(1, x[0]).wxyz


def by_its_matrix(x):
    """The quaternion of a matrix, as squares and products, which have no sign to choose."""
    q = Quaternion.from_matrix(Quaternion(x).matrix()).wxyz
    return (q[:, None] * q[None, :]).reshape(-1)


def on_the_group(x):
    """Steps and rates of the group's coordinates, from quaternion, coordinates and rate."""
    q, local = Quaternion(x[:4]), x[4:7]
    moved = q.moved(local)
    return moved.wxyz, moved.coordinate_rate(local, moved.rate(x[7:]))


def euler_rates(x):
    """There and back, for two sequences, from angles and vector."""
    a, v = x[:3], x[3:]
    return tuple(
        rates(a, v, sequence)
        for rates in (omega_from_euler_rates, euler_rates_from_omega)
        for sequence in ("313", "321")
    )


def tensor(x):
    """The inertia of its six elements."""
    a, b, c, d, e, f = x
    return InertiaTensor(jnp.stack([a, d, e, d, b, f, e, f, c]).reshape(3, 3))


def momentum(x):
    """Momentum, rate and energy from a tensor and a vector."""
    inertia, v = tensor(x[:6]), x[6:]
    return inertia.times(v), inertia.solve(v), kinetic_energy(inertia, v)[None]


def eulers_equations(x):
    """From moments, rate and torque."""
    inertia = PrincipalInertia(x[:3])
    return angular_acceleration(inertia, x[3:6], x[6:]), inertia.times(x[6:]), inertia.solve(x[6:])


def other_axes(x):
    """About another point, from six elements, mass and offset; and with other moments added."""
    inertia = tensor(x[:6])
    moved = parallel_axes(inertia, x[6], x[7:]).matrix()
    return moved.reshape(-1), inertia.plus_diagonal(x[7:]).matrix().reshape(-1)


def sum_of_loads(x):
    return linear_acceleration(x[:3], x[3:6], x[6])


def burning(x):
    """Inertia, its rate by the mass and centre, from dry mass, moments, radii of gyration, station
    and mass."""
    body = BurningBody(x[0], PrincipalInertia(x[1:4]), x[4:7], x[7])
    diagonal = body.inertia(x[8]).times(jnp.ones(3, x.dtype))
    return diagonal, body.inertia_per_mass(x[8]), body.centre_of_mass(x[8])


def principal_moments(x):
    return principal_axes(tensor(x))[0]


def root_of_tensor(x):
    return tensor_function(jnp.sqrt, tensor(x)).matrix().reshape(-1)


ONES = (1.0, 0.0, 0.0, 0.0)
GENERAL = (0.6, -0.3, 0.7, 0.2)
BODY = (3.0, 2.0, 1.5, 0.1, -0.2, 0.15)
NEARLY_EQUAL = (2.0, 2.0 + 1e-9, 2.0 - 1e-9, 1e-9, 0.0, 1e-9)
QUATERNION = "rotations.Quaternion."

FORMS = (
    Form(
        products,
        ("core.dot", "core.cross", "core.inverse_norm", "core.scale"),
        [(1.0, 2.0, 3.0, 3.0, 2.0, 1.0, 0.5), (1.0, 1e-8, 0.0, 1.0, 0.0, 1e-8, 2.0)],
    ),
    Form(
        linear,
        ("core.matvec", "core.solve3"),
        [
            (2.0, 0.1, 0.2, 0.1, 3.0, 0.4, 0.2, 0.4, 1.0, 1.0, -2.0, 0.5),
            (1.0, 2.0, 3.0, 1.0, 2.0, 3.0 + 1e-9, 0.0, 1.0, 0.0, 1.0, 1.0, 0.3),
        ],
    ),
    Form(
        second_exponential_quotient,
        ("core.phi2",),
        [(0.5,), (0.0,), (1e-9,), (-0.9999999,), (1.0,), (30.0,), (-700.0,)],
    ),
    Form(quotient, ("core.safe_divide",), [(1.0, 3.0), (1e-30, 1e-30)]),
    Form(first_kind, ("core.complete_first",), [(2.0, 1.0), (1.0, 1e-12), (3.0, 1.0)]),
    Form(stumpff_within, ("core.stumpff_near",), [(0.0,), (-9.8,), (9.86,), (1e-9,)]),
    Form(
        polygon,
        ("core.Table", "core.polygon"),
        [(1.0, 3.0, -1.0, 2.0, 1.7), (1.0, 1.0, 1.0, 1.0, 0.3), (0.0, 1.0, 2.0, 3.0, 2.5)],
    ),
    Form(
        cubic,
        ("core.Spline",),
        [(1.0, 3.0, -1.0, 2.0, 1.7), (1.0, 1.0, 1.0, 1.0, 0.3), (0.0, 1.0, 2.0, 3.0, 2.5)],
        exact=twins.cubic,
    ),
    Form(
        turned_vectors,
        tuple(QUATERNION + name for name in ("rotate", "rotate_back", "rate")),
        [(*GENERAL, 1.0, -2.0, 0.5), (*ONES, 1.0, 1e-9, 0.0), (1e-9, 1.0, 0.0, 0.0, 0.3, 2.0, 1.0)],
    ),
    Form(
        quaternion_products,
        tuple(
            QUATERNION + name
            for name in ("then", "matrix", "norm_squared", "normalised", "inverse")
        ),
        [(*GENERAL, 0.1, 0.9, -0.2, 0.3), (*ONES, 1.0, 1e-9, 0.0, 0.0)],
        vectors=(4, 4),
    ),
    Form(about_an_axis, (QUATERNION + "about",), [(0.0,), (3.141592653589793,), (1e-9,), (100.0,)]),
    Form(
        by_its_matrix,
        (QUATERNION + "from_matrix",),
        [GENERAL, ONES, (1e-9, 0.7, 0.7, 0.1), (0.5, 0.5, 0.5, 0.5), (0.0, 1.0, 0.0, 1e-12)],
    ),
    Form(
        on_the_group,
        (QUATERNION + "moved", QUATERNION + "coordinate_rate"),
        [
            (*GENERAL, 0.1, 0.2, -0.1, 1.0, 2.0, 3.0),
            (*GENERAL, 0.0, 0.0, 0.0, 1.0, 2.0, 3.0),
            (*GENERAL, 0.3, 0.1, 0.0, 1.0, 2.0, 3.0),
            (*GENERAL, 3.0, 0.5, 0.5, 1.0, 2.0, 3.0),
        ],
    ),
    Form(
        euler_rates,
        ("rotations.omega_from_euler_rates", "rotations.euler_rates_from_omega"),
        [(0.4, 1.1, -0.7, 0.3, 0.2, 1.0), (0.4, 1e-6, -0.7, 0.3, 0.2, 1.0),
         (0.4, 1.570796, -0.7, 0.3, 0.2, 1.0)],
    ),
    Form(
        momentum,
        (
            *(f"bodies.InertiaTensor.{name}" for name in ("times", "solve", "matrix")),
            "bodies.kinetic_energy",
        ),
        [(*BODY, 1.0, 2.0, -1.0), (*NEARLY_EQUAL, 1.0, 2.0, -1.0),
         (1.0, 1.0, 1e-6, 0.0, 1e-7, 0.0, 1.0, 2.0, -1.0)],
    ),
    Form(
        eulers_equations,
        (
            "bodies.angular_acceleration",
            *(f"bodies.PrincipalInertia.{name}" for name in ("times", "solve")),
        ),
        [(3.0, 2.0, 1.0, 0.3, -0.4, 0.5, 0.1, 0.0, -0.2),
         (2.0, 2.0, 2.0, 0.3, -0.4, 0.5, 0.0, 0.0, 0.0)],
    ),
    Form(
        other_axes,
        ("bodies.parallel_axes", "bodies.InertiaTensor.plus_diagonal"),
        [(*BODY, 4.0, 0.3, -0.2, 0.1), (*BODY, 4.0, 0.0, 0.0, 0.0)],
    ),
    Form(sum_of_loads, ("bodies.linear_acceleration",), [(1.0, 2.0, 3.0, -4.0, 5.0, 6.0, 2.0)]),
    Form(
        burning,
        (
            *(f"bodies.BurningBody.{name}" for name in ("inertia", "inertia_per_mass")),
            *("bodies.BurningBody.centre_of_mass", "bodies.PrincipalInertia.plus_diagonal"),
        ),
        [(1100.0, 520.0, 560.0, 340.0, 0.42, 0.42, 0.4, -0.6, 1700.0),
         (1100.0, 520.0, 560.0, 340.0, 0.42, 0.42, 0.0, 0.0, 1100.0)],
    ),
    Form(
        principal_moments,
        ("bodies.principal_axes",),
        [BODY, NEARLY_EQUAL, (2.0, 2.0, 2.0, 0.0, 0.0, 0.0), (1.0, 1.0, 2.0, 1e-9, 0.0, 0.0)],
    ),
    Form(
        root_of_tensor,
        ("bodies.tensor_function",),
        [BODY, NEARLY_EQUAL, (2.0, 2.0, 2.0, 0.0, 0.0, 0.0), (1.0, 1.0, 1.9, 1e-9, 0.0, 0.0)],
    ),
)  # fmt: skip
