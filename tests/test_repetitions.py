"""Verbs that are called again with other numbers compile nothing, and take no more memory maps.

A loop of a script calls a verb with new objects of the same structure. Each compiled program takes
memory and memory maps, of which a process may have 65,530 on Linux.

Every public function of the packages of verbs has a call in `CALLS`, or a reason in `EXEMPT`.
"""

import importlib
import inspect
from pathlib import Path
from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
import pytest

from jaxspace import BodyState, Mission, Phase, Scene, simulate, simulate_batch, simulate_mission
from jaxspace.bodies import RigidBody
from jaxspace.control import ClosedLoop, CommandedTorque
from jaxspace.control.attitude_laws import QuaternionFeedback
from jaxspace.core import AbstractSystem, Scalar, quantity
from jaxspace.core.modules import public_names
from jaxspace.dispersion import Campaign, Normal, Uniform, disperse
from jaxspace.dispersion.covariance import moments, sampled
from jaxspace.dispersion.sensitivity import sobol_indices
from jaxspace.estimation import fit
from jaxspace.minimisation import Criterion, minimise, minimise_from
from jaxspace.robust import optimise_design, train_design
from jaxspace.robust.statistics import Mean
from jaxspace.rotations import Quaternion
from jaxspace.studies import equilibrium, modes, propagate_covariance, sensitivity

PROGRAMS = []


def _listen(event: str, duration_secs: float, **kwargs: str | int) -> None:
    del duration_secs, kwargs
    if event == "/jax/core/compile/backend_compile_duration":
        PROGRAMS.append(event)


jax.monitoring.register_event_duration_secs_listener(_listen)


class Swing(eqx.Module):
    x: Scalar
    v: Scalar


@final
class Oscillator(AbstractSystem):
    """x'' = -w^2 x"""

    w: Scalar = quantity("rad/s", doc="angular frequency")

    def vector_field(self, t, y):
        return Swing(y.v, -self.w * self.w * y.x)

    def invariants(self, t, y):
        return {}


TS = jnp.linspace(0.0, 1.0, 5)
CAMPAIGN = Campaign(
    lambda samples: (
        Mission([Phase(Oscillator(samples["w"]), 1.0)]),
        Swing(samples["start"], jnp.zeros(())),
    ),
    {"w": Normal(jnp.asarray(2.0), jnp.asarray(0.1)), "start": Uniform(0.9, 1.1)},
    lambda result, samples: {"x": result.final.x},
    {"x": "m", "start": "m", "w": "rad/s"},
)
FREE = Scene([CommandedTorque()], RigidBody(inertia=[3.0, 3.0, 5.0]))
LBFGS = optax.lbfgs()


def system(k):
    return Oscillator(jnp.asarray(1.0 + 0.1 * k)), Swing(jnp.asarray(1.0 + k), jnp.asarray(0.1 * k))


def batch(k):
    w = jnp.linspace(1.0, 2.0, 4) + 0.1 * k
    return Oscillator(w), Swing(w + 1.0, w)


def line(p):
    return p["rate"] * TS + p["bias"]


def valley(x):
    return Criterion(jnp.sum((x - 1.0) ** 2) + jnp.sum(x**4), x[0] - x[1], 2.0 - x[2])


def lower(x):
    return Criterion(jnp.sum((x - 1.0) ** 2) + jnp.sum(x**4))


def point(k):
    return jnp.array([0.1, 0.2, 0.3]) + 0.01 * k


def design(x):
    """A campaign about the frequency x."""
    return Campaign(
        lambda samples: (
            Mission([Phase(Oscillator(x + samples["w"]), 1.0)]),
            Swing(jnp.ones(()), jnp.zeros(())),
        ),
        {"w": Normal(jnp.asarray(0.0), jnp.asarray(0.1))},
        lambda result, samples: {"x": result.final.x},
    )


def by_parts():
    return optax.multi_transform({"fast": optax.adam(0.1), "slow": optax.sgd(0.05)}, "fast")


def loop(k):
    controller = QuaternionFeedback(0.5 + 0.1 * k, 1.0 + 0.1 * k)
    y0 = BodyState(attitude=Quaternion.about(2, jnp.array(0.1 + 0.1 * k)), omega=jnp.zeros(3))
    return ClosedLoop(FREE, controller, period=0.1).simulate(y0, TS, accuracy=1e-6)


