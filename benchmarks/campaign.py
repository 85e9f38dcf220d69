"""Campaigns with a store: the two-stage ascent of `ascent.py` with a million runs, and the campaign
of the kick stage; the cost of the store, and the peak memory.

The rows of workers are processes with one core each; they count from the moment when every worker
has delivered its second chunk, for each of them compiles or loads the program first. The rate of
pykep on one core tells the machine.

Wanted: a million ascents in under a minute on two cores, the store included, below 2 GB; the store
under 5 % of the time of the runs; two workers 1.8 times as fast as one."""

import json
import resource
import shutil
import tempfile
import time
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from jaxspace import BodyState, load
from jaxspace.core.vectors import norm
from jaxspace.dispersion import Campaign, Dispersion, Normal, ProcessPool, disperse

from ._measure import pykep
from .ascent import LIFT_OFF_MASS, RADIUS, SPIN, mission
from .kepler import states
from .kick_stage import FILE

ASCENTS, KICKS = 1_000_000, 32_768
ACCURACY = 1e-6
WORKED, PART = 49_152, 2048  # runs of the rows of workers, and in a chunk of theirs
PROPAGATIONS = 2**16
CHUNK = 2**16  # of the ascents, which are so quick that smaller ones would be gone in no time

INPUTS = {
    "thrust": Normal(1.0, 4e-3),
    "specific_impulse": Normal(1.0, 3e-3),
    "drag": Normal(1.0, 0.05),
    "kick": Normal(0.0122173, 0.000349),  # 0.7 deg, 0.02 deg
    "density": Normal(1.0, 0.05),
}


def build(samples):
    """The ascent for these factors, from the equator."""
    o = jnp.zeros_like(samples["thrust"])
    r = jnp.stack([RADIUS + o, o, o])
    v = jnp.stack([o, SPIN * RADIUS + o, o])
    factors = [samples[name] for name in INPUTS]
    return mission(factors), BodyState(r, v, mass=LIFT_OFF_MASS + o)


def outputs(result, samples):
    """Height and speed at the end."""
    del samples
    final = result.final
    return {"altitude": norm(final.position) - RADIUS, "speed": norm(final.velocity)}


def row(result: Dispersion) -> dict:
    """What is told of a campaign."""
    there = result.attributes
    flying = result.seconds - there["preparation_seconds"]
    return {
        "runs": result.runs,
        "runs per second": result.runs / flying,
        "seconds to compile and start": there["preparation_seconds"],
        "seconds, store included": flying,
        "share of the store": there["storing_seconds"] / flying,
        "utilisation of the cores": result.utilisation,
        "greatest memory so far, MB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
        "runs that ended well": int(result.good.sum()),
    }


def by_workers(file, workers: int, store: Path) -> dict:
    """The kick stage by so many processes."""
    seen = []

    def watch(done: int, total: int) -> None:
        seen.append((done, time.perf_counter()))

    kicks = disperse(
        file.campaign(),
        WORKED,
        seed=1,
        chunk=PART,
        accuracy=file.accuracy,
        engine=ProcessPool(workers),
        progress=watch,
        store=store,
    )
    (before, start), (done, end) = seen[2 * workers - 1], seen[-1]
    entries = (json.loads(x.read_bytes()) for x in (store / ".manifest").glob("*.json"))
    # The median: in the first chunk of a process it compiles.
    each = np.median([entry["cpu_seconds"] for entry in entries]) / PART
    rate = (done - before) / (end - start)
    return {
        "runs": kicks.runs,
        "runs per second": rate,
        "utilisation of the cores": each * rate / workers,
        "runs that ended well": int(kicks.good.sum()),
    }


def measure() -> dict:
    """A dictionary of what was seen."""
    folder = Path(tempfile.mkdtemp())
    file = load(FILE)
    try:
        kicks = disperse(
            file.campaign(), KICKS, seed=1, accuracy=file.accuracy, store=folder / "kicks"
        )
        rows = {"kick stage": row(kicks)}
        ascents = disperse(
            Campaign(build, INPUTS, outputs, {"altitude": "m", "speed": "m/s"}),
            ASCENTS,
            accuracy=ACCURACY,
            chunk=CHUNK,
            store=folder / "ascents",
        )
        rows["two-stage ascent"] = row(ascents)
        one, two = (by_workers(file, n, folder / f"{n} workers") for n in (1, 2))
        two["times the rate of one worker"] = two["runs per second"] / one["runs per second"]
        rows |= {"kick stage, one worker": one, "kick stage, two workers": two}
        r, v, t = (x[..., :PROPAGATIONS] for x in states())
        if peer := pykep("propagate_lagrangian", r, v, t):
            rows["pykep, propagations"] = {"runs per second": peer[0]["runs_per_second"]}
        return rows
    finally:
        shutil.rmtree(folder)
