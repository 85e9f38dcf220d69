"""Methods whose stages are a loop of the program: the same steps and derivatives as written out,
from a program that holds the vector field once."""

import functools
import re
from pathlib import Path

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace.bodies import BodyState
from jaxspace.core import AbstractSystem
from jaxspace.core.vectors import dot
from jaxspace.integration import _record
from jaxspace.integration.programs import FEW, POWER, ROLLED_FROM, Runs, rolls_stages
from jaxspace.rotations import Quaternion
from jaxspace.simulation import Accuracy, Mission, Phase, simulate, simulate_batch
from jaxspace.simulation.phases import resolve_phases
from jaxspace.solvers import DOP853, RKN1210, ExponentialRosenbrock, MuntheKaas, Stormer, Tsit5
from jaxspace.solvers.protocol import rolled_stages

ROOT = Path(__file__).parents[2]


class Swing(AbstractSystem):
    """r'' = -r sin(|r|^2 + t), with a frame turned by r at the same time."""

    turning: bool = eqx.field(static=True, default=False)
    additions: int = eqx.field(static=True, default=0)

    def vector_field(self, t, y):
        # Operations that change nothing and compile at once.
        zero = 0.0 * y.position[0]
        for _ in range(self.additions):
            t = t + zero
        a = -y.position * jnp.sin(dot(y.position, y.position) + jnp.asarray(t, y.position.dtype))
        if not self.turning:
            return BodyState(y.velocity, a)
        return BodyState(y.velocity, a, y.attitude.rate(y.position), -0.2 * y.omega)

    def invariants(self, t, y):
        return {}


def start(turning=False, dtype=jnp.float64):
    r, v = jnp.array([1.0, 0.2, -0.3], dtype), jnp.array([0.1, 0.8, 0.4], dtype)
    if not turning:
        return BodyState(r, v)
    return BodyState(
        r, v, Quaternion.about(2, jnp.asarray(0.4, dtype)), jnp.array([0.1, 0.2, 0.3], dtype)
    )


def runs(count):
    return jax.tree.map(lambda x: jnp.stack([x] * count, axis=-1), start())


TERM = diffrax.ODETerm(lambda t, y, system: system.vector_field(t, y))
# Both families; states of several blocks compile for twice as long.
METHODS = [
    pytest.param(RKN1210(), False, id="RKN1210"),
    pytest.param(DOP853(), False, id="DOP853"),
    pytest.param(Tsit5(), False, id="Tsit5"),
    pytest.param(DOP853(), True, id="DOP853 with attitude", marks=pytest.mark.sweep),
    pytest.param(MuntheKaas(), True, id="MuntheKaas", marks=pytest.mark.sweep),
]


def step(method, turning):
    """A step as a function of the state, and states within it."""
    system = Swing(turning)

    def go(y):
        t0, t1 = jnp.array(0.3), jnp.array(0.8)
        state = method.init(TERM, t0, t1, y, system)
        y1, error, dense, _, _ = method.step(TERM, t0, t1, y, system, state, jnp.array(False))
        within = method.interpolation_cls(t0=t0, t1=t1, **dense).evaluate(jnp.array(0.45))
        return y1, error, within

    return go


def far(a, b):
    return max(
        float(jnp.max(jnp.abs(x - y)))
        for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True)
    )


@pytest.mark.parametrize(("method", "turning"), METHODS)
@pytest.mark.parametrize("dtype", [jnp.float64, pytest.param(jnp.float32, marks=pytest.mark.sweep)])
def test_the_loop_takes_the_same_step_with_the_same_derivatives(method, turning, dtype):
    y = start(turning, dtype)
    looped = rolled_stages(method)
    assert type(looped) is type(method)
    assert looped != method
    tangent = jax.tree.map(lambda x: jnp.cos(1.0 + jnp.arange(x.size, dtype=x.dtype)), y)

    def both_modes(method):
        go = step(method, turning)

        @jax.jit
        def found(y, tangent):
            out, pushed = jax.jvp(go, (y,), (tangent,))
            # Without the error: its tangent is the estimate of an error too, for step control, and
            # not linear. Nothing that a run returns depends on it.
            ends, pull = jax.vjp(lambda y: go(y)[::2], y)
            return out, pushed, pull(jax.tree.map(jnp.ones_like, ends))

        return found(y, tangent)

    got, wanted = both_modes(looped), both_modes(method)
    assert all(a.dtype == dtype for a in jax.tree.leaves(got))
    # The sums are taken in another order; derivatives are some tens in size.
    assert far(got, wanted) < 200.0 * float(jnp.finfo(dtype).eps)


