"""Flight data on the page of a run: altitude, speed, burns, and the planet."""

import json
from pathlib import Path
from types import ModuleType

import numpy as np
from jaxtyping import PyTree

from ..core.record import Record

COAST = Path(__file__).parent / "_coast.json"
"""Coast lines of the Earth: longitudes and latitudes in turn, degrees. From Natural Earth
(1:110 million, public domain), thinned to half a degree."""
EARTH_MU = (3.98e14, 3.99e14)
"""Gravitational parameters that are the Earth's, m^3/s^2."""
EARTH_RADII = (6.35e6, 6.4e6)
"""Radii that are the Earth's, m."""
EARTH_RATE = 7.292115e-5
"""Rate of the Earth about its axis, rad/s (IERS Conventions 2010)."""


def readings(
    joined: dict[str, PyTree], ground: float | None, library: ModuleType = np
) -> dict[str, PyTree]:
    """Numbers displayed next to the clock, each (*times,).

    **Arguments**

    - `joined`: blocks of the states, (components, *times).
    - `ground`: radius of the ground, m; `None` where no one states it.
    - `library`: of the arrays.

    **Returns** `altitude` above the ground, or `distance` from the origin, m, and `speed`, m/s."""
    result = {}
    # A direction is a pure number.
    if "position" in joined and "direction" not in joined:
        distance = library.linalg.norm(joined["position"], axis=0)
        if ground is None:
            result["distance"] = distance
        else:
            result["altitude"] = distance - ground
    if "velocity" in joined:
        result["speed"] = library.linalg.norm(joined["velocity"], axis=0)
    return result


def burns(mass: np.ndarray | None) -> np.ndarray | None:
    """Whether propellant leaves between each frame and the next one, (times,); `None` where it
    never does.

    - `mass`: kg, (times,), or `None`."""
    if mass is None:
        return None
    change = np.diff(mass, append=mass[-1])
    # A stage dropped between two frames is not a burn: its mass is lost from one frame to the next.
    lit = (change < 0.0) & (change > -0.2 * mass)
    return lit if np.any(lit) else None


def planet_lines(phase: PyTree, radius: float) -> Record:
    """The coast lines of the planet at the origin, and its rate, where it is the Earth.

    - `phase`: whose system attracts by its `mu`, or has effects that do.
    - `radius`: with which it is drawn, m."""
    system = phase.system
    parts = (system, *getattr(system, "effects", ()))
    mus = [float(np.max(np.asarray(x.mu))) for x in parts if hasattr(x, "mu")]
    is_earth = EARTH_RADII[0] < radius < EARTH_RADII[1] and any(
        EARTH_MU[0] < mu < EARTH_MU[1] for mu in mus
    )
    if not is_earth:
        return {"coast": None}
    return {"coast": json.loads(COAST.read_text(encoding="utf-8")), "rate": EARTH_RATE}
