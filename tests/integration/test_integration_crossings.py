"""Every crossing of a run: counts, times, states, derivatives, room, dips, and samples too few."""

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float

from jaxspace import BodyState, Event, Scene, Status, simulate, simulate_batch
from jaxspace.core import AbstractClosedForm, AbstractSystem, InputError
from jaxspace.orbits import PointGravity
from jaxspace.orbits.initial import orbit_from_radius
from jaxspace.orbits.shadow import shadow_event
from jaxspace.simulation import Accuracy, Mission, Phase, crossings
from jaxspace.solvers import Tsit5

ARGUMENT, INCLINATION = 0.4, 0.7  # of periapsis, rad; of the orbit, rad


class Turn(AbstractClosedForm):
    rate: Float[Array, "*#runs"]

    def flow(self, duration, y):
        c, s = jnp.cos(self.rate * duration), jnp.sin(self.rate * duration)
        r, v = y.position, y.velocity
        return BodyState(c * r + s / self.rate * v, c * v - s * self.rate * r)


class Wheel(AbstractSystem):
    """An oscillator in space: every component of the position is a sine of the time."""

    rate: Float[Array, "*#runs"]

    def vector_field(self, t, y):
        return BodyState(y.velocity, -self.rate * self.rate * y.position)

    def invariants(self, t, y):
        return {}

    def closed_form(self):
        return Turn(self.rate)


def height(t, y):
    return y.position[2]


ZEROS = Event(height, terminal=False, capacity=12)
START = Event(lambda t, y: y.position[1], 1, terminal=False, capacity=12, at_start=True)
# Two zeros within one sample, and of two falls there is room for one.
DIP = Event(lambda t, y: (t - 9.03) * (t - 9.05) * (4.0 - t), terminal=False, capacity=4)
FALLS = Event(DIP.condition, -1, terminal=False, capacity=1)
SIDE = BodyState(jnp.array([1.0, 0.0, -0.5]), jnp.array([0.0, 1.0, 0.5 * np.sqrt(3.0)]))


def turning(end):
    """z = sin(t - pi/6), y = sin(t)."""
    events = (ZEROS, START, DIP, FALLS)
    return simulate(Wheel(1.0), SIDE, jnp.array([0.0, end]), events=events, throw=False)


def test_every_zero_is_found():
    run = turning(20.0)
    zeros, apses, dip, falls = run.crossings
    exact = np.pi / 6.0 + np.pi * np.arange(7)
    assert zeros.count == 7 and not zeros.overflow and run.status == Status.COMPLETED
    # A few roundings of the time.
    np.testing.assert_allclose(zeros.ts[:7], exact, rtol=1e-14)
    assert np.all(np.isnan(zeros.ts[7:])) and np.all(np.isnan(zeros.states.position[:, 7:]))
    np.testing.assert_allclose(zeros.states.position[1, :7], np.sin(exact), atol=1e-14)
    np.testing.assert_array_equal(zeros.rising[:7], np.arange(7) % 2 == 0)
    # The zero at the start was asked for.
    assert apses.count == 4 and np.all(apses.rising[:4])
    np.testing.assert_allclose(apses.ts[:4], 2.0 * np.pi * np.arange(4), rtol=1e-14, atol=1e-15)
    np.testing.assert_allclose(dip.ts[:3], [4.0, 9.03, 9.05], rtol=1e-13)
    assert dip.count == 3 and not dip.overflow
    assert falls.count == 1 and falls.overflow and not falls.rising[0]
    np.testing.assert_allclose(falls.ts, [4.0], rtol=1e-14)


def test_samples_that_miss_whole_turns_are_no_answer():
    run = turning(700.0)
    assert run.status == Status.SAMPLES_TOO_FEW and np.all(np.isnan(run.final.position))
    assert np.all(np.isnan(run.crossings[0].ts))


