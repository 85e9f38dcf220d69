"""A million transfers from Earth to Mars on elliptic orbits: the magnitudes of both impulses for a
thousand departure and a thousand arrival times, with one call of `lambert` for each transfer, on
one device and with the departures distributed over all devices. The times are for the whole
table."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxspace.constants import MU_SUN, PLANETS
from jaxspace.orbits import ClassicalElements
from jaxspace.orbits.elements import state_from_elements
from jaxspace.orbits.interception import porkchop

from ._measure import WIDE, in_turn

SIDE, DAY = 1000, 86400.0
# Eccentricity, inclination, node, argument of periapsis and true anomaly at the start, rad.
ORBITS = {"earth": (0.0167, 0.0, 0.0, 1.797, 1.0), "mars": (0.0934, 0.0323, 0.865, 5.0, 4.2)}


def state(name: str):
    """Position and velocity of a planet at the start."""
    e, *angles = ORBITS[name]
    a = PLANETS[name].orbit_radius
    return state_from_elements(ClassicalElements(a * (1.0 - e * e), e, *angles), MU_SUN)


def measure() -> dict:
    """Seconds and transfers a second."""
    earth, mars = state("earth"), state("mars")
    departures = jnp.linspace(0.0, 800.0 * DAY, SIDE)
    arrivals = jnp.linspace(820.0 * DAY, 1500.0 * DAY, SIDE)

    def table(departures):
        found = porkchop(earth, mars, departures, arrivals, MU_SUN)
        return found.departure + found.arrival

    mesh = jax.make_mesh((len(jax.devices()),), ("runs",))
    spread = jax.sharding.PartitionSpec("runs")
    shares = jax.device_put(departures, jax.sharding.NamedSharding(mesh, spread))
    one = jax.jit(table, compiler_options=WIDE)
    shared = jax.jit(
        jax.shard_map(table, mesh=mesh, in_specs=(spread,), out_specs=spread, check_vma=False),
        compiler_options=WIDE,
    )
    calls = {
        "one device": lambda: one(departures),
        "every core": lambda: shared(shares),
    }
    rows = in_turn(calls, SIDE * SIDE)
    for name, call in calls.items():
        found = np.asarray(call())
        rows[name]["seconds_of_the_table"] = SIDE * SIDE / rows[name]["runs_per_second"]
        rows[name]["least_total_km_per_s"] = float(np.nanmin(found)) / 1e3
    return rows
