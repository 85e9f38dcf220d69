"""NaN in place of states that a failed run did not reach."""

import dataclasses
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, PyTree

from ..core.barrier import barrier
from ..core.status import Status
from ..integration.crossings import Crossings
from .trajectory import Trajectory

T = TypeVar("T")

# Failures after which no state but the first is known: a step missed the tolerance, an event may
# have been missed, or the model is invalid.
WITHOUT_BOUND = (
    Status.TOLERANCE_MISSED,
    Status.EVENT_UNRESOLVED,
    Status.CONDITION_NOT_FINITE,
    Status.OUTSIDE_MODEL,
    Status.SAMPLES_TOO_FEW,
    Status.COMMAND_NOT_FINITE,
    Status.TIME_UNRESOLVED,
)
# Failures after which it is unknown up to which time the zeros of a condition are complete.
CROSSINGS_UNKNOWN = (Status.TOLERANCE_MISSED, Status.OUTSIDE_MODEL, Status.SAMPLES_TOO_FEW)


def scaled(tree: T, factor: Array) -> T:
    """Floating-point arrays times a factor of each run (one, or NaN), derivatives included."""

    def leaf(x: PyTree) -> PyTree:
        return x * factor.astype(x.dtype) if eqx.is_inexact_array(x) else x

    return jax.tree.map(leaf, tree)


def nan_unless(good: Array) -> Array:
    """One where `good`, NaN elsewhere."""
    # As a factor, and not a selection, so that the derivative of a failed run is NaN, too.
    return jnp.where(good, 1.0, jnp.nan)


def _among(status: Array, some: tuple[Status, ...]) -> Bool[Array, "..."]:
    """Whether each status is one of these."""
    # One bit for each status, and a single shift, because comparisons with each would lengthen
    # every first call.
    return ((sum(1 << s for s in some) >> status) & 1).astype(bool)


def known_crossings(crossings: Crossings, status: Array) -> Crossings:
    """The crossings of runs with this `status`, that of the search included; NaN where it is
    unknown up to which time they are complete."""
    known = barrier(~_among(status, CROSSINGS_UNKNOWN))
    crossings = scaled(crossings, nan_unless(known))
    count = jnp.where(known, crossings.count, 0)
    return dataclasses.replace(
        crossings,
        count=count,
        rising=crossings.rising & known,
        overflow=crossings.overflow & known,
        status=status,
    )


def mask_invalid(result: Trajectory) -> Trajectory:
    """The result with NaN for states that a failed run did not reach within its tolerance.

    These are all states after the first for a status of `WITHOUT_BOUND`, and every state with a
    block that is not finite. Crossings already contain only those before a failure."""
    run_axes = result.status.ndim
    good = True
    for block in jax.tree.leaves(result.states):
        components = tuple(range(block.ndim - 1 - run_axes))
        good = good & jnp.all(jnp.isfinite(block), axis=components)
    first = jnp.arange(result.ts.shape[0]).reshape(-1, *(1,) * run_axes) == 0
    good = barrier(good & (first | ~_among(result.status, WITHOUT_BOUND)))
    return dataclasses.replace(result, states=scaled(result.states, nan_unless(good)))
