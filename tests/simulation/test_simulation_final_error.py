"""The error at the end that is asked for: it is met, or said not to be, against closed forms."""

import functools
from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from jaxtyping import Array
from systems import Integrated
from unchecked import unchecked

from jaxspace import BodyState, FinalError, Scene, simulate, simulate_batch, simulate_mission
from jaxspace.bodies import Load
from jaxspace.core import AbstractSystem, InputError
from jaxspace.integration.accuracy import as_accuracy
from jaxspace.orbits import TwoBody, UniformGravity
from jaxspace.scene import Custom
from jaxspace.simulation import (
    Accuracy,
    Event,
    Mission,
    Phase,
    SimulationError,
    Status,
    simulate_mission_batch,
)
from jaxspace.solvers import DOP853, Stormer

ORBIT = Integrated(TwoBody(1.0))
METHOD = Accuracy(method=DOP853())
# Five revolutions of the fastest of the speeds below.
TS = jnp.array([0.0, 40.0])
# The truth has roundings of its own, of which the time of passage holds most.
ROUNDINGS = 1e-12


def start(speed):
    speed = jnp.asarray(speed)
    zero = jnp.zeros_like(speed)
    return BodyState(jnp.stack([zero + 1.0, zero, zero]), jnp.stack([zero, speed, 0.2 + zero]))


def truth(speed):
    return TwoBody(1.0).closed_form().flow(TS[1], start(speed))


def apart(a, b):
    return np.linalg.norm(np.asarray(a) - np.asarray(b), axis=0)


@pytest.mark.parametrize("within", [1e-2, 1e-5, 1e-8, 1e-10])
@pytest.mark.parametrize("speed", [0.7, 1.0, 1.2])
def test_the_error_is_below_what_is_asked(within, speed):
    asked = FinalError(position=within, velocity=10.0 * within, accuracy=METHOD)
    run = simulate(ORBIT, start(speed), TS, accuracy=asked)
    exact = truth(speed)
    errors = (
        apart(run.final.position, exact.position) / within,
        apart(run.final.velocity, exact.velocity) / (10.0 * within),
    )
    rounded = ROUNDINGS / within
    estimate = float(run.stats["final_error"])
    # What is asked is met. How fast errors fall is known from three runs at most: the estimate may
    # be too small by the spread of that, and not by more than three times.
    assert max(errors) <= 1.0 + rounded and estimate <= 1.0
    assert max(errors) <= 3.0 * estimate + rounded
    assert int(run.status) == Status.COMPLETED and run.accuracy.rtol > 0.0


def test_a_relative_error_is_that_of_every_block():
    run = simulate(ORBIT, start(1.0), TS, accuracy=FinalError(1e-7, accuracy=METHOD))
    exact = truth(1.0)
    assert apart(run.final.position, exact.position) < 1e-7 * np.linalg.norm(exact.position)
    assert apart(run.final.velocity, exact.velocity) < 1e-7 * np.linalg.norm(exact.velocity)


def test_a_smaller_error_compiles_nothing(monkeypatch):
    simulate(ORBIT, start(1.0), TS, accuracy=FinalError(1e-4, accuracy=METHOD))

    def compiled(*args, **kwargs):
        raise AssertionError("a program was compiled")

    monkeypatch.setattr("jax._src.compiler.compile_or_get_cached", compiled)
    simulate(ORBIT, start(1.0), TS, accuracy=FinalError(1e-9, accuracy=METHOD))


