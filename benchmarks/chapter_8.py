"""The optimisations of Thomson's chapter 8 with optax and with the SQP method of `minimise`:
staging, steering to a height, steering into an orbit by laws with two to nineteen parameters, and
staging with simulated losses. The table lists the CPU time of the first call, including
compilation, and of a further one (median of five), steps, and the error with respect to the known
optimum: the closed form, the linear tangent law, Pontryagin's conditions; stages with losses are
compared with the lighter of the two resulting rockets.

L-BFGS is that of `optimisers.lbfgs`. The network is trained by `adam` with a rate that falls by a
cosine, in 4000 steps."""

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxspace.constants import MU_EARTH, RADIUS_EARTH
from jaxspace.core import Spline
from jaxspace.optimization import (
    Criterion,
    Insertion,
    InsertionState,
    Minimum,
    SteeringProfile,
    minimise,
    optimal_staging,
    optimise_insertion,
    optimise_steering,
)
from jaxspace.optimization.ascent import Ascent, ConstantMassFlow, ConstantThrustAcceleration
from jaxspace.optimization.flown_staging import staging_with_losses
from jaxspace.optimization.laws import SteeringNetwork, TangentLaw
from jaxspace.optimization.optimisers import lbfgs, named_optimiser
from jaxspace.optimization.staged_flight import StageDesign
from jaxspace.optimization.staging import optimal_staging_by_gradient
from jaxspace.optimization.steering import linear_tangent_steering

FURTHER = 5
STEPS = 1000

EXHAUST = jnp.array([2500.0, 3000.0, 4200.0])
STRUCTURE = jnp.array([0.08, 0.1, 0.12])
TOTAL = 9500.0

# Case T8.3-A of the book.
ASCENT = Ascent(ConstantThrustAcceleration(96.6), 160.0, 3000.0, 0.0, 600000.0, 32.2)

# The second stage of Electron, from 100 km to a circle at 185 km; the least time, s, is that of
# Pontryagin's conditions, which the tests of insertion solve by SciPy.
ORBIT = Insertion(
    ConstantMassFlow(3363.7, 333.0),
    InsertionState(RADIUS_EARTH + 100e3, 900.0, 3000.0),
    mu=MU_EARTH,
    radius=RADIUS_EARTH + 185e3,
)
LEAST_TIME = 254.953710009
NODES = np.linspace(0.0, 1.0, 7)
LAWS = {
    "linear tangent": TangentLaw(0.5, -0.4),
    "bilinear tangent": TangentLaw(0.5, -0.4, 0.1),
    "seven nodes": SteeringProfile(NODES, 0.45 - 0.4 * NODES),
    "spline of seven nodes": Spline(NODES, 0.45 - 0.4 * NODES),
}

LIFTED = StageDesign(
    jnp.array([2600.0, 3000.0, 4300.0]),
    jnp.array([0.08, 0.1, 0.12]),
    jnp.array([3e6, 8e5, 1.5e5]),
    jnp.zeros(3),
)


class Search(NamedTuple):
    """What a search `finds`, its steps where it says them, and how far its optimum is `off`."""

    finds: Callable[[], Any]
    off: Callable[[Any], float]
    steps: Callable[[Any], int | None] = lambda found: int(found.minimum.steps)


def _processor_seconds(call: Callable[[], Any]) -> tuple[Any, float]:
    started = time.process_time()
    found = jax.block_until_ready(call())
    return found, time.process_time() - started


def row_of(search: Search) -> dict:
    """What a search takes, and where it ends."""
    found, first = _processor_seconds(search.finds)
    further = np.median([_processor_seconds(search.finds)[1] for _ in range(FURTHER)])
    return {
        "first_call_cpu_seconds": first,
        "further_call_cpu_ms": 1e3 * float(further),
        "steps": search.steps(found),
        "off_by": search.off(found),
    }


