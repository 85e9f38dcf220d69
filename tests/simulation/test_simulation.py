"""The runner: accuracy against closed forms and published problems, events, missions, batches, and
what it refuses."""

import os
import subprocess
import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float
from systems import Integrated

from jaxspace import Scene
from jaxspace.attitude import TorqueFreeBody
from jaxspace.bodies import BodyState
from jaxspace.core import AbstractSystem, InputError, Scalar
from jaxspace.integration.mapping import BLOCK
from jaxspace.orbits import PointGravity, TwoBody
from jaxspace.rotations import Quaternion
from jaxspace.simulation import (
    Accuracy,
    Event,
    Mission,
    Phase,
    SimulationError,
    Status,
    simulate,
    simulate_batch,
    simulate_mission,
)
from jaxspace.simulation._batch_runs import _relative_rate
from jaxspace.solvers import DOP853, Regularised, Splitting, Stormer, Tsit5


class Fall(AbstractSystem):
    """A ball under constant gravity: `position` is its height."""

    gravity: Float[Array, "3 *#runs"]

    def vector_field(self, t: Scalar, y: BodyState) -> BodyState:
        return BodyState(position=y.velocity, velocity=0.0 * y.velocity - self.gravity)

    def invariants(self, t: Scalar, y: BodyState) -> dict[str, Array]:
        return {}


class Plane(AbstractSystem):
    """Any plane or N-body problem given by its accelerations."""

    acceleration: object

    def vector_field(self, t: Scalar, y: tuple) -> tuple:
        return (y[1], self.acceleration(y[0], y[1]))

    def invariants(self, t: Scalar, y: tuple) -> dict[str, Array]:
        return {}


KEPLER = Integrated(Scene((PointGravity(1.0),)))


def start(e):
    """Periapsis of an ellipse with semi-major axis 1 and gravitational parameter 1."""
    return BodyState(
        jnp.array([1.0 - e, 0.0, 0.0]), jnp.array([0.0, np.sqrt((1.0 + e) / (1.0 - e)), 0.0])
    )


def ball(height=10.0, speed=0.0):
    """A ball in three directions of which one matters."""
    return BodyState(jnp.array([0.0, 0.0, height]), jnp.array([0.0, 0.0, speed]))


FALL = Fall(jnp.array([0.0, 0.0, 9.81]))
FLOOR = Event(lambda t, y: y.position[2], direction=-1, within=2.0)


# ODE-DETEST-D1 to D5: x, y, x', y' at t = 20.
DETEST = {
    0.1: [0.2198835352008397, 0.9427076846341813, -0.9787659841058176, 0.3287977990962036],
    0.3: [-0.1777027357140412, 0.9467784719905892, -1.030294163192969, 0.1211074890053952],
    0.5: [-0.5780432953035362, 0.8633840009194192, -0.9595083730380727, -0.0650491512671209],
    0.7: [-0.9538990293416394, 0.6907409024219432, -0.8212674270877433, -0.1539574259125825],
    0.9: [-1.295266250987574, 0.4003938963792321, -0.6775390924707566, -0.1270838154278686],
}


@pytest.mark.parametrize("system", [KEPLER, TwoBody(1.0)], ids=["integrated", "closed form"])
@pytest.mark.parametrize("e", DETEST)
def test_detest_orbits(e, system):
    end = simulate(system, start(e), jnp.array([0.0, 20.0]), accuracy=1e-13).final
    found = [*end.position[:2], *end.velocity[:2]]
    np.testing.assert_allclose(found, DETEST[e], rtol=0.0, atol=1e-10)


def test_arenstorf_orbit_returns():
    """ODE-ARENSTORF."""
    mu = 0.012277471

    def acceleration(r, v):
        x, y = r
        d1, d2 = ((x + mu) ** 2 + y**2) ** 1.5, ((x - 1.0 + mu) ** 2 + y**2) ** 1.5
        ax = x + 2.0 * v[1] - (1.0 - mu) * (x + mu) / d1 - mu * (x - 1.0 + mu) / d2
        return jnp.stack([ax, y - 2.0 * v[0] - (1.0 - mu) * y / d1 - mu * y / d2])

    y0 = (jnp.array([0.994, 0.0]), jnp.array([0.0, -2.00158510637908252240537862224]))
    end = simulate(
        Plane(acceleration), y0, jnp.array([0.0, 17.0652165601579625588917206249]), accuracy=1e-13
    ).final
    for a, b in zip(end, y0, strict=True):
        np.testing.assert_allclose(a, b, rtol=0.0, atol=1e-7)


