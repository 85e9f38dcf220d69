"""Events that the steps of a run find by themselves: one program, every run of a batch at its own
event, two zeros in one step, and conditions that no polynomial describes."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.extend.core import subjaxprs
from jaxtyping import Array, Float

from jaxspace import (
    BodyState,
    simulate,
    simulate_batch,
    simulate_mission,
    simulate_mission_batch,
)
from jaxspace.core import AbstractClosedForm, AbstractSystem
from jaxspace.simulation import Accuracy, Event, Mission, Phase, Status
from jaxspace.solvers import DOP853, RKN1210, MuntheKaas, Tsit5

G = 9.81


def downwards(y):
    """The unit vector of gravity."""
    runs = y.velocity.ndim - 1
    return jnp.array([0.0, 0.0, -1.0], y.velocity.dtype).reshape(3, *(1,) * runs)


class Throw(AbstractSystem):
    """A ball under gravity."""

    def vector_field(self, t, y):
        return BodyState(y.velocity, 0.0 * y.velocity + G * downwards(y))

    def invariants(self, t, y):
        return {}


class Dragged(AbstractSystem):
    """A ball that drag slows."""

    drag: Float[Array, "*#runs"]

    def vector_field(self, t, y):
        speed = jnp.sqrt(jnp.sum(y.velocity * y.velocity, axis=0))
        return BodyState(y.velocity, G * downwards(y) - self.drag * speed * y.velocity)

    def invariants(self, t, y):
        return {}


class Pushed(AbstractSystem):
    """A ball that a motor pushes upwards until it burns out, at 2 s."""

    def vector_field(self, t, y):
        force = G - jnp.where(t < 2.0, 20.0, 0.0)
        return BodyState(y.velocity, 0.0 * y.velocity + force * downwards(y))

    def breaks(self):
        return jnp.array([2.0])

    def invariants(self, t, y):
        return {}


class Large(AbstractSystem):
    """A ball under gravity, as a field of so many operations that its stages are a loop."""

    def vector_field(self, t, y):
        zero = y.position[2]
        for _ in range(300):
            zero = jnp.sin(zero)
        # Of no value: it marks the vector field in a traced program.
        mark = jax.lax.erf_inv(0.0 * zero)
        return BodyState(y.velocity, 0.0 * y.velocity + (G + mark) * downwards(y))

    def invariants(self, t, y):
        return {}


def ball(height=10.0, speed=0.0):
    zero = 0.0 * jnp.asarray(height)
    at = jnp.stack([zero, zero, zero + height])
    return BodyState(at, jnp.stack([zero, zero, zero + speed]))


def fields_in(function, *args):
    """How often the vector field stands in the traced program."""

    def count(jaxpr):
        own = sum(e.primitive.name == "erf_inv" for e in jaxpr.eqns)
        # The program of an integration is known to its primitive alone.
        inner = [e.params["problem"].solve_jaxpr.jaxpr for e in jaxpr.eqns if "problem" in e.params]
        return own + sum(map(count, [*subjaxprs(jaxpr), *inner]))

    return count(jax.make_jaxpr(function)(*args).jaxpr)


def with_number(condition, number):
    """A condition of (number, t, y) with its number as a leaf, so that all share a program."""
    return jax.tree_util.Partial(condition, jnp.asarray(number))


def above(height, t, y):
    return y.position[2] - height


def faster(speed, t, y):
    return y.velocity[2] - speed


GROUND = Event(lambda t, y: y.position[2], within=60.0)


def test_the_vector_field_of_a_phase_stands_in_its_program_once():
    """In the steps: a large field finds the first of them by trial."""

    def phase(until, num_saved):
        mission = Mission(Phase(Large(), until))
        return lambda y: simulate_mission(mission, y, num_saved=num_saved, throw=False).final

    def run(y):
        return simulate(Large(), y, jnp.array([0.0, 1.0]), throw=False).final

    for until in (GROUND, 1.0):
        assert fields_in(phase(until, 2), ball()) == 1
        assert fields_in(phase(until, 9), ball()) == 1
    assert fields_in(run, ball()) == 1


def integrations_in(function, *args):
    """The integrations in the traced program."""
    known = "integrate", "integrate_recorded"

    def names(jaxpr):
        own = [e.primitive.name for e in jaxpr.eqns if e.primitive.name in known]
        return own + [name for inner in subjaxprs(jaxpr) for name in names(inner)]

    return names(jax.make_jaxpr(function)(*args).jaxpr)


def test_a_gradient_to_an_event_integrates_once():
    """Along the recorded steps of the run that locates the event."""

    def end(v):
        return simulate_mission(Mission(Phase(Throw(), GROUND)), ball(10.0, v), throw=False).end

    assert integrations_in(jax.grad(end), 25.0) == ["integrate_recorded"]


@pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev])
def test_runs_that_meet_their_events_early_keep_their_derivatives(mode):
    """In a block of runs that go on for thousands of steps, of which a record holds every
    sixteenth state: T = (v + sqrt(v^2 + 20 g))/g, T' = T/sqrt(v^2 + 20 g)."""
    how = Accuracy(rtol=1e-3, method=Tsit5(), max_step=2e-3, max_steps=8192)
    mission = Mission(Phase(Throw(), GROUND))

    def both(speeds):
        run = simulate_mission_batch(mission, ball(10.0 + 0.0 * speeds, speeds), accuracy=how)
        return run.end, run.final.velocity[2]

    speeds = jnp.array([-5.0, 0.0, 8.0, 60.0])
    root = np.sqrt(speeds**2 + 20.0 * G)
    of_end, of_speed = mode(both)(speeds)
    # A few thousand roundings, and one more for each step.
    np.testing.assert_allclose(of_end, np.diag((1.0 + speeds / root) / G), rtol=1e-11, atol=1e-14)
    np.testing.assert_allclose(of_speed, np.diag(-speeds / root), rtol=1e-11, atol=1e-13)


