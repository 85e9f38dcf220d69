"""Every zero of a condition along a run, not only the first: times, states and their number.

    t_k :  g(t_k, y(t_k)) = 0            dt_k = -(dg)/(g_t + g_y f)

The condition is sampled along the dense output of the run. Each change of sign, and each dip
between two samples of the same sign, is bracketed as for the first event (`_event_bracket`); no
derivative is taken of this search. For derivatives, the run is integrated again from the sample
before the zero to the zero, and one Newton step adds those of the time of the zero (`events`).

Too few samples miss zeros in pairs, which leaves the signs of the samples as they are. The rate of
the condition reveals it: between samples that are close enough, the condition changes by
h (g_k' + g_{k+1}')/2. The search fails where the root mean square of the deviation from this rule
exceeds half of that of the condition. A sine reaches this at about three and a half samples a
period.

    symbol  meaning                      unit
    g, g'   condition, its rate          any, 1/s times it
    f       vector field of the system   state/s
    h       time between two samples     s
"""

__all__ = ["Crossings"]

import dataclasses
from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..core import AbstractSystem, Scalar, State
from ..core.printing import printed
from ..core.status import Status
from ..core.structure import HashedModule
from ._event_runs import ConditionOnRun, Roots, Samples, sampled, zeros_between
from .config import IntegrationConfig
from .event_zero import pick
from .events import Event, newton_correct
from .field_trace import field_trace
from .integrate import integrate
from .layout import state_at, times_behind_components
from .methods import HIGH_ORDER

# Largest deviation of the samples from their rates, relative to the root mean square of the
# condition.
RESOLVED = 0.5
# Most steps between a sample and a zero: with more, the samples would not resolve the motion.
STEPS_TO_ZERO = 256


@final
@printed(ts="s", status=Status)
class Crossings(HashedModule):
    """Every zero of the condition of an event along a run, or a batch of runs.

    - `ts`: times, s, (zeros, *runs), in the order of the run; NaN behind the last one. Their
      number is limited by `Event.capacity`.
    - `states`: the states there: a position is (3, zeros, *runs).
    - `rising`: whether the condition rises along the run.
    - `count`: how many zeros are given, (*runs,).
    - `overflow`: whether there are more zeros than the capacity.
    - `status`: how the search ended, a `Status`; of a run that failed, its status. The zeros are
      those before the failure; NaN where the time of the failure is unknown.
    - `after`: the states after the jumps of an event with `then`, whose `states` are those before;
      `None` for other events."""

    ts: Float[Array, "zeros *#runs"]
    states: State
    rising: Bool[Array, "zeros *#runs"]
    count: Int[Array, "*runs"]
    overflow: Bool[Array, "*runs"]
    status: Int[Array, "*runs"]
    after: State | None = None

    def until(self, start: Scalar, duration: Scalar) -> "Crossings":
        """The zeros up to a `duration`, s, after the `start`, s, of each run."""
        # Times behind the last zero are NaN, and every comparison with NaN is false.
        reached = jnp.abs(self.ts - start) <= duration

        def leaf(x: Array) -> Array:
            return jnp.where(reached, x, jnp.nan)

        return Crossings(
            leaf(self.ts),
            jax.tree.map(leaf, self.states),
            self.rising & reached,
            jnp.sum(reached, axis=0).astype(self.count.dtype),
            self.overflow & jnp.all(reached, axis=0),
            self.status,
            jax.tree.map(leaf, self.after),
        )


def crossings_between(
    system: AbstractSystem,
    event: Event,
    times: Float[Array, "samples *#runs"],
    states: State,
    config: IntegrationConfig,
    run_axes: int,
) -> Crossings:
    """Every zero of the condition of an event along runs that are sampled at these times.

    **Arguments**

    - `times`: of the samples, s, from the start of each run to its end.
    - `states`: the states there, times first.
    - `config`: of the runs.

    **Returns** the `Crossings`, differentiable with respect to `system`, `times`, `states` and the
    event."""
    start = times[0], jax.tree.map(lambda x: x[0], states)
    # A rule for derivatives sees leaves alone.
    hidden = field_trace(system, *start).closes_over_tracers
    find = _integrated_to if hidden else _zeros_with_rule
    return find(system, event, times, states, _for_short_ways(config), run_axes)


