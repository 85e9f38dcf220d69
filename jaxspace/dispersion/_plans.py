"""Plans of steps: nodes in normalised time, refined until all runs meet the tolerance."""

from collections.abc import Sequence
from typing import TypeAlias

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, PyTree

# How much finer than the pilots' plan the trial block runs.
TRIAL = 1.2
# Factor by which the errors of the trial block have to be below the tolerance.
MARGIN = 1.5
# The local error falls with at least this power of the number of steps.
ORDER = 6.0
# Factors of refinement: first one, then those for the runs that missed the tolerance.
FINENESS = (1.0, 2.0, 4.0)
# Largest refinement of the pilots' plan, for which the padded length suffices.
FINEST = 8.0
# Plans are padded to a multiple of this, so that the program can be compiled before the plan is
# known, and a similar campaign can reuse it.
PADDING = 2**14

# The plan of each phase; `None` for a closed form, and for a phase whose steps are searched for its
# end.
Plans: TypeAlias = tuple[Array | None, ...]


def nodes_of(ends: np.ndarray) -> np.ndarray:
    """The plan that ends its steps at these times, which are followed by infinities."""
    return np.concatenate([np.zeros(1, ends.dtype), ends[np.isfinite(ends)]])


def refinement(error: np.ndarray) -> float:
    """Factor by which the plan of a phase has to be finer than that of the pilots, from the errors
    of the trial block."""
    finite = error[np.isfinite(error)]
    # Not the maximum, because single difficult runs are repeated and need not refine the plan of
    # all.
    largest = float(np.quantile(finite, 0.99)) if finite.size else 1.0
    return float(np.clip(TRIAL * (MARGIN * largest) ** (1.0 / ORDER), 1.0, FINEST / FINENESS[-1]))


def padded(pilots: list[np.ndarray | None], factors: list[float]) -> Plans:
    """The plans refined by `factors`, each padded to the length of the finest with nodes beyond its
    end, which are never reached."""
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


def placeholders(steps: Sequence[PyTree]) -> Plans:
    """Plans of the usual padded length with one step for each segment, for phases with these
    recorded `steps`; `None` for one without a plan."""
    return tuple(None if x is None else jnp.arange(PADDING, dtype=x.dtype) for x in steps)


def _refined(plan: ArrayLike, factor: float) -> np.ndarray:
    """A plan with about `factor` times as many steps in every segment, in the same distribution."""
    plan = np.asarray(plan)
    pieces = [plan[:1]]
    for k in range(round(plan[-1])):
        nodes = plan[(plan >= k) & (plan <= k + 1)]
        count = int(np.ceil(factor * (len(nodes) - 1)))
        places = np.linspace(0.0, len(nodes) - 1.0, count + 1)[1:]
        piece = np.interp(places, np.arange(len(nodes)), nodes)
        # A step has to end exactly at the end of the segment.
        piece[-1] = k + 1.0
        pieces.append(piece)
    return np.concatenate(pieces)
