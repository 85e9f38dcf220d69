"""Evidence for the rules of `method="auto"`: evaluations of the vector field per run, and the error
of the worst of eight runs, by the methods between which a rule decides. Heavy tops for ten seconds
(loose or tight tolerance), low orbits about an oblate Earth for one day (second order or not), ten
revolutions at an eccentricity of 0.7 (regularised or not), and a gyrocompass for ten seconds, 1e4
radians of its nutation (fast linear motion combined with slow motion). Each run is simulated
separately, so that its steps are its own; the number of evaluations does not depend on the
machine."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxspace import BodyState, Scene
from jaxspace.attitude import Top
from jaxspace.constants import J2_EARTH, MU_EARTH, RADIUS_EARTH
from jaxspace.core import AbstractSystem, State
from jaxspace.orbits import ClassicalElements, Oblateness, PointGravity
from jaxspace.orbits.elements import state_from_elements
from jaxspace.simulation import Accuracy, simulate
from jaxspace.solvers import (
    DOP853,
    RKN1210,
    AdaptiveRegularised,
    ExponentialRosenbrock,
    Tsit5,
)

from ._measure import worst
from .choice import Compass, Gyrocompass, orbits

RUNS = 8
NAMES = {
    "Tsit5": Tsit5,
    "DOP853": DOP853,
    "RKN 12(10)": RKN1210,
    "adaptive regularised": AdaptiveRegularised,
    "exponential Rosenbrock": ExponentialRosenbrock,
}


def _rows(
    about: str,
    system: AbstractSystem,
    y0: State,
    end: float,
    tolerances: dict[str, tuple[float, ...]],
    picked: Callable[[State], Array],
) -> dict:
    """Evaluations and errors of one case; the reference is the last method named, at 1e-13."""

    def ends(name: str, rtol: float) -> tuple[np.ndarray, float]:
        accuracy = Accuracy(rtol, method=NAMES[name](), max_steps=2**19)
        runs = [
            simulate(system, of_run(y0, k), jnp.array([0.0, end]), accuracy=accuracy)
            for k in range(RUNS)
        ]
        evaluations = np.mean([run.stats["evaluations"] for run in runs])
        return np.stack([picked(run.final) for run in runs], axis=-1), float(evaluations)

    reference, _ = ends(list(tolerances)[-1], 1e-13)
    rows = {}
    for name, rtols in tolerances.items():
        for rtol in rtols:
            found, evaluations = ends(name, rtol)
            rows[f"{about}: {name} {rtol:.0e}"] = {
                "evaluations_a_run": evaluations,
                "worst_relative_error": worst(found, reference),
            }
    return rows


def of_run(y: State, k: int) -> State:
    """The state of run `k`."""
    return jax.tree.map(lambda x: x[..., k], y)


def _place(y: BodyState) -> Array:
    return y.position


def _tops() -> dict:
    g = np.random.default_rng(0)
    top = Top(transverse_inertia=0.02, axial_inertia=0.01, weight_moment=1.0)
    spins = jnp.asarray(g.uniform(20.0, 60.0, RUNS))
    tilts = jnp.asarray(g.uniform(0.3, 1.2, RUNS))
    zero = jnp.zeros(RUNS)
    y0 = top.state(jnp.stack([zero, tilts, zero]), jnp.stack([zero, zero, spins]))
    rtols = (1e-3, 1e-4, 1e-5, 1e-6, 1e-8)
    return _rows("top", top, y0, 10.0, {"Tsit5": rtols, "DOP853": rtols}, lambda y: y.omega)


def _low_orbits() -> dict:
    g = np.random.default_rng(1)
    a = RADIUS_EARTH + g.uniform(4e5, 8e5, RUNS)
    e = g.uniform(0.0, 0.01, RUNS)
    angles = g.uniform(0.0, 2.0 * np.pi, (3, RUNS))
    elements = ClassicalElements(
        jnp.asarray(a * (1.0 - e**2)),
        jnp.asarray(e),
        jnp.asarray(np.arccos(g.uniform(-1.0, 1.0, RUNS))),
        *angles,
    )
    y0 = BodyState(*state_from_elements(elements, MU_EARTH))
    scene = Scene([PointGravity(MU_EARTH), Oblateness(MU_EARTH, J2_EARTH, RADIUS_EARTH)])
    rtols = (1e-6, 1e-8, 1e-10, 1e-12)
    methods = {"Tsit5": rtols[:2], "DOP853": rtols, "RKN 12(10)": rtols}
    return _rows("low orbit", scene, y0, 86400.0, methods, _place)


def _eccentric() -> dict:
    y0 = orbits(0.7)
    scene = Scene([PointGravity(1.0), Oblateness(1.0, 1e-3, 1.0)])
    end = 20.0 * np.pi * (1.06 / 0.3) ** 1.5
    rtols = (1e-6, 1e-8, 1e-10, 1e-12)
    methods = {"DOP853": rtols, "RKN 12(10)": rtols, "adaptive regularised": rtols}
    return _rows("e = 0.7", scene, y0, end, methods, _place)


def _compass() -> dict:
    g = np.random.default_rng(2)
    zero = jnp.zeros(RUNS)
    psi = jnp.asarray(g.uniform(0.1, 0.5, RUNS))
    y0 = Compass(psi, zero, 7.2921e-5 * jnp.sin(psi), zero)
    rtols = (1e-6, 1e-8, 1e-10)
    methods = {"exponential Rosenbrock": rtols, "DOP853": rtols}
    return _rows(
        "gyrocompass", Gyrocompass(), y0, 10.0, methods, lambda y: jnp.stack([y.psi, y.tilt])
    )


def measure() -> dict:
    """Evaluations and errors of the methods in every case."""
    return _tops() | _low_orbits() | _eccentric() | _compass()
