"""Gravity of a body beyond that of a point: spherical harmonics of any degree and order.

    U = -(mu/R) sum_nm (C_nm V_nm + S_nm W_nm),   a = -grad U
    V_nm + i W_nm = (R/r) (x + i y)^m F_nm                in (x, y, z) = R r / r^2
    F_nm = a_nm z F_(n-1)m - b_nm (R/r)^2 F_(n-2)m,   F_mm = sqrt((2 m + 1)!! / (m! 2^(m-1)))
    a_nm = sqrt((2 n + 1)(2 n - 1) / ((n - m)(n + m)))
    b_nm = sqrt((2 n + 1)(n + m - 1)(n - m - 1) / ((2 n - 3)(n - m)(n + m)))
    grad V_nm: a sum of V and W of degree n + 1 and of the orders m - 1, m and m + 1

    symbol      meaning                                                            unit
    r           position from the centre in axes fixed to the body                 m
    mu          gravitational parameter of the attracting body                     m^3/s^2
    R           radius to which the coefficients refer                             m
    C, S        fully normalised coefficients of degree n and order m              1
    V, W        fully normalised solid harmonics (F_00 = 1)                        1

Source: Montenbruck and Gill, Satellite Orbits, 3.2.4, 3.2.5 (Cunningham, there not normalised);
Holmes and Featherstone, Journal of Geodesy 76 (2002), 279, equations 11 to 13 (normalised).

No angle occurs, so that nothing is singular on the axis. Below R the sum is computed as it is, and
need not converge within the body. The recursion is stable; in single precision F leaves its range
at the poles beyond the degree 170.
"""

__all__ = ["spherical_harmonics", "spherical_harmonics_potential"]

import functools
import os
from typing import ClassVar, TypeAlias, final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, Float

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load
from ..core import (
    FileName,
    InputError,
    NumberField,
    Scalar,
    Vector,
    argument,
    constructor,
    quantity,
)
from ..core.barrier import barrier
from ..core.formula import AWAY, POSITIVE, formula
from ..core.shapes import with_rank
from ..core.types import precision_of
from ..core.vectors import components, inverse_norm, scale
from ._planet import equatorial_radius, gravitational_parameter
from ._planet_rotation import PlanetRotation
from .gravity_file import read_gfc

Coefficients: TypeAlias = Float[Array, "2 degrees orders *#runs"]
Tangent: TypeAlias = Array | SymbolicZero


@formula(r=AWAY, radius=POSITIVE)
def spherical_harmonics(
    r: Vector, mu: Scalar, coefficients: Coefficients, radius: Scalar
) -> Vector:
    """Acceleration by spherical harmonics.

    **Arguments**

    - `r`: position from the centre in axes fixed to the body, m, (3, *runs).
    - `mu`: gravitational parameter, m^3/s^2.
    - `coefficients`: C and S, fully normalised, by degree and order from zero on, (2, degrees,
      orders, *runs). Those of degree zero are zero if `PointGravity` is added.
    - `radius`: to which they refer, m.

    **Returns** a, m/s^2, (3, *runs), in the same axes."""
    slopes = _gradient(coefficients[None])[0]
    return scale(mu / (radius * radius), _series(scale(1.0 / radius, r), slopes))


@formula(r=AWAY, radius=POSITIVE)
def spherical_harmonics_potential(
    r: Vector, mu: Scalar, coefficients: Coefficients, radius: Scalar
) -> Scalar:
    """Potential energy per unit mass U, m^2/s^2, of spherical harmonics, zero at infinity.

    **Arguments**

    - `r`, `mu`, `coefficients`, `radius`: as in `spherical_harmonics`."""
    return -(mu / radius) * _series(scale(1.0 / radius, r), coefficients[None])[0]


# With a rule, because the slopes of a sum of solid harmonics are such sums of the next degree: no
# derivative, forward or reverse, then passes through the recursion.
@jax.custom_jvp
def _series(u: Vector, series: Array) -> Array:
    """Sums of solid harmonics at a place `u` in units of the radius.

    `series` has C and S of each sum, (sums, 2, degrees, orders, *runs); the result is (sums,
    *runs)."""
    kind = precision_of(u, series)
    runs = jnp.broadcast_shapes(u.shape[1:], series.shape[4:])
    u = jnp.broadcast_to(with_rank(u, len(runs)), (3, *runs)).astype(kind)
    # The axes of runs are needed only where the coefficients differ between runs.
    series = with_rank(series, len(runs), axes=4) if series.ndim > 4 else series
    degrees, orders = series.shape[2:4]
    ratio2, x, y, z = barrier((r2 := inverse_norm(u, 2), *components(scale(r2, u))))
    waves = barrier(_powers(x, y, orders))
    tables = (with_rank(jnp.asarray(t, kind), len(runs), axes=2) for t in _recursion(series.shape))

    # Loops over the degree with all orders at once: the program does not grow with the degree.
    def add_degree(
        carry: tuple[Array, Array, Array], row: tuple[Array, ...]
    ) -> tuple[tuple[Array, Array, Array], None]:
        last, before, total = carry
        along, back, first, weights = row
        now = along * (z * last) - back * (ratio2 * before) + first
        return (now, last, total + _weighted(weights, now * waves)), None

    start = jnp.zeros((orders, *runs), kind)
    nothing = jnp.zeros((series.shape[0], *runs), kind)
    rows = (*tables, jnp.moveaxis(series, 2, 0).astype(kind))
    (_, _, total), _ = lax.scan(add_degree, (start, start, nothing), rows, length=degrees)
    return inverse_norm(u) * total


