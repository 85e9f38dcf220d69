"""Accuracy of a run: tolerances, method and limits of the steps."""

from types import UnionType
from typing import Any, final

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import DTypeLike

from ..core import AbstractParameters, InputError, Scalar, check, quantity
from ..core.checks import check_positive, is_concrete
from ..core.types import as_optional_float
from ..solvers.protocol import solver_traits

# Default relative tolerance by precision: nine digits, and the achievable accuracy of float32 over
# a few hundred steps.
DEFAULT_RTOL = {"float64": 1e-9, "float32": 1e-5}


def _known_float(x: object) -> object:
    """Convert by `as_optional_float`, where a Python number stays concrete under `jit`."""
    if isinstance(x, complex | np.complexfloating):
        # Left to `check_number`, whose error names the field.
        return x
    if not isinstance(x, float | int):
        return as_optional_float(x)
    # As a tracer, a tolerance that the precision cannot reach would pass without an error, and
    # "auto" would take the method for tight tolerances.
    with jax.ensure_compile_time_eval():
        return as_optional_float(x)


@jax.tree_util.register_static
class MethodName(str):
    """The name of a method, as part of the structure of a tree.

    A plain string is a leaf, and `jax.jit` and `jax.vmap` cannot return results that contain
    one."""

    __slots__ = ()


def as_method(method: Any) -> Any:
    """Convert a method given by its name to a `MethodName`; a solver is unchanged."""
    return MethodName(method) if isinstance(method, str) else method


@final
class Accuracy(AbstractParameters):
    """Tolerances, method and limits of the steps of a run.

    **Arguments**

    - `rtol`: relative to the length of every block of the state (position, quaternion, ...). By
      default 1e-9 for float64 states and 1e-5 for float32 states. In a batch each run may have
      individual values, (runs,), also of `atol`.
    - `atol`: in the unit of the block, by default a thousandth of `rtol`. It matters only for a
      block that is close to zero.
    - `method`: `"auto"` (see `select_method`), `"closed_form"`, or a diffrax solver with an error
      estimate whose steps start from the state only, such as every Runge-Kutta method. A
      fixed-step method uses its given number of steps. If their error exceeds the tolerance, the
      run is repeated with up to eight times as many, except under `jit`, in derivatives of a batch
      and in missions.
    - `max_steps`: maximum number of steps of a run. Reverse mode allocates memory for all of them:
      one number per step, or two per step and run with `AdaptiveRegularised`, where a short run is
      differentiated several times faster with a smaller limit. A run that would need more than half
      of the memory for them is rejected.
    - `max_step`: the longest step, s; by default as long as the tolerance allows. The vector field
      is sampled at the stages of the steps, so that a pulse much shorter than a step can be
      missed: choose half the length of the shortest pulse. Closed forms and systems that declare
      their `breaks` do not need it.
    - `decoupled`: whether a part of the motion with a closed form is computed with it, and only the
      rest with the method (`AbstractSystem.decoupled`). An example is the rotation of a body under
      forces without torque. By default "auto" decides: this is done if the revolutions of this part
      would use many of `max_steps`, or if a first attempt reached this limit. It is not done under
      `jit` and in derivatives, where the numbers are unknown.
    - `derivative_control`: whether the step control of a differentiated run also monitors its
      derivatives, and repeats the run with shorter steps if those chosen for the motion do not
      resolve them: at or near an equilibrium, or where a zero parameter leaves nothing to resolve.
      Without it a gradient is slightly faster. Derivatives by `AdaptiveRegularised` and by
      fixed-step methods use steps chosen from the motion only.
    - `chosen_at`: the largest tolerance for which "auto" chooses the method; by default `rtol`, and
      above 1e-5 it is a different one. It allows runs at several tolerances to share one program.

    The tolerances and `max_step` are traced: changing them causes no new compilation.

    **Raises** `InputError` for a value that is not positive, for an `rtol` of 1 or more, and for
    `max_step` with a fixed-step method."""

    rtol: Scalar | None = quantity(
        "",
        positive=True,
        optional=True,
        converter=_known_float,
        doc="relative tolerance of each step",
    )
    atol: Scalar | None = quantity(
        "",
        non_negative=True,
        optional=True,
        converter=_known_float,
        doc="absolute tolerance of each step",
    )
    method: diffrax.AbstractSolver | str = eqx.field(default="auto", converter=as_method)
    max_steps: int = eqx.field(static=True, default=16384)
    max_step: Scalar | None = quantity(
        "s", positive=True, optional=True, converter=_known_float, doc="longest step"
    )
    decoupled: bool | None = eqx.field(static=True, default=None)
    derivative_control: bool = eqx.field(static=True, default=True)
    chosen_at: float | None = eqx.field(static=True, default=None)

    def __check_init__(self):
        check_positive("Accuracy.max_steps", self.max_steps)
        check_positive("Accuracy.chosen_at", 1.0 if self.chosen_at is None else self.chosen_at)
        for name in ("rtol", "atol", "max_step"):
            check_number(f"Accuracy.{name}", getattr(self, name))
        if is_concrete(self.rtol):
            # An error as large as the state itself: most likely a number of digits was meant.
            # A value that is not finite is rejected with the range of the field.
            rtol = np.asarray(self.rtol)
            fine = (rtol < 1.0) | ~np.isfinite(rtol)
            check(fine, "Accuracy.rtol", self.rtol, "below one, such as 1e-9 for nine digits")
        if isinstance(self.method, str):
            if self.method not in ("auto", "closed_form"):
                raise InputError(
                    f'Accuracy.method is "{self.method}": it must be "auto", "closed_form" or a '
                    f"solver, such as jaxspace.solvers.DOP853()."
                )
        elif isinstance(self.method, type):
            name = self.method.__name__
            raise InputError(f"Accuracy.method is the class {name}: it must be a solver, {name}().")
        elif isinstance(self.method, diffrax.AbstractSolver) and self.max_step is not None:
            # A placeholder of a tree transformation is not a solver, and passes.
            if solver_traits(self.method).fixed_step:
                name = type(self.method).__name__
                raise InputError(
                    f"Accuracy.max_step is not available for {name}: set the number of steps with "
                    f"{name}(steps=...)."
                )