def test_every_run_of_a_batch_has_its_error_and_a_failed_one_harms_no_other():
    speeds = jnp.array([0.8, 1.0, jnp.nan, 1.2])
    asked = FinalError(position=1e-6, accuracy=METHOD)
    batch = simulate_batch(ORBIT, start(speeds), TS, accuracy=asked)
    good = np.array([0, 1, 3])
    exact = truth(speeds[good])
    assert np.all(apart(batch.final.position[:, good], exact.position) < 1e-6)
    assert batch.stats["final_error"].shape == (4,)
    np.testing.assert_array_equal(batch.status, [0, 0, Status.NOT_FINITE, 0])
    # The error of a method of order eight falls with the eighth power of its steps, which are whole
    # numbers of some thirty here; a run that failed shows no price.
    price = np.asarray(batch.stats["final_error_price"])
    np.testing.assert_allclose(price[good], 10.0 ** (1.0 / 8.0), rtol=0.15)
    assert np.isnan(price[2])


def test_every_run_of_a_batch_has_its_tolerance():
    """An eccentric orbit needs a tighter one than a circle does. In several blocks, whose order is
    that of the rates, and in each the tolerances are those of its runs."""
    speeds = jnp.tile(jnp.array([0.6, 1.0]), 320)
    asked = FinalError(position=1e-8, accuracy=METHOD)
    batch = simulate_batch(ORBIT, start(speeds), TS, accuracy=asked)
    rtol = np.asarray(batch.accuracy.rtol)
    assert rtol.shape == (640,) and np.all(rtol[::2] < 0.5 * rtol[1::2])
    np.testing.assert_array_less(apart(batch.final.position, truth(speeds).position), 1e-8)
    one = batch.of(1)
    assert one.accuracy.rtol == one.config.rtol == rtol[1]
    np.testing.assert_array_equal(batch.stats["steps"][::2], batch.stats["steps"][0])
    # A run alone with this tolerance takes about as many steps: it is another program, and a step
    # that rounding decides to repeat changes those after it. The other tolerance takes a tenth
    # more.
    alone = simulate(ORBIT, start(1.0), TS, accuracy=Accuracy(rtol[1], method=DOP853()))
    np.testing.assert_allclose(alone.final.position, one.final.position, atol=1e-8)
    assert abs(int(alone.stats["steps"]) - int(one.stats["steps"])) <= 4
    error = apart(batch.error().position, 0.0)
    np.testing.assert_array_less(error, 1e-8)


def test_under_every_transformation():
    """The derivative is that of the run, whose tolerance has none."""

    def height(speed):
        asked = FinalError(position=1e-8, accuracy=METHOD)
        return simulate(ORBIT, start(speed), TS, accuracy=asked).final.position[0]

    exact = lambda speed: truth(speed).position[0]  # noqa: E731
    value, slope = jax.jit(jax.value_and_grad(height))(1.1)
    np.testing.assert_allclose(value, exact(1.1), atol=1e-8)
    speeds = jnp.array([0.9, 1.1])
    values, slopes = jax.vmap(lambda speed: jax.jvp(height, (speed,), (1.0,)))(speeds)
    np.testing.assert_allclose(values, jax.vmap(exact)(speeds), atol=1e-8)
    # A derivative by the speed is some hundred times the position: as much larger is its error.
    np.testing.assert_allclose([slope, slopes[1]], jax.grad(exact)(1.1), atol=1e-5)


def test_a_closed_form_is_run_with_roundings():
    run = simulate(TwoBody(1.0), start(1.0), TS, accuracy=FinalError(position=1e-9))
    # And once more for each of two roundings of its inputs, of less than 1e-13 over five turns.
    assert int(run.stats["final_error_runs"]) == 3
    assert 0.0 < float(run.stats["final_error"]) < 1e-3
    assert float(run.stats["final_error_price"]) == 1.0
    jitted = jax.jit(
        lambda s: simulate(TwoBody(1.0), start(s), TS, accuracy=FinalError(1e-9)).final.position
    )
    np.testing.assert_array_equal(jitted(1.0), run.final.position)


