"""Events: backwards in time, at the start of a run, two at once, touches, bounces to the end, and
searches that fail."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float

from jaxspace import BodyState, simulate, simulate_mission
from jaxspace.core import AbstractSystem
from jaxspace.core.vectors import dot
from jaxspace.simulation import Event, Mission, Phase, SimulationError, Status


class Fall(AbstractSystem):
    """A ball under constant gravity, upwards along z."""

    gravity: Float[Array, "*#runs"]

    def vector_field(self, t, y):
        up = jnp.array([0.0, 0.0, 1.0], y.velocity.dtype)
        return BodyState(y.velocity, 0.0 * y.velocity - self.gravity * up)

    def invariants(self, t, y):
        return {}


G = 9.81
FALL = Fall(G)


def ball(height=10.0, speed=0.0):
    return BodyState(jnp.array([0.0, 0.0, height]), jnp.array([0.0, 0.0, speed]))


def starts(events):
    """A function that runs `FALL` from a state between two times, and returns the end of the run:
    time, state, number of the event, all that happened, status. Compiled once."""

    @jax.jit
    def run(y, t0, t1):
        done = simulate(FALL, y, jnp.stack([t0, t1]), events=events, throw=False)
        return done.ts[-1], done.final, done.event, done.happened, done.status

    return lambda y, t0, t1: run(y, jnp.asarray(t0, float), jnp.asarray(t1, float))


def sequence(events, y, t, end, most=8):
    """Times and numbers of the events between `t` and `end`, one run after the other."""
    run, found = starts(events), []
    while len(found) < most:
        t, y, event, _, _ = run(y, t, end)
        if event < 0:
            return found
        found.append((float(t), int(event)))
    raise AssertionError(f"an event is found again and again: {found}")


def test_close_events_backwards():
    """EV-CLOSE, forwards and backwards, each run from the event of the last one on."""
    events = tuple(Event(lambda t, y, when=when: t - when) for when in (5.5, 5.0))
    forwards = sequence(events, ball(1e4), 0.0, 20.0)
    backwards = sequence(events, ball(1e4), 20.0, 0.0)
    np.testing.assert_allclose(forwards, [(5.0, 1), (5.5, 0)], rtol=1e-14)
    np.testing.assert_allclose(backwards, [(5.5, 0), (5.0, 1)], rtol=1e-14)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_zero_within_rounding_ends_the_search(side):
    """A condition whose rounding takes Newton's step from one end of its bracket to the other and
    back, as the radial speed at an apsis of a nearly circular orbit may."""
    zero, noise = 1.0, 2.0**-30

    def condition(t, y):
        exact = side * (zero - t)
        rounded = noise * jnp.where(exact < 0.0, -1.0, 1.0)
        # The slope stays that of the exact one.
        lost = jnp.where(jnp.abs(exact) < noise, rounded - exact, 0.0)
        return exact + jax.lax.stop_gradient(lost)

    end, _, event, _, status = starts((Event(condition, samples=4),))(ball(1e4), 0.0, 3.0)
    assert status == Status.EVENT and event == 0
    # Newton's correction at the end adds the noise that is asked for here.
    np.testing.assert_allclose(end, zero, atol=1.01 * noise)


@pytest.mark.parametrize(("start", "end"), [(0.0, 6.0), (6.0, 0.0)])
def test_a_zero_at_the_start_is_not_found_again(start, end):
    """By the state and by the time alone, both ways: a height that is passed twice, and times far
    from zero, where the time itself is rounded to a ten millionth of a second."""
    thrown = ball(3.0, 25.0)
    y = simulate(FALL, thrown, jnp.array([0.0, start])).final if start else thrown
    level = (Event(lambda t, y: y.position[2] - 20.0),)
    exact = (25.0 + np.array([-1.0, 1.0]) * np.sqrt(25.0**2 - 2.0 * G * 17.0)) / G
    found = [t for t, _ in sequence(level, y, start, end)]
    np.testing.assert_allclose(found, exact if end > start else exact[::-1], rtol=1e-9)
    late = (Event(lambda t, y: jnp.sin(t - 1e9)),)
    begin, stop = 1e9 + np.clip([start, end], 0.5, 6.0)
    found = [t for t, _ in sequence(late, y, begin, stop)]
    np.testing.assert_allclose(found, [1e9 + np.pi], rtol=1e-15)


def test_a_distance_rounded_far_from_the_origin_is_not_found_again():
    """The distance from a far centre is known to 1e-9 m, and the time begins anew at zero."""
    centre = jnp.array([0.0, 0.0, -6.4e6])

    def height(t, y):
        r = y.position - centre
        return jnp.sqrt(dot(r, r)) - (6.4e6 + 20.0)

    run = starts((Event(height),))
    t, y, event, _, _ = run(ball(3.0, 25.0), 0.0, 6.0)
    assert event == 0
    # The events of the way up and down, the time counted from the last one.
    later, y, event, _, _ = run(y, 0.0, 6.0)
    np.testing.assert_allclose(later, 2.0 * np.sqrt(25.0**2 - 2.0 * G * 17.0) / G, rtol=1e-9)
    assert event == 0 and run(y, 0.0, 6.0)[2] == -1


def test_two_conditions_zero_at_one_time_are_both_reported():
    """A ball at its highest point just when a clock rings, and a third event elsewhere."""
    apex = Event(lambda t, y: y.velocity[2])
    clock = Event(lambda t, y: t - 2.0)
    other = Event(lambda t, y: t - 2.001)
    run = starts((other, clock, apex))
    t, y, event, happened, status = run(ball(1.0, 2.0 * G), 0.0, 3.0)
    assert event in (1, 2) and status == Status.EVENT
    np.testing.assert_array_equal(happened, [False, True, True])
    t, _, event, happened, _ = run(y, t, 3.0)
    assert event == 0 and np.array_equal(happened, [True, False, False])
    # A phase may take up what ended the phase before it, too.
    ring = Event(lambda t, y: t - 2.0, within=1.0, at_start=True)
    phases = [Phase(FALL, Event(apex.condition, within=3.0), name="up")]
    flight = simulate_mission(
        Mission([*phases, Phase(FALL, ring, name="ring")]), ball(1.0, 2.0 * G)
    )
    assert flight.status == Status.EVENT
    np.testing.assert_allclose(flight.end, 2.0, rtol=1e-12)


@pytest.mark.parametrize(
    ("direction", "expected"), [(1, [3.03, 17.03]), (-1, []), (0, [3.03, 17.03])]
)
def test_a_touch_is_reported_once_on_request(direction, expected):
    """g = (t - 3.03)^2 (t - 17.03)^2 ((t - 10)^2 + 1) touches zero twice from above, and has two
    other extrema far from zero."""

    def condition(t, y):
        return (t - 3.03) ** 2 * (t - 17.03) ** 2 * ((t - 10.0) ** 2 + 1.0)

    found = sequence((Event(condition, direction, touch=1e-6),), ball(1e4), 0.0, 20.0)
    np.testing.assert_allclose([t for t, _ in found], expected, rtol=1e-12)


def test_the_time_of_a_touch_is_differentiable():
    """The highest point of a throw, where the height touches that of a ceiling."""

    def when(speed):
        ceiling = Event(lambda t, y: y.position[2] - 20.0**2 / (2.0 * G), touch=1.0)
        return simulate(FALL, ball(0.0, speed), jnp.array([0.0, 3.0]), events=(ceiling,)).ts[-1]

    value, slope = jax.value_and_grad(when)(20.0)
    np.testing.assert_allclose([value, slope], [20.0 / G, 1.0 / G], rtol=1e-12)


def test_bounces_until_the_time_resolves_them_no_more():
    """EV-BOUNCE: speeds and times of every bounce, and a name for the pile-up."""

    def rebound(t, y):
        return BodyState(y.position, -0.5 * y.velocity)

    floor = Event(lambda t, y: y.position[2], direction=-1, within=2.0)
    phases = [Phase(FALL, floor, rebound, f"{k}") for k in range(52)]
    run = simulate_mission(Mission(phases), ball(), throw=False, accuracy=1e-12)
    statuses = np.array([phase.status for phase in run.phases])
    count = int(np.argmax(statuses != Status.EVENT))
    # The flights halve, from three seconds to some hundred roundings of the time.
    assert 42 < count < 50 and statuses[count] == Status.EVENTS_PILE_UP
    assert run.status == Status.EVENTS_PILE_UP
    k = np.arange(count)
    first = np.sqrt(2.0 * 10.0 / G)
    times = [float(phase.ts[-1]) for phase in run.phases[:count]]
    speeds = [float(phase.final.velocity[2]) for phase in run.phases[:count]]
    np.testing.assert_allclose(times, first * (3.0 - 2.0 * 0.5**k), rtol=1e-13)
    # A velocity of 10 m/s is rounded to 1e-15, which the last bounces halve with it; their flights
    # are rounded, too.
    np.testing.assert_allclose(speeds[:40], -G * first * 0.5 ** k[:40], rtol=1e-4)
    with pytest.raises(SimulationError, match="faster than the time resolution"):
        simulate_mission(Mission(phases), ball(), accuracy=1e-12)


@pytest.mark.sweep
def test_a_condition_that_is_not_finite_has_a_status():
    """NaN from t = 4 on: found is what lies before it, and what might lie behind it is named."""
    for level, status in ((1.0, Status.EVENT), (-1.0, Status.CONDITION_NOT_FINITE)):
        event = Event(lambda t, y, level=level: jnp.sqrt(4.0 - t) - level)
        run = simulate(FALL, ball(), jnp.linspace(0.0, 5.0, 3), events=(event,), throw=False)
        assert run.status == status
        assert np.all(np.isnan(run.states.position[:, 1:])) == (status != Status.EVENT)
    np.testing.assert_allclose(run.ts[-1], 5.0)
    with pytest.raises(SimulationError, match="condition of an event became NaN"):
        simulate(FALL, ball(), jnp.array([0.0, 5.0]), events=(event,))


def test_a_search_that_does_not_converge_is_no_event(monkeypatch):
    monkeypatch.setattr("jaxspace.integration._step_zero.SAMPLINGS", 1)
    event = Event(lambda t, y: y.position[2] ** 3, within=2.0)
    run = simulate(FALL, ball(), jnp.array([0.0, 2.0]), events=(event,), throw=False)
    assert run.status == Status.EVENT_UNRESOLVED and np.all(np.isnan(run.final.position))
    mission = Mission([Phase(FALL, event)])
    assert simulate_mission(mission, ball(), throw=False).status == Status.EVENT_UNRESOLVED


def test_a_condition_that_jumps_is_found_by_halving():
    event = Event(lambda t, y: jnp.where(t > 1.2345, 1.0, -1.0))
    run = simulate(FALL, ball(), jnp.array([0.0, 2.0]), events=(event,))
    np.testing.assert_allclose(run.ts[-1], 1.2345, rtol=1e-14)
