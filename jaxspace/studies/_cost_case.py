"""A run in one precision, as functions of its arrays and the tolerance: they compile once."""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
from jaxtyping import Array, PyTree

from ..core import Scalar, State
from ..integration.accuracy import Accuracy
from ..simulation.mission_result import Simulated
from ._runs import Program, in_precision, run_once
from ._scene_effects import Runnable
from .cost_table import MAX_STEPS, Method


class Case(NamedTuple):
    """A run in one precision: its arrays, the rest of it, and the limit of its steps."""

    arrays: PyTree[Array]
    static: PyTree
    max_steps: int

    @classmethod
    def of(
        cls, system: Runnable, y0: State, ts: Array, precision: str, max_steps: int = MAX_STEPS
    ) -> "Case":
        """The case in the `precision`."""
        # Arrays are arguments of the programs, because the compiler would evaluate constants, and
        # with them what is to be timed.
        parts = eqx.partition(in_precision((system, y0, ts), precision), eqx.is_array)
        return cls(*parts, max_steps)

    def restored(self, arrays: PyTree[Array]) -> tuple[PyTree, State, Array]:
        """System, initial state and times, with these arrays."""
        return eqx.combine(arrays, self.static)

    def run(self, method: Method, room: int = 1) -> Callable[[PyTree[Array], Scalar], Simulated]:
        """The run as a function of its arrays and the tolerance, with `room` times the steps of a
        run."""

        def run(arrays: PyTree[Array], rtol: Scalar) -> Simulated:
            accuracy = accuracy_of(method, rtol, room * self.max_steps)
            return run_once(*self.restored(arrays), accuracy)

        return run

    def gradient(
        self, method: Method, output: Callable[[State], Scalar], room: int = 1
    ) -> Callable[[PyTree[Array], Scalar], State]:
        """The gradient of the output with respect to the initial state, as a function of the
        arrays and the tolerance; `room` as of `run`."""

        def gradient(arrays: PyTree[Array], rtol: Scalar) -> State:
            system, y0, ts = self.restored(arrays)
            accuracy = accuracy_of(method, rtol, room * self.max_steps)
            return jax.grad(lambda y: output(run_once(system, y, ts, accuracy).final))(y0)

        return gradient


class Programs(NamedTuple):
    """The run and its gradient, compiled for one method in one precision."""

    run: Program
    gradient: Callable[[PyTree[Array], Scalar], State] | None


def accuracy_of(method: Method, rtol: Scalar, max_steps: int = MAX_STEPS) -> Accuracy:
    """The accuracy of a method at a tolerance, which may be traced."""
    return Accuracy(rtol=rtol, method=method, max_steps=max_steps)  # pyright: ignore