def check_tolerances(accuracy: Accuracy, runs: int | None) -> None:
    """Raise `InputError` for a tolerance that is neither one number nor one for each of the `runs`
    of a batch; `None` for a single run."""
    for name in ("rtol", "atol"):
        shape = np.shape(getattr(accuracy, name))
        if shape and shape != (runs,):
            each = "" if runs is None else f", or one for each run, ({runs},)"
            raise InputError(f"Accuracy.{name} has the shape {shape}: it must be one number{each}.")


def check_number(name: str, value: object) -> None:
    """Raise `InputError` for text, lists or complex numbers instead of a number."""
    if isinstance(value, str | list | tuple | dict | complex | np.complexfloating):
        raise InputError(f"{name} is {value!r}: it must be a number.")


def _check_kind(field: str, value: object, kinds: type | UnionType, allowed: str) -> None:
    """Raise `InputError` for a value of another type. Checked here and not where the `Accuracy` is
    created, because transformations of trees put placeholders in its fields."""
    if not isinstance(value, kinds):
        raise InputError(f"Accuracy.{field} is {value!r}: it must be {allowed}.")


DEFAULT = Accuracy()


def as_accuracy(accuracy: Any) -> Accuracy:
    """An `Accuracy` from itself, from a relative tolerance, or the default one."""
    if isinstance(accuracy, Accuracy):
        _check_kind("method", accuracy.method, str | diffrax.AbstractSolver, "a solver")
        _check_kind("decoupled", accuracy.decoupled, bool | None, "True, False or None")
        _check_kind("derivative_control", accuracy.derivative_control, bool, "True or False")
        _check_kind("max_steps", accuracy.max_steps, int | np.integer, "a whole number")
        return accuracy
    if accuracy is None:
        return DEFAULT
    if isinstance(accuracy, eqx.Module):
        raise InputError(
            f"accuracy is of type {type(accuracy).__name__}: it must be a relative tolerance or an "
            "Accuracy. A FinalError is accepted by simulate, simulate_batch, simulate_mission and "
            "simulate_mission_batch."
        )
    check_number("accuracy", accuracy)
    return Accuracy(rtol=accuracy)


def least_tolerance(dtype: DTypeLike) -> float:
    """The smallest tolerance that the precision resolves: sixteen units in the last place."""
    return 16.0 * float(jnp.finfo(dtype).eps)