def test_a_quantity_of_interest():
    """The time at which the orbit first crosses the plane y = 0 again, by its event."""
    period = 2.0 * np.pi
    event = Event(lambda t, y: y.position[1], direction=1)
    asked = FinalError(output=lambda run: run.ts[-1], within=1e-7, accuracy=METHOD)
    flat = BodyState(jnp.array([1.0, 0.0, 0.0]), jnp.array([0.0, 1.0, 0.0]))
    run = simulate(ORBIT, flat, TS, accuracy=asked, events=[event])
    assert abs(float(run.ts[-1]) - period) < 1e-7 and int(run.status) == Status.EVENT


@functools.cache
def mission():
    kick = lambda t, y: BodyState(y.position, 1.1 * y.velocity)  # noqa: E731
    return Mission([Phase(ORBIT, 10.0, kick, "low"), Phase(ORBIT, 20.0, name="high")])


def kicked(speed):
    flow = TwoBody(1.0).closed_form().flow
    y = flow(jnp.asarray(10.0), start(speed))
    return flow(jnp.asarray(20.0), BodyState(y.position, 1.1 * y.velocity))


def test_a_mission_has_the_error_after_all_its_phases():
    asked = FinalError(position=1e-7, accuracy=METHOD)
    run = simulate_mission(mission(), start(0.9), accuracy=asked)
    assert apart(run.final.position, kicked(0.9).position) < 1e-7
    assert 0.0 < float(run[-1].stats["final_error"]) <= 1.0
    speeds = jnp.array([0.8, 1.0])
    batch = simulate_mission_batch(mission(), start(speeds), accuracy=asked)
    assert np.all(apart(batch.final.position, kicked(speeds).position) < 1e-7)


def test_what_cannot_be_met_is_said():
    """Less than the roundings of five revolutions."""
    asked = FinalError(position=1e-17, accuracy=METHOD)
    with pytest.raises(
        SimulationError, match="not with the requested error.* times the requested one"
    ):
        simulate(ORBIT, start(0.8), TS, accuracy=asked)
    batch = simulate_batch(ORBIT, start(jnp.array([0.8, 1.0])), TS, accuracy=asked)
    np.testing.assert_array_equal(batch.status, Status.FINAL_ERROR_MISSED)
    # The best that there is stays there.
    assert np.all(apart(batch.final.position, truth(jnp.array([0.8, 1.0])).position) < 1e-10)


def test_single_precision_meets_what_it_resolves():
    low = lambda tree: jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), tree)  # noqa: E731
    run = simulate(
        low(ORBIT), low(start(1.0)), low(TS), accuracy=FinalError(position=0.1), throw=False
    )
    assert int(run.status) == Status.COMPLETED
    assert apart(run.final.position, truth(1.0).position) < 0.1


class Place(eqx.Module):
    x: Array


@final
class Edge(AbstractSystem):
    """x' = 1 below x = 1/3 and 2 above, an edge whose time no one declares."""

    def vector_field(self, t, y):
        return Place(jnp.where(y.x < 1.0 / 3.0, 1.0, 2.0).astype(y.x.dtype))

    def invariants(self, t, y):
        return {}


