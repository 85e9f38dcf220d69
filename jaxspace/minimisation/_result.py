"""The `Minimum` of a search, in the units of the problem."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PyTree

from ..core import Scalar
from ._criterion import Criterion, Minimum, StopReason, stop_reason
from ._gradient_check import GRADIENT_TOLERANCE
from ._sqp_measures import at_least_violation, lagrangian_gradient, slope, violation
from ._sqp_state import Limits, Values


class End(NamedTuple):
    """The end of a search: scaled unknowns, values, multipliers; the weights of the violation that
    the search reduced last; whether it diverged; whether it is at its minimum to the rounding of
    the objective; and whether the local scales confirm the convergence (`_local_scale.py`)."""

    z: Float[Array, " n"]
    at: Values
    y: Float[Array, " equal"]
    nu: Float[Array, " inequal"]
    last_y: Float[Array, " equal"]
    last_nu: Float[Array, " inequal"]
    diverged: Bool[Array, ""]
    rounded: Bool[Array, ""]
    judged: Bool[Array, ""]


def minimum_of(end: End, last: PyTree, limits: Limits, interrupted: bool) -> Minimum:
    """The result of a search from its `last` state, in the units of the problem, with x as one
    array."""
    at = end.at
    c, d = at.report.equal_zero, at.report.non_negative
    weight, size = last.weight, last.size
    y = end.y * weight[1 : 1 + end.y.size] / weight[0]
    nu = end.nu * weight[1 + end.y.size :] / weight[0]
    gradient = lagrangian_gradient(at, end.z, end.y, end.nu, limits)
    converged, reason = _ended_by(end, last, gradient, limits, interrupted)
    # In the units of the problem, because a user's limit is in them, too.
    unscaled = jnp.zeros_like(gradient)
    if c is not None:
        unscaled = jnp.maximum(unscaled, jnp.max(jnp.abs(c)))
    if d is not None:
        unscaled = jnp.maximum(unscaled, jnp.max(-d))
    return Minimum(
        x=size * end.z,
        criterion=at.report,
        multipliers=Criterion(
            jnp.ones_like(gradient),
            None if c is None else y.reshape(c.shape),
            None if d is None else nu.reshape(d.shape),
        ),
        gradient=gradient,
        violation=unscaled,
        steps=last.steps,
        converged=converged,
        gradient_error=last.wrong,
        reason=reason.astype(int),
        bound_multipliers=slope(at, end.y, end.nu) / (weight[0] * size),
        history=last.rows,
        left_out=last.left_out,
        refused=last.refused,
        search=last,
        tolerance=limits.tolerance,
    )


def _ended_by(
    end: End, last: PyTree, gradient: Scalar, limits: Limits, interrupted: bool
) -> tuple[Bool[Array, ""], Int[Array, ""]]:
    """Whether a search has converged, and the `StopReason` by which it ended; `gradient`: the
    scaled one of the Lagrangian."""
    at = end.at
    missed = violation(at) > limits.tolerance
    # Without constraints there is nothing to compile.
    infeasible = jnp.zeros_like(missed)
    if at.c.size + at.d.size:
        infeasible = missed & at_least_violation(at, end.z, end.last_y, end.last_nu, limits)
    finite = at.sound()
    # `finite` is needed as well: NaN does not exceed a tolerance, and an infinite objective can
    # have a gradient of zero.
    converged = (gradient <= limits.tolerance) & ~missed & finite & end.judged
    spent = last.taken >= last.rows.shape[0]
    rounded = end.rounded & ~missed & finite & ~converged
    reason = stop_reason(finite, converged, spent, infeasible, end.diverged)
    reason = jnp.where(rounded, StopReason.ROUNDED, reason)
    converged = converged | rounded
    # A wrong gradient and an interruption come first.
    if interrupted:
        reason = jnp.full_like(reason, StopReason.INTERRUPTED)
    reason = jnp.where(last.wrong > GRADIENT_TOLERANCE, StopReason.WRONG_GRADIENT, reason)
    return converged, reason
