"""Many evaluations of one function, by the program that suits the device."""

from collections.abc import Callable
from typing import TypeVar

import jax
from jaxtyping import PyTree

T = TypeVar("T")


def in_turn(function: Callable[[PyTree], T], rows: PyTree) -> T:
    """`function` of each row of the arrays of a tree, stacked: sequentially in a loop on a CPU,
    vectorised elsewhere.

    The compiler for CPUs treats the loop as one piece, and each operation on all rows as a piece of
    its own, which costs it 10 ms. For a batch the loop is also faster: its numbers stay in the
    cache. For a single run of very many rows it is slower."""
    return jax.lax.platform_dependent(
        rows, cpu=lambda rows: jax.lax.map(function, rows), default=jax.vmap(function)
    )
