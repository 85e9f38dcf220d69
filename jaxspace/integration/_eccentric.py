"""Whether runs are eccentric orbits for which steps in regularised variables pay off, by their
initial states.

    e >= 1/2 in half of the sampled runs, at least one revolution of each, and at most eight
    saved states in a revolution

The orbit is the osculating one about the attracting point. On rounder orbits steps in time take as
many evaluations or fewer, and where many states are saved their dense output is cheaper than a
landing on each.

    e^2 = (1 - |r|/A)^2 + (r . v)^2/(mu A)

    symbol  meaning                             unit
    A       semi-major axis                     m
    mu      gravitational parameter             m^3/s^2
"""

from typing import Literal

import equinox as eqx
import jax
import numpy as np
from jax.extend.core import Literal as Constant
from jaxtyping import ArrayLike, PyTree

from ..core import AbstractSystem, Scalar, State
from ..core.structure import once_per_structure, without_numbers
from ..solvers.regularised_step import form_in
from .stiffness import InitialConditions

ECCENTRIC = 0.5
# Up to this number of states in a revolution, a landing on each costs less than dense output.
STATES = 8.0


def is_eccentric(starts: InitialConditions, system: AbstractSystem) -> bool:
    """Whether runs are orbits for which steps in regularised variables pay off.

    **Arguments**

    - `starts`: runs of which some are sampled.
    - `system`: their system.

    `False` where the numbers are unknown (under `jit`, or in a derivative)."""
    if not starts.readable:
        return False
    mu = _attraction_of(system)
    if mu is None:
        return False
    e, revolutions = _orbits(starts, mu)
    if not (np.median(e) >= ECCENTRIC and np.median(revolutions) >= 1.0):
        return False
    _, _, ts = starts.runs
    return bool(np.all(revolutions * STATES >= np.shape(ts)[0] - 1))


@without_numbers
def is_second_order_regularised(system: AbstractSystem, y: State) -> bool:
    """Whether the motion of a system that has regularised variables is of second order in them."""
    form = system.regularised()
    assert form is not None
    return form_in(form, form.to_regularised(y)) is not form


def _attraction_of(system: AbstractSystem) -> Scalar | None:
    """The gravitational parameter of the attracting point; `None` where there is none."""
    place = _attraction_place(system)
    if isinstance(place, int):
        return jax.tree.leaves(system)[place]
    form = system.regularised() if place == "computed" else None
    return None if form is None else form.attraction


@once_per_structure
def _attraction_place(system: AbstractSystem) -> int | Literal["none", "computed"]:
    """The number of the leaf of a system that is its attraction, if one of them is.

    To read a leaf takes a hundredth of the time in which a scene makes its regularised
    variables."""
    shapes, static = eqx.partition(system, lambda x: isinstance(x, jax.ShapeDtypeStruct))

    def attraction(shapes: PyTree) -> Scalar | None:
        form = eqx.combine(shapes, static).regularised()
        return None if form is None else form.attraction

    try:
        jaxpr = jax.make_jaxpr(attraction)(shapes).jaxpr
    # A system that reads the value of a traced number may raise any error.
    except Exception:  # noqa: BLE001
        return "computed"
    if not jaxpr.outvars:
        return "none"
    arrays = [
        k for k, x in enumerate(jax.tree.leaves(system)) if isinstance(x, jax.ShapeDtypeStruct)
    ]
    places = dict(zip(jaxpr.invars, arrays, strict=True))
    (result,) = jaxpr.outvars
    # A number that no array holds is a literal, which cannot be looked up.
    return "computed" if isinstance(result, Constant) else places.get(result, "computed")


def _orbits(starts: InitialConditions, mu: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Eccentricity and revolutions of each sampled run; zero for an orbit that does not return.

    In NumPy, which compiles nothing, because it is part of every first call."""
    _, y, ts = starts.runs
    _, axes, time_axes = starts.run_axes

    def of_rows(x: ArrayLike, run_axes: int) -> np.ndarray:
        return np.asarray(x)[..., starts.rows] if run_axes else np.asarray(x)[..., None]

    r = of_rows(y.position, axes.position)
    v = of_rows(y.velocity, axes.velocity)
    duration = np.ptp(of_rows(ts, time_axes), axis=0)
    mu = of_rows(mu, int(np.size(mu) > 1))
    # A run that starts at the centre, or without attraction, does not count.
    with np.errstate(all="ignore"):
        distance = np.linalg.norm(r, axis=0)
        curvature = 2.0 / distance - np.sum(v * v, axis=0) / mu
        climb = np.sum(r * v, axis=0)
        e = np.sqrt((1.0 - distance * curvature) ** 2 + climb * climb * curvature / mu)
        turns = duration * np.sqrt(mu * curvature) * curvature / (2.0 * np.pi)
    bound = curvature > 0.0
    return np.where(bound, e, 0.0), np.where(bound, turns, 0.0)