@pytest.mark.parametrize(
    ("precision", "some"),
    [("float64", (1e-3, 1e-6, 1e-8, 1e-11, 1e-16)), ("float32", (1e-2, 1e-8))],
)
def test_an_edge_without_a_break_is_met_or_said_not_to_be(precision, some):
    """From x = 0 it is 5/3 at t = 1. Steps pass the edge as far as their shortest length allows;
    the last of what is asked is less than a rounding. What is not met has the best that is."""
    y0, ts = Place(jnp.zeros((), precision)), jnp.array([0.0, 1.0], precision)
    runs = [simulate(Edge(), y0, ts, accuracy=FinalError(x=x), throw=False) for x in some]
    met = [int(run.status) == Status.COMPLETED for run in runs]
    errors = [abs(float(run.final.x) - 5.0 / 3.0) for run in runs]
    assert met[0] and not met[-1]
    for x, run, ok, error in zip(some, runs, met, errors, strict=True):
        assert error <= x if ok else int(run.status) == Status.FINAL_ERROR_MISSED
        assert (float(run.stats["final_error"]) <= 1.0) == ok
    assert errors[-1] <= (1e-6 if precision == "float64" else 1e-4)
    with pytest.raises(
        SimulationError, match="not with the requested error.* times the requested one"
    ):
        simulate(Edge(), y0, ts, accuracy=FinalError(x=some[-1]))


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (lambda: FinalError(), "one kind of request"),
        (lambda: FinalError(1e-9, position=1.0), "one kind of request"),
        (lambda: FinalError(0.0), "FinalError.relative is 0"),
        (lambda: FinalError(position=-1.0), "FinalError.position is -1"),
        (lambda: FinalError(position="1 m"), "FinalError.position is '1 m': it must be a number"),
        (lambda: FinalError(position=jnp.ones(3)), r"has the shape \(3,\)"),
        (lambda: FinalError(output=len), "must be given together"),
        (lambda: FinalError(1e-9, accuracy=Accuracy(1e-9)), "sets a tolerance"),
        (
            lambda: simulate(ORBIT, start(1.0), TS, accuracy=Accuracy(jnp.full(2, 1e-9))),
            r"Accuracy.rtol has the shape \(2,\): it must be one number.$",
        ),
        (
            lambda: simulate_batch(
                ORBIT, start(jnp.ones(3)), TS, accuracy=Accuracy(jnp.full(2, 1e-9))
            ),
            r"Accuracy.rtol has the shape \(2,\): .* one for each run, \(3,\)",
        ),
        (lambda: as_accuracy(FinalError(1e-9)), "A FinalError is accepted by simulate"),
        (lambda: run_with(FinalError(positon=1.0)), "no such block.*Did you mean position"),
        (
            lambda: run_with(FinalError(1e-9, accuracy=Accuracy(method=Stormer(8, steps=64)))),
            "Stormer does not adapt its steps",
        ),
    ],
)
def test_what_makes_no_sense_is_refused(made, said):
    with unchecked(), pytest.raises(InputError, match=said):
        made()


def run_with(asked):
    return simulate(ORBIT, start(1.0), TS, accuracy=asked)


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_a_closed_form_has_the_error_of_its_roundings(precision):
    """What is met is met and what lies far below a rounding is not; of some revolutions, whose
    truth is that of double precision, or of Kepler's equation in 60 digits."""
    low = lambda tree: jax.tree.map(lambda x: jnp.asarray(x, precision), tree)  # noqa: E731
    with mpmath.workdps(60):
        for duration in (4.0, 4000.0):
            y0 = BodyState(jnp.array([1.0, 0.0, 0.0]), jnp.array([0.0, 1.0625, 0.0]))
            speed = mpmath.mpf("1.0625")
            e = speed**2 - 1
            a = 1 / (1 - e)
            mean = duration / mpmath.sqrt(a**3)
            anomaly = mpmath.findroot(lambda E: E - e * mpmath.sin(E) - mean, mean)  # noqa: B023
            x = a * (mpmath.cos(anomaly) - e)
            y = a * mpmath.sqrt(1 - e**2) * mpmath.sin(anomaly)
            exact = np.array([float(x), float(y), 0.0])
            eps = float(np.finfo(precision).eps)
            for within in eps * duration * np.array([1e-22, 1e-3, 1e-2, 0.1, 1.0, 10.0, 1e3]):
                asked = FinalError(position=float(within))
                ts = low(jnp.array([0.0, duration]))
                run = simulate(low(TwoBody(1.0)), low(y0), ts, accuracy=asked, throw=False)
                # The truth is rounded, too.
                error = apart(run.final.position, exact) - 1e-16
                met = int(run.status) == Status.COMPLETED
                assert error <= within if met else int(run.status) == Status.FINAL_ERROR_MISSED
                assert met or within < 1e3 * eps * duration
                assert not met or within > 0.1 * eps


