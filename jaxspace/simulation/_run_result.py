"""What a run leaves, and NaN in it for what a failed one did not reach."""

from typing import NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PyTree

from ..core import State
from ..integration._crossings import Crossings
from ..integration._result import DenseOutput
from ..integration._status import Status

T = TypeVar("T")

# After which nothing behind the start is known: a step missed the tolerance, an event may have
# passed unseen, or the model does not hold.
WITHOUT_BOUND = (
    Status.TOLERANCE_MISSED,
    Status.EVENT_UNRESOLVED,
    Status.CONDITION_NOT_FINITE,
    Status.OUTSIDE_MODEL,
    Status.SAMPLES_TOO_FEW,
    Status.COMMAND_NOT_FINITE,
)
# A bit for each of them: one shift in the program of every run, where comparisons with each would
# be compiled in every first call.
_BITS_WITHOUT_BOUND = sum(1 << status for status in WITHOUT_BOUND)


class RunResult(NamedTuple):
    """What one run, or a batch of them, leaves: the fields of a `Trajectory`, and the recorded
    ends of the steps in normalised time.

    - `crossings`: of each event that is not terminal.
    - `control`: of a closed loop: `commands`, `readings` and the `memory` of the controller."""

    ts: Float[Array, "times *#runs"]
    states: State
    status: Int[Array, "*runs"]
    event: Int[Array, "*runs"]
    happened: Bool[Array, "events *#runs"]
    stats: dict[str, Array]
    dense: DenseOutput | None
    step_ends: Float[Array, " steps"] | None
    crossings: tuple[Crossings, ...] = ()
    control: dict[str, PyTree] | None = None


def scaled(tree: T, factor: Array) -> T:
    """Floating-point arrays times a factor of each run (one, or NaN), derivatives included."""

    def leaf(x: PyTree) -> PyTree:
        return x * factor.astype(x.dtype) if eqx.is_inexact_array(x) else x

    return jax.tree.map(leaf, tree)


def nan_unless(good: Array) -> Array:
    """One for what is good, and NaN for the rest."""
    # A product, and no selection: the derivative of a failed run is NaN, too, and not zero.
    return jnp.where(good, 1.0, jnp.nan)


def reached(result: RunResult) -> RunResult:
    """The result with NaN for what a failed run did not reach within the tolerance.

    All states after the first for a status of `WITHOUT_BOUND`, every state that is not finite in
    one of its blocks, and all crossings of a run that failed."""
    run_axes = result.status.ndim
    good = True
    for block in jax.tree.leaves(result.states):
        components = tuple(range(block.ndim - 1 - run_axes))
        good = good & jnp.all(jnp.isfinite(block), axis=components)
    first = jnp.arange(result.ts.shape[0]).reshape(-1, *(1,) * run_axes) == 0
    unbounded = ((_BITS_WITHOUT_BOUND >> result.status) & 1).astype(bool)
    good = good & (first | ~unbounded)
    crossings = scaled(result.crossings, nan_unless(result.status <= Status.EVENT))
    return result._replace(states=scaled(result.states, nan_unless(good)), crossings=crossings)
