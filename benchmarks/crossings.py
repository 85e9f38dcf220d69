"""Every entry into and exit from the shadow for a thousand satellites over a hundred orbits, in one
call: for Kepler orbits in closed form, and under J2 by integration. The error is that of the last
time found, in seconds, compared with four times as many samples and a tighter tolerance."""

import jax.numpy as jnp
import numpy as np

from jaxspace import BodyState, Event, Scene
from jaxspace.orbits import Oblateness, PointGravity, TwoBody
from jaxspace.orbits.shadow import shadow_event
from jaxspace.simulation import Accuracy, simulate_batch

from . import low_orbits
from ._measure import in_turn, on_one_device

RUNS, ORBITS, CAPACITY, COMPARED = 1000, 100.0, 224, 64
SYSTEMS = {
    "Kepler": TwoBody(1.0),
    "J2": Scene((PointGravity(1.0), Oblateness(1.0, low_orbits.J2, 1.0))),
}
SECONDS = 806.811  # of the unit of time


def measure() -> dict:
    """Satellites a second, crossings found, and errors."""
    y = low_orbits.orbits()
    y0 = on_one_device(BodyState(y.position[:, :RUNS], y.velocity[:, :RUNS]))
    ts = jnp.array([0.0, 2.0 * np.pi * 1.1**1.5 * ORBITS])
    sun = jnp.array([0.9, 0.3, 0.3])

    def crossings_of(system, y0, samples=1000, rtol=1e-9):
        edge = Event(shadow_event(sun, 1.0), terminal=False, capacity=CAPACITY, samples=samples)
        how = Accuracy(rtol)
        return simulate_batch(system, y0, ts, events=(edge,), accuracy=how).crossings[0]

    calls = {name: lambda s=s: crossings_of(s, y0).ts for name, s in SYSTEMS.items()}
    rows = in_turn(calls, RUNS, repeats=3)
    some = BodyState(y0.position[:, :COMPARED], y0.velocity[:, :COMPARED])
    for name, system in SYSTEMS.items():
        all_of_them, few = crossings_of(system, y0), crossings_of(system, some)
        finer = crossings_of(system, some, 4000, 1e-12)
        rows[name]["crossings"] = int(jnp.sum(all_of_them.count))
        rows[name]["overflows"] = int(jnp.sum(all_of_them.overflow))
        rows[name]["missed"] = int(jnp.sum(jnp.abs(few.count - finer.count)))
        gap = jnp.nanmax(jnp.abs(few.ts - finer.ts))
        rows[name]["worst_error_in_seconds"] = float(gap) * SECONDS
    return rows
