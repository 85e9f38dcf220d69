"""Inputs that are drawn together: correlated numbers, directions.

correlated   x_i = F_i^-1(Phi((L z)_i)),  L L^T = R        a Gaussian copula
normal       x = m + S z,                 S S^T = C
cone         d = cos(t) n + sin(t) (cos(p) e_1 + sin(p) e_2),
             1 - cos(t) = (1 - cos(a)) (1 - exp(-(z_1^2 + z_2^2)/2)),  tan(p) = z_2 / z_1

symbol  meaning                                                   unit
z       independent standard normal numbers                       1
R       correlation of the normal numbers behind the inputs       1
m, C    mean and covariance                                       of the quantities
n, a    axis of the cone, and half its angle; pi is the sphere    1, rad

Of normal inputs R is their own correlation; of others theirs is a little smaller.
"""

from abc import abstractmethod
from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from ..core import InputError, Scalar, as_float, is_concrete, phi1
from ._distributions import AbstractDistribution


class AbstractJoint(eqx.Module):
    """A distribution of several numbers together."""

    @property
    @abstractmethod
    def size(self) -> int:
        """How many numbers there are, n."""

    @property
    @abstractmethod
    def dimensions(self) -> int:
        """How many standard normal numbers make one draw, k."""

    @property
    @abstractmethod
    def mean(self) -> Float[Array, " n"]:
        """The numbers of the nominal run."""

    @property
    @abstractmethod
    def covariance(self) -> Float[Array, "n n"]:
        """The mean of (x - m)(x - m)^T about `mean`."""

    @abstractmethod
    def from_normal(self, z: Float[Array, " k"]) -> Float[Array, " n"]:
        """One draw from standard normal numbers."""

    @abstractmethod
    def text(self) -> str:
        """The distribution in words, for records."""

    def inputs(self, *names: str) -> dict[str, AbstractDistribution]:
        """The inputs of a campaign that these `names` stand for, drawn together.

        `Campaign(build, {**cone.inputs("u_x", "u_y", "u_z"), "mass": ...}, ...)`. Raises
        `InputError` unless there is a name for each number."""
        if len(names) != self.size:
            raise InputError(f"{len(names)} names are given for {self.size} numbers.")
        source = "+".join(names)
        # The abstract fields of the base are properties here, and no arguments.
        made = (
            Component(joint=self, index=k, shared=source)  # pyright: ignore[reportCallIssue]
            for k in range(self.size)
        )
        return dict(zip(names, made, strict=True))


@final
class Component(AbstractDistribution):
    """One number of a joint distribution; `AbstractJoint.inputs` makes them.

    - `joint`, `index`: which number of which distribution.
    - `shared`: the name of the draw that all numbers share."""

    joint: AbstractJoint
    index: int = eqx.field(static=True)
    shared: str = eqx.field(static=True)

    @property
    def source(self) -> str:
        return self.shared

    @property
    def dimensions(self) -> int:
        return self.joint.dimensions

    @property
    def mean(self) -> Float[Array, ""]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Of the number."""
        return self.joint.mean[self.index]

    @property
    def deviation(self) -> Float[Array, ""]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Of the number."""
        return jnp.sqrt(self.joint.covariance[self.index, self.index])

    def sample(self, key: Array) -> Float[Array, ""]:
        # Every component of a joint is given the same key, and so the same numbers z.
        return self.from_normal(jax.random.normal(key, (self.joint.dimensions,)))

    def from_normal(self, z: Float[Array, "..."]) -> Float[Array, ""]:
        return self.joint.from_normal(z)[self.index]

    def outside(self, low: float, high: float) -> float:
        z = jax.random.normal(jax.random.key(0), (4096, self.joint.dimensions))
        x = np.asarray(jax.vmap(self.from_normal)(z))
        return float(np.mean((x < low) | (x > high)))

    def text(self) -> str:
        return f"number {self.index} of {self.joint.text()}"


def factor_of(name: str, matrix: ArrayLike) -> np.ndarray:
    """S with S S^T = the matrix, which may be singular.

    Raises `InputError` unless the matrix is square, symmetric and has no negative eigenvalue."""
    c = np.asarray(matrix, float)
    if c.ndim != 2 or c.shape[0] != c.shape[1] or not np.all(np.isfinite(c)):
        raise InputError(f"{name} has the shape {c.shape}: it must be square, and finite.")
    if not np.allclose(c, c.T, rtol=1e-9, atol=1e-12 * np.max(np.abs(c))):
        raise InputError(f"{name} is not symmetric: a covariance is.")
    scale = np.sqrt(np.where(np.diag(c) > 0.0, np.diag(c), 1.0))
    # Scaled to a correlation, so that units do not decide on what counts as zero.
    size, vectors = np.linalg.eigh(c / np.outer(scale, scale))
    if size[0] < -1e-9:
        raise InputError(f"{name} has the eigenvalue {size[0]:.3g}: none may be negative.")
    return scale[:, None] * vectors * np.sqrt(np.maximum(size, 0.0))


