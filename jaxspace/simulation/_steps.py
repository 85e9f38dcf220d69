"""How many equal steps an orbit wants.

mu = -(a . r) |r|       1/A = 2/|r| - v^2/mu       n = sqrt(mu/A^3)       steps = per revolution x n x duration / (2 pi)

symbol   meaning                                                  unit
r, v, a  position, velocity and acceleration                      m, m/s, m/s^2
mu, A    strength and semi-major axis of the osculating orbit     m^3/s^2, m
n        mean motion                                              rad/s
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..core import AbstractSystem, InputError, Scalar, State, is_traced


@eqx.filter_jit
def _mean_motion(system: AbstractSystem, y: State, t: Any) -> Array:
    """That of the osculating orbit, zero for one that does not come back; not a number without an
    attraction."""
    r, v, a = y.position, y.velocity, system.vector_field(t, y).velocity
    distance = jnp.sqrt(jnp.sum(r * r))
    mu = -jnp.sum(a * r) * distance
    curvature = jnp.maximum(2.0 / distance - jnp.sum(v * v) / mu, 0.0)
    return jnp.sqrt(mu * curvature) * curvature


def steps_for(
    system: AbstractSystem, y0: State, duration: Scalar, per_revolution: int, t0: Scalar = 0.0
) -> int:
    """How many equal steps make at least `per_revolution` in a revolution of the osculating orbit,
    in `duration`, s, from `t0`.

    For `Stormer` the duration is that of the run, for `Splitting` and `Regularised` the time
    between two states asked for. Of many runs, on the first axis of every block of `y0`, the
    fastest counts; an orbit that does not come back counts as one revolution. Rounded up to the
    next even number of 2, 2 sqrt(2), 4, ..., so that orbits alike share a compiled program.

    Raises `InputError` for a state without position and velocity or that is traced, or where
    nothing attracts."""
    if is_traced((system, y0, duration)) or any(
        getattr(y0, part, None) is None for part in ("position", "velocity")
    ):
        raise InputError(
            "steps_for wants a state with a position and a velocity, outside of jit: number the steps yourself."
        )
    pace = (
        _mean_motion if y0.position.ndim == 1 else jax.vmap(_mean_motion, in_axes=(None, 0, None))
    )
    n = np.asarray(pace(system, y0, jnp.asarray(t0, y0.position.dtype)))
    if np.all(np.isnan(n)):
        raise InputError(
            "steps_for finds no attraction at the initial position: number the steps yourself."
        )
    wanted = per_revolution * max(1.0, float(np.nanmax(n)) * abs(float(duration)) / (2.0 * np.pi))
    return 2 * int(np.ceil(0.5 * 2.0 ** (0.5 * np.ceil(2.0 * np.log2(wanted) - 1e-9))))
