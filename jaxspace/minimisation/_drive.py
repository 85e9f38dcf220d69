"""The loop of a search, whose program contains the problem and its derivatives once.

    state <- advance(state, evaluate(state))          while unfinished(state)

At each step a search gives the point at which the problem is to be evaluated, and receives the
result: its start, the check of its gradient, its line search and its corrections share one program.
With concrete numbers the loop is Python's: `evaluate` is compiled once, and a search can be
watched, interrupted and resumed. Under a transformation it is a loop of the compiled program.
"""

from collections.abc import Callable
from typing import Any, ParamSpec, TypeAlias, TypeVar

import equinox as eqx
import jax
from jax import lax
from jaxtyping import Array

from ..core.jit import QUICK, compiled
from ..core.tracing import is_traced
from .search_store import SearchStore

# The carry of a search, and the values evaluated for it.
S = TypeVar("S", bound=Any)
F = TypeVar("F")
P = ParamSpec("P")
R = TypeVar("R")

Progress: TypeAlias = Callable[[int, float, float, float], None]
"""Called after each step with its number, objective, violation and gradient."""


def at_once(f: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
    """f(*args) as one compiled program where its numbers are known: otherwise each of its many
    operations would be compiled separately."""
    return f(*args, **kwargs) if is_traced(args) else compiled(f, **QUICK)(*args, **kwargs)


def drive(
    evaluate: Callable[[S], F],
    advance: Callable[[S, F], S],
    unfinished: Callable[[S], Array],
    state: S,
    progress: Progress | None = None,
    store: SearchStore | None = None,
) -> tuple[S, bool]:
    """The last state of a search, and whether it was interrupted (by Ctrl-C).

    **Arguments**

    - `evaluate`: a function from a state to values and derivatives at its `trial`.
    - `advance`: the next state; `unfinished`: whether there is one.
    - `progress`: see `Progress`; its numbers are the last row of `state.rows`.
    - `store`: saves the state after each step.
    """
    if not is_traced(state):
        # A weak type of the start would make another program of each further step.
        state = at_once(_strong, state)
        # Arrays of `evaluate` are arguments of the program, which other searches of the same
        # problem then share.
        evaluated = compiled(evaluate)
        first = evaluated(state)
        # If the problem closes over traced numbers, its results are traced.
        if not is_traced(first):
            return _watched(evaluated, advance, unfinished, state, first, progress, store)

    def body(state: S) -> S:
        return advance(state, evaluate(state))

    # A function, because a tree of arrays has no hash.
    return lax.while_loop(lambda state: unfinished(state), body, state), False


def _strong(state: S) -> S:
    return jax.tree.map(lambda x: lax.convert_element_type(x, x.dtype), state)


def _watched(
    evaluate: Callable[[S], F],
    advance: Callable[[S, F], S],
    unfinished: Callable[[S], Array],
    state: S,
    evaluation: F | None,
    progress: Progress | None,
    store: SearchStore | None,
) -> tuple[S, bool]:
    move = compiled(eqx.Partial(_moved, advance, unfinished), **QUICK)
    # A search that is resumed may have nothing left to do.
    more = bool(at_once(unfinished, state))
    taken = int(state.taken)
    known = taken > 0
    try:
        while more:
            # The first evaluation was already made, to see whether the numbers are known.
            evaluation = evaluate(state) if evaluation is None else evaluation
            state, goes_on = move(state, evaluation)
            evaluation, known = None, True
            more = bool(goes_on)
            if store is not None:
                store.save(state, last=not more)
            if progress is not None and int(state.taken) > taken:
                taken = int(state.taken)
                objective, violation, gradient = (float(x) for x in state.rows[taken - 1])
                progress(taken, objective, violation, gradient)
    except KeyboardInterrupt:
        # Before the first step nothing is known that could be told.
        if not known:
            raise
        # The state of the last whole step, from which `minimise` can continue.
        if store is not None:
            store.save(state, last=True)
        return state, True
    return state, False


def _moved(
    advance: Callable[[S, F], S], unfinished: Callable[[S], Array], state: S, evaluation: F
) -> tuple[S, Array]:
    """The next state, and whether there is one after it."""
    state = advance(state, evaluation)
    return state, unfinished(state)
