"""Inputs that are drawn together: numbers with a covariance or a correlation.

correlated   x_i = F_i^-1(Phi((L z)_i)),  L L^T = R        a Gaussian copula
normal       x = m + S z,                 S S^T = C

symbol  meaning                                                   unit
z       independent standard normal numbers                       1
R       correlation of the normal numbers behind the inputs       1
m, C    mean and covariance                                       of the quantities

For normal inputs R is their correlation; that of other inputs is a little smaller.
"""

from typing import final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from ..core import InputError
from ..core.printing import printed
from ..core.types import as_float
from .distributions import AbstractDistribution, Normal
from .joint import AbstractJoint


def factor_of(name: str, matrix: ArrayLike) -> np.ndarray:
    """S with S S^T = the matrix, which may be singular.

    Raises `InputError` unless the matrix is square, symmetric and positive semidefinite."""
    c = np.asarray(matrix, float)
    if c.ndim != 2 or c.shape[0] != c.shape[1] or not np.all(np.isfinite(c)):
        raise InputError(f"{name} has the shape {c.shape}: it must be square, and finite.")
    if not np.allclose(c, c.T, rtol=1e-9, atol=1e-12 * np.max(np.abs(c))):
        raise InputError(f"{name} is not symmetric: it must be, as a covariance.")
    scale = np.sqrt(np.where(np.diag(c) > 0.0, np.diag(c), 1.0))
    # Scaled to a correlation, so that the limit of zero does not depend on the units.
    size, vectors = np.linalg.eigh(c / np.outer(scale, scale))
    if size[0] < -1e-9:
        raise InputError(f"{name} has the eigenvalue {size[0]:.3g}: none may be negative.")
    return scale[:, None] * vectors * np.sqrt(np.maximum(size, 0.0))


def _shown(numbers: ArrayLike) -> str:
    """Numbers in brackets, rounded to the digits that survive the factorisation."""
    x = np.asarray(numbers)
    if x.ndim == 0:
        return f"{x:.12g}"
    return "[" + ", ".join(map(_shown, x)) + "]"


def _check_rows(name: str, matrix: Array, mean: Array) -> None:
    if jnp.ndim(matrix) != 2 or jnp.shape(matrix)[:1] != jnp.shape(mean):
        raise InputError(
            f"MultivariateNormal.{name} has the shape {jnp.shape(matrix)}: it must have one row "
            f"per component of the mean, whose shape is {jnp.shape(mean)}."
        )


@final
@printed()
class MultivariateNormal(AbstractJoint):
    """Jointly normal numbers: `MultivariateNormal(mean, covariance)`, as in NumPy and SciPy.

    **Arguments**

    - `mean`: (n,).
    - `covariance`: (n, n), symmetric and positive semidefinite.

    `MultivariateNormal.from_factor` accepts a factor S of the covariance S S^T instead. The fields
    are the mean `centre` and the `factor`, (n, k).

    **Raises** `InputError` for a covariance that is not square, finite, symmetric and positive
    semidefinite, and for one whose size differs from that of the mean."""

    centre: Float[Array, " n"]
    factor: Float[Array, "n k"]

    def __init__(self, mean: ArrayLike, covariance: ArrayLike):
        self.centre = as_float(mean)
        self.factor = as_float(factor_of("MultivariateNormal.covariance", covariance))
        _check_rows("covariance", self.factor, self.centre)

    @classmethod
    def from_factor(cls, mean: ArrayLike, factor: ArrayLike) -> "MultivariateNormal":
        """Build the distribution from the `mean`, (n,), and a `factor` S, (n, k), of the covariance
        S S^T."""
        centre, given = as_float(mean), as_float(factor)
        _check_rows("factor", given, centre)
        independent = cls(centre, np.eye(centre.size))
        return eqx.tree_at(lambda d: d.factor, independent, given)

    @property
    def size(self) -> int:
        return self.factor.shape[0]

    @property
    def dimensions(self) -> int:
        return self.factor.shape[1]

    @property
    def mean(self) -> Float[Array, " n"]:
        return self.centre

    @property
    def covariance(self) -> Float[Array, "n n"]:
        return self.factor @ self.factor.T

    def from_normal(self, z: Float[Array, " k"]) -> Float[Array, " n"]:
        return self.centre + self.factor @ z

    def outside(self, index: int, low: float, high: float) -> float:
        deviation = jnp.sqrt(jnp.sum(self.factor[index] ** 2))
        return Normal(self.centre[index], deviation).outside(low, high)

    def text(self) -> str:
        mean, factor = _shown(self.centre), _shown(self.factor)
        return f"multivariate normal, mean {mean}, factor {factor}"


@final
@printed()
class Correlated(AbstractJoint):
    """Distributions of one number each, correlated by a Gaussian copula.

    - `marginals`: the distribution of each number.
    - `factor`: L, (n, n), each row of length one; `Correlated.of` accepts the correlation."""

    marginals: tuple[AbstractDistribution, ...] = eqx.field(converter=tuple)
    factor: Float[Array, "n n"] = eqx.field(converter=as_float)

    @classmethod
    def of(
        cls, marginals: tuple[AbstractDistribution, ...], correlation: ArrayLike
    ) -> "Correlated":
        """Build it from the `marginals` and the `correlation`, (n, n), whose diagonal is ones."""
        matrix = np.asarray(correlation, float)
        if matrix.shape != (len(marginals),) * 2 or not np.allclose(np.diag(matrix), 1.0):
            raise InputError(
                f"correlation has the shape {matrix.shape}: it must be "
                f"{(len(marginals),) * 2}, with ones on its diagonal."
            )
        return cls(tuple(marginals), as_float(factor_of("correlation", matrix)))

    @property
    def size(self) -> int:
        return len(self.marginals)

    @property
    def dimensions(self) -> int:
        return self.factor.shape[1]

    @property
    def mean(self) -> Float[Array, " n"]:
        return jnp.stack([d.mean for d in self.marginals])

    @property
    def covariance(self) -> Float[Array, "n n"]:
        # Not `deviation`, which is that before a cut.
        s = jnp.sqrt(jnp.stack([d.variance for d in self.marginals]))
        return s[:, None] * (self.factor @ self.factor.T) * s

    def from_normal(self, z: Float[Array, " k"]) -> Float[Array, " n"]:
        mixed = self.factor @ z
        return jnp.stack([d.from_normal(mixed[k]) for k, d in enumerate(self.marginals)])

    def searched(self, z: Float[Array, " k"]) -> tuple[Float[Array, " n"], Float[Array, ""]]:
        # Along one row of the factor after the other, each of length one: the numbers across it are
        # independent of that along it, so that the ratio of the densities is that of the marginal.
        likelihood = jnp.ones((), z.dtype)
        for row, d in zip(self.factor, self.marginals, strict=True):
            along = row @ z
            moved, factor = d.spread(along)
            z = z + (moved - along) * row
            likelihood = likelihood * factor
        return self.from_normal(z), likelihood

    @property
    def expectation(self) -> Float[Array, " n"]:
        return jnp.stack([d.expectation for d in self.marginals])

    def outside(self, index: int, low: float, high: float) -> float:
        return self.marginals[index].outside(low, high)

    def text(self) -> str:
        marginals = "; ".join(d.text() for d in self.marginals)
        return f"correlation {_shown(self.factor @ self.factor.T)} of ({marginals})"
