"""Closed loops: against difference equations that are exact between samples, and their hard
cases."""

from xml.etree import ElementTree

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float

from jaxspace import BodyState, Event, Scene, Status
from jaxspace.bodies import AbstractEffect, Load, RigidBody
from jaxspace.control import (
    AbstractController,
    ClosedLoop,
    CommandedAcceleration,
    CommandedTorque,
    Sensor,
    StarTracker,
)
from jaxspace.control._integral import integrated, integrating, unwound
from jaxspace.control.attitude_laws import QuaternionFeedback
from jaxspace.control.point_laws import PID, LinearController
from jaxspace.core import InputError, quantity
from jaxspace.rotations import Quaternion
from jaxspace.scene import Custom
from jaxspace.simulation import SimulationError, crossings

# A point under a commanded acceleration: between samples its motion is a polynomial, which every
# step of a Runge-Kutta method takes exactly, so that only rounding is left.
POINT = Scene([CommandedAcceleration()])
START = BodyState(jnp.array([1.0, -2.0, 0.5]), jnp.array([0.3, 0.1, -0.2]))
ROUNDING = 1e-12
KP, KD, T = 1.2, 1.5, 0.4


def sampled(x, v, span, period=T, delay=0, hold="zero", limit=np.inf, quantum=0.0, ki=None):
    """The loop of a PD or PI law as a difference equation, its commands and its end."""
    sent, log, t, total = [], [], 0.0, np.zeros_like(x)
    queue = [np.zeros_like(x)] * delay
    while t < span - 1e-9:
        asked = -KP * x - KD * v
        new = total
        if ki is not None:
            new = total + (period if sent else 0.0) * -x
            asked = asked + ki * new
        u = np.clip(asked, -limit, limit)
        total = np.where(u == asked, new, total)
        u = np.round(u / quantum) * quantum if quantum else u
        queue.append(u)
        u = queue.pop(0)
        slope = (u - log[-1]) / period if hold == "first" and log else np.zeros_like(x)
        sent.append(u), log.append(u)
        h = min(period, span - t)
        x = x + h * v + h**2 / 2 * u + h**3 / 6 * slope
        v = v + h * u + h**2 / 2 * slope
        t += h
    return x, v, np.stack(log, -1)


@pytest.mark.parametrize(
    ("span", "options", "expected"),
    [
        # The last sample lies 0.1 s before the end: the period does not divide the span.
        (4.1, {}, {}),
        (4.0, {"delay": 2 * T}, {"delay": 2}),
        (4.0, {"hold": "first"}, {"hold": "first"}),
        (4.0, {"limit": 0.7, "quantum": 0.25}, {"limit": 0.7, "quantum": 0.25}),
    ],
    ids=["undivided", "delay", "first_order", "limit_quantum"],
)
def test_the_loop_is_its_difference_equation(span, options, expected):
    loop = ClosedLoop(POINT, PID(KP, KD), period=T, **options)
    run = loop.simulate(START, np.append(np.arange(0.0, span - 1e-9, T), span))
    x, v, commands = sampled(
        np.asarray(START.position), np.asarray(START.velocity), span, **expected
    )
    np.testing.assert_allclose(run.final.position, x, atol=ROUNDING)
    np.testing.assert_allclose(run.final.velocity, v, atol=ROUNDING)
    np.testing.assert_allclose(run.commands[:, :-1], commands, atol=ROUNDING)


def test_a_delay_between_samples():
    """A command that arrives a quarter of a period late acts from there on."""
    loop = ClosedLoop(POINT, PID(KP, KD), period=T, delay=0.25 * T)
    run = loop.simulate(START, [0.0, 2.0 * T])
    x, v, u = np.asarray(START.position), np.asarray(START.velocity), 0.0
    for _ in range(2):
        new = -KP * x - KD * v
        for h, a in ((0.25 * T, u), (0.75 * T, new)):
            x, v = x + h * v + h**2 / 2 * a, v + h * a
        u = new
    np.testing.assert_allclose(run.final.position, x, atol=ROUNDING)


