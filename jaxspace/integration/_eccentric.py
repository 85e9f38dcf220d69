"""Whether runs are eccentric orbits for which steps in regularised variables pay off, by their
initial states.

    e >= 1/2 in half of the sampled runs, at least one revolution of each, and at most eight
    saved states in a revolution

The orbit is the osculating one about the attracting point. On less eccentric orbits steps in time
need no more evaluations, and where many states are saved their dense output is cheaper than landing
on each.

    e^2 = (1 - |r|/A)^2 + (r . v)^2/(mu A)

    symbol  meaning                             unit
    A       semi-major axis                     m
    mu      gravitational parameter             m^3/s^2
"""

import numpy as np
from jaxtyping import ArrayLike

from ..core import AbstractSystem, Scalar, State
from ..core.structure import reads_a_leaf, without_numbers
from ..solvers.regularised_step import form_in
from .stiffness import InitialConditions

ECCENTRIC = 0.5
# Up to this number of states in a revolution, a landing on each costs less than dense output.
STATES = 8.0
TURN = 2.0 * np.pi


def is_eccentric(starts: InitialConditions, system: AbstractSystem) -> bool:
    """Whether runs are orbits for which steps in regularised variables pay off.

    **Arguments**

    - `starts`: runs of which some are sampled.
    - `system`: their system.
    """
    mu = _attraction_of(system)
    if mu is None:
        return False
    e, motion = _orbits(starts, mu)
    if not _in_half(e >= ECCENTRIC):
        return False
    _, _, ts = starts.runs
    revolutions = motion * np.ptp(_of_rows(ts, starts.run_axes[2], starts), axis=0) / TURN
    enough = revolutions * STATES >= np.shape(ts)[0] - 1
    return _in_half(revolutions >= 1.0) and bool(np.all(enough))


def _in_half(holds: np.ndarray) -> bool:
    """Whether it applies to at least half of the runs."""
    return bool(2 * np.count_nonzero(holds) >= holds.size)


@without_numbers
def is_second_order_regularised(system: AbstractSystem, y: State) -> bool:
    """Whether the motion of a system that has regularised variables is of second order in them."""
    form = system.regularised()
    assert form is not None
    return form_in(form, form.to_regularised(y)) is not form


@reads_a_leaf
def _attraction_of(system: AbstractSystem) -> Scalar | None:
    """The gravitational parameter of the attracting point; `None` where there is none."""
    form = system.regularised()
    return None if form is None else form.attraction


def _orbits(starts: InitialConditions, mu: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Eccentricity and mean motion, rad/s, of each sampled run; zero for an orbit that does not
    return.

    In NumPy, which compiles nothing, because it is part of every first call."""
    _, y, _ = starts.runs
    _, axes, _ = starts.run_axes
    r = _of_rows(y.position, axes.position, starts)
    v = _of_rows(y.velocity, axes.velocity, starts)
    mu = _of_rows(mu, int(np.size(mu) > 1), starts)
    # A run that starts at the centre, or without attraction, does not count.
    with np.errstate(all="ignore"):
        distance = np.sqrt((r * r).sum(axis=0))
        curvature = 2.0 / distance - (v * v).sum(axis=0) / mu
        climb = (r * v).sum(axis=0)
        e = np.sqrt((1.0 - distance * curvature) ** 2 + climb * climb * curvature / mu)
        motion = np.sqrt(mu * curvature) * curvature
    bound = curvature > 0.0
    return np.where(bound, e, 0.0), np.where(bound, motion, 0.0)


def _of_rows(x: ArrayLike, run_axes: int, starts: InitialConditions) -> np.ndarray:
    """The array of the sampled runs, with an axis of them."""
    x = np.asarray(x)
    return x[..., starts.rows] if run_axes else x[..., None]