def test_pleiades():
    """ODE-PLEIADES: seven bodies with close encounters."""
    m = jnp.arange(1.0, 8.0)

    def acceleration(r, v):
        d = r[:, None, :] - r[:, :, None]
        r3 = (jnp.sum(d**2, axis=0) + jnp.eye(7)) ** 1.5
        return jnp.sum(m[None, None, :] * d / r3, axis=2)

    r0 = jnp.array([[3.0, 3, -1, -3, 2, -2, 2], [3, -3, 2, 0, 0, -4, 4]])
    v0 = jnp.array([[0.0, 0, 0, 0, 0, 1.75, -1.5], [0, 0, 0, -1.25, 1, 0, 0]])
    end = simulate(Plane(acceleration), (r0, v0), jnp.array([0.0, 3.0]), accuracy=1e-12).final
    expected = [
        0.3706139143970502,
        3.237284092057233,
        -3.222559032418324,
        0.659709145577531,
        0.3425581707156584,
    ]
    expected += [
        1.562172101400631,
        -0.7003092922212495,
        -3.943437585517392,
        -3.27138097397255,
        5.225081843456543,
    ]
    expected += [-2.59061243497747, 1.198213693392275, -0.2429682344935824, 1.09144924042898]
    np.testing.assert_allclose(end[0].reshape(-1), expected, rtol=0.0, atol=1e-8)
    rates = [
        3.417003806314313,
        1.354584501625501,
        -2.590065597810775,
        2.025053734714242,
        -1.155815100160448,
    ]
    rates += [
        -0.8072988170223021,
        0.595239635420871,
        -3.74124496123401,
        0.377345968575063,
        0.9386858869551074,
    ]
    rates += [0.3667922227200571, -0.347404635380849, 2.344915448180937, -1.947020434263292]
    np.testing.assert_allclose(end[1].reshape(-1), rates, rtol=0.0, atol=1e-8)


def test_states_between_steps_are_as_good_as_step_ends():
    ts = jnp.linspace(0.0, 20.0, 203)
    run = simulate(KEPLER, start(0.5), ts, accuracy=1e-11)
    exact = simulate(TwoBody(1.0), start(0.5), ts)
    # The dense output has order 7 beside a method of order 8: a few hundred times the local
    # tolerance over three turns.
    assert float(jnp.max(jnp.abs(run.states.position - exact.states.position))) < 3e-9
    assert float(run.drift()["energy"].max()) < 1e-9
    assert float(run.stats["evaluations"]) < 12 * 400


def test_error_is_estimated_and_honest():
    ts = jnp.array([0.0, 20.0])
    run = simulate(KEPLER, start(0.5), ts, accuracy=1e-8)
    exact = simulate(TwoBody(1.0), start(0.5), ts).final
    true = float(jnp.linalg.norm(run.final.position - exact.position))
    told = float(jnp.linalg.norm(run.error().position))
    # Far above the roundings of 45 steps. It is the sum of terms that nearly cancel: 1.3e-9 or
    # 3.9e-11, as the processor rounds the lengths of the steps.
    assert 1e-12 < true < 1e-5 and 0.5 * true < told < 2.0 * true
    assert float(simulate(TwoBody(1.0), start(0.5), ts).error().position.max()) < 1e-13


def test_tolerance_buys_accuracy():
    exact = simulate(TwoBody(1.0), start(0.3), jnp.array([0.0, 20.0])).final.position
    errors = []
    for rtol in (1e-6, 1e-9, 1e-12):
        end = simulate(KEPLER, start(0.3), jnp.array([0.0, 20.0]), accuracy=rtol).final.position
        errors.append(float(jnp.linalg.norm(end - exact)))
    assert errors[0] > 30.0 * errors[1] > 900.0 * errors[2]


