"""Mass, centre of mass and inertia of uniform solids, shells and rods, each in its local axes.

    simplex of n vertices    int r r^T dm = m / (n (n + 1)) [sum r_i r_i^T + (sum r_i)(sum r_i)^T]
    box                      A = m (b^2 + c^2) / 12
    hollow cylinder          C = m (R^2 + r^2) / 2,   A = C/2 + m l^2 / 12
    frustum, solid           C = 3/10 m (R^4 + R^3 r + R^2 r^2 + R r^3 + r^4) / S
                             A = C/2 + 3/80 m h^2 (R^4 + 4 R^3 r + 10 R^2 r^2 + 4 R r^3 + r^4) / S^2
                             z = h/4 (R^2 + 2 R r + 3 r^2) / S,   S = R^2 + R r + r^2
    frustum, sheet           C = m (R^2 + r^2) / 2
                             A = C/2 + m h^2 (R^2 + 4 R r + r^2) / (18 (R + r)^2)
                             z = h/3 (R + 2 r) / (R + r)
    hollow sphere            A = 2/5 m (R^4 + R^3 r + R^2 r^2 + R r^3 + r^4) / S
    ellipsoid                A = m (b^2 + c^2) / 5

    symbol   meaning                                                        unit
    m        mass                                                           kg
    A, C     moment of inertia about x, which is also that about y for a    kg m^2
             body of revolution; about its axis z
    R, r     outer and inner radius; radius of the base and of the top      m
    l, h     length, height                                                 m
    b, c     sides or semi-axes along y and z                               m
    z        height of the centre of mass above the base                    m

Source: Thomson 5.3 (the integrals) and Problems 5.5-6, -7, 5.12-2; the quotients are reduced, so
that a shell (r = R), a full body (r = 0), a cone (top 0) and a tube (top R) need no special case.
"""

__all__ = [
    "box",
    "cone",
    "conical_shell",
    "cylinder",
    "ellipsoid",
    "particles",
    "simplex",
    "sphere",
]

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import Matrix, Scalar, Vector, check
from ..core.checks import check_non_negative, check_positive
from ..core.formula import formula
from ..core.shapes import check_components, with_rank
from ..core.types import as_float
from ..core.vectors import axis
from .inertia import diagonal
from .mass_properties import MassProperties


@formula
def particles(
    masses: Float[Array, "particles *#runs"], places: Float[Array, "3 particles *#runs"]
) -> MassProperties:
    """A rigid set of particles (Thomson 5.3).

    **Arguments**

    - `masses`: kg, (particles, *runs); they must not add up to zero.
    - `places`: m, (3, particles, *runs).

    **Returns** the mass properties in the axes of `places`.

    **Raises** `InputError` where the first axis of `places` does not have three components.
    """
    check_components("particles: places", places, 3)
    rank = max(masses.ndim - 1, places.ndim - 2)
    masses, places = with_rank(masses, rank), with_rank(places, rank, axes=2)
    total = jnp.sum(masses, axis=0)
    # Relative to the first particle, so that a small set far from the origin is accurate.
    apart = places - places[:, :1]
    centre = jnp.sum(masses * apart, axis=1) / total
    tensor = _tensor(masses, apart - centre[:, None])
    return MassProperties(total, places[:, 0] + centre, tensor)


@formula
def simplex(mass: Scalar, vertices: Float[Array, "3 vertices *#runs"]) -> MassProperties:
    """A uniform thin rod between two points, triangular plate between three or tetrahedron between
    four: from these any polygon and any polyhedron is put together.

    **Arguments**

    - `mass`: kg, (*runs,).
    - `vertices`: m, (3, n, *runs), one to four of them; they may coincide.

    **Returns** the mass properties in the axes of `vertices`.

    **Raises** `InputError` for another number of vertices or of components, or a mass that is not
    positive.
    """
    check_components("simplex: vertices", vertices, 3)
    count = vertices.shape[1]
    check(1 <= count <= 4, "simplex: the number of vertices", count, "1, 2, 3 or 4")
    check_positive("simplex: mass", mass)
    mass = as_float(mass)
    vertices = with_rank(vertices, mass.ndim, axes=2)
    # From the first vertex, as in `particles`.
    apart = vertices - vertices[:, :1]
    centre = jnp.mean(apart, axis=1)
    # About the centre the second term of the formula above is zero.
    share = with_rank((mass / (count * (count + 1)))[None], vertices.ndim - 2)
    tensor = _tensor(share, apart - centre[:, None])
    return MassProperties(mass, vertices[:, 0] + centre, tensor)


@formula
def box(mass: Scalar, sides: Vector) -> MassProperties:
    """A box about its centre, with the axes along its sides; a plate where one of
    them is zero, a thin rod where two are (Thomson 5.5-P7).

    **Arguments**

    - `mass`: kg, (*runs,).
    - `sides`: lengths of the sides, m, (3, *runs).

    **Raises** `InputError` for a negative side or a mass that is not positive."""
    return _triaxial("box", mass, sides, 1.0 / 12.0)


@formula
def ellipsoid(mass: Scalar, semi_axes: Vector) -> MassProperties:
    """A full ellipsoid about its centre, with the axes along its semi-axes.

    **Arguments**

    - `mass`: kg, (*runs,).
    - `semi_axes`: m, (3, *runs).

    **Raises** `InputError` for a negative axis or a mass that is not positive."""
    return _triaxial("ellipsoid", mass, semi_axes, 1.0 / 5.0)