@pytest.mark.parametrize(
    ("method", "stages"),
    # Of Tsit5, the first stage is that of the start, or evaluated anew behind a jump; the last one,
    # which only the next step needs, is left out here.
    [
        (DOP853(dense=False), 12),
        (RKN1210(jnp.zeros((0,))), 17),
        (Tsit5(), 7),
    ],
    ids=repr,
)
def test_the_program_holds_the_field_once(method, stages):
    def fields(method):
        def end(y):
            t0, t1, field = jnp.array(0.3), jnp.array(0.8), Swing()
            state = method.init(TERM, t0, t1, y, field)
            return method.step(TERM, t0, t1, y, field, state, jnp.array(False))[0]

        return evaluations(jax.jit(end).lower(start()).as_text())

    assert fields(method) == stages
    assert fields(rolled_stages(method)) == 1


def test_the_dense_output_of_rkn1210_passes_the_stages_of_the_step():
    """Its two shorter steps are no further copies; each of the three has the rate at its end."""

    def fields(method):
        def step(y):
            t0, t1, field = jnp.array(0.3), jnp.array(0.8), Swing()
            state = method.init(TERM, t0, t1, y, field)
            return method.step(TERM, t0, t1, y, field, state, jnp.array(False))[:3]

        return evaluations(jax.jit(step).lower(start()).as_text())

    assert fields(RKN1210()) == 17 + 1
    assert fields(rolled_stages(RKN1210())) == 1 + 1


def evaluations(program):
    """How often the text of a program evaluates the vector field: all stages share its tracing."""
    return len(re.findall(r"call @(evaluate|_acceleration)\w*\(", program))


def test_methods_without_such_a_form_are_their_own():
    for method in (ExponentialRosenbrock(), Stormer(steps=30), diffrax.Dopri8()):
        assert rolled_stages(method) == method
    assert rolled_stages(diffrax.HalfSolver(DOP853())).solver == DOP853(rolled=True)


@pytest.mark.parametrize("method", [DOP853(), RKN1210()], ids=["DOP853", "RKN1210"])
@pytest.mark.slow
def test_derivatives_of_one_run_are_those_of_the_same_run_in_a_batch(method):
    """A single run takes the loop for its derivative, a batch the stages written out."""
    ts = jnp.array([0.0, 1.5, 4.0])
    accuracy = Accuracy(1e-11, method=method)
    y0 = start()
    one = jax.grad(
        lambda y: jnp.sum(simulate(Swing(), y, ts, accuracy=accuracy).states.position[0])
    )(y0)
    runs = jax.tree.map(lambda x: jnp.stack([x, x], axis=-1), y0)
    among = jax.grad(
        lambda y: jnp.sum(simulate_batch(Swing(), y, ts, accuracy=accuracy).states.position[0])
    )(runs)
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(among), strict=True):
        # The steps are the same but for the order of sums within a stage.
        np.testing.assert_allclose(b, jnp.stack([a, a], axis=-1), rtol=1e-9, atol=1e-11)


def end(y, additions, accuracy, ts=(0.0, 1.5)):
    """The end of one run, or of those of a batch."""
    of = simulate if y.position.ndim == 1 else simulate_batch
    return of(Swing(additions=additions), y, jnp.array(ts), accuracy=accuracy).final


@pytest.mark.parametrize(
    ("y", "additions", "looped"),
    [
        pytest.param(start(), 100, False, id="one run"),
        pytest.param(start(), 300, True, id="one run of a large field"),
        pytest.param(runs(1), 300, True, id="one on an axis"),
        pytest.param(runs(2), 300, False, id="many"),
        pytest.param(runs(2), 900, True, id="many of a very large field"),
    ],
)
def test_runs_of_a_large_field_have_rolled_stages(y, additions, looped):
    """One run sooner than many, which are there to be fast."""
    accuracy = Accuracy(1e-6, method=DOP853(dense=False))
    program = jax.jit(lambda y: end(y, additions, accuracy)).lower(y).as_text()
    # Besides the stages, the first step of a small field is chosen by a loop of two evaluations.
    estimate = 1 if additions == 100 else 0
    assert evaluations(program) == estimate + (1 if looped else 12)