def test_an_integral_of_many_samples_in_single_precision():
    """A constant error over 100,000 samples, whose times are exact: each adds a few roundings of
    the integral only, and a plain sum is off by two parts in a thousand."""
    error = jnp.array([1.1, -0.3, 0.0], jnp.float32)
    samples, step = 100_000, 1.0 / 128.0

    def sample(memory, k):
        return integrated(memory, k.astype(jnp.float32) * step, error), None

    memory, _ = jax.lax.scan(sample, integrating(error), jnp.arange(samples))
    exact = np.asarray(error, float) * (samples - 1) * step
    np.testing.assert_allclose(memory.total, exact, rtol=1e-6)
    # Without the last sample both are as before.
    back = unwound(integrated(memory, jnp.float32(samples * step), error), jnp.array(True))
    np.testing.assert_array_equal(back.total, memory.total)
    np.testing.assert_array_equal(back.rest, memory.rest)


def test_an_integral_does_not_wind_up():
    """Beside the difference equation; and without the rule the overshoot is larger."""
    x0, v0 = np.asarray(START.position), np.asarray(START.velocity)
    law = PID(KP, KD, 0.4)
    run = ClosedLoop(POINT, law, period=T, limit=0.3).simulate(START, np.arange(0.0, 40.0, T))
    x, v, _ = sampled(x0, v0, run.ts[-1].item(), limit=0.3, ki=0.4)
    np.testing.assert_allclose(run.final.position, x, atol=1e-10)
    # A limit inside of the law's reach, which the law is not told of: the integral winds up.
    blind = PID(KP, KD, 0.4)

    class Blind(AbstractController):
        def start(self, measured):
            return blind.start(measured)

        def act(self, t, memory, measured):
            u, memory = blind.act(t, memory, measured)
            return jnp.clip(u, -0.3, 0.3), memory

    wound = ClosedLoop(POINT, Blind(), period=T).simulate(START, np.arange(0.0, 40.0, T))
    assert np.abs(run.states.position[1]).max() < np.abs(wound.states.position[1]).max()
    assert np.max(run.states.position[1]) < 0.7 * np.max(wound.states.position[1])


def test_runs_trail_and_each_is_its_own():
    """A batch, its gains of each run, against the runs alone; every third has a NaN gain."""
    gains = jnp.linspace(0.8, 1.6, 6).at[2].set(jnp.nan)
    starts = jax.tree.map(lambda x: x[:, None] * jnp.linspace(1.0, 2.0, 6), START)

    def loop(k):
        # A NaN is refused where it is known; inside a program it is not.
        return eqx.tree_at(
            lambda c: c.controller.proportional, ClosedLoop(POINT, PID(1.0, KD), period=T), k
        )

    run = loop(gains).simulate_batch(starts, [0.0, 2.0, 4.0])
    assert run.status.tolist() == [0, 0, Status.COMMAND_NOT_FINITE, 0, 0, 0]
    assert np.isnan(run.final.position[:, 2]).all() and run.states.position.shape == (3, 3, 6)
    alone = loop(gains[4]).simulate(jax.tree.map(lambda x: x[:, 4], starts), [0.0, 2.0, 4.0])
    np.testing.assert_allclose(run.states.position[..., 4], alone.states.position, atol=ROUNDING)
    with pytest.raises(SimulationError, match="controller returned a command that is NaN"):
        loop(gains[2]).simulate(START, [0.0, 4.0])
    # One of them taken out reads as it was, and is flown again as it was: each with its own gain.
    one = run.of(4)
    np.testing.assert_array_equal(one.commands, run.commands[..., 4])
    for x, y in zip(*map(jax.tree.leaves, (one.error(), alone.error())), strict=True):
        np.testing.assert_allclose(x, y, atol=ROUNDING)
    with pytest.raises(InputError, match="Run number 6 is out of range"):
        run.of(6)
    lines = repr(run).splitlines()
    assert lines[0] == "Closed loop of Scene, 6 runs"
    # The least and the greatest of those that did not fail.
    ends = np.delete(np.asarray(run.commands[:, -1]), 2, axis=1)
    for bound in (ends.min(axis=1), ends.max(axis=1)):
        assert ", ".join(f"{x:.6g}" for x in bound) in lines[-1]


