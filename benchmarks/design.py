"""A design under dispersion: the ignition altitude and the thrust of a lander that minimise the 99
% quantile of the drop height, while 99 % of the landings stop above the ground. With 21 and 81
design variables the thrust is a table of time; the 99.9 % quantile takes 32,768 runs. The
optimisation uses `robust.optimise_design`, and SLSQP of SciPy over `disperse` with finite
differences, with the same statistics of the same runs, from the same initial design within the same
bounds.

Processor seconds are those of the search with compilation, and those without: of the same search
once more, and of SciPy behind its first campaign. The value is the quantile of the height, m, over
fresh runs of each design, and the violation the share that hits the ground. Beside it the runs per
processor second inside the search, with the gradient by all unknowns and without, those of the
plain campaign, and those of a plain `vmap` of diffrax with the gradient."""

import dataclasses
import time
from collections.abc import Callable
from typing import Any, NamedTuple, final

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix
import scipy.optimize

from jaxspace.core import AbstractSystem, Scalar, Table
from jaxspace.dispersion import Campaign, Normal, disperse
from jaxspace.dispersion.evaluate import inputs_at
from jaxspace.minimisation.batch_descent import FORWARD_RATIO
from jaxspace.robust import optimise_design
from jaxspace.robust._runs import problem_of
from jaxspace.robust.statistics import Quantile
from jaxspace.sampling.designs import Sobol
from jaxspace.simulation import Accuracy, Event, Mission, Phase
from jaxspace.solvers import Tsit5

RUNS, FRESH, SHARE = 2048, 65_536, 0.99
# Of which 33 lie beyond the quantile, and 524 of the fresh ones.
MANY_RUNS, MANY_FRESH, LARGE_SHARE = 32_768, 524_288, 0.999
# Altitude, m, and thrust, m/s^2: start, least and greatest.
START, LOW, HIGH = np.array([[600.0, 8.0], [100.0, 6.0], [1200.0, 9.0]])
# How long the table of the thrust lasts from the ignition on, s, and numbers of its nodes.
LASTS, NODES, MORE_NODES = 30.0, 20, 80
# Of the difference quotients of SciPy, in sizes of the unknowns: best of 1e-2, 1e-3 and 1e-4.
STEP = 1e-3
REPEATS = 5


@final
class Lander(AbstractSystem):
    """Height z and speed v under drag and thrust."""

    thrust: Scalar
    drag: Scalar

    def vector_field(self, t, y):
        drag = -self.drag * y["v"] * jnp.abs(y["v"])
        return {"z": y["v"], "v": self.thrust + drag - 3.7}

    def invariants(self, t, y):
        return {}


class Build(eqx.Module):
    """The mission of a design; a module, so that campaigns of all designs share a program."""

    x: Any

    def __call__(self, inputs):
        lit = Event(Ignition(self.x[0]), direction=-1, within=60.0)
        stopped = Event(speed, direction=1, within=60.0)
        drag = inputs["drag"]
        none = jnp.zeros_like(drag)
        thrust = self.x[1] * inputs["factor"]
        phases = [
            Phase(Lander(none, drag), lit, name="fall"),
            Phase(Lander(thrust, drag), stopped, name="brake"),
        ]
        return Mission(phases), {"z": none + 1500.0, "v": inputs["speed"]}


class Ignition(eqx.Module):
    """The height above the ignition."""

    height: Any

    def __call__(self, t, y):
        return y["z"] - self.height


def speed(t, y):
    return y["v"]


def outputs(result, inputs):
    return {"height": result.final["z"]}


SCATTER = {
    "factor": Normal(1.0, 0.02),
    "drag": Normal(1e-3, 1e-4),
    "speed": Normal(-60.0, 3.0),
}


@final
class Throttled(AbstractSystem):
    """The lander under a thrust that is a table of time from the start of its phase on."""

    thrust: Table
    factor: Scalar
    drag: Scalar

    def started_at(self, t0):
        return eqx.tree_at(lambda s: s.thrust.times, self, self.thrust.times + t0)

    def vector_field(self, t, y):
        drag = -self.drag * y["v"] * jnp.abs(y["v"])
        return {"z": y["v"], "v": self.factor * self.thrust(t) + drag - 3.7}

    def invariants(self, t, y):
        return {}