def _staging(share: jax.Array) -> Criterion:
    """The logarithm of the initial mass by the shares of the velocity, whose sum is one."""
    s = TOTAL * share / EXHAUST
    mass = jnp.sum(s + jnp.log1p(-STRUCTURE) - jnp.log(1.0 - STRUCTURE * jnp.exp(s)))
    return Criterion(mass, equal_zero=jnp.sum(share) - 1.0)


# As one program, as the searches of the package are: by itself each search compiles its problem.
@jax.jit
def staging_by_programmes() -> Minimum:
    """The shares as unknowns of quadratic programmes."""
    most = -EXHAUST * jnp.log(STRUCTURE)
    return minimise(_staging, most / jnp.sum(most), tolerance=1e-12)


def _of_ratios(ratios: Callable[[Any], jax.Array]) -> Callable[[Any], float]:
    exact = optimal_staging(EXHAUST, STRUCTURE, TOTAL).mass_ratio
    return lambda found: float(jnp.max(jnp.abs(ratios(found) / exact - 1.0)))


def stagings() -> dict[str, Search]:
    """Mass ratios of three stages."""
    return {
        "staging, three stages: optax.lbfgs": Search(
            lambda: optimal_staging_by_gradient(EXHAUST, STRUCTURE, TOTAL),
            _of_ratios(lambda found: found.mass_ratio),
            lambda found: None,
        ),
        "staging, three stages: quadratic programmes": Search(
            staging_by_programmes,
            _of_ratios(lambda found: jnp.exp(TOTAL * found.x / EXHAUST)),
            lambda found: int(found.steps),
        ),
    }


def steerings() -> dict[str, Search]:
    """The velocity at the apex with nine nodes and the release angle free."""
    best = linear_tangent_steering(ASCENT).final_velocity
    start = SteeringProfile(np.linspace(0.0, 160.0, 9), np.full(9, np.radians(20.0)))

    def off(found):
        return float(1.0 - found.final_velocity / best)

    def search(**options):
        return Search(
            lambda: optimise_steering(ASCENT, start, np.radians(20.0), **options),
            off,
            lambda found: None,
        )

    return {
        "steering, nine nodes: optax.lbfgs": search(),
        "steering, nine nodes: quadratic programmes": search(optimiser="sqp"),
    }


def insertions() -> dict[str, Search]:
    """The time to orbit by laws of two to nineteen numbers."""

    def search(law, **options):
        return Search(
            lambda: optimise_insertion(ORBIT, law, 270.0, **options),
            lambda found: float(found.duration / LEAST_TIME - 1.0),
        )

    rows = {}
    for name, law in LAWS.items():
        rows[f"insertion, {name}: optax.lbfgs"] = search(law, optimiser=lbfgs(), max_steps=STEPS)
        rows[f"insertion, {name}: quadratic programmes"] = search(law)
    made = eqx.nn.MLP("scalar", "scalar", 6, 1, jax.nn.tanh, key=jax.random.key(3))
    network = SteeringNetwork(made)
    adam = named_optimiser("adam", 0.03, 4 * STEPS)
    rows["insertion, network: optax.adam"] = search(
        network, tolerance=1e-5, optimiser=adam, max_steps=4 * STEPS
    )
    rows["insertion, network: quadratic programmes"] = search(network, tolerance=1e-5)
    return rows


def flights() -> dict[str, Search]:
    """The initial mass with losses, beside the lighter of the two that are found."""

    def flown(**options):
        return staging_with_losses(LIFTED, 2000.0, 7600.0, **options)

    ways = {"optax.lbfgs": lambda: flown(optimiser=lbfgs()), "quadratic programmes": flown}
    lightest = min(float(way().initial_mass) for way in ways.values())
    jax.clear_caches()
    return {
        f"staging with losses: {name}": Search(
            way, lambda found: float(found.initial_mass / lightest - 1.0)
        )
        for name, way in ways.items()
    }


def measure() -> dict:
    """A row for each search and method."""
    rows = {}
    for searches in (stagings, steerings, insertions, flights):
        for name, search in searches().items():
            rows[name] = row_of(search)
            print(name, rows[name], flush=True)
    return rows
