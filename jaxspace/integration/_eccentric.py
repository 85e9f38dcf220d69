"""Whether runs are eccentric orbits for which steps in regularised variables pay off, told by their
numbers at the start.

    e >= 1/2 in half of the runs looked at, at least one revolution of each, and at most eight
    states asked for in a revolution

The orbit is the osculating one, that of two bodies through the state with the attraction there
(`steps_for`). On rounder ones steps in time take as many evaluations or fewer, and where many
states are asked for their dense output is cheaper than a landing on each.

    e^2 = (1 - |r|/A)^2 + (r . v)^2/(mu A)

    symbol  meaning
    A       semi-major axis
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..core import AbstractSystem, State
from ..solvers._adaptive_regularised import form_in
from ._stiffness import InitialConditions, of_each

ECCENTRIC = 0.5
# States in a revolution up to which to land on each costs less than dense output.
STATES = 8.0


def is_eccentric(starts: InitialConditions, system: AbstractSystem, second_order: bool) -> bool:
    """Whether runs are to be integrated in regularised variables.

    **Arguments**

    - `starts`: runs of which some are looked at.
    - `system`: their system.
    - `second_order`: whether a method for second-order systems serves otherwise: then only a
      perturbation with a potential has a better one.

    `False` where the numbers are not known (under `jit`, or in a derivative)."""
    form = system.regularised()
    if form is None or not starts.readable:
        return False
    _, y, ts = starts.runs
    if second_order:
        z = jax.eval_shape(form.to_regularised, y)
        if form_in(form, z) is form:
            return False
    e, revolutions = _orbits(*map(np.asarray, _starts(starts, np.zeros(starts.rows.size))))
    between = revolutions * STATES >= np.shape(ts)[0] - 1
    return bool(np.median(e) >= ECCENTRIC and np.median(revolutions) >= 1.0 and np.all(between))


@eqx.filter_jit
def _starts(starts: InitialConditions, unused: Any) -> tuple[Array, Array, Array, Array]:
    """Position, velocity, acceleration and duration of each run."""

    def one(system: AbstractSystem, y: State, ts: Array, unused: Array) -> tuple[Array, ...]:
        del unused
        a = system.vector_field(ts[0], y).velocity
        return y.position, y.velocity, a, ts[-1] - ts[0]

    return of_each(starts, one, jnp.asarray(unused))


def _orbits(
    r: np.ndarray, v: np.ndarray, a: np.ndarray, duration: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Eccentricity and revolutions of each run, runs first; zero where an orbit does not come back.

    In NumPy, which compiles nothing: it is part of every first call."""
    # A run that starts at the centre, or without attraction, is none of these orbits.
    with np.errstate(all="ignore"):
        distance = np.linalg.norm(r, axis=-1)
        mu = -np.sum(a * r, axis=-1) * distance
        curvature = 2.0 / distance - np.sum(v * v, axis=-1) / mu
        climb = np.sum(r * v, axis=-1)
        e = np.sqrt((1.0 - distance * curvature) ** 2 + climb * climb * curvature / mu)
        n = np.sqrt(mu * curvature) * curvature
        turns = np.abs(duration) * n / (2.0 * np.pi)
    bound = curvature > 0.0
    return np.where(bound, e, 0.0), np.where(bound, turns, 0.0)