class BuildThrottled(eqx.Module):
    """As `Build`, with the table of the thrust behind the altitude."""

    x: Any

    def __call__(self, inputs):
        mission, y0 = Build(self.x)(inputs)
        fall, brake = mission.phases
        factor, drag = inputs["factor"], inputs["drag"]
        nodes = jnp.linspace(0.0, LASTS, self.x.size - 1)
        values = jnp.broadcast_to(self.x[1:, None], (nodes.size, *factor.shape))
        times = jnp.broadcast_to(nodes[:, None], values.shape)
        system = Throttled(Table(times, values), factor, drag)
        return Mission([fall, Phase(system, brake.until, name="brake")]), y0


def landing(x) -> Campaign:
    """The campaign of a design: its altitude of ignition, m, and thrust, m/s^2."""
    accuracy = Accuracy(1e-6, method=Tsit5(), max_steps=256)
    build = Build if x.size == 2 else BuildThrottled
    return Campaign(build(jnp.asarray(x)), SCATTER, outputs, accuracy=accuracy)


class Task(NamedTuple):
    """Start and bounds of the unknowns, and over how many runs which share of them counts."""

    start: np.ndarray
    low: np.ndarray
    high: np.ndarray
    runs: int
    fresh: int
    share: float

    @property
    def greatest(self) -> Quantile:
        """What is minimised."""
        return Quantile("height", self.share)

    @property
    def least(self) -> Quantile:
        """What must be above the ground."""
        return Quantile("height", 1.0 - self.share)


def task_of(nodes: int, runs: int = RUNS, fresh: int = FRESH, share: float = SHARE) -> Task:
    """The task with so many numbers of the thrust."""
    start, low, high = (np.r_[x[0], np.full(nodes, x[1])] for x in (START, LOW, HIGH))
    return Task(start, low, high, runs, fresh, share)


def ours(task: Task) -> tuple[np.ndarray, dict]:
    """The design, and how long it took, with compilation and without."""
    seconds = []
    for _ in range(2):
        began = time.process_time()
        found = optimise_design(
            landing,
            jnp.asarray(task.start),
            minimise=task.greatest,
            subject_to=[task.least.at_least(0.0)],
            bounds=(jnp.asarray(task.low), jnp.asarray(task.high)),
            runs=task.runs,
        )
        seconds.append(time.process_time() - began)
    row = {"processor_seconds": seconds[0], "without_compilation": seconds[1]}
    return np.asarray(found.x), {**row, "steps": int(found.minimum.steps)}


def by_scipy(task: Task) -> tuple[np.ndarray, dict]:
    """The same by SLSQP over campaigns of the same runs."""
    size = task.high - task.low
    known: dict[bytes, np.ndarray] = {}
    good = jnp.ones(task.runs, bool)
    # Heights of a hundred meters as numbers of order one.
    scale = 100.0

    @jax.jit
    def quantiles(heights):
        return jnp.stack([x.value(heights, good) for x in (task.greatest, task.least)]) / scale

    def numbers(z):
        # Objective and constraint ask for the same runs.
        if z.tobytes() not in known:
            campaign = dataclasses.replace(landing(size * z), design=Sobol())
            heights = disperse(campaign, task.runs).values("height")
            known[z.tobytes()] = np.asarray(quantiles(heights))
        return known[z.tobytes()]

    began = time.process_time()
    numbers(task.start / size)
    compiled = time.process_time()
    found = scipy.optimize.minimize(
        lambda z: numbers(z)[0],
        task.start / size,
        method="SLSQP",
        bounds=list(zip(task.low / size, task.high / size, strict=True)),
        constraints={
            "type": "ineq",
            "fun": lambda z: numbers(z)[1],
            "jac": lambda z: scipy.optimize.approx_fprime(z, lambda q: numbers(q)[1], STEP),
        },
        options={"eps": STEP},
    )
    ended = time.process_time()
    row = {"processor_seconds": ended - began, "without_compilation": ended - compiled}
    return size * found.x, {**row, "steps": int(found.nit), "campaigns": len(known)}


def assessed(x: np.ndarray, task: Task) -> dict:
    """The design by fresh runs."""
    fresh = disperse(landing(x), task.fresh, seed=1)
    value = fresh.percentile("height", task.share).value
    return {"value_m": value, "violation": fresh.violation("height", at_least=0.0).value}


