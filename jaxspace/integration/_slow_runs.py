"""Repetition of a block of runs with shared steps without the runs that use up the steps.

When the steps run out, they do so for all runs of the block. So that a slow run does not cost the
others their results, the block is repeated without the runs that kept the steps short, until the
others reach the end or none is left. A block that reaches its end is computed once.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from ..core import State

# A `LoopState` or an `OwnLoop`, whose modules import this one.
Loop: TypeAlias = Any


class _Attempt(NamedTuple):
    """A loop, the runs that it leaves out, and whether it has yet to run."""

    loop: Loop
    left_out: Bool[Array, "*runs"]
    repeat: Bool[Array, ""]


def without_slow_runs(
    start: Loop,
    run: Callable[[Loop], Loop],
    slow: Callable[[Loop], Bool[Array, "*runs"]],
    nan_in: Callable[[Bool[Array, "*runs"], State], State],
) -> Loop:
    """The loop at its end, and in its `left_out` the runs that it had to leave out.

    **Arguments**

    - `start`: the loop before its first step, with no run left out.
    - `run`: takes all its steps.
    - `slow`: the runs that used up the steps of a loop; none of one that reached its end.
    - `nan_in`: a state with NaN in some runs, so that no step depends on them."""

    def attempt(carry: _Attempt) -> _Attempt:
        # Built again here, because a selection after the loop would be needed for every array.
        y = nan_in(carry.left_out, start.y)
        loop = run(start._replace(y=y, buffers=carry.loop.buffers.again(start.buffers)))
        result = slow(loop)
        left_out = carry.left_out | result
        # If all remaining runs are slow, the loop stays as it ended.
        return _Attempt(loop, left_out, jnp.any(result) & ~jnp.all(left_out))

    first = _Attempt(start, start.left_out, jnp.array(True))
    last = jax.lax.while_loop(lambda carry: carry.repeat, attempt, first)
    return last.loop._replace(left_out=last.left_out)


def nan_where(left_out: Bool[Array, "*runs"], y: State) -> State:
    """The state with NaN in the runs that are left out."""
    return jax.tree.map(lambda x: jnp.where(left_out, jnp.nan, x), y)