def failing(condition=height, events=(), **accuracy):
    """z = sin(t - pi/6) up to t = 20, which fails on its way."""
    events = (Event(condition, terminal=False, capacity=12), *events)
    ts, accuracy = jnp.array([0.0, 20.0]), Accuracy(**accuracy)
    return simulate(Wheel(1.0), SIDE, ts, events=events, accuracy=accuracy, throw=False)


def hollow(t, y):
    """The height, and no number from t = 12 on."""
    return jnp.where(t < 12.0, y.position[2], jnp.nan)


def ended(t, y):
    """Never zero, and no number from t = 12 on."""
    return jnp.where(t < 12.0, 1.0, jnp.nan)


@pytest.mark.parametrize(
    ("run", "status", "count"),
    [
        (lambda: failing(method=Tsit5(), max_steps=80), Status.MAX_STEPS, 2),
        (lambda: failing(hollow), Status.CONDITION_NOT_FINITE, 4),
        # Of the event that should end the run, not of the one that is collected.
        (lambda: failing(events=(Event(ended),)), Status.CONDITION_NOT_FINITE, 4),
    ],
)
def test_zeros_before_a_failure_are_kept(run, status, count):
    run = run()
    found = run.crossings[0]
    assert run.status == found.status == status and found.count == count
    exact = np.pi / 6.0 + np.pi * np.arange(count)
    np.testing.assert_allclose(found.ts[:count], exact, rtol=1e-7)
    np.testing.assert_array_equal(found.rising[:count], np.arange(count) % 2 == 0)
    assert np.all(np.isnan(found.ts[count:])) and np.all(np.isnan(found.states.position[:, count:]))
    assert not np.any(found.rising[count:]) and not found.overflow


def test_one_event_ends_the_run_that_another_collects():
    """Numbers of events are those of the list."""
    end = Event(lambda t, y: y.position[0] + 0.8, direction=1)
    run = simulate(Wheel(1.0), SIDE, jnp.array([1.0, 20.0]), events=(ZEROS, end))
    assert run.event == 1 and run.status == Status.EVENT
    np.testing.assert_array_equal(run.happened, [False, True])
    np.testing.assert_allclose(run.ts[-1], 1.0 + 2.0 * np.pi - np.arccos(-0.8), rtol=1e-13)
    np.testing.assert_allclose(run.crossings[0].ts[:2], 1.0 + np.pi * np.array([1, 7]) / 6.0)
    assert run.crossings[0].count == 2


@jax.jit
def start(e):
    """At the periapsis, at unit distance from a centre with mu = 1."""
    angles = {"inclination": INCLINATION, "argument_of_periapsis": ARGUMENT}
    return BodyState(*orbit_from_radius(1.0, 1.0, e, **angles))


def node_times(e, count):
    """Kepler's equation at both nodes, from the periapsis on."""
    a = 1.0 / (1.0 - e)
    found = []
    for true_anomaly in (np.pi - ARGUMENT, 2.0 * np.pi - ARGUMENT):
        half = np.tan(0.5 * true_anomaly) * np.sqrt((1.0 - e) / (1.0 + e))
        anomaly = np.mod(2.0 * np.arctan(half), 2.0 * np.pi)
        first = (anomaly - e * np.sin(anomaly)) * a**1.5
        found.append(first + 2.0 * np.pi * a**1.5 * np.arange(count))
    return np.sort(np.concatenate(found))[: 2 * count]


