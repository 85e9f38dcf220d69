"""Whether runs are eccentric orbits for which steps in regularised variables pay off: their
numbers at the start show it.

    e >= 1/2 in half of the runs looked at, at least one revolution of each, and at most eight
    states asked for in a revolution

The orbit is the osculating one, that of two bodies about the attracting point. On rounder ones
steps in time take as many evaluations or fewer, and where many states are asked for their dense
output is cheaper than a landing on each.

    e^2 = (1 - |r|/A)^2 + (r . v)^2/(mu A)

    symbol  meaning                             unit
    A       semi-major axis                     m
    mu      gravitational parameter             m^3/s^2
"""

import equinox as eqx
import numpy as np
from jaxtyping import ArrayLike, PyTree

from ..core import AbstractRegularised, AbstractSystem, State, once_per_structure
from ..solvers._regularised_step import form_in
from ._stiffness import InitialConditions

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
    if not starts.readable:
        return False
    form = system.regularised()
    if form is None or form.attraction is None:
        return False
    _, y, ts = starts.runs
    e, revolutions = _orbits(starts, form.attraction)
    if not (np.median(e) >= ECCENTRIC and np.median(revolutions) >= 1.0):
        return False
    if not np.all(revolutions * STATES >= np.shape(ts)[0] - 1):
        return False
    return not second_order or _is_second_order(form, y)


@once_per_structure
def _is_second_order(form: AbstractRegularised, y: State) -> bool:
    """Whether the motion is of second order in regularised variables, too."""

    def offers(form: AbstractRegularised, y: State) -> PyTree:
        return form_in(form, form.to_regularised(y)) is not form

    return eqx.filter_eval_shape(offers, form, y)


def _orbits(starts: InitialConditions, mu: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Eccentricity and revolutions of each run looked at; zero where an orbit does not come back.

    In NumPy, which compiles nothing: it is part of every first call."""
    _, y, ts = starts.runs
    _, axes, time_axes = starts.run_axes

    def of_rows(x: ArrayLike, run_axes: int) -> np.ndarray:
        return np.asarray(x)[..., starts.rows] if run_axes else np.asarray(x)[..., None]

    r = of_rows(y.position, axes.position)
    v = of_rows(y.velocity, axes.velocity)
    duration = np.ptp(of_rows(ts, time_axes), axis=0)
    mu = of_rows(mu, int(np.size(mu) > 1))
    # A run that starts at the centre, or without attraction, is none of these orbits.
    with np.errstate(all="ignore"):
        distance = np.linalg.norm(r, axis=0)
        curvature = 2.0 / distance - np.sum(v * v, axis=0) / mu
        climb = np.sum(r * v, axis=0)
        e = np.sqrt((1.0 - distance * curvature) ** 2 + climb * climb * curvature / mu)
        turns = duration * np.sqrt(mu * curvature) * curvature / (2.0 * np.pi)
    bound = curvature > 0.0
    return np.where(bound, e, 0.0), np.where(bound, turns, 0.0)
