"""The flight of a model rocket with a motor file and six degrees of freedom, Calisto from rail to
apogee: a batch of many rail inclinations, compared with RocketPy, which simulates the same vehicle
one flight at a time, each with its default tolerances. The errors are those of the apogee: for
jaxspace compared with runs at 1e-10, for RocketPy compared with itself at 1e-10 and steps of 0.01
s. `times the rate of RocketPy` compares the whole machine with one core of RocketPy, `of one core`
core with core.

Wanted: 300 times the rate of RocketPy, 1000 as a goal.
"""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np

from jaxspace import Accuracy, simulate_mission_batch
from jaxspace.simulation import Status
from jaxspace.solvers import Tsit5
from jaxspace.vehicles import sounding_flight

from ._measure import in_turn, optional

ROCKETS = Path(__file__).resolve().parents[1] / "examples" / "model_rockets"
PEER = Path(__file__).with_name("_rocketpy.py")
RUNS = 2048
FLIGHTS = 10
# RocketPy takes rtol 1e-6 and, for velocities and rates, atol 1e-3 by default. Without an absolute
# tolerance a rocket that hardly turns is followed to nine digits of its rate.
SETTINGS = {"jaxspace, 1e-06": (1e-6, 1e-4), "jaxspace, 1e-05": (1e-5, 2e-4)}
EXACT = (1e-10, 1e-10)


def flights(runs: int):
    """The mission and the states of so many flights of Calisto, at inclinations of 80 to 88 deg."""
    sys.path.insert(0, str(ROCKETS))
    from rockets import ROCKETS as GIVEN
    from rockets import site, vehicle

    given = GIVEN["Calisto"]
    tilted = {**given, "site": {**given["site"], "inclination": np.linspace(80.0, 88.0, runs)}}
    # No flight takes longer: what lies behind an event is searched in vain.
    return sounding_flight(vehicle(given), site(tilted), rail_within=0.6, ascent_within=27.0)


def apogees(given, rtol: float, atol: float):
    """The run of flights to their apogees."""
    accuracy = Accuracy(rtol=rtol, atol=atol, method=Tsit5())
    return simulate_mission_batch(*given, 0.0, accuracy=accuracy)


def heights(run) -> tuple[np.ndarray, int]:
    """The apogees above the ground, m, NaN where a flight failed, and how many did."""
    return np.asarray(run.final.position[2]), int(np.count_nonzero(run.status != Status.EVENT))


def measure():
    """A dictionary of what was seen."""
    given = flights(RUNS)
    calls = {
        name: lambda tolerances=tolerances: apogees(given, *tolerances).final.position
        for name, tolerances in SETTINGS.items()
    }
    rows = in_turn(calls, RUNS)
    exact, failed = heights(apogees(given, *EXACT))
    assert failed == 0, "The runs that the others are compared with fail."
    for name, tolerances in SETTINGS.items():
        found, rows[name]["failed_runs"] = heights(apogees(given, *tolerances))
        rows[name]["worst_relative_error"] = float(np.nanmax(np.abs(found / exact - 1.0)))
    if optional("rocketpy"):
        done = subprocess.run(
            [sys.executable, str(PEER), str(FLIGHTS)], capture_output=True, text=True, check=True
        )
        peer = json.loads(done.stdout.splitlines()[-1])
        rate, share = 1.0 / peer["seconds"], 1.0 / peer["cpu_seconds"]
        for name in SETTINGS:
            row = rows[name]
            row["times_the_rate_of_RocketPy"] = row["runs_per_second"] / rate
            row["of_one_core"] = row["runs_per_cpu_second"] / share
        rows["RocketPy, its default"] = {
            "runs_per_second": rate,
            "runs_per_cpu_second": share,
            "cores": peer["cpu_seconds"] / peer["seconds"],
            "worst_relative_error": peer["worst_relative_error"],
        }
    return rows
