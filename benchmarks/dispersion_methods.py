"""Mean and standard deviation by methods that need no campaign, compared with 20 000 runs, whose
rows state the sampling errors; and rare events with a known probability, 1e-6.

The scene is `intercept.toml` with errors of 5 m/s in each component of the first impulse. Rare
events are of a point that moves straight on, x = x0 + v0 t with x0 and v0 normal: x itself, whose
nearest violation is one point, and the distance of (x0, v0) from zero, where each direction leads
to a violation alike; of the second one the row tells of 40 repetitions.
"""

import math
from pathlib import Path
from typing import final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from scipy.stats import norm

from jaxspace import Mission, Phase
from jaxspace.core import AbstractClosedForm, AbstractSystem, Scalar
from jaxspace.dispersion import Campaign, Normal, disperse
from jaxspace.dispersion.comparison import compare_methods
from jaxspace.dispersion.rare import rare_event
from jaxspace.io import load

FILE = Path(__file__).parents[1] / "examples" / "scenes" / "intercept.toml"
MORE = '"radial_error", "along_track_error", "cross_track_error", "velocity_error",'
RUNS, RARE_RUNS, REPETITIONS = 20_000, 10_000, 40
PROBABILITY = 1e-6
DURATION = 3.0


class Point(eqx.Module):
    """A place on a line, and its rate."""

    x: Scalar
    v: Scalar


@final
class StraightLine(AbstractClosedForm):
    """x grows by v t."""

    def flow(self, duration, y):
        return Point(y.x + duration * y.v, y.v)


@final
class Drift(AbstractSystem):
    """x' = v, in closed form, so that only the method is on trial."""

    def vector_field(self, t, y):
        return Point(y.v, jnp.zeros_like(y.v))

    def invariants(self, t, y):
        return {"v": y.v}

    def closed_form(self):
        return StraightLine()


def drift(samples):
    """A point that moves straight on."""
    return Mission([Phase(Drift(), DURATION)]), Point(samples["x0"], samples["v0"])


def ends(result, samples):
    """Its place at the end, and how far from zero its inputs lie."""
    return {"x": result.final.x, "radius": jnp.hypot(samples["x0"], samples["v0"])}


def beside_monte_carlo() -> dict:
    """A row for every output and method."""
    text = FILE.read_text(encoding="utf-8").replace('"0.1 m/s"', '"5 m/s"')
    text = text.replace('"apoapsis_altitude",', f'"apoapsis_altitude", {MORE}')
    file = load(FILE, text=text)
    campaign = file.campaign()
    reference = disperse(campaign, RUNS, seed=1, accuracy=file.accuracy)
    rows = {}
    for c in compare_methods(campaign, reference, accuracy=file.accuracy):
        own = c.method == "monte_carlo"
        percent = 100.0 * c.std_error
        known = math.isfinite(c.mean + c.std)
        rows[f"{c.output}, {c.method.replace('_', ' ')}"] = {
            "mean off by, deviations": f"{'±' if own else ''}{c.mean_error:.3f}" if known else "-",
            "deviation off by, %": f"{'±' if own else ''}{percent:.3g}" if known else "-",
            "runs": c.runs,
            "seconds": c.seconds,
            "warning": c.warning or None,
        }
    return rows


def rare() -> dict:
    """Importance sampling about the nearest violation, and subset simulation forty times."""
    inputs = {"x0": Normal(0.0, 1.0), "v0": Normal(0.0, 1.0)}
    campaign = Campaign(drift, inputs, ends)
    limit = norm.isf(PROBABILITY) * math.hypot(1.0, DURATION)
    found = rare_event(campaign, "x", above=limit, runs=RARE_RUNS, seed=1)
    rows = {"importance sampling": {
        "probability": found.value, "from": found.low, "to": found.high, "runs": found.runs,
    }}  # fmt: skip
    radius = math.sqrt(-2.0 * math.log(PROBABILITY))
    again = [
        rare_event(campaign, "radius", above=radius, runs=RARE_RUNS, method="subset", seed=s)
        for s in range(REPETITIONS)
    ]
    values = np.array([f.value for f in again])
    rows["subset simulation, the mean"] = {
        "probability": float(values.mean()),
        "from": float(values.min()),
        "to": float(values.max()),
        "runs": int(np.mean([f.runs for f in again])),
        "scatter of the logarithms": float(np.log(values).std(ddof=1)),
        "intervals that hold 1e-6": float(np.mean([f.low < PROBABILITY < f.high for f in again])),
    }
    return rows


def measure() -> dict:
    """A dictionary of what was seen."""
    return beside_monte_carlo() | rare()
