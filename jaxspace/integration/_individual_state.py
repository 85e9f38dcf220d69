"""State of a loop with individual steps for every run, and the rows that its runs fill."""

import functools
from typing import NamedTuple, final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..core import AbstractRegularised, Scalar
from ..solvers.regularised_step import Regular, landed
from ..solvers.vector_field import ScaledField
from ._buffers import Buffers
from ._individual_control import Trend
from ._loop_settings import LoopSettings


@final
class IndividualState(eqx.Module):
    """Regularised variables of each run, and the number of segments that it has completed.

    The last variable is the time, s, since the current segment began."""

    z: Regular
    segment: Float[Array, "*runs"]


class IndividualLoop(NamedTuple):
    """Carry of the loop. Buffers, `count` and `iterations` are shared; all else is of each run.

    - `h`: the next step; `free`: the length that the error allows; `trend`: the prediction of the
      length.
    - `landing`: whether the next step should end the segment; `pending`: whether the run waits for
      the others before it takes such a step, or has taken one.
    - `worst`: the largest local error of the steps taken, in units of the tolerance.
    - `count`: number of the `iterations` in which a run moved.
    - `buffers`: with a row for each of these iterations, but the states at the save times by
      segment."""

    y: IndividualState
    h: Float[Array, "*runs"]
    free: Float[Array, "*runs"]
    trend: Trend
    landing: Bool[Array, "*runs"]
    pending: Bool[Array, "*runs"]
    worst: Float[Array, "*runs"]
    accepted: Int[Array, "*runs"]
    rejected: Int[Array, "*runs"]
    iterations: Int[Array, ""]
    count: Int[Array, ""]
    buffers: Buffers


class Segment(NamedTuple):
    """Start and duration of the current segment of each run, s."""

    t: Scalar
    duration: Scalar

    @classmethod
    def of(cls, field: ScaledField, settings: LoopSettings, number: Array) -> "Segment":
        """The segment with this number for each run; beyond the end, the last segment."""
        last = jnp.minimum(number, settings.end - 1.0).astype(settings.end.dtype)
        duration = field.duration(last, jnp.ones_like(last))
        return cls(field.time(last), duration.astype(number.dtype))


def alive(z: Regular) -> Bool[Array, "*runs"]:
    """Whether all variables of a run are finite."""
    # The sum is finite if all are. Added one by one, because a reduction over the first axis would
    # treat one run after the other.
    return jnp.isfinite(functools.reduce(jnp.add, list(z)))


def unit(form: AbstractRegularised, z: Regular, rate: Regular) -> Scalar:
    """The fictitious time in which the variables change by their own sizes."""
    return 1.0 / form.size(rate, z, z)


def landing_state(
    form: AbstractRegularised, segment: Segment, y: IndividualState, done: Bool[Array, "*runs"]
) -> IndividualState:
    """Move the runs that are `done` to the start of their next segment."""
    z = landed(form, *segment, y.z)
    z = jnp.concatenate([z[:-1], jnp.zeros_like(z[-1:])])
    return IndividualState(jnp.where(done, z, y.z), y.segment + done.astype(y.segment.dtype))


def record_of_iteration(h: Array, done: Bool[Array, "*runs"]) -> Array:
    """The record of one iteration: the step of each run, zero for none, and whether it landed,
    (2, *runs)."""
    return jnp.stack([h, done.astype(h.dtype)])