@pytest.mark.parametrize(
    ("y", "phases", "looped"), [(runs(2), 3, True), (runs(2), 1, False), (start(), 3, False)]
)
def test_the_phases_of_a_mission_decide_together(y, phases, looped):
    """By the operations of all fields of many runs; one run is decided phase by phase, later."""
    mission = Mission([Phase(Swing(additions=400), 1.0, name=str(k)) for k in range(phases)])
    configs = resolve_phases(mission, y, Accuracy(1e-6, method=Tsit5()), y.position.ndim - 1)
    assert [config.method.rolled for config in configs] == [looped] * phases


@pytest.mark.parametrize(
    ("operations", "runs", "small"),
    [(249, 1, False), (515, 29_000, True), (515, 30_000, False), (600, 10**9, True)],
)
def test_a_campaign_of_few_runs_of_a_large_field_is_small(operations, runs, small):
    assert rolls_stages(Runs.CAMPAIGN, operations, runs) is small
    assert rolls_stages(Runs.CAMPAIGN, operations) is (operations >= 600)


def test_the_manual_has_the_rule():
    """Row by row, as the code has it."""
    text = (ROOT / "docs" / "explanation" / "accuracy_and_derivatives.md").read_text()
    rows = re.findall(
        r"^\| ([^|]+) \| (any size|(\d+) operations or more) \| ([^|]+) \|$", text, re.M
    )
    found = {name: (int(number or 0), evidence) for name, _, number, evidence in rows}
    assert found == {str(runs): tuple(limit) for runs, limit in ROLLED_FROM.items()}
    assert f"${FEW} n^{{{POWER}}}$" in text


@pytest.mark.parametrize(
    ("method", "mode"),
    [
        pytest.param(DOP853(), jax.jacrev, id="DOP853-reverse"),
        pytest.param(RKN1210(), jax.jacfwd, id="RKN1210-forward"),
        pytest.param(DOP853(), jax.jacfwd, id="DOP853-forward", marks=pytest.mark.sweep),
        pytest.param(RKN1210(), jax.jacrev, id="RKN1210-reverse", marks=pytest.mark.sweep),
    ],
)
def test_derivatives_of_many_runs_of_a_large_field(method, mode):
    """By loops of stages what the stages written out of a small field give."""
    accuracy = Accuracy(1e-11, method=method)

    def derivative(additions):
        return mode(lambda y: jnp.sum(end(y, additions, accuracy).position, axis=-1))(runs(2))

    small, large = derivative(0), derivative(250)
    for a, b in zip(jax.tree.leaves(small), jax.tree.leaves(large), strict=True):
        # The steps are the same but for the order of sums within a stage.
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("times", [2, 5])
@pytest.mark.parametrize("method", [DOP853(), RKN1210()], ids=["DOP853", "RKN1210"])
@pytest.mark.parametrize("additions", [0, 110], ids=["a step twice", "a step once"])
@pytest.mark.slow
def test_reverse_mode_along_several_states_of_a_record(
    monkeypatch, additions, method, times, fresh_programs
):
    """Some 300 to 800 steps with room for six states: between two of them lie more steps than are
    kept at once."""
    monkeypatch.setattr(_record, "RECORD_BYTES", 0)
    monkeypatch.setattr(_record, "FEWEST_STATES", 6)
    ts = jnp.linspace(0.0, 16.0, times)
    accuracy = Accuracy(1e-9, method=method)

    def last(y):
        run = simulate(Swing(additions=additions), y, ts, accuracy=accuracy)
        return jnp.sum(run.states.position[0])

    backwards, forwards = jax.jit(jax.grad(last))(start()), jax.jit(jax.jacfwd(last))(start())
    for a, b in zip(jax.tree.leaves(backwards), jax.tree.leaves(forwards), strict=True):
        # Along the same steps: by rounding, which the motion magnifies as it does the derivative.
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-10 * float(jnp.max(jnp.abs(b))))


def test_a_derivative_has_rolled_stages_throughout_from_fewer_operations_on():
    accuracy = Accuracy(1e-6, method=DOP853(dense=False))

    def count(transform, additions):
        last = transform(lambda y: jnp.sum(end(y, additions, accuracy).position))
        return evaluations(jax.jit(last).lower(start()).as_text())

    for additions in (0, 110):
        assert count(lambda last: last, additions) == 1 + 12
    # One stage in place of twelve forwards, and none to fill in the states between two of a record.
    assert count(jax.grad, 0) - count(jax.grad, 110) == 11 + 1


