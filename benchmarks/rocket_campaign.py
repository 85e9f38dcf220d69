"""Calisto to its apogee with a scatter of the angles of its rail: by the campaign of RocketPy, its
class `MonteCarlo` with its stochastic classes, one flight after the other, and by ours. Both draw
for themselves: mean and deviation of the apogee agree within their sampling errors, which the rows
give, and to what the two models of the flight differ by.
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

from ._measure import optional

HERE = Path(__file__).resolve().parent
RUNS, FLIGHTS = 16_384, 40
# Deviations of the rail, deg.
SCATTER = {"inclination": 1.0, "heading": 10.0}
ACCURACY = Accuracy(rtol=1e-6, method=Tsit5())


def calisto() -> dict:
    """Its numbers."""
    sys.path.insert(0, str(HERE.parent / "examples" / "model_rockets"))
    from rockets import ROCKETS

    return ROCKETS["Calisto"]


def build(samples):
    """The flights at these angles."""
    given = calisto()
    from rockets import site, vehicle

    launch = site(given)
    angles = {name: jnp.radians(samples[name]) for name in SCATTER}
    own = {
        name: getattr(launch, name)
        for name in ("latitude", "elevation", "rail_length", "wind")
    }  # fmt: skip
    rocket = vehicle(given)
    # No flight takes longer: what lies behind an event is searched in vain.
    return sounding_flight(rocket, type(launch)(**own, **angles), rail_within=0.7, ascent_within=29)


def apogee(result, samples):
    """Its height above the ground."""
    del samples
    return {"apogee": result.final.position[2]}


def row(apogees: np.ndarray, seconds: float) -> dict:
    """Rate and statistics, with their sampling errors."""
    n, s = apogees.size, float(apogees.std(ddof=1))
    return {
        "runs": n,
        "runs per second": n / seconds,
        "mean of the apogee, m": f"{apogees.mean():.2f} ± {s / n**0.5:.2f}",
        "its deviation, m": f"{s:.2f} ± {s / (2.0 * n - 2.0) ** 0.5:.2f}",
    }


def ours() -> dict:
    """A row of our campaign."""
    given = calisto()
    nominal = {name: given["site"][name] for name in SCATTER}
    inputs = {name: Normal(nominal[name], deviation) for name, deviation in SCATTER.items()}
    found = disperse(Campaign(build, inputs, apogee), RUNS, seed=1, accuracy=ACCURACY)
    flying = found.seconds - found.attributes["preparation_seconds"]
    return row(found.outputs["apogee"][found.good], flying)


def theirs() -> dict:
    """A row of RocketPy's."""
    import rocketpy
    from rocketpy import stochastic

    sys.path.insert(0, str(HERE))
    from _rocketpy import environment, flight, rocket

    given = calisto()
    made, air = rocket(given), environment(given["site"])
    nominal = flight(given, made, air, to_apogee=True)
    nose, fins, tail = (surface for surface, _ in made.aerodynamic_surfaces)
    loose = stochastic.StochasticRocket(made)
    loose.add_motor(
        stochastic.StochasticSolidMotor(made.motor), position=(given["exit_station"], 0.0)
    )
    loose.add_nose(stochastic.StochasticNoseCone(nose), position=(given["nose"]["tip"], 0.0))
    where = (given["fins"]["leading_edge"], 0.0)
    loose.add_trapezoidal_fins(stochastic.StochasticTrapezoidalFins(fins), position=where)
    loose.add_tail(stochastic.StochasticTail(tail), position=(given["tail"]["fore_end"], 0.0))
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        campaign = rocketpy.MonteCarlo(
            filename=os.path.join(folder, "calisto"),
            environment=stochastic.StochasticEnvironment(air),
            rocket=loose,
            flight=stochastic.StochasticFlight(nominal, **SCATTER),
            export_list=["apogee"],
        )
        start = time.perf_counter()
        campaign.simulate(FLIGHTS, append=False)
        seconds = time.perf_counter() - start
    heights = np.array(campaign.results["apogee"]) - given["site"]["elevation"]
    return row(heights, seconds)


def measure() -> dict:
    """A dictionary of what was seen."""
    rows = {"jaxspace": ours()}
    if optional("rocketpy"):
        rows["RocketPy"] = theirs()
        ratio = rows["jaxspace"]["runs per second"] / rows["RocketPy"]["runs per second"]
        rows["jaxspace"]["times the rate of RocketPy"] = ratio
    return rows