def test_derivatives_of_the_times_in_both_modes():
    """Along an integrated run, against the derivative of Kepler's equation."""
    scene = Scene([PointGravity(1.0)])

    @jax.jit
    def slopes(e):
        def times(e):
            ts = jnp.array([0.0, 20.0])
            return simulate(scene, start(e), ts, events=(ZEROS,), accuracy=1e-12).crossings[0].ts

        value, forwards = jax.jvp(times, (e,), (1.0,))
        # Unused entries carry nothing into the derivative.
        return value, forwards, jax.grad(lambda e: jnp.nansum(times(e) ** 2))(e)

    e, step = 0.3, 1e-4
    # Richardson's extrapolation of central differences: 1e-4^4 and rounding over 1e-4.
    one = (node_times(e + step, 2) - node_times(e - step, 2)) / (2.0 * step)
    two = (node_times(e + 2.0 * step, 2) - node_times(e - 2.0 * step, 2)) / (4.0 * step)
    exact, rate = node_times(e, 2)[:3], ((4.0 * one - two) / 3.0)[:3]
    value, forwards, backwards = slopes(e)
    np.testing.assert_allclose(value[:3], exact, rtol=1e-11)
    np.testing.assert_allclose(forwards[:3], rate, rtol=1e-9)
    np.testing.assert_allclose(backwards, np.sum(2.0 * exact * rate), rtol=1e-9)


@pytest.mark.sweep
def test_a_batch_and_a_run_afterwards_find_the_same():
    scene = Scene([PointGravity(1.0)])
    eccentricities = np.array([0.0, 0.2, 0.4])
    y0s = jax.vmap(start, out_axes=-1)(jnp.array(eccentricities))
    run = simulate_batch(scene, y0s, jnp.array([0.0, 20.0]), events=(ZEROS,))
    after = crossings(run, height, capacity=3)
    assert after.ts.shape == (3, 3)
    np.testing.assert_array_equal(after.overflow, run.crossings[0].count > 3)
    for k, e in enumerate(eccentricities):
        exact = node_times(e, 4)
        exact = exact[exact < 20.0]
        nodes = run.of(k).crossings[0]
        assert nodes.count == exact.size
        # The tolerance of a step, over some thirty steps.
        np.testing.assert_allclose(nodes.ts[: exact.size], exact, rtol=1e-7)
        np.testing.assert_allclose(after.ts[:3, k], exact[:3], rtol=1e-7)


def test_wrong_uses_are_refused():
    with pytest.raises(InputError, match="capacity is 0"):
        Event(height, capacity=0)
    with pytest.raises(InputError, match="terminal=False"):
        Mission([Phase(Wheel(1.0), Event(height, within=1.0, terminal=False))])


def test_every_eclipse_of_a_circle():
    """In parallel light the shadow is a cylinder: dark while the angle from the axis behind the
    planet is below asin(R/r). Two full turns, from the sunlit side on."""
    radius, sun = 0.8, jnp.array([0.0, 0.0, -0.5])
    shade = Event(shadow_event(sun, radius), terminal=False, capacity=6)
    y0 = BodyState(jnp.array([0.0, 0.0, -1.0]), jnp.array([0.0, 1.0, 0.0]))
    run = simulate(Wheel(1.0), y0, jnp.array([0.0, 4.0 * np.pi]), events=(shade,))
    found = run.crossings[0]
    half = np.arcsin(radius)
    expected = np.pi * np.array([1, 1, 3, 3]) + half * np.array([-1, 1, -1, 1])
    assert found.count == 4
    np.testing.assert_allclose(found.ts[:4], expected, rtol=1e-13)
    # It falls at the entry and rises at the exit.
    np.testing.assert_array_equal(found.rising[:4], [False, True, False, True])


def test_a_corner_between_samples_is_no_way_past():
    """|t - 3.3| < 1e-3 wherever the samples fall: two zeros, of which the first one ends a run."""
    ends = jnp.linspace(5.0, 9.0, 41)
    start = jax.tree.map(lambda x: jnp.broadcast_to(x[:, None], (3, 41)), SIDE)
    near = Event(lambda t, y: jnp.abs(t - 3.3) - 1e-3)
    ts = jnp.stack([0.0 * ends, ends])
    run = simulate_batch(Wheel(1.0), start, ts, events=(near,))
    np.testing.assert_allclose(run.ts[-1], 3.299, rtol=1e-12)


