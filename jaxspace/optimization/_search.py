"""What the methods of `minimise` share: their arguments, the reason of an end, and how a search
that ended before its time goes on."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..core import InputError, Scalar
from ._bounds import Bounds
from ._criterion import Criterion, Minimum, Point, StopReason, stop_reason
from ._drive import Progress
from ._gradient_check import GRADIENT_TOLERANCE


class Common(NamedTuple):
    """Arguments that both methods share."""

    problem: Callable[[Point], Criterion]
    start: Point
    limits: Bounds
    tolerance: Scalar
    check: bool
    progress: Progress | None


def reason_of(
    wrong: Array,
    interrupted: bool,
    finite: Array,
    converged: Array,
    limited: Array,
    infeasible: Array,
    astray: Array,
) -> Int[Array, ""]:
    """The reason of the end, of which a wrong gradient and an interruption come first."""
    reason = stop_reason(finite, converged, limited, infeasible, astray)
    if interrupted:
        reason = jnp.full_like(reason, StopReason.INTERRUPTED)
    return jnp.where(wrong > GRADIENT_TOLERANCE, StopReason.WRONG_GRADIENT, reason).astype(int)


def taken_up(before: Minimum, blank: Any) -> Any:
    """The state in which a search ended, with room for as many further steps."""
    last = before.search
    # Other numbers of constraints make other arrays; the rows are those of the new limits.
    if type(last) is not type(blank) or _shapes(last) != _shapes(blank):
        raise InputError("start is a Minimum of another problem or method: start from its x.")
    # What was pending when it ended is evaluated first.
    return last._replace(rows=blank.rows, taken=jnp.asarray(0))


def _shapes(state: Any) -> list[tuple[int, ...]]:
    return [x.shape for x in jax.tree.leaves(state._replace(rows=None))]


def joined_rows(before: Minimum | None, rows: Array) -> Float[Array, "rows 3"]:
    """The history, with that of the search that was taken up before it."""
    if before is None:
        return rows
    old = before.history
    # Rows that were not taken are NaN, and would stand between both searches.
    return jnp.concatenate([old[~jnp.isnan(old[:, 0])], rows])
