"""A thousand low orbits for one day by DOP853 at 1e-9 with one additional effect at a time: the
increase of the CPU time relative to point-mass gravity, and of the number of evaluations. The cost
of an effect per evaluation is the ratio of the two."""

from typing import Any

import jax.numpy as jnp

from jaxspace import BodyState, Scene
from jaxspace.bodies import ExponentialAtmosphere
from jaxspace.constants import (
    ASTRONOMICAL_UNIT,
    J2_EARTH,
    MU_EARTH,
    MU_MOON,
    RADIUS_EARTH,
    RADIUS_SUN,
    ROTATION_RATE_EARTH,
    ZONALS_EARTH,
)
from jaxspace.orbits import (
    CircularPath,
    Drag,
    Oblateness,
    PointGravity,
    SolarPressure,
    ThirdBody,
    Zonals,
)
from jaxspace.simulation import Accuracy, simulate_batch
from jaxspace.solvers import DOP853

from . import low_orbits
from ._measure import in_turn, on_one_device

RUNS, DAY = 1000, 86400.0
SUN = CircularPath(ASTRONOMICAL_UNIT, 1.99e-7, inclination=0.409)
AIR = ExponentialAtmosphere(1e-11, 4.0e5, 6.0e4)
EFFECTS = {
    "attraction of a point alone": (),
    "J2": (Oblateness(MU_EARTH, J2_EARTH, RADIUS_EARTH),),
    "J2 to J6": (Zonals(MU_EARTH, list(ZONALS_EARTH), RADIUS_EARTH),),
    "drag in air that turns": (Drag(100.0, AIR, RADIUS_EARTH, ROTATION_RATE_EARTH),),
    "the moon": (ThirdBody(MU_MOON, CircularPath(3.844e8, 2.66e-6, inclination=0.4)),),
    "sunlight with penumbra": (SolarPressure(0.01, SUN, RADIUS_EARTH, RADIUS_SUN),),
}


def starts() -> BodyState:
    """The orbits of `low_orbits`, in metres."""
    y, rate = low_orbits.orbits(), (MU_EARTH / RADIUS_EARTH) ** 0.5
    return on_one_device(
        BodyState(RADIUS_EARTH * y.position[:, :RUNS], rate * y.velocity[:, :RUNS])
    )


def measure() -> dict:
    """Runs a second under each effect, and under all."""
    y0, ts = starts(), jnp.array([0.0, DAY])
    how = Accuracy(1e-9, method=DOP853())
    every = {**EFFECTS, "all but J2 alone": sum((e for n, e in EFFECTS.items() if n != "J2"), ())}

    def run(effects: Any) -> Any:
        return simulate_batch(Scene((PointGravity(MU_EARTH), *effects)), y0, ts, accuracy=how)

    calls = {name: lambda effects=effects: run(effects).final for name, effects in every.items()}
    rows = in_turn(calls, RUNS)
    alone = next(iter(rows.values()))["runs_per_cpu_second"]
    for name, effects in every.items():
        rows[name]["times_the_attraction_alone"] = alone / rows[name]["runs_per_cpu_second"]
        rows[name]["evaluations"] = int(jnp.max(run(effects).stats["evaluations"]))
    return rows
