"""Second-order systems as the integrators here see them, and methods that take equal steps.

    r' = l v        v' = l a(s, r)        l: length of the segment on the clock, whatever its unit

The methods of Nystrom and Stormer sum accelerations into velocities, and hand velocities to the
system to learn how the position moves: so they need not know l, and no state ever holds anything
but what the system understands.
"""

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..core import InputError, barrier


@eqx.filter_jit
def _acceleration(terms: Any, s: Any, r: Array, y: Any, args: Any) -> Array:
    return barrier(terms.vf(s, dataclasses.replace(y, position=barrier(r)), args).velocity)


class SecondOrder(NamedTuple):
    """A second-order system from the state `y0` on, over clock times up to `end`, seen from within
    the step; the rate of the position is the velocity times the `pace` of the clock."""

    terms: Any
    args: Any
    y0: Any
    end: Array
    pace: Array

    def acceleration(self, s: Any, r: Array) -> Array:
        """The rate of the velocity at the position `r`; the velocity is taken not to matter."""
        return _acceleration(self.terms, jnp.minimum(s, self.end), r, self.y0, self.args)

    def travel(self, v: Array) -> Array:
        """The rate of the position that belongs to the velocity `v`."""
        return self.pace * v

    def state(self, r: Array, v: Array) -> Any:
        """The state of position `r` and velocity `v`."""
        return dataclasses.replace(self.y0, position=r, velocity=v)

    def velocity_matters(self) -> Array:
        """For each run whether its first acceleration changes when it stands still: then no method
        of this kind applies."""
        y0 = jax.lax.stop_gradient(self.y0)

        def a(v):
            return self.terms.vf(self.end, dataclasses.replace(y0, velocity=v), self.args).velocity

        moving, still = a(y0.velocity), a(jnp.zeros_like(y0.velocity))
        same = jnp.abs(moving - still) <= 1e3 * jnp.finfo(still.dtype).eps * jnp.max(
            jnp.abs(still), axis=0
        )
        return jax.lax.stop_gradient(~jnp.all(same | ~jnp.isfinite(moving), axis=0))


def second_order(terms: Any, t0: Any, t1: Any, y0: Any, args: Any, who: str) -> SecondOrder:
    """The system of one step. Raises `InputError` unless the state holds a position and a velocity,
    and nothing else."""
    parts = [getattr(y0, name, None) for name in ("position", "velocity")]
    if any(part is None for part in parts) or len(jax.tree.leaves(y0)) != 2:
        raise InputError(
            f"{who} integrates a position and a velocity, and nothing else: take DOP853() for this state."
        )
    end = t1 - 4.0 * jnp.finfo(t1.dtype).eps * jnp.maximum(jnp.abs(t1), t1 - t0)
    pace = terms.vf(
        end, dataclasses.replace(y0, velocity=jnp.ones_like(y0.velocity)), args
    ).position
    return SecondOrder(terms, args, y0, end, pace)


def estimate_by_coarsening(
    integrate: Callable[[int], Any], steps: int, fewer: int, error_reduction: Any, estimate: bool
) -> tuple[Any, Any]:
    """The end of a `integrate` in so many steps, and its error: what `fewer` steps do otherwise,
    divided by `error_reduction`.

    The error is without derivatives, and zero where no `estimate` is asked for."""
    end = integrate(steps)
    if not estimate:
        return end, jax.tree.map(jnp.zeros_like, end)
    apart = jax.tree.map(jnp.subtract, end, integrate(fewer))
    return end, jax.lax.stop_gradient(jax.tree.map(lambda x: x / error_reduction, apart))
