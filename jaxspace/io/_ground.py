"""The warning of a nominal run that passes below the ground of the planet of its file."""

import warnings

import jax.numpy as jnp

from ..bodies import AbstractEffect, BodyState
from ..scene.ground_check import ground_warning, lowest_below_ground
from ..simulation import Trajectory
from ..simulation.finish import with_doubts
from ..simulation.mission_result import Result
from ._kinds import Values


def warned_of_ground(run: Result, values: Values, stacklevel: int) -> Result:
    """The run, with the status of one that passes below the ground, of which it warns.

    An effect that states the ground warns of it itself.

    **Arguments**

    - `values`: of the file, whose [planet] has `mu`, m^3/s^2, and `radius`, m.
    - `stacklevel`: of the verb that the user calls, from here."""
    planet = values.get("planet") or {}
    mu, radius = planet.get("mu"), planet.get("radius")
    if mu is None or radius is None:
        return run
    below = False
    for phase in run.phases:
        words = _words(phase, mu, radius)
        if words:
            warnings.warn(words, stacklevel=stacklevel + 1)
            below = True
    return with_doubts(run, jnp.asarray(below)) if below else run


def _words(phase: Trajectory, mu: float, radius: float) -> str:
    """How deep a phase passes below the ground, in a sentence; empty where it stays above."""
    parts = (phase.system, *getattr(phase.system, "effects", ()))
    # Over flat ground the origin is no centre.
    about_centre = any(hasattr(part, "mu") for part in parts)
    known = any(isinstance(e, AbstractEffect) and e.ground() is not None for e in parts)
    if not about_centre or known or not isinstance(phase.states, BodyState):
        return ""
    within = mu if phase.undisturbed else None
    return ground_warning(
        lowest_below_ground(phase.ts, phase.states, radius, within), radius, "planet.radius"
    )
