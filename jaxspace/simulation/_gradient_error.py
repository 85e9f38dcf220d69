"""Estimate of the numerical error of a derivative, as `Trajectory.error` estimates that of a run.

Steps that resolve a motion need not resolve its derivative, whose error may be a thousand times as
large. The derivative is therefore compared with one at another tolerance, by the same program.
"""

import dataclasses
from collections.abc import Callable
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, PyTree

from ..core import InputError
from ..core.jit import quick_jit
from ..core.printing import printed
from ..core.tracing import is_traced
from ..integration.accuracy import DEFAULT_RTOL, Accuracy, as_accuracy, least_tolerance
from ..integration.initial_state import as_state, state_dtype
from ..solvers.protocol import solver_traits
from ._to_final_error import LOOSEST_TOLERANCE

X = TypeVar("X")

FINER = 0.01
# A tolerance that is less than so many times smaller shows no error.
LEAST_REFINEMENT = 0.1


@printed(tolerance="")
class CheckedGradient(NamedTuple):
    """A derivative with its error.

    - `gradient`: as `jax.jacrev` has it.
    - `error`: the estimate of its error, of the same form.
    - `tolerance`: that of its runs."""

    gradient: PyTree
    error: PyTree
    tolerance: float


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
      `simulate(system_of(x), y0, ts, accuracy=accuracy).final.position`. Results that do not depend
      on it are treated as exact.
    - `x`: a number, an array or a pytree of them, with respect to which the derivative is computed.
    - `accuracy`: relative tolerance of the derivative, or an `Accuracy`; by default as in
      `simulate`. Where the precision resolves not even a tenth of it, the comparison is with
      a hundred times the tolerance, and the estimate that of the looser derivative. With
      `derivative_control=False` the comparison is with a derivative whose steps are controlled.
    - `forward`: forward mode, for few numbers in `x`; reverse mode by default.

    **Raises** `InputError` for a method of fixed steps, which follow no tolerance, and inside of
    `jit` and other transformations."""
    accuracy = as_accuracy(accuracy)
    x, dtype = _checked(x, accuracy)
    rtol = DEFAULT_RTOL[dtype.name] if accuracy.rtol is None else float(accuracy.rtol)
    other_rtol = max(FINER * rtol, 2.0 * least_tolerance(dtype))
    # At the limit of the precision no finer tolerance is left: a looser one is compared with.
    if other_rtol > LEAST_REFINEMENT * rtol:
        other_rtol = min(rtol / FINER, LOOSEST_TOLERANCE)
    gradient = _derivative(function, x, accuracy, rtol, forward)
    # At rest the motion needs the same steps at every tolerance: without control of the derivatives
    # both would have the same error.
    controlled = dataclasses.replace(accuracy, derivative_control=True)
    other = _derivative(function, x, controlled, other_rtol, forward)
    # The finer derivative has a hundredth of the error: the difference is that of the coarser one.
    error = jax.tree.map(lambda a, b: np.abs(np.asarray(a) - np.asarray(b)), gradient, other)
    return CheckedGradient(gradient, error, rtol)


def _checked(x: PyTree, accuracy: Accuracy) -> tuple[PyTree, np.dtype]:
    """`x` as arrays, and their precision. Raises `InputError` for a method of fixed steps, and
    inside of a transformation."""
    if is_traced((x, accuracy)):
        raise InputError(
            "The error of a derivative is estimated from concrete values: request it outside of "
            "jit, vmap and grad."
        )
    if not isinstance(accuracy.method, str) and solver_traits(accuracy.method).fixed_step:
        raise InputError(
            f"accuracy.method is {type(accuracy.method).__name__}, which does not adapt its steps "
            "to a tolerance: use a method with an error estimate."
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