def test_a_run_taken_out_of_a_batch_keeps_its_noise():
    """Flown again with half the steps' length it has the same readings: for steps that are exact
    the error is rounding."""
    sensors = {"position": Sensor("position", noise=0.1), "velocity": Sensor("velocity")}
    loop = ClosedLoop(POINT, PID(KP, KD), sensors, period=T, key=jax.random.key(7))
    starts = jax.tree.map(lambda x: x[:, None] * jnp.linspace(1.0, 2.0, 3), START)
    run = loop.simulate_batch(starts, [0.0, 2.0 * T], start=jnp.array([0.0, 1.0, 2.0])).of(2)
    np.testing.assert_array_equal(run.ts, [2.0, 2.0 + 2.0 * T])
    assert float(jnp.max(jnp.abs(run.readings["position"] - run.states.position))) > 1e-3
    for error in jax.tree.leaves(run.error()):
        np.testing.assert_allclose(error, 0.0, atol=ROUNDING)


@eqx.filter_jit
def end(gain, noise, y0):
    sensors = {
        "position": Sensor("position", noise=noise, bias=0.01, walk=0.01),
        "velocity": Sensor("velocity", quantum=0.01, period=2.0 * T),
    }
    loop = ClosedLoop(POINT, PID(gain, KD), sensors, period=T)
    run = loop.simulate(y0, [0.0, 3.0], key=jax.random.key(3))
    return jnp.sum(run.final.position**2)


def test_gradients_of_gains_sensors_and_states():
    """Both modes agree. The rounded reading passes its slope straight through, so that differences
    say nothing here: the next test compares a loop without it."""
    args = (jnp.asarray(KP), jnp.asarray(0.05), START.position)

    def f(gain, noise, x):
        return end(gain, noise, BodyState(x, START.velocity))

    gradient = jax.grad(f, (0, 1, 2))(*args)
    direction = (jnp.asarray(1.0), jnp.asarray(-0.5), jnp.array([0.2, 0.1, -0.4]))
    _, forward = jax.jvp(f, args, direction)
    along = sum(jnp.sum(g * d) for g, d in zip(gradient, direction, strict=True))
    np.testing.assert_allclose(along, forward, rtol=1e-12)
    assert all(bool(jnp.all(jnp.isfinite(g))) for g in gradient)


def test_gradient_beside_differences():
    def f(gain, x):
        loop = ClosedLoop(POINT, PID(gain, KD), period=T)
        run = loop.simulate(BodyState(x, START.velocity), [0.0, 3.0])
        lines = repr(run).splitlines()
        assert lines[0] == "Closed loop of Scene (traced)" and "(3, 2)" in lines[-1]
        ElementTree.fromstring(run._repr_html_())
        return jnp.sum(run.final.position**2)

    # Value and slope from one program, in which a run prints its shapes.
    f = jax.jit(jax.value_and_grad(f))
    gain, x = jnp.asarray(KP), START.position
    _, slope = f(gain, x)
    # Of second order in the step: 1e-5^2 and a rounding over it.
    difference = (f(gain + 1e-5, x)[0] - f(gain - 1e-5, x)[0]) / 2e-5
    np.testing.assert_allclose(slope, difference, rtol=1e-8)


def test_sensors_are_seeded_and_have_their_deviation():
    """A thousand readings of noise, bias and drift; the tolerances are five standard errors."""
    resting = BodyState(jnp.zeros(3), jnp.zeros(3))
    sensors = {
        "position": Sensor("position", noise=0.2, bias=[1.0, 2.0, 3.0]),
        "velocity": Sensor("velocity", walk=0.1),
    }
    loop = ClosedLoop(POINT, lambda z: 0.0 * z["position"], sensors, period=0.01)
    ts = np.linspace(0.0, 10.0, 1001)
    run = loop.simulate(resting, ts, key=jax.random.key(0))
    read = np.asarray(run.readings["position"][:, :-1])
    np.testing.assert_allclose(read.std(axis=1), 0.2, rtol=5 / np.sqrt(2000))
    np.testing.assert_allclose(read.mean(axis=1), [1, 2, 3], atol=5 * 0.2 / np.sqrt(1000))
    steps = np.diff(run.readings["velocity"][:, :-1])
    np.testing.assert_allclose(steps.std(), 0.1 * 0.1, rtol=5 / np.sqrt(6000))
    again = loop.simulate(resting, ts, key=jax.random.key(0))
    np.testing.assert_array_equal(read, again.readings["position"][:, :-1])
    with pytest.raises(InputError, match="sensor position has noise"):
        loop.simulate(resting, ts)


