"""The same tasks with ten thousand to ten million runs on one device, in both precisions, with the
error of a sample.

`python -m benchmarks --device gpu` measures it, on any machine with `--device cpu`, only the works
named, and with `--widths 10000 100000` at other widths. All programs are compiled first, at the
same time, so that nothing runs beside a measurement. The arithmetic and the memory traffic are
those that the compiler counts in one pass of each loop. A width that the memory does not hold, or
whose call would take too long, has no row. Errors are beside forty digits (kepler, lambert), or
beside the same runs on the processor in double precision at 1e-12 by adaptive steps; of gradients
beside forward mode."""

import itertools
import os
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxspace import Mission, load
from jaxspace.orbits.kepler import kepler_flow
from jaxspace.orbits.lambert import lambert
from jaxspace.simulation import Accuracy, simulate_batch, simulate_mission_batch
from jaxspace.solvers import DOP853, RKN1210, Stormer, Tsit5

from . import (
    ascent,
    environment_steps,
    gradients,
    kepler,
    kernel,
    kick_stage,
    low_orbits,
    model_rocket,
)
from . import lambert as transfers
from ._measure import exact_position, in_turn, worst

WIDTHS = (10_000, 100_000, 1_000_000, 10_000_000)
PRECISIONS = ("float64", "float32")
CHECKED = 16
# Of each call, after a first one.
REPEATS = 3
# Of a call, s, by the rate of the width before it.
LONGEST = 15.0
# Enough for 1e-8 over the day of the low orbits; no tolerance changes them.
STEPS = Accuracy(0.5, method=Stormer(12, steps=1310))
# The longest step of an environment here, s.
STEP = 0.1
EXACT = 1e-12


def moved(r, v, t):
    """Positions of two-body motion at later times."""
    return kepler_flow(r, v, t, 1.0)[0]


def slopes(r, v, t):
    """Derivatives of a sum of them with respect to the positions, in reverse mode."""
    return jax.grad(lambda r: jnp.sum(moved(r, v, t)))(r)


def slopes_forward(r, v, t):
    """The same in forward mode."""

    def column(k):
        along = jnp.zeros_like(r).at[k].set(1.0)
        return jnp.sum(jax.jvp(lambda r: moved(r, v, t), (r,), (along,))[1], axis=0)

    return jnp.stack([column(k) for k in range(3)])


def departures(start, end, duration):
    """Velocities at the start of transfers."""
    return lambert(start, end, duration, 1.0)[0]


def days(y0, accuracy=STEPS):
    """Positions of low orbits under oblateness a day later, in fixed steps."""
    ts = jnp.array([0.0, low_orbits.DAY], y0.position.dtype)
    return simulate_batch(low_orbits.SCENE, y0, ts, accuracy=accuracy).final.position


def slopes_of_orbits(y0):
    """Derivatives of a component of the end of three revolutions, in reverse mode."""
    return gradients.gradient(low_orbits.SCENE, y0, gradients.STORMER, 1e-5).position


def slopes_of_orbits_forward(y0):
    """The same in forward mode, in adaptive steps."""
    return gradients.matrix(low_orbits.SCENE, y0, RKN1210(), EXACT)[:3, 0]


def ends(accuracy: Accuracy) -> Callable[..., Any]:
    """A function that gives the positions at the end of missions; in single precision at its
    default tolerance where the one given is tighter."""

    def positions(mission, y0):
        single = y0.position.dtype == jnp.float32
        rtol = max(float(accuracy.rtol), 1e-5) if single else accuracy.rtol
        used = Accuracy(rtol, accuracy.atol, accuracy.method)
        return simulate_mission_batch(mission, y0, 0.0, accuracy=used).final.position

    return positions


def kick_stages() -> tuple[Mission, Any]:
    """The dispersed kick stages."""
    campaign = load(kick_stage.FILE).campaign()
    return campaign.build(campaign.samples(jax.random.key(1), jnp.arange(kick_stage.RUNS)))


def seconds(y0, length=STEP):
    """Rates and quaternions of free bodies a second later, by steps of an environment."""
    return environment_steps.moved(y0, jnp.asarray(length, y0.omega.dtype), round(1.0 / length))


def error_of_motion(found, given) -> float:
    """The worst relative error of positions against forty digits."""
    r, v, t = (np.asarray(x, float) for x in given)
    exact = [exact_position(r[:, k], v[:, k], t[k]) for k in range(t.size)]
    return worst(found, np.stack(exact, axis=1))


def error_of_transfers(found, given) -> float:
    """How far the worst transfer misses its end, in the distance of the end."""
    start, end, duration = (np.asarray(x, float) for x in given)
    exact = [exact_position(start[:, k], found[:, k], duration[k]) for k in range(duration.size)]
    return worst(np.stack(exact, axis=1), end)


def beside(other: Callable[..., Any]) -> Callable[..., float]:
    """The worst relative difference from another way to the same results, in double precision."""

    def error(found, given) -> float:
        return worst(found, eqx.filter_jit(other)(*given))

    return error


class Work(NamedTuple):
    """What is done, what it starts from, and the worst error of its first runs."""

    run: Callable[..., Any]
    starts: Callable[[], Any]
    error: Callable[..., float]


