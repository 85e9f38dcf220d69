"""One step of each run, which the loop accepts or rejects: of its own length, as its part of a step
of the method from 0 to 1 (`StepTimes`)."""

from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PyTree

from ..core import State
from ..core.barrier import barrier
from ..solvers.protocol import (
    AbstractDeclaredSolver,
    bind,
    field_of_step,
    linear_errors,
    solver_traits,
)
from ..solvers.vector_field import TERM, ScaledField
from ._buffers import place_in_step
from ._loop_settings import LoopSettings
from ._loop_state import LoopState
from .normalised_time import StepTimes, field_of_part


class StepStart(NamedTuple):
    """The start of a step of each run: at `s`, with the state `y0`; its `length` in normalised
    time, and whether the vector field `jumped` there."""

    s: Float[Array, "*runs"]
    length: Float[Array, "*runs"]
    y0: State
    jumped: Bool[Array, "*runs"]

    @classmethod
    def of(cls, loop: LoopState) -> "StepStart":
        """State of the next step. A run that waits at its event repeats the step that contains
        it."""
        going, event_state = loop.going, loop.event_state
        # A step of no length, so that the state of a run that has ended stays as it is.
        length = jnp.where(going, loop.t_next - loop.t, 0.0)
        if event_state is None:
            return cls(loop.t, length, loop.y, loop.jumped)
        return cls(
            jnp.where(going, loop.t, event_state.start),
            jnp.where(going, length, event_state.length),
            jax.tree.map(lambda a, b: jnp.where(going, a, b), loop.y, event_state.y0),
            loop.jumped | ~going,
        )


class TrialStep(NamedTuple):
    """A step of each run.

    - `begin`: where it begins; `y1`: the state at its end.
    - `error`: in units of the tolerance.
    - `polynomial`: its dense output, from 0 to 1; `segment`: its times, if the field is not
      hoisted.
    - `carried`: carry of the method into the next step."""

    begin: StepStart
    y1: State
    error: Float[Array, "*runs"]
    polynomial: diffrax.AbstractLocalInterpolation
    carried: PyTree
    segment: StepTimes | None


def trial_step(settings: LoopSettings, field: ScaledField, loop: LoopState) -> TrialStep:
    """The next step of each run."""
    begin = StepStart.of(loop)
    s, length, y0 = begin.s, begin.length, begin.y0
    zero, one = jnp.zeros_like(s, shape=()), jnp.ones_like(s, shape=())
    if settings.tolerance.run_axes == 0:
        # Operations that depend on the parameters only would be moved out of the loop, which for a
        # single run is one kernel, each into a separate kernel.
        arrays, static = eqx.partition(field, eqx.is_array)
        arrays, s, length = barrier((arrays, s, length))
        field = eqx.combine(arrays, static)
    part, segment = field_of_part(field, s, length)
    method = _bound_to_save(settings, loop, s, length)
    if solver_traits(method).linear:
        # The tolerance puts the parts together, in less time. Another method would transform each
        # of them.
        method = linear_errors(method)
    inner = field_of_step(method, part, zero, one)
    carried = loop.carried if carries(settings) else method.init(TERM, zero, one, y0, inner)
    y1, error, dense_info, carried, result = method.step(
        TERM, zero, one, y0, inner, carried, begin.jumped
    )
    # Where the root finder failed, the state is meaningless: the step is rejected.
    failed = result != diffrax.RESULTS.successful
    local = settings.tolerance.error(y0, y1, error)
    local = jax.lax.stop_gradient(jnp.where(failed, jnp.inf, local))
    polynomial = method.interpolation_cls(t0=zero, t1=one, **dense_info)
    return TrialStep(begin._replace(s=s, length=length), y1, local, polynomial, carried, segment)


def _bound_to_save(
    settings: LoopSettings, loop: LoopState, s: Array, length: Array
) -> diffrax.AbstractSolver:
    """The method, bound to the next state that each run saves, as a place in this step."""
    saved = loop.buffers.saved
    if saved is None or settings.terminal is not None:
        return settings.method
    place = place_in_step(saved.next_ts, s, length)
    tolerance = settings.tolerance
    return bind(
        settings.method, tolerance=tolerance, save_ts=place[None], run_axes=tolerance.run_axes
    )


def carries(settings: LoopSettings) -> bool:
    """Whether the method may carry values from step to step. Methods of diffrax restart, because
    the steps differ in their length."""
    return isinstance(settings.method, AbstractDeclaredSolver)


def carried_on(
    settings: LoopSettings, loop: LoopState, step: TrialStep, accept: Array, length: Array
) -> PyTree:
    """The carry of the method for the next step, of this `length`."""
    if not carries(settings):
        return None
    old = jax.tree.map(
        lambda a, b: jnp.where(accept, a, b) if a.ndim >= accept.ndim else a,
        step.carried,
        loop.carried,
    )
    assert isinstance(settings.method, AbstractDeclaredSolver)
    factor = length / jnp.where(step.begin.length > 0.0, step.begin.length, 1.0)
    return settings.method.longer(old, factor)


def error_order(settings: LoopSettings) -> Any:
    """The order of the estimate of the error."""
    return settings.method.error_order(TERM)
