"""A thousand dispersed runs of thirty days on a Molniya orbit and on a geostationary transfer orbit
about an oblate Earth with drag at perigee: by the default method, which is DOP853 in physical time,
and by adaptive regularised steps. The error is the relative error of the final position for the
first runs, compared with DOP853 at the tightest tolerance."""

import dataclasses
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxspace import BodyState, Scene
from jaxspace.bodies import ExponentialAtmosphere
from jaxspace.orbits import ClassicalElements, Drag, Oblateness, PointGravity
from jaxspace.orbits.elements import state_from_elements
from jaxspace.simulation import Accuracy, simulate_batch
from jaxspace.solvers import DOP853, AdaptiveRegularised

from ._measure import in_turn, on_one_device, worst

RUNS, COMPARED, DAYS = 1000, 64, 30.0
MU, RADIUS, J2 = 3.986004418e14, 6.378137e6, 1.08262668e-3
# Perigee and apogee, m above the equator, and inclination, rad.
ORBITS = {"Molniya": (5.0e5, 3.986e7, 1.1065), "transfer": (2.5e5, 3.5786e7, 0.12)}


def case(name: str) -> tuple[Scene, BodyState]:
    """Scene and states of the runs, dispersed in perigee, apogee, angles and mass over area."""
    g = np.random.default_rng(0)
    low, high, tilt = ORBITS[name]
    perigee = RADIUS + low + g.normal(0.0, 2e3, RUNS)
    apogee = RADIUS + high + g.normal(0.0, 1e5, RUNS)
    e = (apogee - perigee) / (apogee + perigee)
    node, turn = g.normal([[0.3], [4.7]], 1e-3, (2, RUNS))
    elements = ClassicalElements(
        jnp.asarray(perigee * (1.0 + e)),
        jnp.asarray(e),
        jnp.asarray(tilt + g.normal(0.0, 1e-3, RUNS)),
        jnp.asarray(node),
        jnp.asarray(turn),
        jnp.asarray(g.uniform(0.0, 2.0 * np.pi, RUNS)),
    )
    drag = Drag(
        jnp.asarray(100.0 * np.exp(g.normal(0.0, 0.1, RUNS))),
        ExponentialAtmosphere(6.1e-11, 2.5e5, 4.5e4),
        RADIUS,
        7.2921159e-5,
    )
    scene = Scene((PointGravity(MU), Oblateness(MU, J2, RADIUS), drag))
    return scene, on_one_device(BodyState(*state_from_elements(elements, MU)))


def measure() -> dict:
    """Runs per second and errors."""
    rows: dict[str, dict] = {}
    for name in ORBITS:
        scene, y0 = case(name)
        ts = jnp.array([0.0, DAYS * 86400.0])

        def ends(method: Any, rtol: float, scene=scene, y0=y0, ts=ts) -> Any:
            accuracy = Accuracy(rtol, method=method, max_steps=2**15)
            return simulate_batch(scene, y0, ts, accuracy=accuracy).final.position

        calls = {
            f"{name}: adaptive regularised, {rtol:.0e}": lambda rtol=rtol, ends=ends: ends(
                AdaptiveRegularised(), rtol
            )
            for rtol in (1e-8, 1e-10)
        }
        calls |= {
            f"{name}: DOP853 in time, {rtol:.0e}": lambda rtol=rtol, ends=ends: ends(DOP853(), rtol)
            for rtol in (1e-9, 1e-11)
        }
        *effects, drag = scene.effects
        coefficient = drag.ballistic_coefficient[:COMPARED]
        some = Scene((*effects, dataclasses.replace(drag, ballistic_coefficient=coefficient)))
        start = BodyState(y0.position[:, :COMPARED], y0.velocity[:, :COMPARED])
        reference = ends(DOP853(), 1e-14, some, start)
        seen = in_turn(calls, RUNS, repeats=3)
        for label, call in calls.items():
            seen[label]["worst_relative_error"] = worst(call()[:, :COMPARED], reference)
        rows |= seen
    return rows
