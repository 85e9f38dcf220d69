"""Derivatives along the recorded steps of runs that each take their own steps.

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
from ..solvers.regularised_step import attempt, form_of
from ._needed import needed_only
from ._own_buffers import get_landed, put_landed
from ._own_state import OwnState, Segment, landing_state
from ._replay import Replay


@final
class OwnReplay(Replay):
    """The recorded steps of runs with their own steps; fields as of `Replay`."""

    def _landed(self, n: Array) -> Array:
        return self.record.step(n)[1] > 0.5

    def step(self, moving: PyTree, n: Array, y: OwnState) -> tuple[OwnState, None]:
        """The state after step number `n` of every run, from `y`."""
        field = eqx.combine(moving, self.fixed)
        form = form_of(field, y.z)
        h = self.record.step(n)[0]
        done = self._landed(n)
        segment = Segment.of(field, self.settings, y.segment)
        z = attempt(form, *segment, y.z, h).z
        y = OwnState(jnp.where(h != 0.0, z, y.z), y.segment)
        return jax.lax.cond(
            jnp.any(done), lambda y: landing_state(form, segment, y, done), lambda y: y, y
        ), None

    def jvp(self, moving: PyTree, y0: State, d_moving: PyTree, d_y0: State) -> State:
        save_ts = self.settings.save_ts

        def advance(n: Array, carry: tuple[PyTree, ...]) -> tuple[PyTree, ...]:
            y, dy, saved = carry
            y, dy = jax.jvp(
                needed_only(lambda p, y: self.step(p, n, y)[0]), (moving, y), (d_moving, dy)
            )
            if save_ts is not None:
                saved = put_landed(saved, dy, y.segment, self._landed(n))
            return y, dy, saved

        saved = None
        if save_ts is not None:
            rows = save_ts.shape[0]
            saved = jax.tree.map(lambda x: jnp.zeros((rows, *x.shape), x.dtype).at[0].set(x), d_y0)
        _, dy, saved = jax.lax.fori_loop(0, self.record.count, advance, (y0, d_y0, saved))
        return jax.tree.map(lambda x: x[None], dy) if saved is None else saved

    def vjp(self, moving: PyTree, y0: State, cotangent: State) -> tuple[PyTree, State]:
        of_moving, of_y = super().vjp(moving, y0, cotangent)
        if self.settings.save_ts is not None:
            # The first saved state is the initial one.
            of_y = jax.tree.map(lambda a, b: a + b[0], of_y, cotangent)
        return of_moving, of_y

    def _step_vjp(
        self, moving: PyTree, n: Array, y: OwnState, cotangent: State, total: tuple[PyTree, ...]
    ) -> tuple[PyTree, ...]:
        of_moving, of_y, k = total
        if self.settings.save_ts is not None:
            more = get_landed(cotangent, y.segment + 1.0, self._landed(n))
            of_y = jax.tree.map(jnp.add, of_y, more)
        _, pull = jax.vjp(needed_only(lambda p, y: self.step(p, n, y)[0]), moving, y)
        more, of_y = barrier(pull)(of_y)
        return jax.tree.map(jnp.add, of_moving, more), of_y, k