@final
class MultivariateNormal(AbstractJoint):
    """Normal numbers with a covariance.

    - `centre`: their mean, (n,).
    - `factor`: S, (n, k), with the covariance S S^T; `from_covariance` takes the matrix itself."""

    centre: Float[Array, " n"] = eqx.field(converter=as_float)
    factor: Float[Array, "n k"] = eqx.field(converter=as_float)

    def __check_init__(self):
        if jnp.ndim(self.factor) != 2 or jnp.shape(self.factor)[:1] != jnp.shape(self.centre):
            shapes = jnp.shape(self.factor), jnp.shape(self.centre)
            raise InputError(
                f"MultivariateNormal.factor has the shape {shapes[0]}: it must have a row for each "
                f"number of the mean, whose shape is {shapes[1]}."
            )

    @classmethod
    def from_covariance(cls, mean: ArrayLike, covariance: ArrayLike) -> "MultivariateNormal":
        """From the `mean`, (n,), and the `covariance`, (n, n)."""
        return cls(as_float(mean), as_float(factor_of("covariance", covariance)))

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

    def text(self) -> str:
        return f"multivariate normal, factor {np.asarray(self.factor).tolist()}"


@final
class Correlated(AbstractJoint):
    """Distributions of one number each, correlated by a Gaussian copula.

    - `marginals`: the distribution of each number.
    - `factor`: L, (n, n), each row of length one; `Correlated.of` takes the correlation."""

    marginals: tuple[AbstractDistribution, ...] = eqx.field(converter=tuple)
    factor: Float[Array, "n n"] = eqx.field(converter=as_float)

    @classmethod
    def of(
        cls, marginals: tuple[AbstractDistribution, ...], correlation: ArrayLike
    ) -> "Correlated":
        """From the `marginals` and the `correlation`, (n, n), with ones on its diagonal."""
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
        s = jnp.stack([d.deviation for d in self.marginals])
        return s[:, None] * (self.factor @ self.factor.T) * s

    def from_normal(self, z: Float[Array, " k"]) -> Float[Array, " n"]:
        mixed = self.factor @ z
        return jnp.stack([d.from_normal(mixed[k]) for k, d in enumerate(self.marginals)])

    def text(self) -> str:
        return "correlated (" + "; ".join(d.text() for d in self.marginals) + ")"


@final
class ConeDirection(AbstractJoint):
    """A vector of a fixed length whose direction is uniform over a cone; the nominal one lies on
    its axis.

    - `vector`: the nominal vector, (3,); its length is that of all draws.
    - `half_angle`, rad: of the cone; pi for the whole sphere."""

    vector: Float[Array, "3"] = eqx.field(converter=as_float)
    half_angle: Float[Array, ""] = eqx.field(converter=as_float, default=np.pi)

    def __check_init__(self):
        if is_concrete(self.vector):
            length = float(np.linalg.norm(np.asarray(self.vector)))
            if np.shape(self.vector) != (3,) or not length > 0.0:
                raise InputError(
                    "ConeDirection.vector must be three numbers, not all of them zero."
                )
        if is_concrete(self.half_angle) and not 0.0 < float(self.half_angle) <= np.pi + 1e-6:
            raise InputError(
                f"ConeDirection.half_angle is {float(self.half_angle)}: it must be above 0, and at "
                f"most pi."
            )

    @property
    def size(self) -> int:
        return 3

    @property
    def dimensions(self) -> int:
        return 2

    @property
    def mean(self) -> Float[Array, "3"]:
        return self.vector

    @property
    def covariance(self) -> Float[Array, "3 3"]:
        # 1 - cos t is uniform from 0 to h: the means of (1 - cos t)^2 and of sin^2 t follow.
        h = 1.0 - jnp.cos(self.half_angle)
        along, across = h * h / 3.0, (h - h * h / 3.0) / 2.0
        outer = jnp.outer(self.vector, self.vector)
        return along * outer + across * (jnp.sum(self.vector**2) * jnp.eye(3) - outer)

    def from_normal(self, z: Float[Array, " k"]) -> Float[Array, "3"]:
        length = jnp.sqrt(jnp.sum(self.vector**2))
        n = self.vector / length
        e1, e2 = _across(n)
        s = 0.5 * (z[0] ** 2 + z[1] ** 2)
        h = 1.0 - jnp.cos(self.half_angle)
        # h (1 - e^-s), and sin(t)/|z| without a division by zero at the axis.
        versine = h * s * phi1(-s)
        ratio = jnp.sqrt(0.5 * h * phi1(-s) * (2.0 - versine))
        return length * ((1.0 - versine) * n + ratio * (z[0] * e1 + z[1] * e2))

    def text(self) -> str:
        vector, angle = np.asarray(self.vector).tolist(), float(self.half_angle)
        return f"direction within {angle:.6g} rad of {vector}"


def _across(n: Float[Array, "3"]) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
    """Two unit vectors that are perpendicular to the unit vector n and to each other, without a
    singular direction (Duff et al., J. Comput. Graph. Tech. 6 (2017), 1)."""
    sign: Scalar = jnp.where(n[2] >= 0.0, 1.0, -1.0)
    a = -1.0 / (sign + n[2])
    b = n[0] * n[1] * a
    e1 = jnp.stack([1.0 + sign * n[0] ** 2 * a, sign * b, -sign * n[0]])
    return e1, jnp.stack([b, sign + n[1] ** 2 * a, -n[1]])