@pytest.mark.parametrize(
    ("p", "depth"),
    [
        pytest.param(1.0, 1e-2, id="corner"),
        # As the distance in a near collision.
        pytest.param(2.0 / 3.0, 1e-2, id="cusp"),
        pytest.param(2.0, 1e-2, id="parabola"),
        pytest.param(2.0, -1e-2, id="above"),
    ],
)
def test_both_zeros_of_a_dip_are_found_wherever_the_samples_fall(p, depth):
    """|x|^p = depth, x = (t - 3.3)/0.1, within samples of 0.04 to 0.07 s."""
    ends = jnp.linspace(5.0, 9.0, 41)
    start = jax.tree.map(lambda x: jnp.broadcast_to(x[:, None], (3, 41)), SIDE)
    dip = Event(lambda t, y: jnp.abs((t - 3.3) / 0.1) ** p - depth, terminal=False, capacity=2)
    ts = jnp.stack([0.0 * ends, ends])
    found = simulate_batch(Wheel(1.0), start, ts, events=(dip,), throw=False).crossings[0]
    # Where a sample is next to the cusp, its rate says that the samples are too few.
    known = found.status == Status.COMPLETED
    assert np.mean(known) > 0.9 if p < 1.0 else np.all(known)
    np.testing.assert_array_equal(found.status[~known], Status.SAMPLES_TOO_FEW)
    if depth < 0.0:
        np.testing.assert_array_equal(found.count, 0)
        return
    half = 0.1 * depth ** (1.0 / p)
    np.testing.assert_array_equal(found.count[known], 2)
    assert not np.any(found.rising[0]) and np.all(found.rising[1, known])
    # A few roundings of the time.
    np.testing.assert_allclose(found.ts[0, known], 3.3 - half, rtol=1e-14)
    np.testing.assert_allclose(found.ts[1, known], 3.3 + half, rtol=1e-14)


def test_a_condition_that_adds_up_the_runs_is_refused():
    start = jax.tree.map(lambda x: jnp.broadcast_to(x[:, None], (3, 4)), SIDE)
    mixed = Event(lambda t, y: jnp.sum(y.position))
    with pytest.raises(InputError, match="must not reduce over the batch axis"):
        simulate_batch(Wheel(1.0), start, jnp.array([0.0, 1.0]), events=(mixed,))


class Marked(AbstractClosedForm):
    def flow(self, duration, y):
        return BodyState(y.position + jax.lax.tan(duration) * y.velocity, y.velocity)


class Marks(Wheel):
    """A motion that is known in the text of a program by operations that nothing else has."""

    def vector_field(self, t, y):
        return BodyState(y.velocity, jax.lax.cbrt(y.position))

    def closed_form(self):
        return Marked()


def held(program, operation, name="main"):
    """How often the text of a program holds an operation, once its functions are written out."""
    body = re.search(rf"func\.func [a-z ]*@{name}\((.*?)\n  }}\n", program, re.DOTALL)
    if body is None:
        return 0
    called = re.findall(r"call @(\w+)\(", body[1])
    return body[1].count(operation) + sum(held(program, operation, f) for f in called)


@pytest.mark.parametrize(
    ("method", "motion", "times"),
    # The motion comes once for the samples and once for the search: by steps, the vector field in
    # all stages of the one, in the loop of the other, and for the rates of the condition.
    [("closed_form", "tan", 2), (Tsit5(), "cbrt", 10)],
    ids=["closed form", "steps"],
)
def test_the_program_holds_motion_and_condition_few_times(method, motion, times):
    """They are what compiles longest."""
    event = Event(lambda t, y: jax.lax.log1p(y.position[2]), terminal=False, capacity=3)

    @jax.jit
    def found(y):
        ts, how = jnp.array([0.0, 1.0]), Accuracy(method=method)
        return simulate(Marks(1.0), y, ts, events=(event,), accuracy=how).crossings[0].ts

    program = found.lower(SIDE).as_text()
    # Samples and search.
    assert held(program, "log_plus_one") == 2
    assert held(program, f"stablehlo.{motion}") == times
