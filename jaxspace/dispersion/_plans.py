"""Plans of steps: nodes in normalised time, refined until runs that are no pilots meet them."""

from collections.abc import Sequence
from typing import Any, TypeAlias

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike

# How much finer than the pilots' plan the trial block runs.
TRIAL = 1.2
# Factor by which the errors of the trial block shall lie below the tolerance.
MARGIN = 1.5
# A cautious order of the local error: it shrinks at least with that power of the number of steps.
ORDER = 6.0
# Factors by which a plan is refined: first none, then for the runs that missed the tolerance.
FINENESS = (1.0, 2.0, 4.0)
# How much finer than the pilots' plan a plan may be: what the padded length holds.
FINEST = 8.0
# Plans are padded to a multiple of this: the program can be compiled before the plan is known, and
# a similar campaign finds it compiled.
PADDING = 2**14

# The plan of each phase; `None` for a closed form, and for a phase whose steps are searched for its
# end.
Plans: TypeAlias = tuple[Array | None, ...]


def nodes_of(ends: np.ndarray) -> np.ndarray:
    """The plan that ends its steps at these times, which are followed by infinities."""
    return np.concatenate([np.zeros(1, ends.dtype), ends[np.isfinite(ends)]])


def refinement(error: np.ndarray) -> float:
    """How much finer than the pilots' plan the plan of a phase has to be, from the errors of the
    trial block."""
    finite = error[np.isfinite(error)]
    # Not the maximum: single hard runs are repeated, and must not make the plan of all finer.
    largest = float(np.quantile(finite, 0.99)) if finite.size else 1.0
    return float(np.clip(TRIAL * (MARGIN * largest) ** (1.0 / ORDER), 1.0, FINEST / FINENESS[-1]))


def padded(pilots: list[np.ndarray | None], factors: list[float]) -> Plans:
    """The plans refined by `factors`, each brought to a length that holds the finest by nodes
    beyond its end, which are never reached."""
    plans: list[Array | None] = []
    for pilot, factor in zip(pilots, factors, strict=True):
        if pilot is None:
            plans.append(None)
            continue
        plan = _refined(pilot, factor)
        # All plans of a phase have one length, so that one program serves them.
        length = PADDING * -(-len(_refined(pilot, FINEST)) // PADDING)
        filled = np.concatenate([plan, plan[-1] + 1.0 + np.arange(length - len(plan))])
        plans.append(jnp.asarray(filled, pilot.dtype))
    return tuple(plans)


def placeholders(steps: Sequence[Any]) -> Plans:
    """Plans of the length that most have, one step a segment, for phases whose recorded `steps`
    look like this; `None` for one without a plan."""
    return tuple(None if x is None else jnp.arange(PADDING, dtype=x.dtype) for x in steps)


def _refined(plan: ArrayLike, factor: float) -> np.ndarray:
    """A plan with about `factor` times as many steps in every segment, distributed alike."""
    plan = np.asarray(plan)
    pieces = [plan[:1]]
    for k in range(round(plan[-1])):
        nodes = plan[(plan >= k) & (plan <= k + 1)]
        count = int(np.ceil(factor * (len(nodes) - 1)))
        places = np.linspace(0.0, len(nodes) - 1.0, count + 1)[1:]
        piece = np.interp(places, np.arange(len(nodes)), nodes)
        # A step has to land on the end of the segment to the last bit.
        piece[-1] = k + 1.0
        pieces.append(piece)
    return np.concatenate(pieces)
