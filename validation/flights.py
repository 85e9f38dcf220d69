"""Students' rockets whose apogee was measured, flown with the air of the day."""

import runpy
import sys
from pathlib import Path

import numpy as np

from jaxspace import Accuracy, simulate_mission_batch
from jaxspace.solvers import Tsit5
from jaxspace.vehicles import sounding_flight

from ._row import Row, compared

ABOUT = """## Model rockets beside their flights

Eleven rockets of students whose apogee was measured, from the examples of RocketPy, to which their
teams gave them: `examples/model_rockets/measured.py` has their numbers and whose they are. Each is
flown from its rail to its apogee with six degrees of freedom, all of them by one program. There are
three rows for each: beside RocketPy with the same numbers, beside the simulation that RocketPy
publishes, and beside the altimeter.

What a simulator misses here lies in the numbers and not in the equations: with the same numbers
both agree to a thousandth, and both miss the altimeter by the same 0.4 to 9 percent. Without drag
the apogee goes with the square of the speed at burnout, so that two percent of the impulse are up
to four percent of the height. Thrust is that of the maker's test or of one burn on a stand; drag is
a curve of another program from before the flight, for eight of them the same with the motor on and
off; masses are what the teams say. Astra, Erebus and Lince fly 7 to 9 percent higher than such
numbers give, Andromeda, Genesis and Prometheus 4 to 5 percent lower.

The published simulations differ where their air does: RocketPy has a wind for Juno III, and one of
the same day a year later for Prometheus, of which none is at hand here. These two and Valetudo fly
through calm standard air, all others through the air of the day. The page of Valetudo has thrust
and drag that are not thinned.
"""
ROCKETS = Path(__file__).parents[1] / "examples" / "model_rockets"
# Of `measured.APOGEES`: source, the share that is allowed, and why.
SOURCES = (
    (
        "RocketPy 1.13, the same numbers",
        0.002,
        "our judgement, 0.2 percent: models that differ, as above",
    ),
    (
        "RocketPy's page",
        0.04,
        "our judgement, 4 percent: other winds, and older versions of RocketPy",
    ),
    (
        "altimeter",
        0.1,
        "our judgement, 10 percent: to which mass, thrust, drag and wind were known",
    ),
)
# Of the tables by the Mach number and by time, so that all rockets are one batch.
POINTS = 37


def apogees() -> tuple[np.ndarray, dict[str, tuple[float, ...]]]:
    """The apogees above the ground, m, by one program, same structure and other numbers; and those
    of `examples/model_rockets/measured.py`, by the names of the flights."""
    if str(ROCKETS) not in sys.path:
        sys.path.insert(0, str(ROCKETS))
    tools, data = (runpy.run_path(str(ROCKETS / f"{name}.py")) for name in ("rockets", "measured"))
    flights = data["FLIGHTS"].values()
    vehicles = tools["stacked"]([tools["vehicle"](flight, POINTS) for flight in flights])
    sites = tools["stacked"]([tools["site"](flight) for flight in flights])
    mission, y0 = sounding_flight(vehicles, sites, ascent_within=60.0)
    accuracy = Accuracy(rtol=1e-6, method=Tsit5())
    run = simulate_mission_batch(mission, y0, 0.0, accuracy=accuracy, throw=True)
    return np.asarray(run.final.position[2]), data["APOGEES"]


def rows() -> list[Row]:
    """A row for each flight and each of the `SOURCES`."""
    found, known = apogees()
    return [
        compared(
            ours,
            theirs,
            share * theirs,
            what=name,
            source=source,
            quantity="apogee above the ground, m",
            why=why,
        )
        for ours, (name, others) in zip(found, known.items(), strict=True)
        for theirs, (source, share, why) in zip(others, SOURCES, strict=True)
    ]
