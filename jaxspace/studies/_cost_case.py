"""A run in one precision, as functions of its arrays and the tolerance: they compile once."""

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
from jaxtyping import Array, PyTree

from ..core import Scalar, State
from ..integration import Accuracy
from ._cost_table import Method
from ._runs import Program, RunOutcome, in_precision, run_once
from ._scene_effects import Runnable


class Case(NamedTuple):
    """What runs, in one precision: its arrays, and what is left of it without them."""

    arrays: PyTree[Array]
    static: PyTree

    @classmethod
    def of(cls, system: Runnable, y0: State, ts: Array, precision: str) -> "Case":
        """The case in the `precision`."""
        # Arrays are arguments of the programs: with constants the compiler would compute beforehand
        # what is to be timed.
        return cls(*eqx.partition(in_precision((system, y0, ts), precision), eqx.is_array))

    def restored(self, arrays: PyTree[Array]) -> tuple[Any, State, Array]:
        """System, initial state and times, with these arrays."""
        return eqx.combine(arrays, self.static)

    def run(self, method: Method, room: int = 1) -> Callable[[PyTree[Array], Scalar], RunOutcome]:
        """The run as a function of its arrays and the tolerance; it may take `room` times as many
        steps as by default."""

        def run(arrays: PyTree[Array], rtol: Scalar) -> RunOutcome:
            return run_once(*self.restored(arrays), accuracy_of(method, rtol, room))

        return run

    def gradient(
        self, method: Method, output: Callable[[State], Scalar], room: int = 1
    ) -> Callable[[PyTree[Array], Scalar], State]:
        """The gradient of the output with respect to the initial state, as a function of the
        arrays and the tolerance; `room` as of `run`."""

        def gradient(arrays: PyTree[Array], rtol: Scalar) -> State:
            system, y0, ts = self.restored(arrays)
            accuracy = accuracy_of(method, rtol, room)
            return jax.grad(lambda y: output(run_once(system, y, ts, accuracy).final))(y0)

        return gradient


class Programs(NamedTuple):
    """The run and its gradient, compiled for one method in one precision."""

    run: Program
    gradient: Callable[[PyTree[Array], Scalar], State] | None


def accuracy_of(method: Method, rtol: Scalar, room: int = 1) -> Accuracy:
    """The accuracy of a method at a tolerance, which may be traced, with `room` times the steps of
    the default."""
    own = Accuracy(rtol=rtol, method=method)  # pyright: ignore[reportArgumentType]
    return own if room == 1 else dataclasses.replace(own, max_steps=room * own.max_steps)
