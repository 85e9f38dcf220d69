"""A system with its integration settings, for integrations that differ only in states and times."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..core import AbstractSystem, Scalar, State
from ..core.safe import safe_divide
from ..core.status import combine_status
from ..integration.config import IntegrationConfig
from ..integration.event_search import FirstEvent, first_event
from ..integration.events import Event
from ..integration.integrate import integrate
from ..integration.layout import (
    replace_state,
    runs_of,
    state_at,
    times_behind_components,
    times_first,
    with_start,
)
from ..integration.result import IntegrationResult


class Integrator(NamedTuple):
    """A system, how it is integrated, and number of trailing axes of its states carry runs."""

    system: AbstractSystem
    config: IntegrationConfig
    run_axes: int

    def run(
        self, y0: State, t0: Scalar, t1: Scalar, fractions: Array | None = None, **options: Any
    ) -> IntegrationResult:
        """`integrate` with these and its further arguments."""
        return integrate(self.system, y0, t0, t1, fractions, self.config, self.run_axes, **options)

    def to(self, y0: State, t0: Scalar, t1: Scalar) -> tuple[State, IntegrationResult]:
        """The state at `t1`, s, and the result of the integration from `t0`."""
        result = self.run(y0, t0, t1)
        return state_at(result.states, -1, self.run_axes), result

    def first_event(
        self,
        y0: State,
        t0: Scalar,
        t1: Scalar,
        events: tuple[Event, ...],
        start_known: Array | None = None,
    ) -> FirstEvent:
        """`first_event` of these events."""
        arguments = self.system, y0, t0, t1, events, self.config, self.run_axes
        return first_event(*arguments, start_known)

    def through(self, y0: State, times: Array) -> IntegrationResult:
        """States at `times`, (times, *runs), which differ between runs: interval by interval."""

        def interval(
            carry: tuple[State, Array], ends: tuple[Array, Array]
        ) -> tuple[tuple[State, Array], tuple[State, dict[str, Array]]]:
            y, status = carry
            y, result = self.to(y, *ends)
            return (y, combine_status(status, result.status)), (y, result.stats)

        start = (y0, jnp.zeros(runs_of(y0, self.run_axes), jnp.int32))
        # By a scan, so that the integration is traced and compiled once for all intervals.
        (_, status), (states, stats) = jax.lax.scan(interval, start, (times[:-1], times[1:]))
        states = times_behind_components(states, self.run_axes)
        states = with_start(y0, states, self.run_axes)
        return IntegrationResult(states, status, total_of(stats), None, None)

    def at_times(
        self, y0: State, ts: Array, *, dense: bool = False, for_search: bool = False
    ) -> IntegrationResult:
        """States at `ts`, (times,) or (times, *runs), the first of which is that of `y0`."""
        # An integration that restarts at each time has no steps of the whole run to store.
        if ts.ndim > 1 and ts.shape[0] > 2 and not dense:
            return self.through(y0, ts)
        if ts.shape[0] == 2:
            result = self.run(y0, ts[0], ts[1], dense=dense)
            return result._replace(states=with_start(y0, result.states, self.run_axes))
        # A run of no duration divides zero by zero.
        fractions = safe_divide(ts - ts[0], ts[-1] - ts[0])
        result = self.run(y0, ts[0], ts[-1], fractions, dense=dense, for_search=for_search)
        # The state at the first time is exactly the initial one.
        return result._replace(states=replace_state(result.states, 0, y0, self.run_axes))

    def sampled(
        self, y0: State, ts: Array, samples: int, *, dense: bool
    ) -> tuple[IntegrationResult, Array, State]:
        """`at_times`, with the times and states of at least `samples` parts of the run, times
        first.

        One integration, except where the save times differ between runs."""
        duration = ts[-1] - ts[0]
        if ts.ndim > 1:
            result = self.at_times(y0, ts, dense=dense)
            fractions = jnp.linspace(0.0, 1.0, samples + 1, dtype=ts.dtype)
            between = self.run(y0, ts[0], ts[-1], fractions)
            times = ts[0] + jnp.multiply.outer(fractions, duration)
            states = replace_state(between.states, 0, y0, self.run_axes)
            return result, times, times_first(states, self.run_axes)
        # Rounded up, so that there are at least as many samples.
        parts = -(-samples // (ts.shape[0] - 1))
        shares = jnp.linspace(0.0, 1.0, parts, endpoint=False, dtype=ts.dtype)
        # Every save time is exactly a sample.
        inner = ts[:-1, None] + shares * jnp.diff(ts)[:, None]
        times = jnp.concatenate([inner.reshape(-1), ts[-1:]])
        result = self.at_times(y0, times, dense=dense, for_search=True)
        states = times_first(result.states, self.run_axes)
        asked = jax.tree.map(lambda x: x[::parts], states)
        asked = times_behind_components(asked, self.run_axes)
        every = of_each_run(times, runs_of(y0, self.run_axes))
        return result._replace(states=asked), every, states


def total_of(stats: dict[str, Array]) -> dict[str, Array]:
    """Statistics over all intervals: their work, and the largest error."""
    return {
        name: jnp.max(x, axis=0) if name == "largest_local_error" else jnp.sum(x, axis=0)
        for name, x in stats.items()
    }


def of_each_run(ts: Array, runs: tuple[int, ...]) -> Array:
    """The times of each run, (times, *runs)."""
    return jnp.broadcast_to(_with_runs(ts, runs), (ts.shape[0], *runs))


def _with_runs(ts: Array, runs: tuple[int, ...]) -> Array:
    """The times with axes of runs of length one where all runs share them."""
    missing = (1,) * (len(runs) - ts.ndim + 1)
    return ts.reshape(ts.shape[0], *missing, *ts.shape[1:])
