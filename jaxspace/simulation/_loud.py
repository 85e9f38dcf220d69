"""Failures of runs inside of a compiled program, as errors of Python.

A JAX program raises an error through a Python function that it calls. JAX reports the exception of
this function twice: in its log, with a traceback, and as an error whose message holds the traceback
of the call and ends with the exception. Here the log is shortened to the sentence of the failure.
"""

import contextlib
import logging
from collections.abc import Iterator
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from jax.custom_batching import custom_vmap
from jaxtyping import Array, Int, PyTree

from ..integration.status import SimulationError, Status

T = TypeVar("T")


@jax.custom_jvp
def raise_where_failed(tree: T, status: Int[Array, ""]) -> T:
    """The arrays of the `tree`, which raise `SimulationError` where they are computed if the
    `status` is that of a failure; of mapped runs the largest status counts."""
    shapes = jax.eval_shape(lambda: tree)
    worst = _largest(status)

    def failed(tree: T, worst: Array) -> PyTree:
        del tree
        return jax.pure_callback(_fail, shapes, worst)

    # One branch for all mapped runs, because a mapped branch would evaluate both sides.
    return jax.lax.cond(worst > Status.EVENT, failed, lambda tree, worst: tree, tree, worst)


@raise_where_failed.defjvp
def _raise_where_failed_tangent(primals, tangents):
    # The primal values raise, which is enough for the derivatives as well.
    return raise_where_failed(*primals), tangents[0]


@custom_vmap
def _largest(status: Int[Array, "..."]) -> Int[Array, "..."]:
    return status


@_largest.def_vmap
def _largest_of_mapped(axis_size: int, in_batched: Any, status: Array) -> tuple[Array, bool]:
    del axis_size, in_batched
    return _largest(jnp.max(status, axis=0)), False


@contextlib.contextmanager
def sentence_alone() -> Iterator[None]:
    """In this context, turn the error of a program with a failed run into a `SimulationError`."""
    try:
        yield
    # Which of the two is raised depends on how JAX calls the program.
    except (jax.errors.JaxRuntimeError, ValueError) as error:
        _, name, sentence = str(error).rpartition(f"{SimulationError.__name__}: ")
        if not name:
            raise
        raise SimulationError(sentence.strip()) from None


def _fail(worst: Array) -> None:
    logging.getLogger("jax._src.callback").addFilter(_SHORT)
    sentence = Status(int(worst)).sentence
    raise SimulationError(f"{sentence} Run it with throw=False to read the status of each run.")


class _SentenceAlone(logging.Filter):
    """A filter of the log that shortens the entry of a failed run, and leaves the others."""

    def filter(self, record: logging.LogRecord) -> bool:
        error = record.exc_info[1] if record.exc_info else None
        if isinstance(error, SimulationError):
            record.msg = str(error)
            record.args = None
            record.exc_info = None
        return True


# One object, which the logger keeps once however often a run fails.
_SHORT = _SentenceAlone()
