"""Calisto from rail to landing with dispersed rail angles: the campaign of RocketPy, its class
`MonteCarlo` with its stochastic classes, one flight at a time, and that of jaxspace. The samples
are independent: means and standard deviations agree within the sampling errors, which are listed,
and the differences between the two flight models. Each rocket of RocketPy's campaign is corrected
by `_rocketpy.corrected`: in version 1.13 as released, propellant and nozzle are ahead of the centre
of dry mass, and the rocket turns further into the wind and lands 89 m further west.

Ours is timed as a whole, compilation included: the rows say how much of it that was, and how much
the processors worked.
"""

import contextlib
import io
import os
import sys
import tempfile
import time
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from jaxspace import Accuracy
from jaxspace.dispersion import Campaign, Normal, disperse
from jaxspace.solvers import Tsit5
from jaxspace.vehicles import sounding_flight
from jaxspace.vehicles.landings import landing

from ._measure import optional

HERE = Path(__file__).resolve().parent
RUNS, FLIGHTS = 16_384, 40
OUTPUTS = ("apogee", "east", "north")
RATE = "runs per processor second"
# Deviations of the rail, deg.
SCATTER = {"inclination": 1.0, "heading": 10.0}
ACCURACY = Accuracy(rtol=1e-5, method=Tsit5())


def calisto() -> dict:
    """Its numbers."""
    sys.path.insert(0, str(HERE.parent / "examples" / "model_rockets"))
    from rockets import ROCKETS

    return ROCKETS["Calisto"]


def build(samples):
    """The flights at these angles."""
    given = calisto()
    from rockets import recovery, site, vehicle

    launch = site(given)
    angles = {name: jnp.radians(samples[name]) for name in SCATTER}
    own = {
        name: getattr(launch, name)
        for name in ("latitude", "elevation", "rail_length", "wind")
    }  # fmt: skip
    rocket = vehicle(given)
    # No flight takes longer: what lies behind an event is searched in vain.
    limits = {"rail_within": 0.7, "ascent_within": 29.0, "descent_within": 200.0}
    return sounding_flight(rocket, type(launch)(**own, **angles), recovery(given), **limits)


def row(seconds: float, used: float, **heights: np.ndarray) -> dict:
    """Rates by the clock and by the time that the processors `used`, and statistics with their
    sampling errors."""
    n = next(iter(heights.values())).size
    found = {"runs": n, "runs per second": n / seconds, RATE: n / used}
    for name, x in heights.items():
        s = float(x.std(ddof=1))
        found[f"mean of the {name}, m"] = f"{x.mean():.2f} ± {s / n**0.5:.2f}"
        found[f"deviation of the {name}, m"] = f"{s:.2f} ± {s / (2.0 * n - 2.0) ** 0.5:.2f}"
    return found


def ours() -> dict:
    """A row of our campaign."""
    given = calisto()
    nominal = {name: given["site"][name] for name in SCATTER}
    inputs = {name: Normal(nominal[name], deviation) for name, deviation in SCATTER.items()}
    used, wall = time.process_time(), time.perf_counter()
    found = disperse(Campaign(build, inputs, landing), RUNS, seed=1, accuracy=ACCURACY)
    used, wall = time.process_time() - used, time.perf_counter() - wall
    ahead = found.attributes["preparation_seconds"]
    whole = {"seconds, all in all": wall, "of them to compile and to start": ahead}
    outputs = {name: found.outputs[name][found.good] for name in OUTPUTS}
    return {
        **row(found.seconds - ahead, found.attributes["cpu_seconds"], **outputs),
        **whole,
        "processor seconds, all in all": used,
    }


def theirs() -> dict:
    """A row of RocketPy's."""
    import rocketpy
    from rocketpy import stochastic

    sys.path.insert(0, str(HERE))
    from _rocketpy import corrected, environment, flight, rocket

    class CorrectedRocket(stochastic.StochasticRocket):
        """A campaign builds each rocket from its parts: one corrected before would be lost."""

        def create_object(self):
            return corrected(super().create_object())

    given = calisto()
    made, air = rocket(given), environment(given)
    nominal = flight(given, made, air)
    nose, fins, tail = (surface for surface, _ in made.aerodynamic_surfaces)
    loose = CorrectedRocket(made)
    loose.add_motor(
        stochastic.StochasticSolidMotor(made.motor), position=(given["exit_station"], 0.0)
    )
    loose.add_nose(stochastic.StochasticNoseCone(nose), position=(given["nose"]["tip"], 0.0))
    where = (given["fins"]["leading_edge"], 0.0)
    loose.add_trapezoidal_fins(stochastic.StochasticTrapezoidalFins(fins), position=where)
    loose.add_tail(stochastic.StochasticTail(tail), position=(given["tail"]["fore_end"], 0.0))
    for chute in made.parachutes:
        loose.add_parachute(stochastic.StochasticParachute(chute))
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        campaign = rocketpy.MonteCarlo(
            filename=os.path.join(folder, "calisto"),
            environment=stochastic.StochasticEnvironment(air),
            rocket=loose,
            flight=stochastic.StochasticFlight(nominal, **SCATTER),
            export_list=["apogee", "x_impact", "y_impact"],
        )
        used, start = time.process_time(), time.perf_counter()
        campaign.simulate(FLIGHTS, append=False)
        used, seconds = time.process_time() - used, time.perf_counter() - start
    apogees = np.array(campaign.results["apogee"]) - given["site"]["elevation"]
    east, north = (np.array(campaign.results[f"{k}_impact"]) for k in "xy")
    return row(seconds, used, apogee=apogees, east=east, north=north)


def measure() -> dict:
    """A dictionary of what was seen."""
    rows = {"jaxspace": ours()}
    if optional("rocketpy"):
        rows["RocketPy"] = theirs()
        # Others may use the machine: the clock would say how much of it each was given.
        ratio = rows["jaxspace"][RATE] / rows["RocketPy"][RATE]
        rows["jaxspace"]["times the rate of RocketPy"] = ratio
    return rows