def test_states_on_the_way_to_an_event_and_their_slopes_are_those_of_the_formula():
    """Of one run, whose program serves twice: z = 10 + v t - g t^2/2 at parts of the time
    T = (v + sqrt(v^2 + 20 g))/g. The times on the way are held fixed: dz/dv = t."""

    def saved(v):
        run = simulate_mission(Mission(Phase(Throw(), GROUND)), ball(10.0, v), num_saved=9)
        return run.phases[0].ts, run.phases[0].states.position[2], run.status

    (ts, z, status), (of_ts, of_z, _) = jax.jit(lambda v: jax.jvp(saved, (v,), (1.0,)))(25.0)
    root = np.sqrt(25.0**2 + 2.0 * G * 10.0)
    times = np.linspace(0.0, 1.0, 9) * (25.0 + root) / G
    assert status == Status.EVENT
    np.testing.assert_allclose(ts, times, rtol=1e-14)
    np.testing.assert_allclose(z, 10.0 + 25.0 * times - 0.5 * G * times**2, atol=1e-12)
    np.testing.assert_allclose(of_z, [*times[:-1], 0.0], atol=1e-9)
    np.testing.assert_allclose(of_ts, [*(8 * [0.0]), (1.0 + 25.0 / root) / G], atol=1e-12)
    # Not met: the states go on to the limit of the time.
    away = Event(lambda t, y: y.position[2] + 1e3, within=2.0)
    run = simulate_mission(Mission(Phase(Throw(), away)), ball(), num_saved=3, throw=False)
    assert run.status == Status.EVENT_MISSED
    np.testing.assert_allclose(run.phases[0].ts, [0.0, 1.0, 2.0], rtol=1e-15)


@pytest.mark.parametrize("method", [DOP853(), Tsit5(), MuntheKaas(), RKN1210()])
def test_the_ground_by_every_method_that_has_polynomials(method):
    """h + v t - g t^2/2 = 0, whose zero is exact to rounding: every method here is exact for it."""
    height, speed = 10.0, 25.0
    flight = simulate(
        Throw(),
        ball(height, speed),
        jnp.array([0.0, 1.0, 2.0, 60.0]),
        accuracy=Accuracy(1e-8, method=method),
        events=(Event(GROUND.condition),),
    )
    exact = (speed + np.sqrt(speed**2 + 2.0 * G * height)) / G
    np.testing.assert_allclose(flight.ts, [0.0, 1.0, 2.0, exact], rtol=1e-13)
    t = np.asarray(flight.ts)
    # Within steps the polynomials are those of the motion, too.
    np.testing.assert_allclose(
        flight.states.position[2], height + speed * t - 0.5 * G * t * t, rtol=0, atol=1e-11
    )