def test_the_first_tolerance_of_a_run_does_not_depend_on_its_neighbours():
    asked = FinalError(position=1e-6, accuracy=METHOD)
    y = start(jnp.array([0.8, 1.0]))
    larger = jnp.array([1.0, 1e4])
    far = BodyState(y.position * larger, y.velocity / jnp.sqrt(larger))
    near, mixed = (asked.usual_tolerance(y, (2,)) for y in (y, far))
    assert near[0] == mixed[0] == asked.usual_tolerance(start(0.8))
    np.testing.assert_allclose(mixed[1], 1e-10, rtol=1e-12)
    # A block that all runs share.
    shared = BodyState(jnp.array([2.0, 0.0, 0.0]), y.velocity)
    np.testing.assert_allclose(asked.usual_tolerance(shared, (2,)), 5e-7, rtol=1e-12)


G, K, KEPT, BOUNCES = 9.81, 0.02, 0.9, 13


def bounces():
    """The time of the last bounce after a fall from 10 m with drag, and the speed after it.

    The speed squared after a fall from h is (g / k) (1 - exp(-2 k h)); a rise with v reaches
    h = log(1 + k v^2 / g) / (2 k). The times are acosh(exp(k h)) and atan(v sqrt(k / g)), both over
    sqrt(g k)."""
    h, time, root, rise = 10.0, 0.0, np.sqrt(G * K), 0.0
    for _ in range(BOUNCES):
        time += rise + np.arccosh(np.exp(K * h)) / root
        v = KEPT * np.sqrt(G / K * -np.expm1(-2.0 * K * h))
        h = np.log1p(K * v**2 / G) / (2.0 * K)
        rise = np.arctan(v * np.sqrt(K / G)) / root
    return time, v


@pytest.mark.parametrize("in_place", [True, pytest.param(False, marks=pytest.mark.sweep)])
def test_many_bounces(in_place):
    """Errors after jumps follow no power of the tolerance: what is met is met all the same."""
    up = jnp.array([0.0, 0.0, 1.0])
    drag = Custom(
        lambda t, y, body: Load(acceleration_N=-K * jnp.abs(y.velocity) * y.velocity * up)
    )
    scene = Scene([UniformGravity([0.0, 0.0, -G]), drag])
    height = lambda t, y: y.position[2]  # noqa: E731
    back = lambda t, y: BodyState(y.position * (1.0 - up), y.velocity * (1.0 - (1.0 + KEPT) * up))  # noqa: E731
    y0 = BodyState(jnp.array([0.0, 0.0, 10.0]), jnp.array([1.0, 0.0, 0.0]))
    time, v = bounces()
    # On the way up.
    after = 0.1
    phase = np.arctan(v * np.sqrt(K / G))
    turned = phase - np.sqrt(G * K) * after
    z, rate = np.log(np.cos(turned) / np.cos(phase)) / K, np.sqrt(G / K) * np.tan(turned)
    # x runs with one metre per second.
    exact = BodyState(np.array([time + after, 0.0, z]), np.array([1.0, 0.0, rate]))
    for within in 10.0 ** -np.arange(2.0, 9.0, 0.25):
        asked = FinalError(position=within, velocity=within, accuracy=METHOD)
        if in_place:
            ground = Event(height, -1, terminal=False, capacity=2 * BOUNCES, then=back)
            ts = jnp.array([0.0, time + after])
            run = simulate(scene, y0, ts, events=[ground], accuracy=asked)
        else:
            ground = Event(height, -1, within=20.0)
            phases = [Phase(scene, ground, back, f"bounce {i}") for i in range(BOUNCES)]
            # From the last bounce, whose time has an error, the same time as in place.
            run = simulate_mission(Mission([*phases, Phase(scene, after)]), y0, accuracy=asked)
        assert apart(run.final.position, exact.position) <= within
        assert apart(run.final.velocity, exact.velocity) <= within
