"""Detection of interpolations in time within a vector field whose nodes are not breaks of the
integration.

A search for the interval of a time is visible in the traced vector field. `Table` and `Spline`
contain no such search. Interpolations over the state, such as the density over the height, are left
out, because step control handles their kinks as it does any other change.
"""

import warnings
from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
from jax.extend.core import Jaxpr, Literal, Var
from jaxtyping import PyTree

from ..core import AbstractSystem
from ..core.tables import breaks_of


class Follows(NamedTuple):
    """Dependencies of a traced value."""

    time: bool
    state: bool


NOTHING = Follows(False, False)


def warn_of_kinks(jaxpr: Jaxpr, system: AbstractSystem, y0: PyTree, stacklevel: int) -> None:
    """Warn of a traced vector field that interpolates in time, unless the system has breaks.

    `jaxpr` has the arrays of the system, of the time and of the state as its arguments, in this
    order."""
    breaks = eqx.filter_eval_shape(breaks_of, system)
    if breaks is not None and breaks.shape[0] > 0:
        return
    states = len(jax.tree.leaves(eqx.filter(y0, lambda x: hasattr(x, "shape"))))
    given = [NOTHING] * (len(jaxpr.invars) - states - 1)
    given += [Follows(True, False)] + [Follows(False, True)] * states
    if _searches(jaxpr, given):
        warnings.warn(
            f"{type(system).__name__}.vector_field interpolates in time between nodes that are not "
            f"breaks: steps pass over its kinks, and gradients by its values are wrong; take a "
            f"jaxspace.core.Table or Spline, or declare breaks().",
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
