"""Warnings of vector fields whose derivatives are wrong: they interpolate in time between nodes
that are not breaks of the integration, or jump with the state without an event at the jump.

A search for the interval of a time is visible in the traced vector field. `Table` and `Spline`
contain no such search. Interpolations over the state, such as the density over the height, are left
out, because step control handles their kinks as it does any other change.

The derivative of a step over a jump does not contain how the time of the jump moves. An event adds
this (`newton_correct`).
"""

import warnings
from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
from jax.extend.core import Jaxpr, Literal, Var
from jaxtyping import PyTree

from ..core import AbstractSystem, Scalar, State
from ..core.structure import without_numbers
from ..core.tables import breaks_of
from ..integration.events import Event


class Follows(NamedTuple):
    """Dependencies of a traced value."""

    time: bool
    state: bool


NOTHING = Follows(False, False)


def warn_of_kinks(jaxpr: Jaxpr, system: AbstractSystem, states: int, stacklevel: int) -> None:
    """Warn of a traced vector field that interpolates in time, unless the system has breaks.

    `jaxpr` has the arrays of the system, of the time and of the state, `states` of them, as its
    arguments, in this order."""
    breaks = eqx.filter_eval_shape(breaks_of, system)
    # Who declares breaks knows the kinks.
    if breaks is not None and breaks.shape[0] > 0:
        return
    given = [NOTHING] * (len(jaxpr.invars) - states - 1)
    given += [Follows(True, False)] + [Follows(False, True)] * states
    if _searches(jaxpr, given):
        warnings.warn(
            f"{type(system).__name__}.vector_field interpolates in time between nodes that are "
            "not declared as breaks: integration steps cross the kinks, and gradients with "
            "respect to the nodal values are wrong. Use a jaxspace.core.Table or Spline, or "
            "declare breaks().",
            stacklevel=stacklevel + 1,
        )


def _searches(jaxpr: Jaxpr, given: Sequence[Follows]) -> bool:
    """Whether the program searches sorted nodes for a time, from the dependencies of its
    arguments."""
    known = dict(zip(jaxpr.invars, given, strict=True))

    def follows(x: Var | Literal) -> Follows:
        # Literals cannot be hashed, and depend on nothing.
        return NOTHING if isinstance(x, Literal) else known.get(x, NOTHING)

    for operation in jaxpr.eqns:
        inputs = [follows(x) for x in operation.invars]
        time = any(x.time for x in inputs)
        state = any(x.state for x in inputs)
        name = operation.params.get("name", "") or operation.primitive.name
        # By the time alone: a kink at a state occurs at an unknown time, and steps resolve it
        # through their error.
        if time and not state and name.lower() == "searchsorted":
            return True
        inner = operation.params.get("jaxpr")
        inner = getattr(inner, "jaxpr", inner)
        # Calls alone, because loops and branches have their arguments in another order.
        if time and inner is not None and len(inner.invars) == len(inputs):
            if _searches(inner, inputs):
                return True
        known.update(dict.fromkeys(operation.outvars, Follows(time, state)))
    return False


def warn_of_switches(
    system: AbstractSystem,
    events: tuple[Event, ...],
    y: PyTree,
    t: Scalar | jax.ShapeDtypeStruct,
    stacklevel: int,
) -> None:
    """Warn of a system that jumps by a part of the state (`AbstractSystem.switches`) that no event
    reads.

    - `y`: the shapes of the state, from `check_structure`.
    - `stacklevel`: that of the caller."""
    for name, part in _switches_of(system).items():
        if not any(_reads(event, t, y, part) for event in events):
            warnings.warn(
                f"{name} makes the vector field discontinuous where {part} reaches a threshold, "
                "and no event of the run detects it: derivatives omit the shift of the time of "
                "that jump. End the run or the phase there with an event such as "
                "PropellantDepletion, or continue through it with Event(..., terminal=False, "
                "then=lambda t, y: y).",
                stacklevel=stacklevel + 1,
            )


@without_numbers
def _switches_of(system: AbstractSystem) -> dict[str, str]:
    return system.switches()


def _reads(event: Event, t: Scalar | jax.ShapeDtypeStruct, y: PyTree, part: str) -> bool:
    """Whether the condition of an event reads a part of the state."""
    leaves = jax.tree.leaves(getattr(y, part, None))
    others = len(jax.tree.leaves((t, y)))

    def condition(part_of_y: PyTree, t: Scalar, y: State) -> Scalar:
        y = eqx.tree_at(lambda y: getattr(y, part), y, part_of_y)
        return event.condition(t, y)

    traced, *_ = eqx.filter_make_jaxpr(condition)(getattr(y, part), t, y)
    jaxpr = traced.jaxpr
    variables = jaxpr.invars[len(jaxpr.invars) - others - len(leaves) : len(jaxpr.invars) - others]
    # By identity, because literals among the inputs cannot be hashed.
    read = {id(x) for operation in jaxpr.eqns for x in operation.invars}
    return any(id(x) in read for x in variables)