TIGHT = beside(ends(Accuracy(EXACT, method=DOP853())))
WORKS = {
    "kepler": Work(moved, kepler.states, error_of_motion),
    "lambert": Work(departures, transfers.pairs, error_of_transfers),
    "gradients of kepler": Work(slopes, kepler.states, beside(slopes_forward)),
    "low_orbits": Work(
        days,
        lambda: (low_orbits.orbits(),),
        beside(lambda y0: days(y0, Accuracy(EXACT, method=RKN1210()))),
    ),
    "low_orbits, one kernel": Work(
        kernel.days,
        lambda: (low_orbits.orbits(),),
        beside(lambda y0: days(y0, Accuracy(EXACT, method=RKN1210()))),
    ),
    # As the file asks.
    "kick_stage": Work(ends(Accuracy(3e-7)), kick_stages, TIGHT),
    "ascent": Work(ends(Accuracy(1e-7)), lambda: ascent.start(ascent.dispersed()), TIGHT),
    "model_rocket": Work(
        ends(Accuracy(*model_rocket.SETTINGS["jaxspace, 1e-05"], Tsit5())),
        lambda: model_rocket.flights(model_rocket.RUNS),
        TIGHT,
    ),
    "environment_steps": Work(
        seconds, lambda: (environment_steps.starts(),), beside(environment_steps.exact)
    ),
    "gradients": Work(
        slopes_of_orbits, lambda: (low_orbits.orbits(),), beside(slopes_of_orbits_forward)
    ),
}


def in_precision(tree: Any, precision: str) -> Any:
    """The same with its numbers in the precision."""
    arrays, rest = eqx.partition(tree, eqx.is_inexact_array)
    return eqx.combine(jax.tree.map(lambda x: jnp.asarray(x, precision), arrays), rest)


def cut(tree: Any, width: int) -> Any:
    """As many runs of the arrays that have them, last, repeated where there are fewer; what all
    runs share stays whole."""
    arrays, rest = eqx.partition(tree, eqx.is_inexact_array)
    runs = max(x.shape[-1] for x in jax.tree.leaves(arrays) if x.ndim)

    def some(x):
        shared = x.ndim == 0 or x.shape[-1] < runs
        return x if shared else jnp.take(x, jnp.arange(width) % runs, axis=-1)

    return eqx.combine(jax.tree.map(some, arrays), rest)


def measure(
    device: str,
    widths: Sequence[int] = WIDTHS,
    names: Sequence[str] = tuple(WORKS),
    precisions: Sequence[str] = PRECISIONS,
) -> dict[str, dict[str, float]]:
    """Runs a second, error, and work of the compiler's count, of each work, width and precision."""
    place, rows = jax.devices(device)[0], {}
    with jax.default_device(jax.devices("cpu")[0]):
        starts = {name: WORKS[name].starts() for name in names}
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        programs = {
            (name, width, precision): pool.submit(
                compiled, WORKS[name], starts[name], width, precision, place
            )
            for name, width, precision in itertools.product(names, widths, precisions)
        }
    for name, precision in itertools.product(names, precisions):
        seconds_a_run = 0.0
        for width in widths:
            label = f"{name}, {width} runs, {precision}"
            if width * seconds_a_run > LONGEST:
                print(f"{label}: a call would take too long.", file=sys.stderr)
                break
            try:
                program = programs[name, width, precision]
                rows[label] = row(WORKS[name], program, starts[name], width, precision, place)
            except jax.errors.JaxRuntimeError as error:
                if "RESOURCE_EXHAUSTED" not in str(error):
                    raise
                # Wider ones do not fit, either.
                print(f"{label}: the memory of the device does not hold it.", file=sys.stderr)
                break
            print(label, rows[label], file=sys.stderr)
            seconds_a_run = 1.0 / rows[label]["runs_per_second"]
    return rows


def inputs_of(whole: Any, width: int, precision: str, place: Any) -> tuple[Any, Any]:
    """What as many runs of a work start from: its arrays, on the device `place`, and the rest."""
    arrays, rest = eqx.partition(in_precision(cut(whole, width), precision), eqx.is_array)
    return jax.device_put(arrays, place), rest


def compiled(work: Work, whole: Any, width: int, precision: str, place: Any) -> Any:
    """The program of one width and precision for the device `place`."""
    arrays, rest = inputs_of(whole, width, precision, place)
    return jax.jit(lambda arrays: work.run(*eqx.combine(arrays, rest))).lower(arrays).compile()


def row(
    work: Work, program: Future, whole: Any, width: int, precision: str, place: Any
) -> dict[str, float]:
    """The row of one width and precision."""
    run = program.result()
    arrays, _ = inputs_of(whole, width, precision, place)
    seen = in_turn({"": lambda: run(arrays)}, width, REPEATS)[""]
    found = np.asarray(run(arrays)[:, :CHECKED], float)
    with jax.default_device(jax.devices("cpu")[0]):
        # In double precision, and with the rounding of the inputs: these are no errors of the work.
        sample = in_precision(in_precision(cut(whole, found.shape[1]), precision), "float64")
        error = work.error(found, sample)
    return {
        "runs_per_second": seen["runs_per_second"],
        "worst_relative_error": error,
        **counted(run, seen["runs_per_second"] / width),
    }


def counted(program: Any, calls_per_second: float) -> dict[str, float]:
    """Arithmetic and memory traffic a second, of one pass through each loop, as XLA counts."""
    seen = program.cost_analysis() or {}
    return {
        "1e9_operations_per_second": seen.get("flops", np.nan) * calls_per_second / 1e9,
        "1e9_bytes_per_second": seen.get("bytes accessed", np.nan) * calls_per_second / 1e9,
    }
