"""Selection of the method for `"auto"`: the method of the first applicable rule.

A method for second-order systems is selected only if the traced vector field proves that it
applies: the rate of the position is the velocity itself, and the acceleration does not depend on
the velocity. No declaration of an effect is used for it.

Whether a run is stiff follows from its numbers (`stiffness.py`). Where these are unknown, under
`jit` or in a derivative, and for the phases of a mission, only the rules of structure apply."""

import functools
import typing
from collections.abc import Callable, Sequence
from typing import NamedTuple, final

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jax.extend.core import Literal
from jaxtyping import Array, ArrayLike, PyTree

from ..core import AbstractSystem
from ..core.structure import once_per_structure, without_numbers
from ..core.tracing import depending_on, is_traced
from ..solvers.second_order import Parts
from ._eccentric import is_eccentric, is_second_order_regularised
from .methods import HIGH_ORDER, LOW_ORDER, REGULARISED, SECOND_ORDER, STIFF
from .stiffness import InitialConditions, is_stiff

# above this tolerance the method of order 5 needs fewer evaluations than those of high order
LOOSE = 1e-5


class SelectionContext(NamedTuple):
    """Properties of a run from which its method is selected.

    - `system`, `y`: a system and a state, or their shapes.
    - `rtol`: the relative tolerance; zero where it is unknown.
    - `starts`: returns runs whose numbers are known, or `None`."""

    system: AbstractSystem
    y: PyTree
    rtol: float
    starts: Callable[[], InitialConditions | None] | None


@final
class Rule(NamedTuple):
    """A rule of selection: its condition, in words and as a test, and the method selected."""

    when: str
    holds: Callable[[SelectionContext], bool]
    method: diffrax.AbstractSolver | typing.Literal["closed_form"]


@once_per_structure
def is_second_order(system: AbstractSystem, y: PyTree) -> bool:
    """Whether the state consists of a position and a velocity only, and the acceleration is
    provably independent of the velocity."""
    # The methods for second-order systems take no other block, such as a mass or an attitude.
    parts = Parts.of(y)
    if parts is None:
        return False
    shapes, rest = eqx.partition(system, lambda x: isinstance(x, jax.ShapeDtypeStruct))

    def rates(arrays: PyTree, r: Array, v: Array) -> tuple[PyTree, PyTree]:
        rate = eqx.combine(arrays, rest).vector_field(jnp.zeros((), r.dtype), parts.state(r, v))
        return parts.split(rate) if Parts.of(rate) else (None, None)

    jaxpr = jax.make_jaxpr(rates)(shapes, *parts.split(y)).jaxpr
    velocity = jaxpr.invars[-1]
    if len(jaxpr.outvars) != 2:
        return False
    travel, acceleration = jaxpr.outvars
    # The same variable, because equal numbers would prove nothing.
    if travel is not velocity:
        return False
    # A literal number depends on nothing, and cannot be looked up.
    constant = isinstance(acceleration, Literal)
    return constant or acceleration not in depending_on(jaxpr, [velocity])


@without_numbers
def has_closed_form(system: AbstractSystem) -> bool:
    """Whether a system has a closed form."""
    return system.closed_form() is not None


def _is_fast_and_linear(context: SelectionContext) -> bool:
    if context.starts is None or is_second_order(context.system, context.y):
        return False
    starts = context.starts()
    return starts is not None and is_stiff(starts, context.rtol)


def _is_eccentric(context: SelectionContext) -> bool:
    starts = None if context.starts is None else context.starts()
    if starts is None or not is_eccentric(starts, context.system):
        return False
    # Without a potential, as under drag, DOP853 integrates either variables. The regularised ones
    # are not faster at equal error, and take three times as long to compile.
    return is_second_order_regularised(context.system, context.y)


# The first applicable rule decides: exact methods come first, and the one for all systems last.
RULES = (
    Rule("the system has a closed form", lambda c: has_closed_form(c.system), "closed_form"),
    Rule(
        "slow compared with a fast linear motion or decay, over more than 1e4 of its radians",
        _is_fast_and_linear,
        STIFF,
    ),
    Rule("the tolerance is above 1e-5", lambda c: c.rtol > LOOSE, LOW_ORDER),
    Rule(
        "orbits of e >= 0.5 about a point mass, perturbed by a potential",
        _is_eccentric,
        REGULARISED,
    ),
    Rule(
        "r' = v, v' = a(t, r), without further variables",
        lambda c: is_second_order(c.system, c.y),
        SECOND_ORDER,
    ),
    Rule("else", lambda c: True, HIGH_ORDER),
)


def select_method(
    system: AbstractSystem,
    y0: PyTree,
    rtol: float,
    ts: ArrayLike | Sequence[float] | None = None,
    *,
    starts: Callable[[], InitialConditions | None] | None = None,
) -> diffrax.AbstractSolver | typing.Literal["closed_form"]:
    """The method for `"auto"`: that of the first applicable one of the `RULES`.

    **Arguments**

    - `system`, `y0`: a system and a state, or their shapes.
    - `rtol`: the relative tolerance; zero where it is unknown.
    - `ts`: save times, s, without which a stiff run is not recognised.
    - `starts`: returns several runs, in place of `ts`.

    **Returns** a solver, or "closed_form"."""
    if starts is None:
        starts = _known_start(system, y0, ts)
    # Two rules use the runs.
    known_starts = None if starts is None else functools.cache(starts)
    context = SelectionContext(system, y0, rtol, known_starts)
    return next(rule.method for rule in RULES if rule.holds(context))


def _known_start(
    system: AbstractSystem, y0: PyTree, ts: ArrayLike | Sequence[float] | None
) -> Callable[[], InitialConditions] | None:
    """A function that returns a single run; `None` where its numbers are unknown."""
    if ts is None:
        return None
    leaves = jax.tree.leaves((system, y0, ts))
    if is_traced(leaves) or any(isinstance(x, jax.ShapeDtypeStruct) for x in leaves):
        return None
    return functools.partial(InitialConditions.of_one, system, y0, jnp.asarray(ts))


def eligible_methods(
    system: AbstractSystem,
    y0: PyTree,
    rtols: Sequence[float],
    ts: ArrayLike | Sequence[float] | None = None,
) -> tuple[diffrax.AbstractSolver | typing.Literal["closed_form"], ...]:
    """The methods of all `RULES` that apply at one of the tolerances, not only of the first one.

    **Arguments**

    - `system`, `y0`: a system and a state, or their shapes.
    - `rtols`: relative tolerances.
    - `ts`: save times, s, without which a stiff run is not recognised."""
    starts = _known_start(system, y0, ts)
    contexts = [SelectionContext(system, y0, rtol, starts) for rtol in rtols]
    return tuple(rule.method for rule in RULES if any(rule.holds(c) for c in contexts))
