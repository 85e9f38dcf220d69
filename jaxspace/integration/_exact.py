"""Motions that are known exactly, whole or in part: their results without steps."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import AbstractClosedForm, AbstractDecoupled, State
from ..core.groups import on_group, project
from ..core.status import Status, status_from
from ..solvers.tolerances import Tolerance
from .layout import of_each, times_behind_components, times_first
from .result import IntegrationResult


def by_closed_form(
    closed_form: AbstractClosedForm,
    y0: State,
    duration: Array,
    fractions: Float[Array, "times *#runs"] | None,
    run_axes: int,
    rows: Callable[[Callable[[Array], State], Array], State],
) -> IntegrationResult:
    """The result of a closed form, whose states `rows` computes: for each saved time one.

    Arguments as of `integrate`."""
    # A single duration is not mapped over, because that would trace everything twice.
    if fractions is None:
        final = _on_groups(closed_form.flow(duration, y0))
        states = jax.tree.map(lambda x: x[None], final)
    else:
        durations = of_each(fractions, duration)
        states = rows(lambda d: _on_groups(closed_form.flow(d, y0)), durations)
        final = jax.tree.map(lambda x: x[-1], states)
    finite = Tolerance(0.0, 0.0, run_axes).alive(final)
    status = status_from(jnp.array(False), finite, jnp.zeros(finite.shape))
    states = times_behind_components(states, run_axes)
    return IntegrationResult(states, status, {"evaluations": jnp.array(0)}, None, None)


def joined(
    decoupled: AbstractDecoupled,
    y0: State,
    duration: Array,
    fractions: Float[Array, "times *#runs"] | None,
    result: IntegrationResult,
    run_axes: int,
) -> IntegrationResult:
    """The result of the rest, joined with the exact part at the same times; the steps are those of
    the rest."""
    rest = times_first(result.states, run_axes)
    if fractions is None:
        last = jax.tree.map(lambda x: x[0], rest)
        final = _on_groups(decoupled.joined(duration, y0, last))
        states = jax.tree.map(lambda x: x[None], final)
    else:
        states = jax.vmap(lambda d, y: _on_groups(decoupled.joined(d, y0, y)))(
            of_each(fractions, duration), rest
        )
        final = jax.tree.map(lambda x: x[-1], states)
    lost = ~Tolerance(0.0, 0.0, run_axes).alive(final)
    # The rest of the motion has reached its end: it is the exact part that is not finite.
    lost = lost & (result.status <= Status.TOLERANCE_MISSED)
    status = jnp.where(lost, Status.NOT_FINITE, result.status).astype(jnp.int32)
    return result._replace(states=times_behind_components(states, run_axes), status=status)


def at_once(function: Callable[[Array], State], rows: Array) -> State:
    """The function of all rows, by one program."""
    return jax.vmap(function)(rows)


def _on_groups(y: State) -> State:
    """The state with NaN for every block that is not near its group, such as a quaternion of zeros.

    A closed form may return such a block as it is; the projection at the end of a step makes it
    NaN."""

    def leaf(x: State) -> State:
        if not on_group(x):
            return x
        # Only whether it is near counts: the derivative is that of the closed form.
        near = jax.lax.stop_gradient(project(x))
        return jax.tree.map(lambda a, b: jnp.where(jnp.isfinite(b), a, jnp.nan), x, near)

    return jax.tree.map(leaf, y, is_leaf=on_group)