def _zeros(
    system: AbstractSystem,
    event: Event,
    times: Float[Array, "samples *#runs"],
    states: State,
    config: IntegrationConfig,
    run_axes: int,
) -> Crossings:
    """`crossings_between`, as the search leaves them, without derivatives."""
    on_run = ConditionOnRun(system, event, config, run_axes)
    samples = sampled(on_run, times, states)
    # One more than stored, which reveals whether there are more.
    search = zeros_between(on_run, samples, event.capacity + 1, event.capacity)
    stored = jnp.minimum(search.count, event.capacity)
    used = jnp.arange(event.capacity).reshape(-1, *(1,) * stored.ndim) < stored

    def leaf(x: Array) -> Array:
        return jnp.where(used, x, jnp.nan)

    crossings = Crossings(
        leaf(search.times),
        jax.tree.map(leaf, times_behind_components(search.states, run_axes)),
        search.rising & used,
        stored,
        search.count > event.capacity,
        _status(samples, search),
    )
    # The search has covered every interval up to the first sample that is not finite.
    return crossings.until(times[0], samples.ill)


def _integrated_to(
    system: AbstractSystem,
    event: Event,
    times: Float[Array, "samples *#runs"],
    states: State,
    config: IntegrationConfig,
    run_axes: int,
) -> Crossings:
    """`_zeros`, with derivatives: by an integration from the sample before each zero to it."""
    parts = jax.tree.map(_fixed, (system, event, times, states))
    found = _zeros(parts[0], parts[1], parts[2], parts[3], config, run_axes)
    moments = parts[2]

    # Zeros one after the other: those of all runs with the same number share an integration.
    def one(carry: None, t: Array) -> tuple[None, tuple[Array, State]]:
        used = jnp.isfinite(t)
        passed = jnp.sum(jnp.abs(moments - moments[0]) <= jnp.abs(t - moments[0]), axis=0)
        y, start = pick((states, times), jnp.maximum(passed - 1, 0), run_axes)
        t = jnp.where(used, t, jax.lax.stop_gradient(start))
        result = integrate(system, y, start, t, None, config.rolled_stages(), run_axes)
        y = state_at(result.states, -1, run_axes)
        return carry, newton_correct(system, (event,), jnp.where(used, 0, -1), t, y)

    _, (ts, at_zeros) = jax.lax.scan(one, None, found.ts)
    used = jnp.isfinite(found.ts)
    at_zeros = times_behind_components(at_zeros, run_axes)
    return dataclasses.replace(
        found,
        ts=jnp.where(used, ts, jnp.nan),
        states=jax.tree.map(lambda x: jnp.where(used, x, jnp.nan), at_zeros),
    )


_zeros_with_rule = eqx.filter_custom_jvp(_zeros)


@_zeros_with_rule.def_jvp
def _zeros_jvp(primals: tuple, tangents: tuple) -> tuple[Crossings, Crossings]:
    return eqx.filter_jvp(_integrated_to, primals, tangents)


# A system may have functions among its leaves.
def _fixed(x: object) -> object:
    return jax.lax.stop_gradient(x) if eqx.is_array(x) else x


def _for_short_ways(config: IntegrationConfig) -> IntegrationConfig:
    """The configuration of an integration from a sample to a zero: few steps.

    A fixed-step method would perform all of its steps, and reverse mode reserves memory for the
    largest number of steps."""
    method = HIGH_ORDER if config.fixed_step else config.method
    steps = min(config.max_steps, STEPS_TO_ZERO)
    return dataclasses.replace(config, method=method, max_steps=steps)


def _status(samples: Samples, search: Roots) -> Int[Array, "*runs"]:
    """Status of the search."""
    status = jnp.where(search.unresolved, Status.EVENT_UNRESOLVED, Status.COMPLETED)
    status = jnp.where(samples.unexplained > RESOLVED, Status.SAMPLES_TOO_FEW, status)
    ill = jnp.isfinite(samples.ill)
    return jnp.where(ill, Status.CONDITION_NOT_FINITE, status).astype(jnp.int32)
