"""What a run leaves: times, states, how it ended, what it cost, and how far it can be trusted."""

import functools
from typing import Any, final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..core import AbstractSystem, State
from ..integration._accuracy import Accuracy, state_dtype


@functools.partial(jax.jit, static_argnums=(1, 2))
def _at(states: State, index: int, axis: int) -> State:
    """The states at one place along an axis, by one program for all blocks."""
    return jax.tree.map(lambda x: x[(slice(None),) * axis + (index,)], states)


@final
class Trajectory(eqx.Module):
    """A run, or many: every array has the axes (runs, times, components); one run has no axis of
    runs.

    - `ts`, s: the times asked for; where an event stopped a run, its later times are the time of
      the event.
    - `states`: the state at each time.
    - `status`: a `Status` for each run.
    - `event`: which of the events stopped the run, -1 for none.
    - `stats`: steps, evaluations of the vector field, largest local error in units of the
      tolerance.
    - `system`, `accuracy`: what was run, and how."""

    ts: Float[Array, "*runs times"]
    states: State
    status: Int[Array, "*runs"]
    event: Int[Array, "*runs"]
    stats: dict[str, Array]
    system: AbstractSystem | None = None
    accuracy: Accuracy | None = None
    shared: tuple[bool, ...] | None = eqx.field(static=True, default=None)

    @property
    def final(self) -> State:
        """The state at the last time, of each run."""
        return _at(self.states, -1, 0 if self.shared is None else 1)

    @property
    def initial(self) -> State:
        """The state at the first time, of each run."""
        return _at(self.states, 0, 0 if self.shared is None else 1)

    def along(self, function: Any) -> Any:
        """`function(system, t, y)` of one time and one state, at every time of every run."""
        over_times = jax.vmap(function, in_axes=(None, 0, 0))
        if self.shared is None:
            return over_times(self.system, self.ts, self.states)
        leaves, tree = jax.tree.flatten(self.system)
        axes = jax.tree.unflatten(tree, [None if alone else 0 for alone in self.shared])
        del leaves
        return jax.vmap(over_times, in_axes=(axes, 0, 0))(self.system, self.ts, self.states)

    def drift(self) -> dict[str, Float[Array, "*runs times"]]:
        """Change of every invariant since the first time, relative to its size (absolute for an
        invariant that begins at zero), at every time."""

        def relative(values: Array) -> Array:
            along = values if self.shared is None else jnp.moveaxis(values, 0, 1)
            runs = 0 if self.shared is None else 1
            axes = tuple(range(1 + runs, along.ndim))
            size = jnp.sqrt(jnp.sum(along[:1] ** 2, axis=axes))
            change = jnp.sqrt(jnp.sum((along - along[:1]) ** 2, axis=axes))
            result = change / jnp.where(size > 0.0, size, 1.0)
            return result if self.shared is None else jnp.moveaxis(result, 0, 1)

        return {
            name: relative(v) for name, v in self.along(lambda s, t, y: s.invariants(t, y)).items()
        }

    def error(self) -> State:
        """Estimate of the global error of the final state, component by component: how far it moves
        when the run is repeated with a hundredth of the tolerance (and half the `max_step`, or
        twice as many equal steps); for a closed form, when the span is passed in two parts. Not a
        number where the steps of the repetition run out. What both runs pass over, it does not know
        (`Accuracy.max_step`)."""
        from ._simulate import repeated

        return jax.tree.map(lambda a, b: jnp.abs(a - b), self.final, repeated(self, 0.01))

    def dtype(self) -> Any:
        """The precision of the states."""
        return state_dtype(self.states)


@final
class MissionTrajectory(eqx.Module):
    """The trajectories of a mission's phases, in order, each up to and including its end before the
    jump that follows.

    - `phases`: a `Trajectory` for each phase; `names`: their names; index by either.
    - `final`: the state after the last jump, and `end`, s, its time, of each run.
    - `status`: of each run: the first trouble, or how the last phase ended."""

    phases: tuple[Trajectory, ...]
    names: tuple[str, ...] = eqx.field(static=True)
    final: State
    end: Float[Array, "*runs"]
    status: Int[Array, "*runs"]

    def __getitem__(self, phase: int | str) -> Trajectory:
        return self.phases[self.names.index(phase) if isinstance(phase, str) else phase]

    def evaluations(self) -> Array:
        """Evaluations of the vector field over all phases."""
        return sum((p.stats["evaluations"] for p in self.phases), jnp.array(0))