def test_zero_noise_is_no_sensor_at_all():
    """Of zero deviation, also of an attitude, whose noise is a rotation."""
    scene = Scene([CommandedTorque()], RigidBody(inertia=[1.0, 1.5, 2.0]))
    y0 = BodyState(attitude=Quaternion.identity(), omega=jnp.array([0.1, -0.2, 0.3]))
    law = QuaternionFeedback(2.0, 2.0)
    sensors = {"attitude": StarTracker(0.0), "omega": Sensor("omega", noise=0.0)}

    def final(noise):
        given = eqx.tree_at(lambda s: s["attitude"].noise, sensors, noise)
        loop = ClosedLoop(scene, law, given, period=0.1)
        run = loop.simulate(y0, [0.0, 2.0], key=jax.random.key(1), accuracy=1e-7)
        return run.final.omega, run.final.omega

    # The end and its slopes from one program.
    slopes, omega = jax.jit(jax.jacrev(final, has_aux=True))(jnp.array(0.0))
    plain = ClosedLoop(scene, law, period=0.1).simulate(y0, [0.0, 2.0], accuracy=1e-7)
    np.testing.assert_allclose(omega, plain.final.omega, atol=1e-13)
    assert np.all(np.isfinite(slopes))


class Push(AbstractEffect):
    """An acceleration of one until a time."""

    until: Float[Array, "*#runs"] = quantity("s", doc="end")

    def load(self, t, y, body):
        return Load(acceleration_N=jnp.where(t < self.until, 1.0, 0.0) + 0.0 * y.velocity)

    def breaks(self):
        return self.until[None]


def test_a_sample_on_a_break():
    """A push that ends at a sample and between two, of known time, of a traced one, and of each run
    its own: polynomials on both sides of the break."""
    ends = jnp.array([2.0 * T, 2.5 * T, 0.0, 9.0])

    def loop(until):
        scene = Scene([Push(until), CommandedAcceleration()])
        return ClosedLoop(scene, PID(KP, KD), period=T)

    def expected(until):
        x, v = np.asarray(START.position), np.asarray(START.velocity)
        for k in range(5):
            u = -KP * x - KD * v
            on = np.clip(until - k * T, 0.0, T)
            for h, a in ((on, u + 1.0), (T - on, u)):
                x, v = x + h * v + h**2 / 2 * a, v + h * a
        return x

    ts = [0.0, 5 * T]
    traced = jax.jit(lambda u: loop(u).simulate(START, ts).final.position)
    starts = jax.tree.map(lambda x: jnp.repeat(x[:, None], 4, axis=1), START)
    batch = loop(ends).simulate_batch(starts, ts).final.position
    for k, until in enumerate(ends):
        known = loop(until).simulate(START, ts).final.position
        for found in (known, traced(until), batch[:, k]):
            np.testing.assert_allclose(found, expected(float(until)), atol=ROUNDING)


def test_an_event_on_a_sample_and_between():
    """A fall under a held command ends at its zero, known in closed form, with its derivative;
    at a sample the controller does not act again."""
    event = Event(lambda t, y: y.position[0], direction=-1)

    @jax.jit
    def fall(x):
        y0 = BodyState(jnp.stack([x, 0.0 * x, 0.0 * x]), jnp.array([0.0, 1.0, 0.0]))
        loop = ClosedLoop(POINT, lambda t, z: jnp.array([-2.0, 0.0, 0.0]), period=0.5)
        run = loop.simulate(y0, [0.0, 3.0], events=event, throw=False)
        return run.end, (run.status, run.final.velocity, run.trajectory.ts)

    # x - t^2 = 0: at t = 1.0, which is a sample, and at t = sqrt(0.9).
    for x in (1.0, 0.9):
        (t, (status, velocity, _)), slope = jax.value_and_grad(fall, has_aux=True)(jnp.array(x))
        np.testing.assert_allclose(t, np.sqrt(x), rtol=1e-13)
        np.testing.assert_allclose(slope, 0.5 / np.sqrt(x), rtol=1e-12)
        np.testing.assert_allclose(velocity, [-2.0 * np.sqrt(x), 1.0, 0.0], rtol=1e-12)
        assert status == Status.EVENT