@formula
def sphere(mass: Scalar, radius: Scalar, inner_radius: Scalar = 0.0) -> MassProperties:
    """A sphere about its centre.

    **Arguments**

    - `mass`: kg, (*runs,).
    - `radius`, `inner_radius`: m, (*runs,); equal for a thin shell.

    **Returns** the mass properties.

    **Raises** `InputError` for a length that is negative, a mass or `radius` that is not positive.
    """
    _check_solid("sphere", mass, {"radius": radius}, {"inner_radius": inner_radius})
    moment = 0.4 * mass * _fourth(radius, inner_radius)
    return _part(mass, moment, moment)


@formula
def cylinder(
    mass: Scalar, radius: Scalar, length: Scalar, inner_radius: Scalar = 0.0
) -> MassProperties:
    """A cylinder about its centre, its axis along z (Thomson 5.5-P6, 5.12-P2).

    **Arguments**

    - `mass`: kg, (*runs,).
    - `radius`, `inner_radius`: m, (*runs,); equal for a thin tube, both zero for a thin rod.
    - `length`: along z, m, (*runs,); zero for a disk, with equal radii for a hoop.

    **Returns** the mass properties.

    **Raises** `InputError` for a length that is negative and a mass that is not positive.
    """
    lengths = {"radius": radius, "length": length, "inner_radius": inner_radius}
    _check_solid("cylinder", mass, {}, lengths)
    axial = 0.5 * mass * (radius * radius + inner_radius * inner_radius)
    return _part(mass, 0.5 * axial + mass * length * length / 12.0, axial)


@formula
def cone(mass: Scalar, radius: Scalar, height: Scalar, top_radius: Scalar = 0.0) -> MassProperties:
    """A full cone, or the frustum of one, with the centre of its base at the origin and its axis
    along z.

    **Arguments**

    - `mass`: kg, (*runs,).
    - `radius`, `top_radius`: at z = 0 and z = `height`, m, (*runs,).
    - `height`: m, (*runs,).

    **Returns** the mass properties; the tensor is about the centre of mass.

    **Raises** `InputError` for a length that is negative, a mass or `radius` that is not positive.
    """
    lengths = {"height": height, "top_radius": top_radius}
    _check_solid("cone", mass, {"radius": radius}, lengths)
    R, r, h = radius, top_radius, height
    axial = 0.3 * mass * _fourth(R, r)
    S = R * R + R * r + r * r
    # R^4 + 4 R^3 r + 10 R^2 r^2 + 4 R r^3 + r^4
    along = (R * R + r * r) * (R * R + 4.0 * R * r + r * r) + 8.0 * (R * r) * (R * r)
    across = 0.5 * axial + 0.0375 * mass * h * h * along / (S * S)
    return _part(mass, across, axial, 0.25 * h * (R * R + 2.0 * R * r + 3.0 * r * r) / S)


@formula
def conical_shell(
    mass: Scalar, radius: Scalar, height: Scalar, top_radius: Scalar = 0.0
) -> MassProperties:
    """A uniform thin sheet in the form of a cone, a tube or a ring, without base and top.

    **Arguments** as in `cone`; `top_radius` equal to `radius` for a tube, `height` zero for a disk
    with a hole of the radius `top_radius`.

    **Returns** the mass properties; the tensor is about the centre of mass.

    **Raises** `InputError` as `cone` does.
    """
    lengths = {"height": height, "top_radius": top_radius}
    _check_solid("conical_shell", mass, {"radius": radius}, lengths)
    R, r, h = radius, top_radius, height
    axial = 0.5 * mass * (R * R + r * r)
    along = mass * h * h * (R * R + 4.0 * R * r + r * r) / (18.0 * (R + r) * (R + r))
    return _part(mass, 0.5 * axial + along, axial, h * (R + 2.0 * r) / (3.0 * (R + r)))


def _fourth(R: Scalar, r: Scalar) -> Scalar:
    """(R^5 - r^5) / (R^3 - r^3), without its removable singularity."""
    # R^4 + R^3 r + R^2 r^2 + R r^3 + r^4
    numerator = R * R * (R * R + R * r) + r * r * (R * R + R * r + r * r)
    return numerator / (R * R + R * r + r * r)


def _triaxial(name: str, mass: Scalar, lengths: Vector, share: float) -> MassProperties:
    check_components(f"{name}: lengths", lengths, 3)
    _check_solid(name, mass, {}, {"lengths": lengths})
    x, y, z = (a * a for a in lengths)
    moments = share * mass * jnp.stack([y + z, z + x, x + y])
    # Plus zero, to broadcast to the runs of the lengths.
    mass = as_float(mass) + 0.0 * moments[0]
    return MassProperties(mass, 0.0 * moments, diagonal(moments))


def _part(mass: Scalar, across: Scalar, axial: Scalar, height: Scalar = 0.0) -> MassProperties:
    """A body of revolution, whose centre of mass is on z."""
    mass, across, axial, height = jnp.broadcast_arrays(
        *(as_float(x) for x in (mass, across, axial, height))
    )
    return MassProperties(
        mass, height * axis(2, height), diagonal(jnp.stack([across, across, axial]))
    )


def _tensor(masses: Array, places: Array) -> Matrix:
    """The tensor about the origin of particles, (particles, *runs) and (3, particles, *runs)."""
    spread = jnp.sum(masses * places[:, None] * places[None, :], axis=2)
    trace = spread[0, 0] + spread[1, 1] + spread[2, 2]
    return diagonal(jnp.stack([trace, trace, trace])) - spread


def _check_solid(
    name: str, mass: Scalar, positive: dict[str, Scalar], lengths: dict[str, Scalar]
) -> None:
    for key, value in {"mass": mass, **positive}.items():
        check_positive(f"{name}: {key}", value)
    for key, value in lengths.items():
        check_non_negative(f"{name}: {key}", value)
