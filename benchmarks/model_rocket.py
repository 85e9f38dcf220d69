"""A model rocket flown from its motor file with six degrees of freedom, Calisto from its rail to
its apogee: many inclinations of the rail in one batch, against RocketPy, which flies the same
vehicle one flight after the other. The error is that of the apogee against a run at 1e-10.

Wanted: 300 times the rate of RocketPy, 1000 as a goal.
"""

import json
import subprocess
import sys
from pathlib import Path

import diffrax
import numpy as np

from jaxspace import Accuracy, simulate_batch
from jaxspace.vehicles import sounding_flight

from ._measure import in_turn, optional

ROCKETS = Path(__file__).resolve().parents[1] / "examples" / "model_rockets"
PEER = Path(__file__).with_name("_rocketpy.py")
RUNS = 2048
COMPARED = 16
FLIGHTS = 10
RTOL = 1e-6
METHOD = diffrax.Tsit5()


def flights(runs: int):
    """The mission and the states of so many flights of Calisto, at inclinations of 80 to 88 deg."""
    sys.path.insert(0, str(ROCKETS))
    from rockets import ROCKETS as GIVEN
    from rockets import site, vehicle

    given = GIVEN["Calisto"]
    tilted = {**given, "site": {**given["site"], "inclination": np.linspace(80.0, 88.0, runs)}}
    # No flight takes longer: what lies behind an event is searched in vain.
    return sounding_flight(vehicle(given), site(tilted), rail_within=0.6, ascent_within=27.0)


def apogees(runs: int, rtol: float):
    """The heights of the apogee above the ground, m, and whether all runs ended there."""
    mission, y0 = flights(runs)
    run = simulate_batch(mission, y0, 0.0, accuracy=Accuracy(rtol=rtol, method=METHOD))
    return run.final.position[2], run.status


def measure():
    """A dictionary of what was seen."""
    rows = in_turn({"jaxspace": lambda: apogees(RUNS, RTOL)}, RUNS)
    found = np.asarray(apogees(COMPARED, RTOL)[0])
    exact = np.asarray(apogees(COMPARED, 1e-10)[0])
    rows["jaxspace"]["worst_relative_error_of_the_apogee"] = float(
        np.max(np.abs(found / exact - 1.0))
    )
    if optional("rocketpy"):
        done = subprocess.run(
            [sys.executable, str(PEER), str(FLIGHTS)], capture_output=True, text=True, check=True
        )
        rate = 1.0 / json.loads(done.stdout.splitlines()[-1])["seconds"]
        rows["RocketPy"] = {"runs_per_second": rate}
        rows["jaxspace"]["times_the_rate_of_RocketPy"] = rows["jaxspace"]["runs_per_second"] / rate
    return rows
