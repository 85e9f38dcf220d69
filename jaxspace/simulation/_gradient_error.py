"""The error of a derivative: estimated, or asked for, as of a run by `Trajectory.error` and
`FinalError`.

Steps that serve a motion need not serve its derivative, which may be some thousand times as far
off. A derivative is therefore compared with those by other tolerances, all by one program.
"""

import dataclasses
from collections.abc import Callable
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, PyTree

from ..core import InputError
from ..core.checks import check_positive
from ..core.jit import quick_jit
from ..core.printing import printed
from ..core.tracing import is_traced
from ..integration.accuracy import (
    DEFAULT,
    DEFAULT_RTOL,
    Accuracy,
    as_accuracy,
    as_state,
    least_tolerance,
    state_dtype,
)
from ..integration.status import Status, raise_on_failure
from ..solvers.protocol import solver_traits
from ._final_error import USUAL, Measured
from ._to_final_error import APART, MOST, advance, begun

X = TypeVar("X")

FINER = 0.01
# A tolerance that is less than so many times smaller shows no error.
LITTLE = 0.1


@printed(tolerance="", runs="")
class CheckedGradient(NamedTuple):
    """A derivative with its error.

    - `gradient`: as `jax.jacrev` has it.
    - `error`: the estimate of its error, of the same form.
    - `tolerance`: that of its runs.
    - `runs`: how many times it was computed."""

    gradient: PyTree
    error: PyTree
    tolerance: float
    runs: int


def gradient_error(
    function: Callable[[X, Accuracy], PyTree],
    x: X,
    accuracy: Accuracy | Float[ArrayLike, ""] | None = None,
    *,
    forward: bool = False,
) -> CheckedGradient:
    """A derivative, and how far it changes with a hundredth of the tolerance, component by
    component.

    **Arguments**

    - `function(x, accuracy)`: numbers of runs that it makes with this `accuracy`, such as
      `simulate(system_of(x), y0, ts, accuracy=accuracy).final.position`. What does not depend on it
      is taken as exact.
    - `x`: a number, an array or a tree of them, by which the derivative is taken.
    - `accuracy`: relative tolerance of the derivative, or an `Accuracy`; by default as in
      `simulate`. Where the precision resolves not even a tenth of it, the comparison is with
      a hundred times the tolerance, and the estimate that of the looser derivative.
    - `forward`: forward mode, for few numbers in `x`; reverse mode by default.

    **Raises** `InputError` for a method of fixed steps, which follow no tolerance, and inside of
    `jit` and other transformations."""
    accuracy = as_accuracy(accuracy)
    x, dtype = _checked(x, accuracy)
    rtol = DEFAULT_RTOL[dtype.name] if accuracy.rtol is None else float(accuracy.rtol)
    other_rtol = max(FINER * rtol, 2.0 * least_tolerance(dtype))
    # At the limit of the precision no finer tolerance is left: a looser one is compared with.
    if other_rtol > LITTLE * rtol:
        other_rtol = min(rtol / FINER, MOST)
    gradient, other = (_derivative(function, x, accuracy, r, forward) for r in (rtol, other_rtol))
    # The finer derivative has a hundredth of the error: the difference is that of the coarser one.
    error = jax.tree.map(lambda a, b: np.abs(np.asarray(a) - np.asarray(b)), gradient, other)
    return CheckedGradient(gradient, error, rtol, 2)