def _rule(primals: tuple[Vector, Array], tangents: tuple[Tangent, Tangent]) -> tuple[Array, Array]:
    u, series = primals
    du, change = tangents
    count = series.shape[0]
    # Value and slopes from one recursion.
    value = None
    parts = []
    if not isinstance(du, SymbolicZero):
        slopes = _gradient(series)
        higher = [(0, 0), (0, 0), (0, 1), (0, 1), *[(0, 0)] * (series.ndim - 4)]
        every = [jnp.pad(series, higher), slopes.reshape(3 * count, *slopes.shape[2:])]
        found = _series(u, jnp.concatenate(every))
        value, along = found[:count], found[count:]
        along = along.reshape(count, 3, *found.shape[1:])
        parts.append(jnp.sum(along * with_rank(du, found.ndim - 1), axis=1))
    value = _series(u, series) if value is None else value
    if not isinstance(change, SymbolicZero):
        # Linear in the coefficients. Without the rule, whose call has no transpose.
        parts.append(_series.fun(u, change))
    return value, functools.reduce(jnp.add, parts)


_series.defjvp(_rule, symbolic_zeros=True)


def _weighted(weights: Array, harmonics: Array) -> Array:
    """The sums over both kinds and all orders, the first axes of the `harmonics`."""
    if weights.ndim > 3:
        return jnp.sum(weights * harmonics, axis=(1, 2))
    # An accelerator would by default round the factors to fewer digits.
    return jnp.tensordot(weights, harmonics, 2, precision=lax.Precision.HIGHEST)


def _powers(x: Scalar, y: Scalar, count: int) -> Array:
    """The real and imaginary parts of (x + i y)^m for the first `count` exponents, (2, count,
    *runs), doubling their number each time."""
    real, imaginary = jnp.stack([jnp.ones_like(x), x]), jnp.stack([jnp.zeros_like(x), y])
    while real.shape[0] < count:
        c, s = real[-1], imaginary[-1]
        higher = real[1:] * c - imaginary[1:] * s, imaginary[1:] * c + real[1:] * s
        real = jnp.concatenate([real, higher[0]])
        imaginary = jnp.concatenate([imaginary, higher[1]])
    return jnp.stack([real[:count], imaginary[:count]])


def _grid(degrees: int, orders: int) -> tuple[np.ndarray, np.ndarray]:
    return np.arange(0.0, degrees)[:, None], np.arange(0.0, orders)[None]


def _root(square: np.ndarray, where: np.ndarray) -> np.ndarray:
    """The square root where a table has entries, and zero elsewhere."""
    return np.sqrt(np.where(where, square, 0.0))


def _recursion(shape: tuple[int, ...]) -> list[np.ndarray]:
    """The factors a and b of the recursion and its start F_mm, (degrees, orders)."""
    n, m = _grid(*shape[2:4])
    with np.errstate(divide="ignore", invalid="ignore"):
        both = (2.0 * n + 1.0) / ((n - m) * (n + m))
        along = _root(both * (2.0 * n - 1.0), n > m)
        back = _root(both * (n + m - 1.0) * (n - m - 1.0) / (2.0 * n - 3.0), n > m + 1.0)
        growth = np.where(m > 1.0, (2.0 * m + 1.0) / (2.0 * m), np.where(m == 1.0, 3.0, 1.0))
    first = np.sqrt(np.cumprod(growth, axis=1))
    return [along, back, np.where(n == m, first, 0.0)]


