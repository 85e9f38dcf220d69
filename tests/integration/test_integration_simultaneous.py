"""Events that happen at one time: motion in straight lines, whose corners are known exactly."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from both_modes import both_modes
from jaxtyping import Array, Float

from jaxspace import (
    Accuracy,
    BodyState,
    Event,
    Mission,
    Phase,
    Status,
    simulate,
    simulate_batch,
    simulate_mission,
)
from jaxspace.core import AbstractSystem
from jaxspace.orbits import TwoBody
from jaxspace.solvers import DOP853, FixedSteps

HOW = {"accuracy": 1e-9}


class Coast(AbstractSystem):
    def vector_field(self, t, y):
        return BodyState(y.velocity, jnp.zeros_like(y.velocity))

    def invariants(self, t, y):
        return {}


class Springs(AbstractSystem):
    """An oscillator along each axis, of the frequencies `w`, rad/s."""

    w: Float[Array, "3"]

    def vector_field(self, t, y):
        squares = self.w.reshape(3, *(1,) * (y.position.ndim - 1)) ** 2
        return BodyState(y.velocity, -squares * y.position)

    def invariants(self, t, y):
        return {}


def falls(k):
    """The condition that the coordinate number `k` falls through zero."""
    return lambda t, y: y.position[k]


def jump(condition, then, direction=-1, **more):
    return Event(condition, direction, terminal=False, then=then, **{"capacity": 4, **more})


def turned(k):
    return lambda t, y: BodyState(y.position, y.velocity.at[k].multiply(-1.0))


def doubled(t, y):
    return BodyState(y.position, 2.0 * y.velocity)


def idle(t, y):
    return y


def pushed(t, y):
    return BodyState(y.position, y.velocity.at[1].add(1.0))


def corner(distance=1.0, speed=1.0):
    """A body that meets the planes x = 0 and z = 0 together."""
    d, u = jnp.asarray(distance), jnp.asarray(speed)
    return BodyState(jnp.stack([d, 0.0 * d, d]), jnp.stack([-u, 0.0 * u, -u]))


def test_in_a_box_every_wall_of_a_corner_acts():
    """Of 80 bodies on a grid many meet two or three walls at once, and some none: unfolded, each
    coordinate is a straight line. One batch, whose runs jump at different times."""
    rng = np.random.default_rng(1)
    x0 = rng.integers(1, 3, (3, 80)).astype(float)
    v0 = rng.integers(-2, 3, (3, 80)).astype(float)
    x0[:, :2], v0[:, :2] = np.array([[2, 1], [2, 1], [2, 2]]), np.array([[2, -1], [2, -1], [2, 1]])
    walls = [
        jump(lambda t, y, k=k, a=a, s=s: a + s * y.position[k], turned(k), capacity=8)
        for k in (2, 0, 1)
        for a, s in ((0.0, 1.0), (3.0, -1.0))
    ]
    y0s = BodyState(jnp.array(x0), jnp.array(v0))
    ts = jnp.array([0.0, 2.1, 6.7])
    run = simulate_batch(Coast(), y0s, ts, events=walls, throw=False, **HOW)
    assert np.all(np.asarray(run.status) == Status.COMPLETED)
    line = x0[:, None] + v0[:, None] * np.asarray(ts)[:, None]
    folded = np.mod(line, 6.0)
    # Roundings of some jumps, at times that are rational.
    expected = np.where(folded > 3.0, 6.0 - folded, folded)
    np.testing.assert_allclose(run.states.position, expected, atol=1e-12)
    planes = np.floor(line[:, -1] / 3.0)
    passed = sum(np.asarray(each.count) for each in run.crossings)
    np.testing.assert_array_equal(passed, np.sum(np.abs(planes - np.floor(x0 / 3.0)), axis=0))


@pytest.mark.parametrize("end_first", [True, False])
def test_jumps_act_in_the_listed_order_and_then_the_run_ends(end_first):
    """A push and a doubling that do not commute, an end, and two that do not happen: one that is
    zero, but rises, and one whose condition the doubling makes zero."""
    end = Event(falls(0), -1)
    rises = jump(lambda t, y: -y.position[0], pushed)
    made_zero = jump(lambda t, y: y.velocity[0] + 2.0, pushed, 0)
    jumps = (jump(falls(2), pushed), jump(falls(0), doubled), rises, made_zero)
    events = (end, *jumps) if end_first else (*jumps, end)
    run = simulate(Coast(), corner(), jnp.array([0.0, 3.0]), events=events, **HOW)
    number = 0 if end_first else 4
    assert run.status == Status.EVENT and run.event == number
    happened = [True, False, False]
    assert list(run.happened) == ([True, True, *happened] if end_first else [True, *happened, True])
    np.testing.assert_allclose(run.ts[-1], 1.0, rtol=1e-14)
    np.testing.assert_allclose(run.final.velocity, [-2.0, 2.0, -2.0], rtol=1e-14)
    push, double, *none = run.crossings
    assert [int(each.count) for each in run.crossings] == [1, 1, 0, 0]
    np.testing.assert_allclose(double.states.velocity[:, 0], push.after.velocity[:, 0])
    np.testing.assert_allclose(push.states.velocity[:, 0], [-1.0, 0.0, -1.0])
    assert all(np.all(np.isnan(each.ts)) for each in none)


def test_what_happens_beyond_a_capacity_at_a_corner():
    """The mirror of z has room once, and a second corner comes: that of x still acts there, and
    then the run ends."""
    walls = [jump(lambda t, y, k=k: 1.0 - (y.position[k] - 1.0) ** 2, turned(k)) for k in (2, 0)]
    short = jump(walls[0].condition, turned(2), capacity=1)
    run = simulate(Coast(), corner(), jnp.array([0.0, 9.0]), events=[short, walls[1]], **HOW)
    assert run.status == Status.EVENT and run.event == 0 and np.all(run.happened)
    assert [int(each.count) for each in run.crossings] == [1, 2]
    assert [bool(each.overflow) for each in run.crossings] == [True, False]
    np.testing.assert_allclose(run.ts[-1], 3.0, rtol=1e-13)
    np.testing.assert_allclose(run.final.velocity, [-1.0, 0.0, 1.0], rtol=1e-13)


def test_a_zero_at_the_start_with_a_jump_acts_once():
    """The event at which the run starts, with one that `at_start` does not let act."""
    y0 = BodyState(jnp.array([0.0, 0.0, 0.0]), jnp.array([-1.0, 0.0, -1.0]))
    events = (jump(falls(0), pushed, at_start=True), jump(falls(2), doubled))
    run = simulate(Coast(), y0, jnp.array([0.0, 2.0]), events=events, **HOW)
    assert [int(each.count) for each in run.crossings] == [1, 0]
    np.testing.assert_allclose(run.final.position, [-2.0, 2.0, -2.0], rtol=1e-13)


def test_two_events_closer_than_the_roundings_of_a_long_run():
    """A nanosecond apart in a run of a week: the second is not taken for a zero at the start of
    the way behind the first."""
    y0 = BodyState(jnp.array([1.0, 0.0, 1.0 + 1e-9]), jnp.array([-1.0, 0.0, -1.0]))
    events = [jump(falls(k), turned(k)) for k in (0, 2)]
    run = simulate(Coast(), y0, jnp.array([0.0, 6e5]), events=events, **HOW)
    assert [int(each.count) for each in run.crossings] == [1, 1]
    np.testing.assert_allclose(run.final.velocity, [1.0, 0.0, 1.0])


def test_events_together_to_the_tolerance_all_act():
    """Of three oscillators that pass zero together, whose zeros the errors of the steps part: in
    every run each is counted once, whichever comes first."""
    phase = np.linspace(0.1, 1.2, 100)
    w, t = np.array([1.0, 2.0, 3.0]), -phase
    x = np.stack([np.cos(t), np.sin(2.0 * t), -np.cos(3.0 * t)])
    v = np.stack([-np.sin(t), 2.0 * np.cos(2.0 * t), 3.0 * np.sin(3.0 * t)])
    y0s, events = BodyState(jnp.array(x), jnp.array(v)), [jump(falls(k), idle) for k in (2, 1, 0)]
    run = simulate_batch(
        Springs(jnp.array(w)), y0s, jnp.array([0.0, 3.0]), events=events, accuracy=1e-6
    )
    for found, period in zip(run.crossings, (2.0 * np.pi / 3.0, np.pi, 2.0 * np.pi), strict=True):
        times = phase + 0.5 * np.pi + period * np.arange(-2, 4)[:, None]
        np.testing.assert_array_equal(found.count, np.sum((times > 0.0) & (times < 3.0), axis=0))


def moved(t, y):
    return BodyState(y.position.at[2].set(5.0), y.velocity)


@pytest.mark.sweep
@pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev])
@pytest.mark.parametrize("first", ["pushed", "doubled", "moved"])
def test_derivatives_through_events_that_always_coincide(mode, first):
    """By distance and speed, along which both planes are met together, in closed form: also where
    the first jump leaves the second condition far from zero."""
    jumps = {"pushed": pushed, "doubled": doubled, "moved": moved}
    others = {"pushed": doubled, "doubled": pushed, "moved": pushed}
    events = (jump(falls(0), jumps[first]), jump(falls(2), others[first]))
    ts = jnp.array([0.0, 3.0])

    def final(x):
        return simulate(Coast(), corner(*x), ts, events=events, **HOW).final.position

    def truth(x):
        d, u = x
        left = 3.0 - d / u
        speeds = {"pushed": (2.0, 2.0), "doubled": (2.0, 1.0), "moved": (1.0, 1.0)}[first]
        z = (5.0 if first == "moved" else 0.0) - speeds[0] * u * left
        return jnp.stack([-speeds[0] * u * left, speeds[1] * left, z])

    x = jnp.array([1.3, 0.7])
    np.testing.assert_allclose(jax.jit(mode(final))(x), mode(truth)(x), rtol=1e-12, atol=1e-12)


def test_derivatives_where_mirrors_commute_and_of_the_time_of_the_end():
    """By all of the state, along which the corner splits: the mirrors commute, so that the motion
    stays |x + v t|. The end comes after both jumps, at the plane y = 0 of a body that rises."""
    mirrors = [jump(falls(k), turned(k)) for k in (2, 0)]
    end = Event(lambda t, y: y.position[0] - 1.0, 1)

    def ends(x):
        run = simulate(
            Coast(), BodyState(x[:3], x[3:]), jnp.array([0.0, 9.0]), events=[*mirrors, end], **HOW
        )
        return jnp.concatenate([run.ts[-1:], run.final.position])

    def truth(x):
        t = -(1.0 + x[0]) / x[3]
        return jnp.concatenate([t[None], -(x[:3] + x[3:] * t) * jnp.array([1.0, -1.0, 1.0])])

    x = jnp.array([1.0, 0.5, 1.0, -1.0, 0.25, -1.0])
    for mode in (jax.jacfwd, jax.jacrev):
        np.testing.assert_allclose(jax.jit(mode(ends))(x), mode(truth)(x), rtol=1e-12, atol=1e-12)


def pushed_and_doubled(x):
    """Where `corner` is after three seconds: pushed where it meets the plane z = 0, then doubled
    where it meets x = 0, at one time. By distance and speed."""
    d, u = x
    left = 3.0 - d / u
    return jnp.stack([-2.0 * u * left, 2.0 * left, -2.0 * u * left])


def test_methods_that_search_before_they_run():
    """In straight lines they are exact."""
    events, fixed = (jump(falls(2), pushed), jump(falls(0), doubled)), FixedSteps(DOP853(), 8)

    @jax.jit
    def final(x):
        how, ts = Accuracy(method=fixed), jnp.array([0.0, 3.0])
        return simulate(Coast(), corner(*x), ts, events=events, accuracy=how).final.position

    x, weights = jnp.array([1.3, 0.7]), jnp.array([1.0, -2.0, 0.5])
    (value, pull), (right, pull_right) = jax.vjp(final, x), jax.vjp(pushed_and_doubled, x)
    np.testing.assert_allclose(value, right, rtol=1e-12)
    np.testing.assert_allclose(pull(weights)[0], pull_right(weights)[0], rtol=1e-12)


@pytest.mark.sweep
def test_a_condition_that_is_touched_beside_one_that_is_passed():
    """The square of x is least where z falls through zero."""
    touched = jump(lambda t, y: y.position[0] ** 2, doubled, 1, touch=1e-6)
    events = (jump(falls(2), pushed), touched)

    @jax.jit
    def final(x):
        run = simulate(Coast(), corner(*x), jnp.array([0.0, 3.0]), events=events, **HOW)
        return run.final.position

    x, weights = jnp.array([1.3, 0.7]), jnp.array([1.0, -2.0, 0.5])
    (value, pull), (right, pull_right) = jax.vjp(final, x), jax.vjp(pushed_and_doubled, x)
    np.testing.assert_allclose(value, right, rtol=1e-12)
    np.testing.assert_allclose(pull(weights)[0], pull_right(weights)[0], rtol=1e-12)


def test_a_jump_where_a_condition_is_touched():
    """Where x is 0.5, which its square about it touches; the runs go on from there."""
    touched = jump(lambda t, y: (y.position[0] - 0.5) ** 2, doubled, 1, touch=1e-6)
    run = simulate(Coast(), corner(), jnp.array([0.0, 3.0]), events=[touched], **HOW)
    assert run.crossings[0].count == 1
    np.testing.assert_allclose(run.final.position, [-4.5, 0.0, -4.5], rtol=1e-12)


def test_an_orbit_in_closed_form():
    """At the far end of an ellipse the radius is largest where the body passes the x axis: it is
    pushed there, and then its speed doubled, both along the orbit."""
    far = jump(lambda t, y: jnp.sum(y.position * y.velocity, axis=0), doubled)
    passed = jump(falls(1), lambda t, y: BodyState(y.position, y.velocity.at[1].add(0.1)))
    system, ts = TwoBody(1.0), jnp.array([0.0, 14.0])

    def final(speed):
        y0 = BodyState(jnp.array([1.0, 0.0, 0.0]), speed * jnp.array([0.0, 1.0, 0.0]))
        run = simulate(system, y0, ts, events=[passed, far], accuracy=1e-9)
        return jnp.concatenate([run.final.position, run.final.velocity])

    def truth(speed):
        a = 1.0 / (2.0 - speed**2)
        half, r = jnp.pi * a**1.5, 2.0 * a - 1.0
        after = 2.0 * (0.1 - speed / r)
        y = BodyState(jnp.stack([-r, 0.0, 0.0]), jnp.stack([0.0, after, 0.0]))
        y = system.closed_form().flow(ts[-1] - half, y)
        return jnp.concatenate([y.position, y.velocity])

    value, *slopes = both_modes(final)(1.2)
    right, right_slope = jax.jvp(truth, (1.2,), (1.0,))
    # The time of the far end is known to the roundings of the condition, some 1e-14.
    np.testing.assert_allclose(value, right, rtol=1e-11, atol=1e-11)
    for slope in slopes:
        np.testing.assert_allclose(slope, right_slope, rtol=1e-10, atol=1e-10)


def test_phases_that_end_at_one_time():
    """The second one ends where it begins: at a zero at its start, which counts where `at_start`
    says so."""
    ends = (
        Event(falls(2), -1, within=9.0),
        Event(falls(0), -1, within=9.0, at_start=True),
    )

    def final(x):
        phases = [
            Phase(Coast(), ends[0], pushed, "to z = 0"),
            Phase(Coast(), ends[1], doubled, "to x = 0"),
            Phase(Coast(), 1.5, name="on"),
        ]
        run = simulate_mission(Mission(phases), corner(*x), **HOW)
        return jnp.append(run["on"].final.position, run["on"].ts[-1])

    def truth(x):
        d, u = x
        return jnp.stack([-3.0 * u, 3.0, -3.0 * u, d / u + 1.5])

    x = jnp.array([1.3, 0.7])
    value, *slopes = both_modes(final)(x)
    np.testing.assert_allclose(value, truth(x), rtol=1e-12)
    for slope in slopes:
        np.testing.assert_allclose(slope, jax.jacfwd(truth)(x), rtol=1e-12, atol=1e-12)


@pytest.mark.sweep
def test_a_batch_of_which_some_runs_have_events_at_one_time():
    """Two mirrors and an end: all three together, two of them, one mirror with the end, none, and
    each alone. The mirrors act before the end: the motion is unfolded up to it."""
    times = np.array([[1.0, 1.0, 0.5, 5.0, 0.7], [1.0, 2.0, 1.5, 5.0, 2.1], [1, 1, 1.5, 5, 1.2]])
    u = np.array([[1.0, 0.5, 2.0, 1.0, 3.0], [0.25, 1.0, 1.0, 2.0, 1.0], [2.0, 1, 1, 1, 0.5]])
    end = Event(falls(1), -1)
    events = [jump(falls(2), turned(2)), end, jump(falls(0), turned(0))]
    ts = jnp.array([0.0, 3.0])

    @jax.jit
    def final(d, u):
        run = simulate_batch(Coast(), BodyState(d, -u), ts, events=events, throw=False, **HOW)
        return run.final.position

    def truth(d, u):
        stop = jnp.minimum(d[1] / u[1], 3.0)
        passed = jnp.asarray(times <= np.minimum(times[1], 3.0))
        turns = jnp.where(passed.at[1].set(False), -1.0, 1.0)
        return turns * (d - u * stop)

    inputs = jnp.asarray(times * u), jnp.asarray(u)
    rng = np.random.default_rng(0)
    along = tuple(jnp.asarray(rng.normal(size=u.shape)) for _ in inputs)
    weights = jnp.asarray(rng.normal(size=u.shape))
    # Roundings of distances of a few metres.
    near = {"rtol": 1e-12, "atol": 1e-12}
    for found, right in zip(
        jax.jvp(final, inputs, along), jax.jvp(truth, inputs, along), strict=True
    ):
        np.testing.assert_allclose(found, right, **near)
    pulled, right = (jax.vjp(f, *inputs)[1](weights) for f in (final, truth))
    np.testing.assert_allclose(pulled, right, **near)