def test_every_run_of_a_batch_ends_at_its_own_event():
    """Many steps apart, one on the way down alone, one at once, and one not at all: as in a run
    of its own, within the tolerance."""
    speeds = jnp.array([1.0, 60.0, 400.0, 0.0, 4e4])
    drags = jnp.array([1e-3, 1e-3, 3e-3, 0.0, 0.0])
    system, y0 = Dragged(drags), ball(jnp.full(5, 10.0), speeds)
    top = Event(lambda t, y: y.velocity[2], -1, within=200.0, at_start=True)
    mission = Mission([Phase(system, top, name="up"), Phase(system, GROUND, name="down")])
    how = Accuracy(1e-10)
    batch = simulate_mission_batch(mission, y0, accuracy=how)
    assert batch["up"].status.tolist() == [Status.EVENT] * 4 + [Status.EVENT_MISSED]
    for k in range(4):
        one = Dragged(drags[k])
        alone = simulate_mission(
            Mission([Phase(one, top, name="up"), Phase(one, GROUND, name="down")]),
            ball(10.0, speeds[k]),
            accuracy=how,
        )
        np.testing.assert_allclose(batch.end[k], alone.end, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(
            batch.final.velocity[2, k], alone.final.velocity[2], rtol=1e-8, atol=1e-9
        )


def test_a_run_that_is_lost_says_so_while_others_end_at_their_events():
    """The block ends with the last event, before the end of the time."""

    class Lost(AbstractSystem):
        """A ball whose gravity is no number below this height."""

        floor: Float[Array, "*#runs"]

        def vector_field(self, t, y):
            g = jnp.where(y.position[2] < self.floor, jnp.nan, G)
            return BodyState(y.velocity, 0.0 * y.velocity + g * downwards(y))

        def invariants(self, t, y):
            return {}

    system = Lost(jnp.array([-1e3, 5.0, -1e3]))
    ends = simulate_mission_batch(Mission(Phase(system, GROUND)), ball(jnp.full(3, 10.0)))
    assert ends.status.tolist() == [Status.EVENT, Status.NOT_FINITE, Status.EVENT]
    fall = np.sqrt(20.0 / G)
    np.testing.assert_allclose(ends.end[jnp.array([0, 2])], fall, rtol=1e-9)
    alone = simulate_mission(Mission(Phase(Lost(5.0), GROUND)), ball(), throw=False)
    assert alone.status == Status.NOT_FINITE and np.all(np.isnan(alone.final.position))


@pytest.mark.parametrize("gap", [1e-2, 1e-4, 1e-7])
def test_two_zeros_in_one_step_are_not_stepped_over(gap):
    """A ball that rises above a height by little, in a step that is as long as the flight."""
    top = 0.5 * 25.0**2 / G
    event = Event(with_number(above, top - 0.5 * G * gap * gap), samples=8)
    run = simulate(Throw(), ball(0.0, 25.0), jnp.array([0.0, 5.0]), events=(event,))
    assert run.status == Status.EVENT
    # A height known to rounding, 32 m, gives the time before the top to sqrt(2 eps h/g).
    np.testing.assert_allclose(run.ts[-1], 25.0 / G - gap, atol=max(1e-14 / gap, 1e-9))


def test_an_event_right_behind_a_break():
    """The motor burns out in the step before, or in the same time to rounding: each end is that of
    the formulas before and after."""
    for late in (1e-9, 1e-3, 0.7):
        system = Pushed()
        # v = (push - g) t until the burnout, then v - g (t - burnout).
        speed = 2.0 * (20.0 - G) - G * late
        slow = Event(with_number(faster, speed), -1, within=10.0)
        end = simulate_mission(Mission(Phase(system, slow)), ball(0.0, 0.0)).end
        np.testing.assert_allclose(end, 2.0 + late, rtol=1e-14, atol=1e-14)


@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize("slope", [0.0, 1.0])
def test_a_condition_that_jumps_ends_the_run_where_it_does(slope, backwards):
    """No slope leads anywhere: the polynomial's bracket does."""

    def jumps(t, y):
        return jnp.where(t < 1.234567, -1.0, 2.0) + slope * (t - 1.3) + 0.0 * y.position[2]

    ts = jnp.array([3.0, 0.0] if backwards else [0.0, 3.0])
    run = simulate(Throw(), ball(), ts, events=(Event(jumps),))
    np.testing.assert_allclose(run.ts[-1], 1.234567, rtol=1e-14)


def test_derivatives_of_a_phase_are_those_of_the_formula():
    """By the speed and by the gravity-free push, forwards and backwards, through `jit` and `vmap`:
    t = (v + sqrt(v^2 + 2 g h))/g, and the second derivative, too."""

    def end(speed):
        return simulate_mission(Mission(Phase(Throw(), GROUND)), ball(10.0, speed)).end

    def exact(speed):
        return (speed + jnp.sqrt(speed * speed + 2.0 * G * 10.0)) / G

    def reverse_and_second(f):
        return lambda v: jax.jvp(jax.grad(f), (v,), (1.0,))

    for of in (reverse_and_second, jax.jacfwd, lambda f: jax.vmap(jax.grad(f))):
        v = 25.0 if of in (reverse_and_second, jax.jacfwd) else jnp.array([25.0, 30.0])
        np.testing.assert_allclose(jax.jit(of(end))(v), jax.jit(of(exact))(v), rtol=1e-9)


def test_a_condition_over_a_traced_number_keeps_its_derivative():
    """A height that the condition closes over is no leaf of it."""

    def end(height):
        at = Event(lambda t, y: y.position[2] - height, -1, within=60.0)
        return simulate_mission(Mission(Phase(Throw(), at)), ball(10.0, 25.0)).end

    # h = 10 + 25 t - g t^2/2: dt/dh = 1/(25 - g t).
    t, slope = jax.value_and_grad(end)(5.0)
    np.testing.assert_allclose(slope, 1.0 / (25.0 - G * t), rtol=1e-10)


def test_mapped_runs_with_a_condition_that_sums_over_them_are_right():
    """The norm over all axes is right of one run, and of many added up would be wrong."""
    away = Event(lambda t, y: jnp.linalg.norm(y.position) - 20.0, within=60.0)

    def end(speed):
        return simulate_mission(Mission(Phase(Throw(), away)), ball(10.0, speed), throw=False).end

    speeds = jnp.array([25.0, 40.0])
    np.testing.assert_allclose(jax.vmap(end)(speeds), [float(end(v)) for v in speeds], rtol=1e-9)


def test_mapped_runs_take_the_steps_of_a_batch():
    """Also the first one, which is not estimated where an event is sought."""
    drags, ts = jnp.linspace(0.01, 0.02, 5), jnp.array([0.0, 60.0])

    def end(drag):
        return simulate(Dragged(drag), ball(10.0, 25.0), ts, events=(GROUND,)).ts[-1]

    batch = simulate_batch(Dragged(drags), ball(10.0, 25.0), ts, events=(GROUND,))
    np.testing.assert_array_equal(jax.vmap(end)(drags), batch.ts[-1])


def test_a_condition_that_is_not_finite_before_its_zero_says_so():
    """And only then: behind the event it may be what it will."""

    def condition(wrong, t, y):
        return jnp.where(t > wrong, jnp.nan, t - 1.5)

    def at(wrong):
        return Event(with_number(condition, wrong), within=3.0)

    before, after = (
        simulate_mission(Mission(Phase(Throw(), at(t))), ball(), throw=False).status
        for t in (1.0, 2.9)
    )
    assert before == Status.CONDITION_NOT_FINITE
    assert after == Status.EVENT


def test_a_run_is_its_single_precision():
    """Within the steps that single precision resolves."""
    y0 = jax.tree.map(lambda x: x.astype(jnp.float32), ball(10.0, 25.0))
    run = simulate_mission(Mission(Phase(Throw(), GROUND)), y0, accuracy=1e-5)
    exact = (25.0 + np.sqrt(25.0**2 + 2.0 * G * 10.0)) / G
    assert run.end.dtype == jnp.float32
    np.testing.assert_allclose(run.end, exact, rtol=1e-5)


class Drift(AbstractSystem):
    """A body without forces: its steps are as long as they may be."""

    def vector_field(self, t, y):
        return BodyState(y.velocity, 0.0 * y.velocity)

    def invariants(self, t, y):
        return {}


class UniformMotion(AbstractClosedForm):
    """Of the body without forces, as far as `y` is a number: for 4.5 s from where it starts."""

    def flow(self, duration, y):
        known = jnp.abs(duration) <= 4.5
        return BodyState(jnp.where(known, y.position + duration * y.velocity, jnp.nan), y.velocity)


class ExactDrift(Drift):
    """The same body in closed form."""

    def closed_form(self):
        return UniformMotion()


DRIFTS = [(Drift(), DOP853()), (ExactDrift(), "closed_form")]
EACH_DRIFT = pytest.mark.parametrize("drift, method", DRIFTS, ids=["steps", "closed form"])


class Pair(eqx.Module):
    """(t - a)(t - b): falls through zero at a, and rises through it at b."""

    a: Float[Array, "*#runs"]
    b: Float[Array, "*#runs"]

    def __call__(self, t, y):
        return (t - self.a) * (t - self.b)


def pairs(runs):
    """Places of two zeros, from far apart to a hundred thousandth of the run."""
    rng = np.random.default_rng(4)
    a = rng.uniform(0.1, 4.0, runs)
    return jnp.asarray(a), jnp.asarray(a + 10.0 ** rng.uniform(-5.0, -0.2, runs))


@EACH_DRIFT
@pytest.mark.parametrize("direction", [-1, 0, 1])
def test_the_first_of_two_zeros_is_found_however_close_they_are(direction, drift, method):
    a, b = pairs(300)
    event = Event(Pair(a, b), direction, within=5.0)
    still = BodyState(jnp.zeros((3, 300)), jnp.ones((3, 300)))
    how = Accuracy(method=method)
    run = simulate_mission_batch(Mission(Phase(drift, event)), still, accuracy=how)
    assert np.all(run.status == Status.EVENT)
    # Roundings of a time of 5 s.
    np.testing.assert_allclose(run.end, b if direction == 1 else a, rtol=0.0, atol=1e-14)


@EACH_DRIFT
def test_a_single_run_finds_what_that_of_a_batch_finds(drift, method):
    still = BodyState(jnp.zeros(3), jnp.ones(3))
    how = Accuracy(method=method)
    for a, b in zip(*pairs(12), strict=True):
        run = simulate_mission(
            Mission(Phase(drift, Event(Pair(a, b), within=5.0))), still, accuracy=how
        )
        np.testing.assert_allclose(run.end, a, rtol=0.0, atol=1e-14)


@EACH_DRIFT
def test_a_run_backwards_finds_the_later_zero_first(drift, method):
    still = BodyState(jnp.zeros(3), jnp.ones(3))
    ts, how = jnp.array([5.0, 1.0]), Accuracy(method=method)
    for a, b in zip(*pairs(6), strict=True):
        run = simulate(drift, still, ts, events=(Event(Pair(a, b)),), accuracy=how)
        # Roundings of a time of 5 s.
        np.testing.assert_allclose(run.ts[-1], jnp.maximum(b, 1.0), rtol=0.0, atol=1e-14)


@EACH_DRIFT
@pytest.mark.parametrize("level", [0.3, 1.3])
def test_a_zero_just_ahead_of_what_is_not_finite_is_found(level, drift, method):
    """Of sqrt(4 - t) in one part of a step, whose later samples are NaN."""
    event = Event(lambda t, y: jnp.sqrt(4.0 - t) - level)
    still = BodyState(jnp.zeros(3), jnp.ones(3))
    ts, how = jnp.array([0.0, 5.0]), Accuracy(method=method)
    run = simulate(drift, still, ts, events=(event,), accuracy=how)
    np.testing.assert_allclose(run.ts[-1], 4.0 - level**2, rtol=1e-14)


@pytest.mark.parametrize("height, status", [(4.0, Status.EVENT), (4.7, Status.NOT_FINITE)])
def test_a_closed_form_that_ends_is_searched_as_far_as_it_goes(height, status):
    """The state is not finite behind 4.5 s, and neither is the condition: that of the state
    counts."""
    event = Event(lambda t, y: y.position[0] - height)
    still = BodyState(jnp.zeros(3), jnp.ones(3))
    ts = jnp.array([0.0, 5.0])
    run = simulate(
        ExactDrift(),
        still,
        ts,
        events=(event,),
        accuracy=Accuracy(method="closed_form"),
        throw=False,
    )
    assert run.status == status
    if status == Status.EVENT:
        np.testing.assert_allclose(run.ts[-1], height, rtol=1e-14)
