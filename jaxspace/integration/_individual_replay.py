"""Derivatives along the recorded steps of runs with individual steps.

As in `_replay.py`, but a record holds the length of the step of every run instead of the ends of
common steps. These lengths have no derivatives; the landing at the end of a segment corrects for
it.
"""

from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from ..core import State
from ..core.barrier import barrier
from ..solvers.regularised_step import form_of, trial_step
from ._individual_state import IndividualState, Segment, landing_state
from ._needed import needed_only
from ._replay import Replay
from ._rows import get_rows, put_rows


@final
class IndividualReplay(Replay):
    """The recorded steps of runs with individual steps; fields as in `Replay`."""

    def _landed(self, n: Array) -> Array:
        return self.record.step(n)[1] > 0.5

    def step(self, moving: PyTree, n: Array, y: IndividualState) -> tuple[IndividualState, None]:
        """The state after step number `n` of every run, from `y`."""
        field = eqx.combine(moving, self.fixed)
        form = form_of(field, y.z)
        h = self.record.step(n)[0]
        done = self._landed(n)
        segment = Segment.of(field, self.settings, y.segment)
        # Written out, the stages of many runs take three times as long to compile, and save 0.3 of
        # the time of a gradient. Segments of a single run compile equally fast.
        z = trial_step(form, *segment, y.z, h, rolled=h.ndim > 0).z
        y = IndividualState(jnp.where(h != 0.0, z, y.z), y.segment)
        return jax.lax.cond(
            jnp.any(done), lambda y: landing_state(form, segment, y, done), lambda y: y, y
        ), None

    def _saved_at_start(self, rows: int, d_y0: IndividualState) -> IndividualState:
        # The first saved state is the initial one.
        return jax.tree.map(lambda x: jnp.zeros((rows, *x.shape), x.dtype).at[0].set(x), d_y0)

    def _save_tangents(
        self,
        n: Array,
        result: tuple[IndividualState, PyTree],
        tangent: tuple[IndividualState, PyTree],
        saved: IndividualState,
        k: Array,
    ) -> tuple[IndividualState, Array]:
        landed = self._landed(n)
        # Beyond the last row nothing is written: between its save times a run alone has none.
        row = jnp.where(landed, result[0].segment, saved.segment.shape[0])
        return put_rows(saved, row.astype(int), landed, tangent[0]), k

    def vjp(self, moving: PyTree, y0: State, cotangent: State) -> tuple[PyTree, State]:
        of_moving, of_y = super().vjp(moving, y0, cotangent)
        if self.settings.save_ts is not None:
            of_y = jax.tree.map(lambda a, b: a + b[0], of_y, cotangent)
        return of_moving, of_y

    def _step_vjp(
        self,
        moving: PyTree,
        n: Array,
        y: IndividualState,
        cotangent: State,
        total: tuple[PyTree, ...],
    ) -> tuple[PyTree, ...]:
        of_moving, of_y, k = total
        if self.settings.save_ts is not None:
            more = get_rows(cotangent, (y.segment + 1.0).astype(int), self._landed(n))
            of_y = jax.tree.map(jnp.add, of_y, more)
        _, pull = jax.vjp(needed_only(lambda p, y: self.step(p, n, y)[0]), moving, y)
        more, of_y = barrier(pull)(of_y)
        return jax.tree.map(jnp.add, of_moving, more), of_y, k