CALLS = {
    "simulate": lambda k: simulate(*system(k), TS + k, accuracy=1e-6).final,
    "simulate_batch": lambda k: simulate_batch(*batch(k), TS + k, accuracy=1e-6).final,
    "simulate_mission": lambda k: (
        simulate_mission(Mission([Phase(system(k)[0], 1.0 + k)]), system(k)[1]).final
    ),
    "sensitivity": lambda k: sensitivity(*system(k), TS + k)[0].final,
    "equilibrium": lambda k: equilibrium(*system(k)).x,
    "modes": lambda k: modes(*system(k)).eigenvalues,
    "propagate_covariance": lambda k: propagate_covariance(
        *system(k), TS + k, (1.0 + k) * jnp.eye(2)
    )[1],
    "minimise": lambda k: minimise(valley, point(k), bounds=(-1.0 - k, 5.0 + k)).x,
    "minimise by optax": lambda k: minimise(valley, point(k), optimiser=LBFGS, max_steps=9).x,
    "minimise by new optax": lambda k: (
        minimise(valley, point(k), optimiser=optax.adam(0.1), max_steps=9).x
    ),
    "minimise by new optax.multi_transform": lambda k: (
        minimise(valley, point(k), optimiser=by_parts(), max_steps=9).x
    ),
    "minimise_from": lambda k: (
        minimise_from(
            lower,
            jnp.stack([point(k), point(k + 1)], axis=-1),
            bounds=(-1.0 - k, 5.0 + k),
            tolerance=1e-6 + 1e-7 * k,
            max_steps=9,
            optimiser=optax.adam(0.1),
        )[0].x
    ),
    "train_design": lambda k: (
        train_design(
            design,
            jnp.asarray(0.9 + 0.01 * k),
            minimise=Mean("x"),
            optimiser=optax.adam(0.01),
            batch=16,
            max_steps=3,
            average=0.9 - 0.01 * k,
        ).x
    ),
    "ClosedLoop.simulate": lambda k: loop(k).states.omega,
    "disperse": lambda k: disperse(CAMPAIGN, 64, seed=k).outputs["x"],
    "disperse another number of runs": lambda k: disperse(CAMPAIGN, 64 + k, seed=k).outputs["x"],
    "sampled": lambda k: sampled(CAMPAIGN, 64, seed=k)["x"],
    "sobol_indices": lambda k: sobol_indices(CAMPAIGN, 32, seed=k),
    "moments": lambda k: moments(CAMPAIGN, check=64, accuracy=1e-6 * (1.0 + k)),
    "fit": lambda k: (
        fit(line, 2.0 * TS - 0.3 * k, {"bias": jnp.array(0.0), "rate": jnp.array(1.0)}).parameters
    ),
    "optimise_design": lambda k: (
        optimise_design(design, jnp.asarray(0.9 + 0.01 * k), minimise=Mean("x"), runs=64).x
    ),
}


# Calls of less than a second.
OFTEN = {"simulate", "simulate_batch", "simulate_mission", "ClosedLoop.simulate", "fit"}
OFTEN |= {"equilibrium", "modes", "propagate_covariance"}

VERBS = ("dispersion", "estimation", "minimisation", "robust", "simulation", "studies")
"""The packages of which every function is one of those called again in a loop."""

NO_RUN = "runs nothing"
TIMES = "measures the time of programs that it compiles for this"
UNMEASURED = "not measured yet"
EXEMPT = {
    "gradient_error": "compiles one program in each call for a function that is new in it",
    "simulate_compact": "compiles one program in each call: its integration is not cached",
    "Progress": NO_RUN,
    "open_store": NO_RUN,
    "residual_tests": NO_RUN,
    "accuracy_cost": TIMES,
    "effect_budget": TIMES,
    **dict.fromkeys(
        (
            *("assess_designs", "choose_method", "compare_methods", "crossings", "free_by_path"),
            *("kalman_filter", "rare_event", "reweight", "run_paths", "run_states"),
            "simulate_mission_batch",
        ),
        UNMEASURED,
    ),
}


def verbs():
    """The names of the public functions of the packages of verbs."""
    packages = [importlib.import_module(f"jaxspace.{package}") for package in VERBS]
    found = {name: thing for each in packages for name, thing in public_names(each).items()}
    return {name for name, thing in found.items() if callable(thing) and not inspect.isclass(thing)}


def test_every_verb_is_called_again_or_has_a_reason():
    every = verbs()
    assert every == (every & set(CALLS)) | set(EXEMPT)
    assert not set(CALLS) & set(EXEMPT)


def memory_maps():
    regions = Path("/proc/self/maps")
    return regions.read_bytes().count(b"\n") if regions.exists() else 0


@pytest.mark.parametrize("name", CALLS)
def test_other_numbers_compile_nothing(name):
    jax.block_until_ready(CALLS[name](0))
    programs, maps = len(PROGRAMS), memory_maps()
    for k in range(1, 20 if name in OFTEN else 4):
        jax.block_until_ready(CALLS[name](k))
    assert len(PROGRAMS) == programs
    # A new region of the heap is no program.
    assert memory_maps() <= maps + 20