def test_events_of_a_batch_and_one_that_never_happens():
    event = Event(lambda t, y: y.position[0], direction=-1)
    loop = ClosedLoop(POINT, lambda t, z: jnp.array([-2.0, 0.0, 0.0]), period=0.5)
    starts = jax.tree.map(lambda x: jnp.zeros((3, 4)), START)
    starts = eqx.tree_at(
        lambda y: y.position, starts, starts.position.at[0].set(jnp.array([0.25, 1.0, 2.0, 100.0]))
    )
    run = loop.simulate_batch(starts, [0.0, 1.0, 3.0], events=event)
    np.testing.assert_allclose(run.ts[-1], [0.5, 1.0, np.sqrt(2.0), 3.0], rtol=1e-12)
    assert run.status.tolist() == [1, 1, 1, 0]
    needed = Event(lambda t, y: y.position[0], direction=-1, within=3.0)
    run = loop.simulate_batch(starts, [0.0, 1.0, 3.0], events=needed)
    assert run.status.tolist() == [1, 1, 1, Status.EVENT_MISSED]


def test_phases_of_loops_join_at_a_sample():
    """A loop that goes on where another has ended, at a sample, is one loop; its memory passes."""
    loop = ClosedLoop(POINT, PID(KP, KD, 0.3), period=T)
    whole = loop.simulate(START, [0.0, 20 * T])
    first = loop.simulate(START, [0.0, 10 * T])
    second = loop.simulate(first.final, [0.0, 10 * T], start=first.end, memory=first.memory)
    np.testing.assert_allclose(second.final.position, whole.final.position, atol=ROUNDING)
    np.testing.assert_allclose(second.end, whole.end)
    _reads_as_its_trajectory(second)
    # Its system alone does not repeat it: the controller would be missing.
    for repeat in (second.trajectory.error, lambda: crossings(second.trajectory, lambda t, y: t)):
        with pytest.raises(InputError, match="not available for a closed loop"):
            repeat()


def _reads_as_its_trajectory(run):
    """A table of what its controller commanded stands behind that of the states."""
    names = "ts states status event stats accuracy final initial".split()
    for x, y in zip(*([getattr(r, n) for n in names] for r in (run, run.trajectory)), strict=True):
        assert eqx.tree_equal(x, y)
    assert len(run) == 2 and eqx.tree_equal(run[-1], run.final)
    assert run.along(lambda system, t, y: t).tolist() == run.ts.tolist()
    lines = repr(run).splitlines()
    assert lines[0] == "Closed loop of Scene"
    assert lines[3].split() == "control PID, a sample every 0.4 s, zero-order hold".split()
    assert lines[5].split()[0] == "state" and lines[8].split()[0] == "sample"
    assert lines[-1].split()[:3] == ["commands", "(3,", "2)"]
    for command in run.commands.T:
        assert ", ".join(f"{x:.6g}" for x in command.tolist()) in lines[-1]
    # The trajectory knows of no law, and has the rest.
    assert repr(run.trajectory).splitlines()[-5:] == lines[-5:]
    page = run._repr_html_()
    ElementTree.fromstring(page)
    assert page.count("<table>") == 3


def test_too_few_steps_are_repeated_and_told():
    """A stiff spring between slow samples: more steps, or under jit the status."""
    spring = Custom(lambda t, y, body: _pull(y))
    scene = Scene([spring, CommandedAcceleration()])
    loop = ClosedLoop(scene, PID(0.0, 0.1), period=1.0)
    run = loop.simulate(START, [0.0, 3.0], accuracy=1e-9)
    assert run.status == Status.COMPLETED and run.steps > 1
    # The estimate of the error is of the size of the error itself.
    fine = loop.simulate(START, [0.0, 3.0], accuracy=1e-12, steps=4 * run.steps)
    miss = np.abs(run.final.position - fine.final.position).max()
    assert miss < 1e-8 and 0.3 * miss < run.error().position.max() < 3.0 * miss
    status = jax.jit(lambda y: loop.simulate(y, [0.0, 3.0], throw=False).status)(START)
    assert status == Status.TOLERANCE_MISSED


def _pull(y):
    return Load(acceleration_N=-100.0 * y.position)


def test_a_linear_controller_is_its_matrices():
    """With a memory, beside the same sums in NumPy."""
    rng = np.random.default_rng(2)
    a, b, c, d = (
        0.3 * rng.normal(size=(2, 2)),
        *(0.1 * rng.normal(size=s) for s in ((2, 6), (3, 2), (3, 6))),
    )
    law = LinearController(d, a, b, c)
    run = ClosedLoop(POINT, law, period=T).simulate(START, [0.0, 5 * T])
    x, v, m = np.asarray(START.position), np.asarray(START.velocity), np.zeros(2)
    for _ in range(5):
        z = np.concatenate([x, v])
        u, m = c @ m + d @ z, a @ m + b @ z
        x, v = x + T * v + T**2 / 2 * u, v + T * u
    np.testing.assert_allclose(run.final.position, x, atol=ROUNDING)
    with pytest.raises(InputError, match="shapes"):
        LinearController(d, a, b.T, c)