def test_the_replay_of_many_runs_of_a_large_field_holds_a_step_once():
    accuracy = Accuracy(1e-6, method=DOP853(dense=False))

    def count(transform, y):
        last = transform(lambda y: jnp.sum(end(y, 250, accuracy).position))
        return evaluations(jax.jit(last).lower(y).as_text())

    for y in (start(), runs(2)):
        # Of the stage: of the run that is recorded; forwards, what changes with it and what does
        # not; backwards, what is computed again and its transpose; and that of the tangents that
        # step control looks at.
        assert count(jax.grad, y) == 6


def test_a_hessian_holds_the_backward_pass_of_the_gradient_once():
    """And no second one for how its cotangents change: they are fixed."""
    accuracy = Accuracy(1e-6, method=DOP853(dense=False))

    def last(y):
        return jnp.sum(end(y, 0, accuracy).position)

    for transform in (jax.grad, jax.hessian):
        program = str(jax.make_jaxpr(transform(last))(start()))
        assert program.count("cotangent_along_steps[") == 1


def test_a_second_derivative_along_several_states_of_a_record(monkeypatch, fresh_programs):
    """Some forty steps with room for six states, of which every second one is dropped when they
    are full; beside the difference of gradients."""
    monkeypatch.setattr(_record, "RECORD_BYTES", 0)
    monkeypatch.setattr(_record, "FEWEST_STATES", 6)
    accuracy = Accuracy(1e-10, method=DOP853(dense=False))
    ts = jnp.array([0.0, 5.0])

    def last(y):
        run = simulate(Swing(), y, ts, accuracy=accuracy)
        return jnp.sum(run.final.position), run.stats["steps"]

    @jax.jit
    def gradient(y):
        along = jax.tree.map(jnp.ones_like, y)
        return jax.jvp(jax.grad(last, has_aux=True), (y,), (along,), has_aux=True)

    _, change, steps = gradient(start())
    assert steps > 30
    h = 1e-5
    low, high = (gradient(jax.tree.map(lambda x, k=k: x + k * h, start()))[0] for k in (-1.0, 1.0))
    for a, b, d in zip(*map(jax.tree.leaves, (low, high, change)), strict=True):
        # The errors of the runs over the length of the difference.
        np.testing.assert_allclose((b - a) / (2.0 * h), d, rtol=1e-5, atol=1e-5)


# How far the motion of a slackening spring goes, rad.
PHASE = 6.0


class SlackeningSpring(AbstractSystem):
    """r'' = -(w a / (t + a)^2)^2 r, with operations that change nothing: within the time a it is
    slack, and its motion straight."""

    age: jax.Array
    additions: int = eqx.field(static=True)

    def vector_field(self, t, y):
        for _ in range(self.additions):
            t = t + 0.0 * y.position[0]
        frequency = PHASE * self.age / (t + self.age) ** 2
        return BodyState(y.velocity, -(frequency**2) * y.position)

    def invariants(self, t, y):
        return {}


def growth(age):
    """r(1) / r(0) of a slackening spring from rest, by u = r / (t + a) as a function of
    a / (t + a): u'' = -w^2 u."""
    phase = PHASE / (1.0 + age)
    return (1.0 + age) / age * (np.cos(phase) - np.sin(phase) / PHASE)


@functools.partial(jax.jit, static_argnums=(1, 2))
def slackened(age, additions, max_steps=1000):
    accuracy = Accuracy(1e-9, method=DOP853(), max_steps=max_steps)
    y = BodyState(jnp.array([1.0, -0.5, 2.0]), jnp.zeros(3))
    ts = jnp.array([0.0, 1.0])
    run = simulate(SlackeningSpring(age, additions), y, ts, accuracy=accuracy, throw=False)
    return run.final.position / y.position, run.stats["steps"], run.stats["rejected_steps"]


def test_a_large_field_finds_its_first_step_by_trial():
    """A first step as long as the run, or up to ten thousand times too long, costs a few steps more
    than the estimate does. All of the motion takes less than a hundred, because where a step of
    thousands is rejected is decided by roundings."""
    for age in (1e3, 1.0, 1e-2, 1e-4):
        (_, few, hardly), (found, more, rejected) = (slackened(age, n) for n in (0, 250))
        np.testing.assert_allclose(found, growth(age), rtol=1e-8)
        # Up to three trials, or three steps to grow; roundings decide on the fourth.
        assert more + rejected <= few + hardly + 4


def test_a_first_step_that_is_far_too_long_shrinks_at_once():
    """Ten attempts, the first of them ten million times too long: each trial is shortened by up to
    40, which makes five; by 5, as a later step, it would be ten."""
    _, accepted, rejected = slackened(1e-8, 250, 10)
    assert accepted + rejected == 10
    assert accepted >= 2
