"""Result of a fit: parameters, their covariance, tests of the residuals, unobservable
combinations."""

from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PyTree

from ..core import InputError
from ..core.checks import is_concrete
from ..core.structure import HashedModule
from ..studies.coordinates import Coordinates
from ._residuals import ResidualTests, chi_squared_tail

SEEN = 0.45
"""A direction is observable if its singular value relative to the largest exceeds the rounding to
this power: 1e-7 in double precision, 1e-3 in single."""


@final
class Fit(HashedModule):
    """Parameters estimated by `fit`, and their uncertainties. With `batch`, the data sets are on
    the last axis of every array.

    - `parameters`: the estimate, with the structure of the start.
    - `names`: of the n coordinates of the parameters.
    - `residuals`: reading minus prediction over the noise, like the data; zero for missing
      readings.
    - `chi_squared`: the sum of the squared residuals.
    - `freedom`: degrees of freedom, the number of readings minus the number of parameters.
    - `scaled_variance`: factor on the covariance: 1 for given noise.
    - `singular_values`, `directions`: of the Jacobian with its columns scaled to length one; the
      rows of `directions` are combinations of parameters.
    - `columns`: the lengths of the unscaled columns of the Jacobian.
    - `steps`, `converged`: of the search.
    - `tests`: p-values of the residuals, a `ResidualTests` for each array of the data.
    - `stated`: whether the noise was given; otherwise it is estimated from the residuals."""

    parameters: PyTree
    names: tuple[str, ...] = eqx.field(static=True)
    residuals: PyTree
    chi_squared: Float[Array, "*runs"]
    freedom: Float[Array, "*runs"]
    scaled_variance: Float[Array, "*runs"]
    singular_values: Float[Array, "n *#runs"]
    directions: Float[Array, "n n *#runs"]
    columns: Float[Array, "n *#runs"]
    steps: Int[Array, "*runs"]
    converged: Bool[Array, "*runs"]
    tests: PyTree[ResidualTests]
    stated: bool = eqx.field(static=True)

    @property
    def _seen(self) -> Bool[Array, "n *#runs"]:
        s = self.singular_values
        return s > jnp.finfo(s.dtype).eps ** SEEN * s[:1]

    @property
    def unseen(self) -> Bool[Array, "n *#runs"]:
        """Whether each parameter is part of a combination on which no reading depends."""
        share = jnp.where(self._seen[:, None], 0.0, self.directions**2)
        # A component of a thousandth, squared: the limit of the sentences below.
        return jnp.sum(share, axis=0) > 1e-6

    @property
    def covariance(self) -> Float[Array, "n n *#runs"]:
        """Covariance of the parameters in the order of `names`; its diagonal is infinite where
        `unseen`."""
        s = jnp.where(self._seen, self.singular_values, 1.0)
        weight = jnp.where(self._seen, 1.0 / s**2, 0.0)
        P = jnp.einsum("ki...,k...,kj...->ij...", self.directions, weight, self.directions)
        P = self.scaled_variance * P / (self.columns[:, None] * self.columns[None])
        blind = jnp.eye(len(self.names), dtype=bool).reshape(*P.shape[:2], *(1,) * (P.ndim - 2))
        return jnp.where(blind & self.unseen[None], jnp.inf, P)

    @property
    def std(self) -> Float[Array, "n *#runs"]:
        """Standard deviations of the parameters, in the order of `names`."""
        return jnp.sqrt(jnp.stack([self.covariance[k, k] for k in range(len(self.names))]))

    @property
    def correlation(self) -> Float[Array, "n n *#runs"]:
        """Correlation of the parameters; zero between any of them and one that is `unseen`."""
        s = self.std
        return self.covariance / jnp.where(s[:, None] * s[None] > 0.0, s[:, None] * s[None], 1.0)

    @property
    def p_value(self) -> Float[Array, "*runs"]:
        """The probability of a larger `chi_squared` due to noise only; NaN without given noise."""
        tail = chi_squared_tail(self.chi_squared, self.freedom)
        return tail if self.stated else jnp.full_like(tail, jnp.nan)

    def observability(self) -> str:
        """Messages about unobservable combinations of parameters; empty without any.

        **Raises** `InputError` for a batch: use `of(i)`."""
        if self.singular_values.ndim > 1:
            raise InputError("This fit is a batch: select one of its data sets, fit.of(i).")
        blind = np.asarray(self.directions)[~np.asarray(self._seen)]
        # A parameter without influence is itself part of the unobservable space.
        alone = np.sum(blind**2, axis=0) > 1.0 - 1e-9
        sentences = [
            f"{name} is unobservable: no reading depends on it."
            for name, is_alone in zip(self.names, alone, strict=True)
            if is_alone
        ]
        _, _, rows = np.linalg.svd(np.where(alone, 0.0, blind), full_matrices=False)
        for row in rows[: len(blind) - int(np.sum(alone))]:
            # From columns of length one back to the units of the parameters.
            parts = row / np.asarray(self.columns)
            parts = parts / parts[np.argmax(np.abs(parts))]
            strong = [k for k in range(row.size) if abs(row[k]) > 1e-3]
            terms = " ".join(f"{parts[k]:+.3g} {self.names[k]}" for k in strong)
            sentences.append(
                f"The combination {terms} is unobservable: no reading changes along it. Fix one of "
                "the parameters, or give a prior."
            )
        return "\n".join(sentences)

    def of(self, i: int) -> "Fit":
        """The i-th data set of a batch."""
        if self.chi_squared.ndim == 0:
            raise InputError("This fit has a single data set and cannot be indexed.")
        return jax.tree.map(lambda x: x[..., i], self)

    def __repr__(self) -> str:
        if not is_concrete(self.chi_squared) or self.chi_squared.ndim > 0:
            sets = self.chi_squared.shape[-1] if self.chi_squared.ndim else 1
            return f"Fit of {len(self.names)} parameters to {sets} data sets"
        values = np.concatenate([np.ravel(x) for x in _values(self.parameters)])
        labels = Coordinates.of(self.parameters, 0).labels
        lines = ["parameter              estimate   standard deviation"]
        if len(values) == len(labels):
            rows = zip(self.names, values, np.asarray(self.std), strict=True)
            lines += [f"{name:18s} {value:12.6g}   {spread:12.3g}" for name, value, spread in rows]
        else:
            rows = zip(self.names, np.asarray(self.std), strict=True)
            lines += [f"{name:18s} {'':12s}   {spread:12.3g}" for name, spread in rows]
        fitted = f"chi^2 {float(self.chi_squared):.5g} for {int(self.freedom)} degrees of freedom"
        ended = "converged" if bool(self.converged) else "NOT converged"
        lines.append(f"{fitted}; {ended} in {int(self.steps)} steps")
        # Far from the data, observability there has no meaning for the estimate.
        seen = self.observability() if bool(self.converged) else ""
        return "\n".join([*lines, seen] if seen else lines)


def _values(tree: PyTree) -> list[np.ndarray]:
    return [np.asarray(x) for x in jax.tree.leaves(tree)]