def _gradient(series: Array) -> Array:
    """The slopes of sums of solid harmonics, (sums, 3, 2, degrees + 1, orders + 1, *runs)."""
    rank = series.ndim - 4
    n, m = _grid(*series.shape[2:4])
    size = (2.0 * n + 1.0) / (2.0 * n + 3.0)
    up = _root(size * (n + m + 1.0) * (n + m + 2.0), n >= m) * np.where(m > 0.0, 0.5, 0.5**0.5)
    down = _root(size * (n - m + 1.0) * (n - m + 2.0), n >= m) * np.where(m > 1.0, 0.5, 0.5**0.5)
    same = _root(size * (n + m + 1.0) * (n - m + 1.0), n >= m)

    def moved(part: Array, table: np.ndarray, by: int) -> Array:
        """The part times a table, one degree higher and `by` orders."""
        weights = with_rank(jnp.asarray(table, part.dtype), rank, axes=2)
        orders = {1: (1, 0), 0: (0, 1), -1: (0, 2)}[by]
        product = (part * weights)[:, :, 1 if by < 0 else 0 :]
        return jnp.pad(product, [(0, 0), (1, 0), orders, *[(0, 0)] * rank])

    cosine, sine = series[:, 0], series[:, 1]
    # There is no W of order zero.
    odd = np.where(m > 0.0, up, 0.0)
    c_up, s_up = moved(cosine, up, 1), moved(sine, odd, 1)
    c_down, s_down = moved(cosine, down, -1), moved(sine, down, -1)
    slopes = [
        [c_down - c_up, s_down - s_up],
        [s_up + s_down, -c_up - c_down],
        [-moved(cosine, same, 0), -moved(sine, same, 0)],
    ]
    return jnp.stack([jnp.stack(pair, axis=1) for pair in slopes], axis=1)


@final
class SphericalHarmonics(AbstractEffect):
    """Attraction by the spherical harmonics of the gravity field of a body, without its point mass:
    add `PointGravity`.

    - `tide_system`: whether the permanent tide is part of the field, as stated by its file:
      "tide_free", "zero_tide", "mean_tide" or "unknown"."""

    uniform: ClassVar[bool] = True

    mu: NumberField = gravitational_parameter()
    coefficients: Coefficients = quantity(
        "", doc="C and S, fully normalised: (2, degrees, orders), both from zero on"
    )
    radius: NumberField = equatorial_radius("the coefficients refer")
    rotation: PlanetRotation | None = eqx.field(
        default=None, metadata={"doc": "of the body; without it the body is at rest"}
    )
    tide_system: str = eqx.field(static=True, default="unknown")

    def __check_init__(self):
        shape = getattr(self.coefficients, "shape", (2, 3, 1))
        if shape[1] < shape[2]:
            raise InputError(
                f"SphericalHarmonics.coefficients has {shape[1]} degrees and {shape[2]} orders: "
                "it must have at most as many orders as degrees."
            )

    @classmethod
    @constructor(
        sets=("mu", "coefficients", "radius", "tide_system"),
        file=FileName("with the coefficients: ICGEM (.gfc)"),
        degree=argument(
            "", low=1, high=1400, whole=True, fixed=True, doc="greatest degree of the sum"
        ),
        order=argument(
            "",
            low=0,
            high=1400,
            whole=True,
            fixed=True,
            optional=True,
            doc="greatest order of the sum; by default that of the degree",
        ),
    )
    def of_file(
        cls,
        file: str | os.PathLike[str],
        degree: Scalar,
        order: Scalar | None = None,
        rotation: PlanetRotation | None = None,
    ) -> "SphericalHarmonics":
        """The field of a file, without the point; see `gravity_file.read_gfc`."""
        field = read_gfc(file, int(degree), None if order is None else int(order))
        coefficients = field.coefficients.copy()
        coefficients[0, 0, 0] = 0.0
        numbers = field.mu, jnp.asarray(coefficients), field.radius
        return cls(*numbers, rotation, field.tide_system)

    @property
    def keeps(self) -> frozenset[str]:  # pyright: ignore[reportIncompatibleVariableOverride]
        return frozenset({"energy"}) if self.rotation is None else frozenset()

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del body
        assert y.position is not None
        r, rotation = y.position, self.rotation
        place = r if rotation is None else rotation.to_body(t, r)
        numbers = self.mu, self._coefficients_for(r), self.radius
        a = spherical_harmonics(place, *numbers)
        return Load(acceleration_N=a if rotation is None else rotation.to_inertial(t, a))

    def potential(self, t: Scalar, y: BodyState, body: AbstractBody) -> Scalar | None:
        del t, body
        # A body that rotates does work.
        if self.rotation is not None:
            return None
        assert y.position is not None
        numbers = self.mu, self._coefficients_for(y.position), self.radius
        return spherical_harmonics_potential(y.position, *numbers)

    def _coefficients_for(self, r: Vector) -> Array:
        """In the precision of the state, because those of a file have their own."""
        return self.coefficients.astype(r.dtype)

    def ground(self) -> Scalar:
        return self.radius

    def scaled(self, factor: Scalar) -> "SphericalHarmonics":
        return eqx.tree_at(lambda e: e.coefficients, self, factor * self.coefficients)