def test_backward_and_empty_spans():
    y = start(0.4)
    there = simulate(KEPLER, y, jnp.array([0.0, 3.0]), accuracy=1e-12).final
    back = simulate(KEPLER, there, jnp.array([3.0, 0.0]), accuracy=1e-12).final
    np.testing.assert_allclose(back.position, y.position, rtol=0.0, atol=1e-10)
    still = simulate(KEPLER, y, jnp.array([2.0, 2.0]), accuracy=1e-12)
    assert np.all(still.final.position == y.position) and int(still.status) == Status.COMPLETED
    slope = jax.grad(
        lambda t: simulate(KEPLER, y, jnp.stack([jnp.array(2.0), t])).final.position[1]
    )(2.0)
    np.testing.assert_allclose(slope, y.velocity[1], rtol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(
    "method",
    ["auto", DOP853(), Stormer(8, steps=240), Regularised(steps=40), Splitting(4, steps=40)],
)
def test_derivatives_of_backward_and_empty_spans(method):
    """Of the end by the start and by the time of the end, against the closed form; an empty span
    hands on what it is given."""

    def end(x, t, system, accuracy):
        y = BodyState(start(0.3).position + x[:3], start(0.3).velocity + x[3:])
        run = simulate(
            system, y, jnp.stack([jnp.array(2.0), t]), accuracy=accuracy, throw=False
        ).final
        return jnp.concatenate([run.position, run.velocity])

    accuracy = Accuracy(rtol=1e-11, method=method)
    found = jax.jit(jax.jacrev(lambda x, t: end(x, t, KEPLER, accuracy), argnums=(0, 1)))
    exact = jax.jit(jax.jacfwd(lambda x, t: end(x, t, TwoBody(1.0), 1e-9), argnums=(0, 1)))
    for t in (-2.0, 2.0):
        for a, b in zip(found(jnp.zeros(6), t), exact(jnp.zeros(6), t), strict=True):
            # The steps of the methods with equal ones are good to some 1e-8 here, the derivatives
            # are up to 20.
            np.testing.assert_allclose(a, b, rtol=0.0, atol=1e-6 if t < 0.0 else 1e-13)


def test_derivatives_of_a_run():
    """Reverse and forward derivatives of an integration against those of the closed form."""
    y, ts = start(0.3), jnp.array([0.0, 4.0])

    def end(system, accuracy):
        def position(v, mu):
            moving = eqx.tree_at(lambda s: s.velocity, y, v)
            return simulate(system(mu), moving, ts, accuracy=accuracy).final.position

        return position

    def scene(mu):
        return Scene((PointGravity(mu),))

    tight = Accuracy(rtol=1e-12, method=Tsit5())
    exact = jax.jit(jax.jacfwd(end(TwoBody, 1e-12), (0, 1)))(y.velocity, 1.0)
    reverse = jax.jit(jax.jacrev(end(scene, tight), (0, 1)))(y.velocity, 1.0)
    forward = jax.jit(jax.jacfwd(end(scene, tight), (0, 1)))(y.velocity, 1.0)
    for a, b, c in zip(exact, reverse, forward, strict=True):
        # The error of the derivative exceeds that of the run by the growth of its deviations, here
        # some tens.
        np.testing.assert_allclose(b, a, rtol=0.0, atol=2e-9)
        np.testing.assert_allclose(c, b, rtol=0.0, atol=1e-11)


# `test_solvers_rolled_stages.py` goes backwards along a record as short.
@pytest.mark.sweep
def test_derivatives_of_a_run_of_many_steps(monkeypatch):
    """The memory for states holds four of them, so that some hundred steps are taken again from
    each, piece by piece."""
    monkeypatch.setattr("jaxspace.integration._record.RECORD_BYTES", 0)
    y, ts = start(0.3), jnp.array([0.0, 3.0, 4.0])

    def distance(system, accuracy):
        def total(v):
            run = simulate(system, eqx.tree_at(lambda s: s.velocity, y, v), ts, accuracy=accuracy)
            return jnp.sum(run.states.position * jnp.arange(9.0).reshape(3, 3).T), run.stats.get(
                "steps"
            )

        return total

    exact = jax.jit(jax.grad(distance(TwoBody(1.0), 1e-12), has_aux=True))(y.velocity)[0]
    tight = Accuracy(rtol=1e-12, method=Tsit5(), max_steps=4095)
    found, steps = jax.jit(jax.grad(distance(KEPLER, tight), has_aux=True))(y.velocity)
    assert steps > 4 * 64
    np.testing.assert_allclose(found, exact, rtol=0.0, atol=2e-8)  # as above, times the weights


def test_single_precision():
    y = jax.tree.map(lambda x: x.astype(jnp.float32), start(0.3))
    run = simulate(KEPLER, y, jnp.array([0.0, 6.0], jnp.float32), accuracy=1e-5)
    exact = simulate(TwoBody(1.0), start(0.3), jnp.array([0.0, 6.0])).final.position
    assert run.final.position.dtype == jnp.float32
    # Tolerance 1e-5 a step over tens of steps.
    np.testing.assert_allclose(run.final.position, exact, atol=2e-3)


# ---------------------------------------------------------------- events


def test_close_events_are_told_apart():
    """EV-CLOSE."""
    events = tuple(Event(lambda t, y, when=when: t - when) for when in (5.5, 5.0))
    run = simulate(FALL, ball(1e4), jnp.linspace(0.0, 20.0, 3), events=events)
    assert int(run.event) == 1 and int(run.status) == Status.EVENT
    np.testing.assert_allclose(run.ts, [0.0, 5.0, 5.0], atol=1e-12)
    # At as many times: the same program.
    rest = simulate(FALL, run.final, jnp.array([5.0, 10.0, 20.0]), events=events)
    assert int(rest.event) == 0
    np.testing.assert_allclose(rest.ts[-1], 5.5, atol=1e-12)


def test_two_changes_of_sign_within_one_step():
    """EV-LARGE-STEP."""
    event = Event(
        lambda t, y: (2.5 - y.position[2]) * (5.0 - y.position[2]) * (0.0 - y.position[2])
    )
    run = simulate(Fall(jnp.zeros(3)), ball(1.0, 1.0), jnp.array([0.0, 9.0]), events=(event,))
    np.testing.assert_allclose(run.ts[-1], 1.5, atol=1e-12)
    rest = simulate(Fall(jnp.zeros(3)), run.final, jnp.array([1.5, 9.0]), events=(event,))
    np.testing.assert_allclose(rest.ts[-1], 4.0, atol=1e-12)


@pytest.mark.parametrize("direction", [0, 1, -1])
def test_a_dip_between_the_samples(direction):
    """g = sign ((t - c)^2 - size |size|) (1 - t/w): a dip far narrower than the 20/128 between the
    samples, amid the span and at its very ends, backwards, and from below; one that does not reach
    zero, and the same before a simple zero."""

    @jax.jit
    def found(ts, c, size, sign, w):
        event = Event(
            lambda t, y: sign * ((t - c) ** 2 - size * jnp.abs(size)) * (1.0 - t / w), direction
        )
        run = simulate(FALL, ball(1e4), ts, events=(event,))
        return run.ts[-1], run.event

    for ts, ahead in ((jnp.array([0.0, 20.0]), 1.0), (jnp.array([20.0, 0.0]), -1.0)):
        for c, size, sign in [
            (5.03, 0.01, 1.0),
            (0.03, 0.01, 1.0),
            (19.93, 0.02, 1.0),
            (7.11, 0.03, -1.0),
        ]:
            time, event = found(ts, c, size, sign, 50.0)
            assert event == 0
            np.testing.assert_allclose(
                time, c + (ahead if direction == sign else -ahead) * size, atol=1e-9
            )
        assert found(ts, 5.03, -0.01, 1.0, 50.0)[1] == -1
        if direction != 1:
            np.testing.assert_allclose(found(ts, 5.03, -0.01, ahead, 12.0)[0], 12.0, rtol=1e-12)


def bounces(height, restitution, count):
    """The times of the first bounces of a ball."""

    def rebound(t, y):
        return BodyState(y.position, -restitution * y.velocity)

    mission = Mission([Phase(FALL, FLOOR, rebound, f"flight {k}") for k in range(count)])
    return simulate_mission(mission, ball(height), accuracy=1e-12, throw=False)


def test_bouncing_ball():
    """EV-BOUNCE: the first twelve bounces, the last flights a thousand times shorter than the span
    searched."""
    run = bounces(10.0, 0.5, 12)
    first = np.sqrt(2.0 * 10.0 / 9.81)
    times = [first * (1.0 + 2.0 * sum(0.5**j for j in range(1, k))) for k in range(1, 13)]
    assert abs(first - 1.427843122927) < 1e-12
    np.testing.assert_allclose([p.ts[-1] for p in run.phases], times, rtol=0.0, atol=1e-9)
    assert int(run.status) == Status.EVENT


def test_an_event_that_does_not_happen_is_reported_by_name():
    lazy = Mission([Phase(FALL, Event(lambda t, y: y.position[2], within=1.0), name="short")])
    run = simulate_mission(lazy, ball(), throw=False)
    assert int(run.status) == Status.EVENT_MISSED
    with pytest.raises(SimulationError, match="did not occur within its time limit"):
        simulate_mission(lazy, ball())


def test_derivatives_pass_through_events():
    """Height, restitution and gravity into the height after two bounces: the saltation, in closed
    form."""

    def height(h, e, g, t):
        def rebound(t, y):
            return BodyState(y.position, -e * y.velocity)

        fall = Fall(g * jnp.array([0.0, 0.0, 1.0]))
        flights = [Phase(fall, FLOOR, rebound, f"{k}") for k in range(2)]
        landed = simulate_mission(Mission(flights), ball(1.0 * h), accuracy=1e-12)
        return landed.final.velocity[2] * (t - landed.end) - 0.5 * g * (t - landed.end) ** 2

    def exact(h, e, g, t):
        t1 = jnp.sqrt(2.0 * h / g)
        left = t - t1 * (1.0 + 2.0 * e)
        return e**2 * g * t1 * left - 0.5 * g * left**2

    where = (10.0, 0.5, 9.81, 3.0)
    (found, slopes), (expected, exact_slopes) = (
        jax.jit(jax.value_and_grad(f, (0, 1, 2, 3)))(*where) for f in (height, exact)
    )
    np.testing.assert_allclose(found, expected, rtol=1e-10)
    np.testing.assert_allclose(slopes, exact_slopes, rtol=1e-9)


def test_runs_of_a_batch_have_their_own_events():
    heights = jnp.linspace(5.0, 15.0, 7)
    y = BodyState(jnp.stack([0.0 * heights, 0.0 * heights, heights]), jnp.zeros((3, 7)))
    run = simulate_batch(FALL, y, jnp.linspace(0.0, 1.5, 4), events=(FLOOR,), accuracy=1e-12)
    landing = np.sqrt(2.0 * heights / 9.81)
    np.testing.assert_allclose(run.ts[-1], np.minimum(landing, 1.5), rtol=1e-12)
    assert np.all(np.asarray(run.status) == np.where(landing < 1.5, Status.EVENT, Status.COMPLETED))
    exact = np.maximum(heights - 0.5 * 9.81 * np.asarray(run.ts) ** 2, 0.0)
    np.testing.assert_allclose(run.states.position[2], exact, atol=1e-10)


# ---------------------------------------------------------------- batches


def rows(es):
    """Periapsis states of many ellipses, the runs last."""
    return jax.tree.map(lambda *x: jnp.stack(x, axis=-1), *(start(e) for e in es))


def test_bad_runs_mark_their_rows_alone():
    y = rows(np.linspace(0.0, 0.5, 9))
    bad = eqx.tree_at(lambda s: s.velocity, y, y.velocity.at[:, 3].set(jnp.nan).at[:, 5].set(0.0))
    accuracy = Accuracy(rtol=1e-9, max_steps=1000)
    ts = jnp.array([0.0, 3.0])
    run = simulate_batch(KEPLER, bad, ts, accuracy=accuracy)
    expected = np.zeros(9, int)
    expected[3], expected[5] = (
        Status.NOT_FINITE,
        Status.TOLERANCE_MISSED,
    )  # the fall into the centre takes less than two units of time
    assert np.all(np.asarray(run.status) == expected)
    good = np.flatnonzero(expected == 0)
    exact = simulate_batch(TwoBody(1.0), y, ts).final.position
    np.testing.assert_allclose(run.final.position[:, good], exact[:, good], atol=1e-7)
    assert np.all(np.isnan(run.final.position[:, [3, 5]]))


def test_many_blocks_equal_one():
    n = 600
    y = rows([0.2])
    y = jax.tree.map(lambda x: jnp.repeat(x, n, axis=-1), y)
    mus = jnp.linspace(0.9, 1.1, n)
    run = simulate_batch(TwoBody(mus), y, jnp.array([0.0, 2.0]))
    assert run.final.position.shape == (3, n) and run.ts.shape == (2, n)
    one = simulate(TwoBody(mus[400]), start(0.2), jnp.array([0.0, 2.0])).final.position
    np.testing.assert_allclose(run.final.position[:, 400], one, rtol=1e-13)
    assert run.drift()["energy"].shape == (2, n) and float(run.drift()["energy"].max()) < 1e-13


def test_every_run_may_have_its_own_times():
    y = rows([0.1, 0.3, 0.5])
    ts = jnp.array([[0.0, 1.0, 2.0], [0.0, 0.5, 3.0], [1.0, 1.5, 5.0]]).T
    run = simulate_batch(KEPLER, y, ts, accuracy=1e-12)
    exact = simulate_batch(TwoBody(1.0), y, ts)
    np.testing.assert_allclose(run.states.position, exact.states.position, atol=1e-9)


def test_runs_that_want_like_steps_share_a_block():
    """Ellipses from circles to an eccentricity of 0.9, in no order: sorted by their pace at the
    start, they take a good third fewer evaluations than the worst one would have cost them all, and
    the results come back in the order given."""
    es = np.random.default_rng(2).uniform(0.0, 0.9, 4 * BLOCK)
    ts = jnp.array([0.0, 7.0])
    y = rows(es)
    run = simulate_batch(KEPLER, y, ts, accuracy=1e-9)
    exact = simulate_batch(TwoBody(1.0), y, ts).final.position
    np.testing.assert_allclose(run.final.position, exact, atol=1e-6)
    evaluations = np.asarray(run.stats["evaluations"])
    assert np.mean(evaluations) < 0.65 * np.max(evaluations)
    assert evaluations[np.argmin(es)] < evaluations[np.argmax(es)]


def test_runs_are_told_apart_that_turn_alike_at_first():
    """Of bodies with two equal moments, A, and the third C, as fast as each other about any axis:
    the rate circles in the body at (C / A - 1) times its third component. What changes of each has
    length one, so that the second derivatives are known."""
    tilt = jnp.linspace(0.1, 1.4, 14)
    across, along = jnp.sin(tilt), jnp.cos(tilt)
    circling = (1.9 - 1.0) * along
    omega = jnp.stack([across, 0.0 * tilt, along])
    attitude = Quaternion(jnp.stack([1.0 + 0.0 * tilt, *jnp.zeros((3, tilt.size))]))
    bodies = BodyState(omega=omega, attitude=attitude)
    body = TorqueFreeBody([1.0, 1.0, 1.9])
    rate = jax.jit(_relative_rate)(body, bodies, jnp.array(0.0))
    of_rate = circling * jnp.sqrt(across)
    # q'' = q (0, omega') / 2 - q / 4
    of_attitude = ((circling * across / 2.0) ** 2 + 1.0 / 16.0) ** 0.25
    # By a difference over a hundredth of the time in which the state changes.
    np.testing.assert_allclose(rate, jnp.maximum(of_rate, of_attitude), rtol=0.01)
    # The first derivative tells none of them apart: it is that of the attitude, half the rate.
    assert np.count_nonzero(circling * across > 0.5) == 0


def test_devices_change_no_number():
    """In a process of its own, because the number of devices is fixed when the first one is
    touched."""
    code = """
import jax
jax.config.update("jax_enable_x64", True)
jax.config.update("jax_num_cpu_devices", 2)
jax.config.update("jax_disable_most_optimizations", True)
import numpy as np
from test_simulation import KEPLER, rows, simulate_batch
e = np.linspace(0.0, 0.5, 150)
# One that takes many steps, and one that fails.
e[7], e[100] = 0.99, np.nan
y, ts = rows(e), np.linspace(0.0, 2.0, 4)
two = simulate_batch(KEPLER, y, ts, accuracy=1e-6)
one = simulate_batch(KEPLER, jax.device_put(y, jax.devices()[0]), ts, accuracy=1e-6)
leaves = [jax.tree.leaves((run.states, run.status)) for run in (one, two)]
same = all(np.array_equal(a, b, equal_nan=True) for a, b in zip(*leaves))
failed = np.count_nonzero(two.status)
print(len(two.status.devices()), len(one.status.devices()), same, failed)
"""
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    assert done.stdout.split() == ["2", "1", "True", "1"], done.stderr


def test_runs_that_missed_the_tolerance_take_more_of_the_equal_steps():
    """Steps that do for the circle are too few for the ellipse, which alone is flown again."""
    y, ts = rows([0.0, 0.02, 0.25]), jnp.array([0.0, 6.0])
    method = Accuracy(rtol=1e-9, method=Stormer(8, steps=80))
    run = simulate_batch(KEPLER, y, ts, accuracy=method)
    exact = simulate_batch(TwoBody(1.0), y, ts).final.position
    steps = np.asarray(run.stats["steps"])
    assert np.all(run.status == Status.COMPLETED) and steps[0] == 80 and steps[2] > 160
    np.testing.assert_allclose(run.final.position, exact, atol=1e-6)


# ---------------------------------------------------------------- what is refused

SPAN = jnp.array([0.0, 1.0])


@pytest.mark.parametrize(
    ("call", "error", "sentence"),
    [
        (
            lambda: simulate(KEPLER, start(0.1), jnp.array([0.0, 1.0]), accuracy=1e-16),
            InputError,
            "for float64 states it must be at least",
        ),
        (
            lambda: simulate(
                KEPLER, jax.tree.map(jnp.float32, start(0.1)), jnp.float32(SPAN), accuracy=1e-6
            ),
            InputError,
            "for float32 states it must be at least",
        ),
        # A number that is written within the compiled function is known, too.
        (
            lambda: jax.jit(lambda y: simulate(KEPLER, y, SPAN, accuracy=1e-6).final)(
                jax.tree.map(jnp.float32, start(0.1))
            ),
            InputError,
            "for float32 states it must be at least",
        ),
        (
            lambda: simulate_batch(
                KEPLER, jax.tree.map(jnp.float32, rows([0.1, 0.2])), SPAN, accuracy=1e-6
            ),
            InputError,
            "for float32 states it must be at least",
        ),
        (
            lambda: simulate(
                KEPLER, start(0.1), SPAN, events=(Event(lambda t, y: y.position[0] > 0.0),)
            ),
            InputError,
            r"events\[0\].condition returns bool: it must return a number that passes",
        ),
        (
            lambda: simulate(KEPLER, start(0.1), SPAN, accuracy=-1.0),
            InputError,
            "Accuracy.rtol is -1",
        ),
        (
            lambda: simulate(KEPLER, start(0.1), jnp.array([0.0, 1.0, 0.5])),
            InputError,
            "ts changes direction",
        ),
        (lambda: simulate(KEPLER, start(0.1), jnp.array([0.0])), InputError, "at least two times"),
        (
            lambda: simulate(KEPLER, ball(np.nan), jnp.array([0.0, 1.0])),
            InputError,
            r"y0.position is .*it must be finite",
        ),
        (
            lambda: Phase(KEPLER, FLOOR.__class__(lambda t, y: t), name="x"),
            InputError,
            "Event.within",
        ),
        (lambda: Event(lambda t, y: t, direction=2), InputError, "Event.direction is 2"),
        (lambda: Mission([]), InputError, "at least one"),
        (
            lambda: simulate_batch(KEPLER, start(0.1), jnp.array([0.0, 1.0]), in_axes=(None, None)),
            InputError,
            "no array with a batch axis",
        ),
        (
            lambda: simulate_batch(TwoBody(jnp.ones(4)), rows([0.1, 0.2]), jnp.array([0.0, 1.0])),
            InputError,
            r"y0s.position has 2 runs on its last axis, systems.mu has 4",
        ),
    ],
)
def test_bad_input_is_refused_in_a_sentence(call, error, sentence):
    with pytest.raises(error, match=sentence):
        call()


def test_steps_that_run_out_are_said():
    with pytest.raises(SimulationError, match="Accuracy.max_steps, in a scene file the key"):
        simulate(KEPLER, start(0.1), jnp.array([0.0, 100.0]), accuracy=Accuracy(max_steps=10))
    assert all(status.sentence for status in Status)