def test_noise_of_a_batch_is_that_of_each_run_alone():
    """Each run draws from its own key of the split."""
    sensors = {"position": Sensor("position", noise=0.1), "velocity": Sensor("velocity")}
    loop = ClosedLoop(POINT, PID(KP, KD), sensors, period=T)
    starts = jax.tree.map(lambda x: jnp.repeat(x[:, None], 3, axis=1), START)
    key = jax.random.key(5)
    batch = loop.simulate_batch(starts, [0.0, 2.0], key=key).final.position
    alone = loop.simulate(START, [0.0, 2.0], key=jax.random.split(key, 3)[1]).final.position
    np.testing.assert_allclose(batch[:, 1], alone, atol=ROUNDING)
    assert jnp.abs(batch[:, 0] - batch[:, 1]).max() > 1e-3


def test_networks_are_controllers():
    """An equinox network over the readings, trained by one step of descent, and in a batch."""
    net = eqx.nn.MLP(6, 3, 8, 1, key=jax.random.key(0))

    class Policy(eqx.Module):
        net: eqx.nn.MLP

        def __call__(self, z):
            return self.net(jnp.concatenate([z.position, z.velocity]))

    starts = jax.tree.map(lambda x: x[:, None] * jnp.linspace(1.0, 2.0, 4), START)

    @eqx.filter_jit
    @eqx.filter_value_and_grad
    def loss(policy):
        run = ClosedLoop(POINT, policy, period=T).simulate_batch(starts, [0.0, 2.0])
        return jnp.mean(run.final.position**2)

    before, gradient = loss(Policy(net))
    after, _ = loss(eqx.apply_updates(Policy(net), jax.tree.map(lambda g: -1e-2 * g, gradient)))
    assert after < before


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: ClosedLoop(POINT, PID(1, 1), period=0.0), "period is 0.0"),
        (lambda: ClosedLoop(POINT, PID(1, 1), period=1.0, hold="second"), "hold"),
        (lambda: ClosedLoop(POINT, PID(1, 1), period=1.0, delay=-1.0), "delay"),
        (lambda: ClosedLoop(POINT, lambda a, b, c: a, period=1.0), "takes 3 arguments"),
        (
            lambda: ClosedLoop(Scene([]), PID(1, 1), period=1.0).simulate(START, [0.0, 1.0]),
            "Scene has no actuator",
        ),
        (lambda: ClosedLoop(POINT, PID(1, 1), period=1.0).simulate(START, [1.0, 0.0]), "ascending"),
        (
            lambda: jax.jit(
                lambda t: ClosedLoop(POINT, PID(1, 1), period=1.0).simulate(START, t).status
            )(jnp.array([0.0, 1.0])),
            "ts is traced: it must be concrete",
        ),
    ],
)
def test_what_no_loop_can_be_flown_with(make, words):
    with pytest.raises(InputError, match=words):
        make()


@pytest.mark.parametrize(
    ("name", "make"),
    [
        ("ClosedLoop.period", lambda x: ClosedLoop(POINT, PID(1, 1), period=x)),
        ("ClosedLoop.delay", lambda x: ClosedLoop(POINT, PID(1, 1), period=1.0, delay=x)),
        ("ClosedLoop.longest", lambda x: ClosedLoop(POINT, PID(1, 1), period=1.0, longest=x)),
        ("Sensor.period", lambda x: Sensor("position", period=x)),
        ("StarTracker.period", lambda x: StarTracker(period=x)),
    ],
)
def test_times_that_decide_how_many_samples_there_are_must_be_known(name, make):
    def used(x):
        make(x)
        return x

    for transformed, x in ((jax.jit, 1.0), (jax.grad, 1.0), (jax.vmap, jnp.ones(2))):
        with pytest.raises(InputError, match=f"{name} is traced: it must be a concrete number"):
            transformed(used)(x)
    with pytest.raises(InputError, match=f"{name} is 'a': it must be a number, in s"):
        make("a")
    # A number of JAX that is known is one.
    make(jnp.asarray(1.0))
