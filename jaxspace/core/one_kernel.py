"""Functions as one kernel of a program."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax.custom_batching import custom_vmap
from jaxtyping import Array, PyTree

from .barrier import barrier
from .tracing import is_traced


def in_one_kernel(function: Callable[..., PyTree], *args: PyTree) -> PyTree:
    """`function(*args)`: in a compiled program, on a CPU, as one kernel.

    The CPU compiler creates a kernel, 10 ms of compilation each, for every few operations, but only
    one for a whole loop with a small carry. The function therefore becomes a loop with one
    iteration: a Kepler orbit then compiles in less than half of the time, at the same run time. It
    must not be differentiated: it belongs into the value of a function with a rule for its
    derivative.

    **Arguments**

    - `function`: of `args`, with arrays as its result.
    - `args`: trees of arrays or numbers, of a single run: under `vmap` this is the function
      itself."""
    if not is_traced(args):
        return function(*args)

    def loop(*args: PyTree) -> PyTree:
        shapes = jax.eval_shape(function, *args)
        nothing = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), shapes)

        def body(carry: tuple[Array, PyTree]) -> tuple[Array, PyTree]:
            # Together with the number of the pass: what does not depend on it would be moved out of
            # the loop.
            number, given = barrier((carry[0], args))
            return number + 1, function(*given)

        # A start hidden from the compiler, which would otherwise remove a loop with one iteration.
        start = barrier(jnp.zeros((), jnp.int32)), nothing
        return jax.lax.while_loop(lambda carry: carry[0] < 1, body, start)[1]

    @custom_vmap
    def alone(*args: PyTree) -> PyTree:
        return jax.lax.platform_dependent(*args, cpu=loop, default=function)

    @alone.def_vmap
    def _(size: int, batched: PyTree, *args: PyTree) -> tuple[PyTree, PyTree]:
        axes = jax.tree.map(lambda is_batched: 0 if is_batched else None, batched)
        result = jax.vmap(function, in_axes=axes, axis_size=size)(*args)
        return result, jax.tree.map(lambda _: True, result)

    return alone(*jax.tree.map(jnp.asarray, args))
