"""256 orbits of eccentricity 0.7 about an oblate body, with a periapsis of about 1.06 radii and
random orientations, for a hundred revolutions: by RKN 12(10) in physical time, by adaptive steps in
regularised variables, and by heyoka with vectorised integration. `choice` has ten revolutions,
where the call, the first step and stopping at the final time take two fifths of the time of
regularised steps; a hundred revolutions show the cost of the steps themselves."""

import jax.numpy as jnp
import numpy as np

from jaxspace import Scene
from jaxspace.orbits import Oblateness, PointGravity
from jaxspace.simulation import Accuracy, simulate_batch
from jaxspace.solvers import RKN1210, AdaptiveRegularised, Regularised

from ._measure import heyoka_ends, in_turn, oblate_orbit, on_one_device, optional, worst
from .choice import RUNS, orbits

E, J2, TURNS = 0.7, 1e-3, 100
SPAN = 2.0 * np.pi * TURNS * (1.06 / (1.0 - E)) ** 1.5


def measure() -> dict:
    """Runs a second, and errors."""
    y0, scene = on_one_device(orbits(E)), Scene((PointGravity(1.0), Oblateness(1.0, J2, 1.0)))
    ts = jnp.array([0.0, SPAN])

    def ends(method, rtol):
        how = Accuracy(rtol, method=method, max_steps=2**16)
        return simulate_batch(scene, y0, ts, accuracy=how).final.position

    calls = {
        f"ours, {name} {rtol:.0e}": lambda method=method, rtol=rtol: ends(method, rtol)
        for name, method in (
            ("RKN 12(10)", RKN1210()),
            ("adaptive regularised", AdaptiveRegularised()),
        )
        for rtol in (1e-10, 1e-11, 1e-12)
    }
    if optional("heyoka") is not None:
        start = np.concatenate([np.asarray(y0.position), np.asarray(y0.velocity)])
        peers = {
            tol: heyoka_ends(lambda h: oblate_orbit(h, J2), start, SPAN, tol)
            for tol in (1e-12, 1e-13, 1e-14)
        }
        calls |= {
            f"heyoka, vectors of 8, {tol:.0e}": lambda end=end: end()[:3]
            for tol, end in peers.items()
        }
    reference = ends(Regularised(steps=200 * TURNS, estimate=False), 1e-1)
    rows = in_turn(calls, RUNS)
    for name, call in calls.items():
        rows[name]["worst_relative_error"] = worst(call(), reference)
    return rows
