"""Controllers: with a memory, or any function of the measurements."""

import inspect
from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, final

import jax
from jaxtyping import PyTree

from ..core import AbstractParameters, InputError, Scalar
from ..core.user_functions import user_function


class AbstractController(AbstractParameters):
    """A controller that acts at samples. A concrete controller is final.

    `broadcasts`: whether its formulas support a batch as the last axis, like those of this library;
    a controller written for a single run is vectorised."""

    broadcasts: ClassVar[bool] = True

    def start(self, measured: PyTree) -> PyTree:
        """The memory before the first sample, of floating-point arrays; `None` if it has none.

        `measured` has the shapes of the measurements."""
        del measured
        return None

    @abstractmethod
    def act(self, t: Scalar, memory: PyTree, measured: PyTree) -> tuple[PyTree, PyTree]:
        """The command and the memory after a sample.

        **Arguments**

        - `t`: s; `memory`: before it.
        - `measured`: the state, or the readings of the sensors by name."""

    def settle(self, memory: PyTree, asked: PyTree, applied: PyTree) -> PyTree:
        """The memory, once the command that was `asked` for has been `applied` within its limits:
        where an integral must not wind up."""
        del asked, applied
        return memory


@final
class Feedback(AbstractController):
    """A controller without memory, given by a function; for one run.

    - `function`: `(measured) -> command` or `(t, measured) -> command`: a Python function, an
      `equinox` network, or a `jax.tree_util.Partial` of a function and its weights."""

    function: Callable[..., PyTree]
    broadcasts: ClassVar[bool] = False

    def act(self, t: Scalar, memory: PyTree, measured: PyTree) -> tuple[PyTree, PyTree]:
        arguments = (measured,) if _arguments(self.function) == 1 else (t, measured)
        with user_function("Feedback.function"):
            return self.function(*arguments), memory


def _arguments(function: Callable[..., object]) -> int:
    """The number of arguments of a function without a default."""
    kinds = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    given = inspect.signature(function).parameters.values()
    return len([p for p in given if p.kind in kinds and p.default is p.empty])


def as_controller(x: object) -> Any:
    """A controller from itself or from a function. Raises `InputError` for anything else."""
    if isinstance(x, AbstractController) or not callable(x):
        # Anything else is a placeholder of a tree transformation, or reported when the loop runs.
        return x
    if _arguments(x) not in (1, 2):
        raise InputError(
            f"ClosedLoop.controller takes {_arguments(x)} arguments: it must take the "
            "measurements, or the time and the measurements."
        )
    return Feedback(x)


def act_on(
    controller: AbstractController, t: Scalar, memory: PyTree, measured: PyTree, run_axes: int
) -> tuple[PyTree, PyTree]:
    """`controller.act`, mapped over the runs where it is written for one."""
    if run_axes == 0 or controller.broadcasts:
        return controller.act(t, memory, measured)
    # The runs of a phase may have started at different times.
    timed = -1 if getattr(t, "ndim", 0) else None
    return jax.vmap(controller.act, (timed, -1, -1), -1)(t, memory, measured)


def started(controller: AbstractController, measured: PyTree, run_axes: int) -> PyTree:
    """`controller.start`, mapped over the runs where it is written for one."""
    if run_axes == 0 or controller.broadcasts:
        return controller.start(measured)
    return jax.vmap(controller.start, -1, -1)(measured)


def measurement(measured: PyTree, name: str) -> PyTree:
    """The measurement with a name: the reading of that sensor, or that part of the state.

    Raises `InputError` where no sensor has the name."""
    if isinstance(measured, Mapping):
        if name not in measured:
            raise InputError(
                f"The controller requires {name!r}, and the sensors are {', '.join(measured)}: add "
                "a sensor with this name."
            )
        return measured[name]
    # A whole state: its own parts, and those integrated by effects.
    result = getattr(measured, name, None)
    return measured.part(name) if result is None else result
