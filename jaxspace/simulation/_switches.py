"""Detection of vector fields that jump with the state, whose derivatives are wrong without an event
at the jump.

The derivative of a step over a jump does not contain how the time of the jump moves. An event adds
this (`newton_correct`).
"""

import warnings

import equinox as eqx
import jax
from jaxtyping import PyTree

from ..core import AbstractSystem, Scalar, State
from ..core.structure import without_numbers
from ..integration.events import Event
from ..integration.layout import broadcast_state


def warn_of_switches(
    system: AbstractSystem,
    events: tuple[Event, ...],
    y0: PyTree,
    t: Scalar | jax.ShapeDtypeStruct,
    stacklevel: int,
) -> None:
    """Warn of a system that jumps by a part of the state (`AbstractSystem.switches`) that no event
    reads. `stacklevel` is that of the caller."""
    switches = _switches_of(system)
    if not switches:
        return
    y = eqx.filter_eval_shape(broadcast_state, system, t, y0)
    for name, part in switches.items():
        if not any(_reads(event, t, y, part) for event in events):
            warnings.warn(
                f"{name} makes the vector field jump where {part} reaches a value, and no event "
                f"of the run looks at {part}: derivatives leave out how the time of that jump "
                f"moves. End the run or the phase there by an event such as PropellantDepletion, "
                f"or let it go on with Event(..., terminal=False, then=lambda t, y: y).",
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
    read = {id(x) for operation in jaxpr.eqns for x in operation.invars}
    return any(id(x) in read for x in variables)