def gradient_within(
    function: Callable[[X, Accuracy], PyTree],
    x: X,
    within: PyTree[Float[ArrayLike, ""]],
    *,
    accuracy: Accuracy = DEFAULT,
    forward: bool = False,
) -> CheckedGradient:
    """A derivative with the error that is asked for, as `FinalError` does it for a run: with
    smaller tolerances until the derivatives, as they change, show it.

    **Arguments**

    - `function`, `x`, `forward`: as in `gradient_error`.
    - `within`: the error of the length of each array of the derivative, in its unit: one number, or
      a tree of the same form.
    - `accuracy`: method and limits of the steps, without a tolerance, which is found.

    **Returns** a `CheckedGradient`, whose `error` is the estimate for the length of each array.

    **Raises** `InputError` as `gradient_error` does, and for a tolerance in `accuracy`;
    `SimulationError` where the error cannot be met."""
    for each in jax.tree.leaves(within):
        check_positive("within", each)
    if accuracy.rtol is not None:
        raise InputError(
            "gradient_within.accuracy has a tolerance, which follows from the error that is asked "
            "for: give its method and limits alone."
        )
    x, dtype = _checked(x, accuracy)
    least = 2.0 * least_tolerance(dtype)
    rtol = min(APART * max(USUAL, least), MOST)
    search = None
    # Each derivative decides on the next tolerance. All are of one program, so that a further one
    # costs its runs alone.
    while True:
        gradient = _derivative(function, x, accuracy, rtol, forward)
        measured = _measured(gradient, within)
        search = (
            begun(measured, rtol, least) if search is None else advance(search, measured, least)
        )
        if bool(search.over):
            break
        rtol = float(search.rtol)
    estimate = float(search.estimate)
    # So written, because an estimate that is NaN has missed, too.
    if not estimate <= 1.0:
        raise_on_failure(
            jnp.asarray(Status.FINAL_ERROR_MISSED),
            lambda: f"That of the derivative is {estimate:.3g} times what is asked.",
        )
    bounds = [estimate * allowed for allowed in search.last.allowed]
    error = jax.tree.unflatten(jax.tree.structure(gradient), bounds)
    return CheckedGradient(gradient, error, rtol, int(search.runs))


def _checked(x: PyTree, accuracy: Accuracy) -> tuple[PyTree, np.dtype]:
    """`x` as arrays, and their precision. Raises `InputError` for a method of fixed steps, and
    inside of a transformation."""
    if is_traced((x, accuracy)):
        raise InputError(
            "The error of a derivative is found from known numbers: it must be asked for outside "
            "of jit, vmap and grad."
        )
    if not isinstance(accuracy.method, str) and solver_traits(accuracy.method).fixed_step:
        raise InputError(
            f"accuracy.method is {type(accuracy.method).__name__}, whose steps follow no "
            f"tolerance: take a method with an error estimate."
        )
    x = as_state(x)
    return x, state_dtype(x)


def _derivative(
    function: Callable[[X, Accuracy], PyTree],
    x: X,
    accuracy: Accuracy,
    rtol: float,
    forward: bool,
) -> PyTree:
    # An array and no number: another tolerance then compiles nothing.
    return _program(function, x, accuracy, jnp.asarray(rtol, state_dtype(x)), forward)


@quick_jit
def _program(
    function: Callable[[X, Accuracy], PyTree],
    x: X,
    accuracy: Accuracy,
    rtol: Array,
    forward: bool,
) -> PyTree:
    """The derivative with a tolerance, which is a number of the program."""
    mode = jax.jacfwd if forward else jax.jacrev
    return mode(lambda x: function(x, dataclasses.replace(accuracy, rtol=rtol)))(x)


def _measured(gradient: PyTree, within: PyTree[Float[ArrayLike, ""]]) -> Measured:
    values, form = jax.tree.flatten(gradient)
    allowed, asked = jax.tree.flatten(within)
    if len(allowed) == 1:
        allowed = allowed * len(values)
    elif asked != form:
        raise InputError(
            f"gradient_within.within is {within}: it must be one number, or a tree like the "
            f"derivative, {form}."
        )
    # A derivative that is not finite shows no error, and asks for a smaller tolerance.
    good = jnp.asarray(all(bool(np.all(np.isfinite(x))) for x in values))
    no = jnp.asarray(False)
    limits = tuple(jnp.asarray(a, x.dtype) for a, x in zip(allowed, values, strict=True))
    return Measured(tuple(values), limits, good, no, no, jnp.asarray(0))
