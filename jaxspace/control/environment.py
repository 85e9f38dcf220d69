"""Environments for reinforcement learning as pure functions: the state is an argument and a result.

    observation, state = environment.reset(key)
    observation, state, reward, done, info = environment.step(key, state, action)

A finished episode restarts in the same call: `state` and `observation` are then those of the
new one, and `info` contains the last observation of the old one. Runs are on the last axes:
`reset(key, (1024,))` starts a thousand episodes, and `step` advances them as a batch, faster than
with `jax.vmap`, which works as well.
"""

__all__ = ["Box", "Episode"]

from abc import abstractmethod
from typing import NamedTuple, final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray, PyTree

from ..core import AbstractParameters, Scalar, State
from ..core.printing import printed
from ._advance import select


@final
@printed()
class Box(NamedTuple):
    """A space of vectors: `shape` without batch axes, and the least and greatest value of a
    component."""

    low: float
    high: float
    shape: tuple[int, ...]

    def sample(self, key: PRNGKeyArray, runs: tuple[int, ...] = ()) -> Array:
        """A vector of the space, uniformly distributed; only for bounded spaces."""
        return jax.random.uniform(key, (*self.shape, *runs), minval=self.low, maxval=self.high)

    def contains(self, x: Array) -> Bool[Array, "*runs"]:
        """Whether vectors belong to the space."""
        inside = (x >= self.low) & (x <= self.high)
        return jnp.all(inside, axis=tuple(range(len(self.shape))))


@final
@printed(time="s")
class Episode(eqx.Module):
    """State of an episode.

    - `y`: the state of the system.
    - `time`, s: since the start of the episode."""

    y: State
    time: Float[Array, "*runs"]


class AbstractEnvironment(AbstractParameters):
    """A task. A concrete environment is final, and defines the start, the steps and the end of an
    episode."""

    horizon: eqx.AbstractVar[Float[Array, ""]]

    @property
    @abstractmethod
    def action_space(self) -> Box:
        """Actions, of components between -1 and 1."""

    @property
    @abstractmethod
    def observation_space(self) -> Box:
        """Observations, scaled to the order of 1."""

    @abstractmethod
    def start(self, key: PRNGKeyArray, runs: tuple[int, ...]) -> State:
        """A state from which an episode starts, for these `runs`."""

    @abstractmethod
    def advance(self, y: State, action: Array, time: Scalar) -> tuple[State, Scalar]:
        """The state after a period under an action, and the duration of the period, s."""

    @abstractmethod
    def observe(self, y: State, time: Scalar) -> Array:
        """The observation of the agent, (observations, *runs)."""

    @abstractmethod
    def judge(
        self, before: State, action: Array, after: State
    ) -> tuple[Scalar, Bool[Array, "*runs"], dict[str, Array]]:
        """The reward of a step, whether the episode is terminated by the state, and further
        information, such as whether it succeeded."""

    def reset(
        self, key: PRNGKeyArray, runs: tuple[int, ...] = ()
    ) -> tuple[Float[Array, "observations *#runs"], Episode]:
        """The first observation, and the state of a new episode, or of several for these `runs`."""
        y = self.start(key, runs)
        dtype = jnp.result_type(*jax.tree.leaves(y))
        time = jnp.zeros(runs, dtype)
        return self.observe(y, time), Episode(y, time)

    def step(
        self, key: PRNGKeyArray, state: Episode, action: Float[Array, "actions *#runs"]
    ) -> tuple[Array, Episode, Array, Array, dict[str, PyTree]]:
        """Advance by one period.

        **Arguments**

        - `key`: for the restart of a finished episode.
        - `state`: of every run; `action`: clipped to between -1 and 1.

        **Returns** observation, state, reward, whether the episode has ended, and `info`:
        `truncated`, whether it ended because of its time limit; `last`, the observation before a
        reset; and the report of the task."""
        space = self.action_space
        action = jnp.clip(action, space.low, space.high)
        y, span = self.advance(state.y, action, state.time)
        time = state.time + span
        reward, ended, measures = self.judge(state.y, action, y)
        # A state that is not finite terminates its episode, without a reward.
        finite = _finite(y, time.shape)
        reward = jnp.where(finite, reward, jnp.zeros_like(reward))
        ended = ended | ~finite
        # Half a period early, because the time is a sum with roundings.
        up = time >= self.horizon - 0.5 * span
        done = ended | up
        last = self.observe(y, time)

        def again(_: None) -> tuple[State, Array, Array]:
            # In the precision of the episode, whatever the default is.
            fresh = jax.tree.map(lambda a, x: a.astype(x.dtype), self.start(key, time.shape), y)
            new = select(done, fresh, y)
            begun = jnp.where(done, 0.0, time)
            return new, begun, self.observe(new, begun)

        # Drawn only where an episode has ended: random numbers cost more than a step.
        y, time, seen = jax.lax.cond(jnp.any(done), again, lambda _: (y, time, last), None)
        info = {"truncated": up & ~ended, "last": last, **measures}
        return seen, Episode(y, time), reward, done, info


def _finite(y: State, runs: tuple[int, ...]) -> Bool[Array, "*runs"]:
    flags = jnp.ones(runs, bool)
    for x in jax.tree.leaves(y):
        # The sum of all numbers times zero is finite if all are, and treats many runs at once.
        flags = flags & (jnp.sum(0.0 * x, axis=tuple(range(x.ndim - len(runs)))) == 0.0)
    return flags
