"""Students' rockets whose apogee was measured, flown with the air of the day."""

import runpy
import sys
from pathlib import Path

import numpy as np

from jaxspace import Accuracy, simulate_mission_batch
from jaxspace.solvers import Tsit5
from jaxspace.vehicles import sounding_flight

from ._row import Row, compared

ABOUT = """## Model rockets compared with measured flights

The comparison includes eleven student rockets with a measured apogee, which their teams contributed
to the examples of RocketPy: `examples/model_rockets/measured.py` contains their data and sources.
Each is simulated from rail to apogee with six degrees of freedom, all with the same code. There are
three rows for each rocket: a comparison with RocketPy using the same data, with the simulation
published by RocketPy, and with the altimeter.

The differences from the measurements are caused by the input data, not by the equations: with the
same data both simulators agree to a thousandth, and both differ from the altimeter by the same 0.4
to 9 percent. Without drag the apogee is proportional to the square of the burnout speed, so two
percent of the impulse correspond to up to four percent of the altitude. The thrust is from the
manufacturer's test or from a single static firing; the drag is a curve computed by another program
before the flight, for eight of the rockets the same with the motor on and off; the masses were
stated by the teams. Astra, Erebus and Lince flew 7 to 9 percent higher than predicted from these
data, Andromeda, Genesis and Prometheus 4 to 5 percent lower.

The published simulations differ where they use another atmosphere: RocketPy uses a wind for Juno
III, and for Prometheus the wind of the same day one year later. These winds are not available here,
so both rockets, like Valetudo, are simulated in the calm standard atmosphere; all others are
simulated in the atmosphere of the day. The
RocketPy example of Valetudo uses thrust and drag data that are not thinned.
"""
ROCKETS = Path(__file__).parents[1] / "examples" / "model_rockets"
# Of `measured.APOGEES`: source, the share that is allowed, and why.
SOURCES = (
    (
        "RocketPy 1.13, same data",
        0.002,
        "our judgement, 0.2 percent: differences of the models, as above",
    ),
    (
        "simulation published by RocketPy",
        0.04,
        "our judgement, 4 percent: other winds, and older versions of RocketPy",
    ),
    (
        "altimeter",
        0.1,
        "our judgement, 10 percent: the uncertainty of mass, thrust, drag and wind",
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
