"""Parameter estimation: weighted least squares with exact Jacobians.

    minimise  sum_k ((z_k - h_k(p)) / sigma_k)^2  +  sum_j ((p_j - p0_j) / s_j)^2
    P = (J^T J)^-1,     J = d r / d p         covariance of the estimate

    symbol  meaning
    z, h    readings, and predictions of the model
    sigma   standard deviation of the noise of a reading
    p0, s   start, and its standard deviation by prior knowledge
    r       residuals over their standard deviations

The columns of J are scaled to one, so that units do not matter. Where J has no full rank, some
combination of parameters has no influence on any reading: it remains at its start, its variance is
infinite, and a message names it.

Source: Tapley, Schutz and Born, Statistical Orbit Determination, 4.3 to 4.6; Nocedal and Wright,
Numerical Optimization, 10.3.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax
import numpy as np
import optimistix
from jaxtyping import Array, PyTree

from ..core import InputError, Scalar
from ..core.checks import is_concrete
from ..core.jit import compiled, quick_jit
from ..core.square_roots import sqrt
from ..core.status import sentence_alone
from ..core.user_functions import user_function
from ..studies.coordinates import Coordinates
from ._fit_result import Fit
from ._residuals import residual_tests

COLUMN = 30.0
"""Length of the scaled columns. The damping starts at a thousandth of their squares."""

LEAST_STEP = 1e-4
"""The step size that ends the search, in units of a thirtieth of the standard deviation of an
individual parameter; and the remaining residuals."""

METHODS = ("levenberg_marquardt", "gauss_newton")

Model: TypeAlias = Callable[[Any], PyTree]
"""Function that predicts the readings from the parameters."""

Known: TypeAlias = tuple[PyTree, PyTree, Scalar]
"""Standard deviations of the readings, prior ones of the parameters, and the tolerance."""


def fit(
    model: Model,
    data: PyTree,
    parameters: PyTree,
    *,
    noise: PyTree = None,
    prior: PyTree = None,
    method: str = "levenberg_marquardt",
    tolerance: Scalar = 1e-8,
    max_steps: int = 64,
    batch: bool = False,
) -> Fit:
    """The best-fit parameters of a model to data, and their uncertainties.

    **Arguments**

    - `model`: from parameters to predicted readings, a pytree of arrays like `data`. It is
      differentiated in forward mode, including calls such as `simulate` with `throw=False`.
    - `data`: the readings, a pytree of arrays with the time on the last axis; NaN for missing ones.
    - `parameters`: start of the search: a pytree of arrays, such as an initial state, a mass and
      the biases of the instruments together. A quaternion is varied on its group.
    - `noise`: standard deviations of the readings: one number, or a pytree of numbers or arrays
      with the structure of `data`. Without it all readings have equal weights, and the noise is
      estimated from their scatter.
    - `prior`: standard deviations of the start by prior knowledge: one number, or a pytree with the
      structure of `parameters`; infinite for unknown parameters. For a quaternion, a number, rad.
    - `method`: "levenberg_marquardt", which rejects failed steps, or "gauss_newton", which does
      not, for starts close to the solution.
    - `tolerance`: relative change of the residuals and of the parameters at which the search ends.
    - `max_steps`: of the search.
    - `batch`: whether the arrays of `data` and `parameters` have data sets on their last axis, each
      of which is fitted separately. The model receives a single one.

    **Returns** a `Fit`; with `batch` its arrays have the data sets on the last axis.

    **Raises** `InputError` for an unknown method, for noise that is not positive, for predictions
    with a structure other than that of the data, and for fewer readings than parameters;
    `SimulationError` for a run of the model that fails."""
    if method not in METHODS:
        raise InputError(f"method is {method!r}: it must be one of {', '.join(METHODS)}.")
    parameters = jax.tree.map(jnp.asarray, parameters)
    if not jax.tree.leaves(parameters):
        raise InputError("parameters contain no array: there is nothing to fit.")
    _check_noise(noise)
    stated = noise is not None
    noise = 1.0 if noise is None else noise
    known = (noise, prior, tolerance)

    def one(data: PyTree, parameters: PyTree) -> Fit:
        return _search(model, data, parameters, known, method, max_steps, stated)

    every = compiled(jax.vmap(one, in_axes=-1, out_axes=-1)) if batch else one
    # A run of the model may fail, which shows when its numbers are there.
    with sentence_alone(), user_function("model"):
        return jax.block_until_ready(every(data, parameters))


def _check_noise(noise: PyTree) -> None:
    for x in jax.tree.leaves(noise):
        if is_concrete(x) and not np.all(np.asarray(x) > 0.0):
            raise InputError(f"noise contains {x}: every standard deviation must be positive.")


def _like(tree: PyTree, form: PyTree) -> PyTree:
    """A number, or a tree, with the structure and the shapes of another one."""
    if jax.tree.structure(tree) != jax.tree.structure(form):
        tree = jax.tree.map(lambda x: tree, form)
    return jax.tree.map(lambda x, y: jnp.broadcast_to(jnp.asarray(x, y.dtype), y.shape), tree, form)


def _prior_of(prior: PyTree, coordinates: Coordinates) -> Array | None:
    """The standard deviation of every coordinate, (n,)."""
    if prior is None:
        return None
    blocks = jax.tree.unflatten(coordinates.structure, coordinates.blocks)
    leaves = jax.tree.leaves(prior)
    if len(leaves) == 1:
        leaves = leaves * len(coordinates.blocks)
    if len(leaves) != len(coordinates.blocks):
        raise InputError(
            f"prior must be one number or a pytree with the structure of the parameters, {blocks}."
        )
    result = [
        jnp.broadcast_to(jnp.asarray(s, coordinates.dtype), shape).reshape(-1)
        for s, shape in zip(leaves, coordinates.shapes, strict=True)
    ]
    return jnp.concatenate(result)


@quick_jit
def _search(
    model: Model,
    data: PyTree,
    parameters: PyTree,
    known: Known,
    method: str,
    max_steps: int,
    stated: bool,
) -> Fit:
    task = _Task.of(model, data, parameters, known)
    dtype = task.coordinates.dtype
    zero = jnp.zeros(task.coordinates.count, dtype)
    start, _ = task.linear(zero)
    size = jnp.sqrt(jnp.sum(start**2, axis=0))
    # A parameter without influence retains its unit.
    usable = jnp.isfinite(size) & (size > 0.0)
    scale = COLUMN / jnp.where(usable, size, 1.0)

    # The damping of the search is in the default precision, whatever that of the model.
    def scaled(u: Array, _: None) -> Array:
        return task.residuals(scale * u.astype(dtype))[0].astype(u.dtype)

    result = optimistix.least_squares(
        scaled,
        _solver(method, known[2]),
        jnp.zeros(task.coordinates.count),
        max_steps=max_steps,
        # Reported by `converged`, so that one data set does not end a batch.
        throw=False,
        # Forward, because there are few parameters and many readings.
        options={"jac": "fwd"},
    )
    solved = result.result == optimistix.RESULTS.successful
    return _fit_of(
        task, scale * result.value.astype(dtype), solved, result.stats["num_steps"], stated
    )


class _Task(NamedTuple):
    """A problem of a fit: a model of parameters in `coordinates`, and readings with their standard
    deviations.

    - `seen`: mask of the available readings; `beforehand`: prior standard deviations of the
      parameters, (n,)."""

    model: Model
    coordinates: Coordinates
    data: PyTree
    sigma: PyTree
    seen: PyTree
    beforehand: Array | None

    @classmethod
    def of(cls, model: Model, data: PyTree, parameters: PyTree, known: Known) -> "_Task":
        """The validated task."""
        noise, prior, _ = known
        coordinates = Coordinates.of(parameters, 0)
        data = jax.tree.map(lambda x: jnp.asarray(x, coordinates.dtype), data)
        shapes = jax.tree.map(jnp.shape, jax.eval_shape(model, parameters))
        if shapes != jax.tree.map(jnp.shape, data):
            raise InputError(
                f"model predicts {shapes}: it must have the structure and shapes of the data, "
                f"{jax.tree.map(jnp.shape, data)}."
            )
        beforehand = _prior_of(prior, coordinates)
        count = sum(z.size for z in jax.tree.leaves(data))
        least = coordinates.count
        if count + (least if beforehand is not None else 0) < least:
            raise InputError(
                f"There are {count} readings for {least} parameters: there must be at least as "
                f"many, or a prior."
            )
        seen = jax.tree.map(lambda z: ~jnp.isnan(z), data)
        return cls(model, coordinates, data, _like(noise, data), seen, beforehand)

    def residuals(self, x: Array) -> tuple[Array, PyTree]:
        """r at the coordinates x, and those of the readings as a tree."""

        def leaf(z: Array, h: Array, s: Array, there: Array) -> Array:
            # Twice: the branch that is not taken would send the NaN of a missing reading into the
            # gradient.
            return jnp.where(there, (jnp.where(there, z, 0.0) - h) / s, 0.0)

        predicted = self.model(self.coordinates.moved(x))
        tree = jax.tree.map(leaf, self.data, predicted, self.sigma, self.seen)
        parts = [r.ravel() for r in jax.tree.leaves(tree)]
        if self.beforehand is not None:
            # One more reading of each coordinate, to which an infinite deviation gives no weight.
            parts.append(-x / self.beforehand)
        return jnp.concatenate(parts), tree

    def linear(self, x: Array) -> tuple[Array, tuple[Array, PyTree]]:
        """J, r, and the residuals as a tree."""
        return jax.jacfwd(lambda x: _twice(self.residuals(x)), has_aux=True)(x)


def _fit_of(task: _Task, x: Array, solved: Array, steps: Array, stated: bool) -> Fit:
    """The result of a search that ended at the coordinates x."""
    jacobian, (r, tree) = task.linear(x)
    count = task.coordinates.count if task.beforehand is None else 0
    readings = jnp.asarray(sum(jnp.sum(s) for s in jax.tree.leaves(task.seen)))
    freedom = readings.astype(r.dtype) - count
    chi_squared = r @ r
    variance = jnp.ones((), r.dtype)
    if not stated:
        # With equal numbers of readings and parameters the residuals vanish, and the noise is
        # unknown.
        variance = chi_squared / jnp.maximum(freedom, 1.0)
    columns = sqrt(jnp.sum(jacobian**2, axis=0))
    # A parameter without influence retains its unit, and appears as a zero singular value.
    columns = jnp.where(columns > 0.0, columns, 1.0)
    _, singular, rows = jnp.linalg.svd(jacobian / columns, full_matrices=False)
    return Fit(
        parameters=task.coordinates.moved(x),
        names=task.coordinates.labels,
        residuals=tree,
        chi_squared=chi_squared,
        freedom=freedom,
        scaled_variance=variance,
        singular_values=singular,
        directions=rows,
        columns=columns,
        steps=steps,
        converged=solved & jnp.all(jnp.isfinite(r)),
        tests=jax.tree.map(residual_tests, tree, task.seen),
        stated=stated,
    )


def _twice(held: tuple[Array, PyTree]) -> tuple[Array, tuple[Array, PyTree]]:
    return held[0], held


def _solver(method: str, tolerance: Scalar) -> optimistix.AbstractLeastSquaresSolver:
    if method == "gauss_newton":
        # By singular values: a direction without influence is not moved along.
        return optimistix.GaussNewton(tolerance, LEAST_STEP, linear_solver=lineax.SVD())
    # The trust region of optimistix reduces its damping only where a step achieves 99 % of the
    # linear prediction, and takes five times as many steps to an orbit.
    search = optimistix.ClassicalTrustRegion(0.75, 0.25, 10.0, 0.2)
    solver = optimistix.LevenbergMarquardt(tolerance, LEAST_STEP)
    return eqx.tree_at(lambda s: s.search, solver, search)
