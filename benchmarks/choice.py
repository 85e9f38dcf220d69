"""Evidence for the rules of `method="auto"`. The first case is 256 eccentric orbits over ten
revolutions, with a low periapsis above an oblate body, by RKN 12(10) in physical time, by adaptive
and by fixed steps in regularised variables with their error estimate, and by heyoka with vectorised
integration. The second case is a gyrocompass for a hundred seconds, 1e5 radians of the nutation of
its rotor, by DOP853 and by the default method."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxspace import BodyState, Scene, simulate
from jaxspace.core import AbstractSystem
from jaxspace.orbits import ClassicalElements, Oblateness, PointGravity
from jaxspace.orbits.elements import state_from_elements
from jaxspace.simulation import Accuracy, simulate_batch
from jaxspace.solvers import DOP853, RKN1210, AdaptiveRegularised, Regularised

from ._measure import heyoka_ends, in_turn, oblate_orbit, on_one_device, optional, worst

RUNS, TURNS = 256, 10
CASES = ((0.7, 1e-3, (48, 64)), (0.95, 0.0, (32,)), (0.95, 1e-3, (64, 128)))


def orbits(e: float) -> BodyState:
    """Orbits of one eccentricity with a periapsis of about 1.06 radii and any orientation; radius
    and gravitational parameter 1."""
    g = np.random.default_rng(0)
    p, node = (1.0 + e) * g.uniform(1.05, 1.07, RUNS), g.uniform(0.0, 2.0 * np.pi, (3, RUNS))
    elements = ClassicalElements(
        jnp.asarray(p), jnp.full(RUNS, e), jnp.arccos(g.uniform(-1.0, 1.0, RUNS)), *node
    )
    return BodyState(*state_from_elements(elements, 1.0))


def _eccentric(e: float, j2: float, counts: tuple[int, ...]) -> dict:
    """Speed and error of the methods on one family of orbits."""
    y0, scene = on_one_device(orbits(e)), Scene((PointGravity(1.0), Oblateness(1.0, j2, 1.0)))
    ts = jnp.array([0.0, 2.0 * np.pi * TURNS * (1.06 / (1.0 - e)) ** 1.5])

    def ends(method: Any, rtol: float) -> Array:
        # At this tolerance no run is repeated with more fixed steps: the error stands beside the
        # speed.
        accuracy = Accuracy(rtol, method=method)
        return simulate_batch(scene, y0, ts, accuracy=accuracy).final.position

    about = f"e = {e}, " + ("oblate" if j2 else "a point")
    calls = {
        f"{about}: RKN 12(10) {rtol:.0e}": lambda rtol=rtol: ends(RKN1210(), rtol)
        for rtol in (1e-9, 1e-10, 1e-12)
    }
    calls |= {
        f"{about}: adaptive regularised {rtol:.0e}": lambda rtol=rtol: ends(
            AdaptiveRegularised(), rtol
        )
        for rtol in (1e-9, 1e-10, 1e-12)
    }
    if optional("heyoka") is not None:
        start = np.concatenate([np.asarray(y0.position), np.asarray(y0.velocity)])
        peers = {
            tol: heyoka_ends(lambda h: oblate_orbit(h, j2), start, float(ts[-1]), tol)
            for tol in (1e-11, 1e-12, 1e-13)
        }
        calls |= {
            f"{about}: heyoka {tol:.0e}": lambda end=end: end()[:3] for tol, end in peers.items()
        }
    for n in counts:
        calls[f"{about}: regularised, {n} a revolution"] = lambda n=n: ends(
            Regularised(steps=n * TURNS), 1e-1
        )
    reference = ends(Regularised(steps=400 * TURNS, estimate=False), 1e-1)
    rows = in_turn(calls, RUNS)
    for name, call in calls.items():
        rows[name]["error_of_the_worst_run"] = worst(call(), reference)
    return rows


class Compass(eqx.Module):
    """Heading and tilt of the rotor's axis, rad, and its inertial rates about the horizontal and
    across, rad/s."""

    psi: Array
    tilt: Array
    u: Array
    v: Array


class Gyrocompass(AbstractSystem):
    """A pendulous rotor at the equator that nutates at n = 1e3 rad/s."""

    n: float = 1e3

    def vector_field(self, t, y):
        s, c, north = jnp.sin(y.tilt), jnp.cos(y.tilt), 7.2921e-5 * jnp.cos(y.psi)
        fast = self.n - (north + y.v * s) / c
        return Compass(
            (y.v + north * s) / c,
            y.u - 7.2921e-5 * jnp.sin(y.psi),
            fast * y.v - 0.02 * self.n * s,
            -fast * y.u,
        )

    def invariants(self, t, y):
        return {}


def _compass() -> dict:
    """Speed and error of a run of 1e5 radians."""
    y0, ts = (
        Compass(*(jnp.array(x) for x in (0.3, 0.0, 7.2921e-5 * np.sin(0.3), 0.0))),
        jnp.array([0.0, 100.0]),
    )

    def end(**how: Any) -> Array:
        y = simulate(Gyrocompass(), y0, ts, accuracy=Accuracy(max_steps=2**19, **how)).final
        return jnp.stack([y.psi, y.tilt])

    calls = {
        "gyrocompass: DOP853 1e-09": lambda: end(method=DOP853()),
        "gyrocompass: by default, 1e-09": end,
    }
    reference, rows = end(rtol=1e-12, method=DOP853()), in_turn(calls, 1)
    for name, call in calls.items():
        rows[name]["error_of_the_worst_run"] = worst(call(), reference)
    return rows


def measure() -> dict:
    """Speed and error of every method on every case."""
    rows = {}
    for case in CASES:
        rows |= _eccentric(*case)
    return rows | _compass()
