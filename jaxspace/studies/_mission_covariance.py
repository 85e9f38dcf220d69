"""Covariance of a mission under process noise: mapped through events, jumps and phases.

    d = -g_y e / (g_t + g_y f)           delay of an event by the error e of the state
    d = that of the start of the phase   of a phase of known duration
    e+ = j_y (e + f- d) + j_t d - f+ d   error behind the jump, at the time of the mean

    symbol   meaning                                                unit
    e, e+    error of the state before and behind the jump          of the state
    d        delay of the end of a phase behind that of the mean    s
    g, j     condition of the event, jump                           any, state
    f-, f+   vector fields before and behind the end                state/s

The covariance is that of these errors: each column of its factors (`_factors`) is mapped as an
error is. Those of the noise of a phase become further columns where the phase ends. The error is
taken at the time of the mean, at which another run may still be in the phase before;
to first order that does not matter. The delay is one more coordinate, because a phase of known
duration ends late if it has started late.

Source: Leine and Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical Systems, 7 (the
saltation matrix); Maybeck, Stochastic Models, Estimation, and Control, 4.9.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple, final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree

from ..core import InputError, Scalar, State
from ..core.printing import printed
from ..simulation import Event, Mission, MissionTrajectory, Phase
from ._factors import Factors, factors_of
from .coordinates import Coordinates
from .covariance import MeanCovariance, Uncertain


@printed(time="s^2")
class MissionCovariance(NamedTuple):
    """The covariance of a mission.

    - `phases`: of the states of each phase, (n, n, times, *runs), at the times of the mean.
    - `final`: of the state after the last jump, at the time of each run, (n, n, *runs).
    - `time`: the variance of the time of the end, s^2, (*runs,)."""

    phases: tuple[Float[Array, "n n times *#runs"], ...]
    final: Float[Array, "m m *#runs"]
    time: Float[Array, "*#runs"]


@final
class _OfMean(eqx.Module):
    """The condition of an event, of the mean."""

    condition: Callable[[Scalar, State], Scalar]

    def __call__(self, t: Scalar, y: MeanCovariance) -> Scalar:
        return self.condition(t, y.mean)


@final
class _Mapped(eqx.Module):
    """The jump of a phase, applied to a mean and its covariance; `after` moves behind it."""

    phase: Phase
    after: Uncertain | None

    def __call__(self, t: Scalar, y: MeanCovariance) -> MeanCovariance:
        known = Factors(y.columns, y.weights)
        if y.added is not None:
            known = known.joined(factors_of(y.added))
        runs = y.columns.shape[2:]
        before = Coordinates.of(y.mean, len(runs))
        n, dtype = before.count, before.dtype
        t = jnp.broadcast_to(jnp.asarray(t, dtype), runs)
        rate = self.phase.moving.vector_field(t, y.mean)
        zero = jnp.zeros((n + 1, *runs), dtype)

        def jumped(t: Scalar, state: State) -> State:
            return state if self.phase.then is None else self.phase.then(t, state)

        behind = jumped(t, y.mean)
        later = None if self.after is None else self.after.system.vector_field(t, behind)
        after = Coordinates.of(behind, len(runs))

        def mapped(e: Array) -> Array:
            _, change = jax.jvp(lambda x: before.moved(x[:n]), (zero,), (e,))
            delay = self._delay(t, y.mean, change, rate, e[n])
            # To the end of this run, through the jump, and back to the end of the mean.
            there = jax.tree.map(lambda c, r: c + r * delay, change, rate)
            _, change = jax.jvp(jumped, (t, y.mean), (delay, there))
            if later is not None:
                change = jax.tree.map(lambda c, r: c - r * delay, change, later)
            return jnp.concatenate([after.components(change), delay[None]])

        known = Factors(jax.vmap(mapped, in_axes=1, out_axes=1)(known.columns), known.weights)
        if self.after is None:
            return MeanCovariance(behind, *known)
        return self.after.about(behind, known)

    def _delay(self, t: Scalar, mean: State, change: State, rate: State, started: Array) -> Array:
        """Delay of the end of a phase for a change of the state and of its start."""
        event = self.phase.until
        if not isinstance(event, Event):
            # It ends late by as much as it has started late.
            return started
        system = self.phase.moving
        _, along = jax.jvp(lambda y: event.value(system, t, y), (mean,), (change,))
        _, slope = jax.jvp(
            lambda t, y: event.value(system, t, y), (t, mean), (jnp.ones_like(t), rate)
        )
        # At a graze the time has no derivative: no delay is assumed.
        return jnp.where(slope != 0.0, -along / jnp.where(slope != 0.0, slope, 1.0), 0.0)


def uncertain_mission(mission: Mission, noises: Sequence[PyTree]) -> Mission:
    """A mission whose states are means with their covariance and the delay of the phase.

    `noises`: the spectral density of the process noise in each phase, as of `Uncertain`."""
    for phase in mission.phases:
        if phase.counts_from_start:
            raise InputError(
                f"Phase {phase.name!r} has a time relative to its start, such as the delay of a "
                "motor: a covariance requires a time of the mission, such as the ignition."
            )
    systems = [
        Uncertain(phase.moving, noise, delayed=True)
        for phase, noise in zip(mission.phases, noises, strict=True)
    ]
    phases = []
    for phase, system, later in zip(mission.phases, systems, [*systems[1:], None], strict=True):
        until = phase.until
        if isinstance(until, Event):
            # The condition alone is replaced: direction, samples and the wait for it stay those of
            # the phase.
            until = eqx.tree_at(lambda e: e.condition, until, _OfMean(until.condition))
        phases.append(Phase(system, until, _Mapped(phase, later), phase.name))
    return Mission(phases)


def covariance_of(run: MissionTrajectory) -> MissionCovariance:
    """The covariance along a run of an `uncertain_mission`."""
    # Without the last coordinate, the delay, which is not part of the state.
    phases = tuple(phase.states.covariance[:-1, :-1] for phase in run.phases)
    P = run.final.covariance
    return MissionCovariance(phases, P[:-1, :-1], P[-1, -1])