def rates(calls: dict[str, tuple[Callable[[], Any], int]]) -> dict[str, dict]:
    """Runs per processor second of calls, each with its runs, that are made in turn: the median of
    several after a first one."""
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    for call, _ in calls.values():
        call()
    for _ in range(REPEATS):
        for name, (call, _) in calls.items():
            began = time.process_time()
            jax.block_until_ready(call())
            seconds[name].append(time.process_time() - began)
    return {
        name: {"runs_per_cpu_second": runs / float(np.median(seconds[name]))}
        for name, (_, runs) in calls.items()
    }


def calls_of(task: Task) -> dict[str, tuple[Callable[[], Any], int]]:
    """The runs of the search, with their gradient and without, and those of the plain campaign."""
    x = jnp.asarray(task.start)
    limits = (task.least.at_least(0.0),)
    problem = problem_of(landing, x, task.greatest, limits, task.runs, 0, None, 0.0)

    def numbers(x):
        found = problem(x)
        return jnp.concatenate([found.objective[None], found.non_negative])

    # As the search chooses it.
    mode = jax.jacfwd if x.size <= FORWARD_RATIO * 2 else jax.jacrev
    value, gradient = jax.jit(numbers), jax.jit(mode(numbers))
    campaign = landing(x)
    return {
        "search with gradient": (lambda: gradient(x), task.runs),
        "search, values alone": (lambda: value(x), task.runs),
        "plain campaign": (lambda: disperse(campaign, FRESH).values("height"), FRESH),
    }


def by_diffrax():
    """Quantiles of a design by a plain `vmap` of diffrax over the same runs."""
    task = task_of(1)
    start = jnp.asarray(task.start)
    problem = problem_of(landing, start, task.greatest, (), task.runs, 0, None, 0.0)
    assert problem.normals is not None
    samples = inputs_at(landing(start), problem.normals)

    def field(t, y, args):
        thrust, drag = args
        return jnp.stack([y[1], thrust - drag * y[1] * jnp.abs(y[1]) - 3.7])

    def until(height, y0, args, rising):
        found = diffrax.diffeqsolve(
            diffrax.ODETerm(field), diffrax.Tsit5(), 0.0, 60.0, 0.1, y0, args,
            stepsize_controller=diffrax.PIDController(rtol=1e-6, atol=1e-9),
            event=diffrax.Event(height, optimistix.Newton(1e-8, 1e-8), direction=rising),
            adjoint=diffrax.ForwardMode(),
            max_steps=256,
        )  # fmt: skip
        return found.ys[-1]

    def height(x, factor, drag, speed):
        lit = lambda t, y, args, **_: y[0] - x[0]  # noqa: E731
        stopped = lambda t, y, args, **_: y[1]  # noqa: E731
        y = until(lit, jnp.stack([1500.0, speed]), (0.0 * drag, drag), False)
        return until(stopped, y, (x[1] * factor, drag), True)[0]

    def quantiles(x):
        rest = [samples[name] for name in SCATTER]
        heights = jax.vmap(lambda *inputs: height(x, *inputs))(*rest)
        good = jnp.ones(task.runs, bool)
        return jnp.stack([x.value(heights, good) for x in (task.greatest, task.least)])

    return quantiles


def measure() -> dict:
    """A dictionary of what was seen."""
    large = (MANY_RUNS, MANY_FRESH, LARGE_SHARE)
    tasks = {
        "2 unknowns": task_of(1),
        "21 unknowns": task_of(NODES),
        "21 unknowns, 99.9 %": task_of(NODES, *large),
        "81 unknowns, 99.9 %": task_of(MORE_NODES, *large),
    }
    ways = {"optimise_design": ours, "SLSQP over disperse": by_scipy}
    pairs = {f"{n}: {w}": (way, task) for n, task in tasks.items() for w, way in ways.items()}
    # Before they are assessed, which compiles the program of the campaign.
    found = {name: way(task) for name, (way, task) in pairs.items()}
    rows = {name: {**row, **assessed(x, pairs[name][1])} for name, (x, row) in found.items()}
    start = jnp.asarray(task_of(1).start)
    of_diffrax = jax.jit(jax.jacfwd(by_diffrax()))
    for name, task in tasks.items():
        calls = calls_of(task)
        if task.start.size == start.size:
            calls["vmap of diffrax with gradient"] = (lambda: of_diffrax(start), RUNS)
        rows |= {f"{name}: {call}": row for call, row in rates(calls).items()}
    return rows
