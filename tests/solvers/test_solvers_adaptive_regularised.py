"""Adaptive steps in regularised variables: the truth is RKN 12(10), or DOP853, of tight tolerance
in time and Cartesian variables, which shares neither the variables nor the steps."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace import (
    Accuracy,
    BodyState,
    Scene,
    simulate,
    simulate_batch,
    simulate_mission,
    simulate_mission_batch,
)
from jaxspace.bodies import Load
from jaxspace.core import AbstractSecondOrderForm
from jaxspace.core.vectors import dot, norm
from jaxspace.integration import select_method
from jaxspace.orbits import Oblateness, PointGravity
from jaxspace.scene import Custom
from jaxspace.simulation import Event, Mission, Phase
from jaxspace.solvers import DOP853, RKN1210, AdaptiveRegularised
from jaxspace.solvers.regularised_step import form_in, trial_step

OWN = AdaptiveRegularised()
# Below every periapsis here; what counts is J2 R^2.
J2, RADIUS = 0.25, 0.05
OBLATE = Scene((PointGravity(1.0), Oblateness(1.0, J2, RADIUS)))
AIR = Custom(
    lambda t, y, body: Load(acceleration_N=-1e-3 * y.velocity),
)
DRAGGED = Scene((*OBLATE.effects, AIR))
# Revolutions of 2 pi; the times lie unevenly, and one of them twice.
TS = jnp.array([0.0, 1.0, 2.5, 2.5, 9.0, 20.0])


def at_periapsis(e, tilt=0.4):
    """An orbit of semi-major axis 1 and eccentricity `e`."""
    speed = jnp.sqrt((1.0 + e) / (1.0 - e))
    r = jnp.array([1.0 - e, 0.0, 0.0])
    return BodyState(r, speed * jnp.array([0.0, np.cos(tilt), np.sin(tilt)]))


def accuracy(method, rtol=1e-12):
    return Accuracy(rtol=jnp.asarray(rtol), method=method, max_steps=2048)


def difference(a, b):
    """The largest difference of positions, in semi-major axes, and of velocities."""
    return max(
        float(np.max(np.abs(a.position - b.position))),
        float(np.max(np.abs(a.velocity - b.velocity))),
    )


def test_it_is_chosen_for_eccentric_orbits():
    def chosen(e, scene=OBLATE, ts=TS):
        return type(select_method(scene, at_periapsis(e), 1e-9, ts))

    own = AdaptiveRegularised
    assert [chosen(e) for e in (0.4, 0.6, 0.9)] == [RKN1210, own, own]
    # Without a potential steps in time are as fast at equal error, and compile sooner.
    assert chosen(0.9, DRAGGED) is chosen(0.3, DRAGGED) is DOP853
    # Less than a revolution, more states than it would land on, and numbers that are not known.
    assert chosen(0.9, ts=TS / 20.0) is RKN1210
    assert chosen(0.9, ts=jnp.linspace(0.0, 20.0, 999)) is RKN1210
    assert type(select_method(OBLATE, at_periapsis(0.9), 1e-9)) is RKN1210


@pytest.mark.parametrize(
    ("scene", "truth", "evaluations"),
    [(OBLATE, RKN1210(), 17), pytest.param(DRAGGED, DOP853(), 12, marks=pytest.mark.sweep)],
)
def test_states_on_the_way_and_between_the_steps(scene, truth, evaluations):
    """The potential decides the order. Rounding in the truth, grown by the periapsides passed, is a
    tenth of the bound."""
    y0 = at_periapsis(0.7)
    run = simulate(scene, y0, TS, accuracy=accuracy(OWN), dense=True)
    true = simulate(scene, y0, TS, accuracy=accuracy(truth, 1e-13))
    assert difference(run.states, true.states) < 2e-11
    taken = run.stats["steps"] + run.stats["rejected_steps"]
    assert run.stats["evaluations"] == evaluations * taken
    assert difference(run.at(TS[4]), true[4]) < 2e-11
    back = simulate(scene, run.final, TS[::-1], accuracy=accuracy(OWN))
    assert difference(back.final, y0) < 2e-10  # the velocity at the periapsis is 2.4


def test_every_run_of_a_batch_takes_its_own_steps():
    """Runs alone and together agree to rounding, however different their neighbours."""
    states = [at_periapsis(e, tilt) for e, tilt in ((0.1, 0.1), (0.9, 0.5), (0.6, 0.3))]
    y0s = jax.tree.map(lambda *x: jnp.stack(x, axis=-1), *states)
    together = simulate_batch(OBLATE, y0s, TS, accuracy=accuracy(OWN))
    for k in (1, 2):
        one = simulate(OBLATE, states[k], TS, accuracy=accuracy(OWN))
        assert difference(together.of(k).states, one.states) < 1e-12
        assert together.stats["steps"][k] == one.stats["steps"]


def test_open_orbits_and_those_in_between():
    """About a parabola the time is a quadrature of the distance, elsewhere of the perturbation."""
    e = jnp.array([0.98, 0.9999, 1.0, 1.0001, 1.5])
    zero = jnp.zeros_like(e)
    speed = jnp.sqrt((1.0 + e) / 0.3)
    y0s = BodyState(
        jnp.stack([zero + 0.3, zero, zero]),
        speed[None] * jnp.array([[0.0], [np.cos(0.4)], [np.sin(0.4)]]),
    )
    ts = jnp.array([0.0, 4.0])
    own = simulate_batch(OBLATE, y0s, ts, accuracy=accuracy(OWN, 1e-11))
    true = simulate_batch(OBLATE, y0s, ts, accuracy=accuracy(RKN1210(), 1e-13))
    # The runs are within ten units of the centre, at tolerances of 1e-11 for some twenty steps.
    assert difference(own.final, true.final) < 2e-10


def test_few_steps_serve_and_the_time_is_as_good_as_the_place():
    """Ten revolutions at a tolerance of 1e-8: wrong by 7e-10. With a quadrature of the whole time
    it was 1.1e-8, and with steps foreseen by the last one alone one or two are rejected at each
    periapsis."""
    y0s = jax.tree.map(lambda *x: jnp.stack(x, axis=-1), *map(at_periapsis, (0.6, 0.7, 0.8)))
    ts = jnp.array([0.0, 20.0 * np.pi])
    own = simulate_batch(OBLATE, y0s, ts, accuracy=accuracy(OWN, 1e-8))
    true = simulate_batch(OBLATE, y0s, ts, accuracy=accuracy(RKN1210(), 1e-13))
    assert difference(own.final, true.final) < 3e-9
    assert np.all(own.stats["rejected_steps"] <= 5)


@pytest.mark.sweep
@pytest.mark.parametrize(("e", "revolutions"), [(0.5, 5), (0.7, 10)])
def test_half_the_evaluations_of_steps_in_time_serve(e, revolutions):
    """At equal tolerance, with no greater error. Measured: 150 for 411 and 180 for 585 a turn."""
    y0, ts = at_periapsis(e), jnp.array([0.0, 2.0 * np.pi * revolutions])

    def end(method, rtol):
        run = simulate(OBLATE, y0, ts, accuracy=Accuracy(rtol=rtol, method=method, max_steps=8192))
        return run.stats["evaluations"], run.final

    _, true = end(RKN1210(), 1e-13)
    (own, reached), (other, beside) = (end(method, 1e-10) for method in (OWN, RKN1210()))
    assert 2 * own < other
    assert difference(reached, true) < difference(beside, true)


def test_the_error_of_a_step_into_an_atmosphere_is_estimated():
    """Steps of up to a quarter of a revolution from everywhere on an orbit whose density falls by e
    in a hundredth of the perigee distance, beside 64 steps of a 64th. The smallest estimate is 0.43
    of the error; with that of DOP853 in time, `blend`, it is 0.08."""
    thin = Custom(
        lambda t, y, body: Load(
            acceleration_N=-1e-4 * jnp.exp((0.3 - norm(y.position)) / 3e-3) * y.velocity
        )
    )
    form = Scene((*OBLATE.effects, thin)).regularised()
    start = form.to_regularised(at_periapsis(0.7))
    # In units of the eccentric anomaly.
    anomaly, length = (
        x.reshape(-1) for x in jnp.meshgrid(jnp.linspace(0.2, 6.2, 40), jnp.linspace(0.2, 1.6, 8))
    )

    def stepped(z, h, steps):
        def step(_, z):
            return trial_step(form, 0.0, 100.0, z, h / steps).z

        return jax.lax.fori_loop(0, steps, step, z)

    @jax.jit
    def ratio(z):
        z = stepped(jnp.broadcast_to(z[:, None], (*z.shape, anomaly.size)), anomaly, 400)
        one, fine = trial_step(form, 0.0, 100.0, z, length), stepped(z, length, 64)
        true = form.size(one.z - fine, z, one.z)
        # Where the density vanishes, both are rounding.
        return jnp.where(true > 1e-10, form.size(one.error, z, one.z) / true, jnp.inf)

    assert jnp.min(ratio(start)) > 0.2


def test_derivatives_agree_with_differences():
    """Of states on the way and at the end, in the start, the attraction and the time."""
    y0 = at_periapsis(0.7)

    def total(x):
        scene = Scene((PointGravity(1.0 + x[0]), Oblateness(1.0, J2, RADIUS)))
        start = BodyState(y0.position + x[1:4], y0.velocity)
        ts = jnp.array([0.0, 1.0, 7.0]) * (1.0 + x[4])
        states = simulate(scene, start, ts, accuracy=accuracy(OWN), throw=False).states
        weights = jnp.array([1.0, 2.0, 3.0])
        return jnp.sum(weights * states.position) + jnp.sum(states.velocity[:, 1:] ** 2)

    direction = jnp.array([1.0, -2.0, 0.5, 0.3, -1.0])

    @jax.jit
    def derivatives(x):
        return *jax.value_and_grad(total)(x), jax.jvp(total, (x,), (direction,))[1]

    x = jnp.zeros(5)
    h = 1e-4

    def rate(k):
        # Of order four, so that the bound is that of the runs: 1e-12 by the step.
        d = [float(derivatives(x.at[k].set(n * h))[0]) for n in (-2, -1, 1, 2)]
        return (8.0 * (d[2] - d[1]) - (d[3] - d[0])) / (12.0 * h)

    _, reverse, forward = derivatives(x)
    atol = 1e-9 * np.max(np.abs(reverse))
    np.testing.assert_allclose(reverse @ direction, forward, rtol=0.0, atol=atol)
    # Their size is that of the fourth power of the frequency times h, beside the largest one.
    differences = np.array([rate(k) for k in range(5)])
    np.testing.assert_allclose(reverse, differences, atol=1e-6 * np.max(np.abs(differences)))


@pytest.mark.sweep
def test_an_event_ends_it():
    node = Event(lambda t, y: y.position[2], direction=1, samples=16)
    y0, ts = at_periapsis(0.7), jnp.array([0.0, 8.0])
    runs = [
        simulate(OBLATE, y0, ts, accuracy=accuracy(method), events=(node,))
        for method in (OWN, RKN1210())
    ]
    assert runs[0].event == 0
    np.testing.assert_allclose(runs[0].ts[-1], runs[1].ts[-1], rtol=1e-11)
    assert difference(runs[0].final, runs[1].final) < 1e-10


def test_single_precision():
    """Three revolutions, to the rounding that the phase gathers: 60 rad times 6e-8."""
    single = jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), (OBLATE, at_periapsis(0.7)))
    ts = jnp.array([0.0, 1.0, 20.0], jnp.float32)
    run = simulate(*single, ts, accuracy=Accuracy(1e-5, method=OWN))
    assert run.states.position.dtype == jnp.float32
    y0 = jax.tree.map(lambda x: x.astype(float), single[1])
    true = simulate(OBLATE, y0, ts.astype(float), accuracy=accuracy(OWN))
    found = jax.tree.map(lambda x: x.astype(float), run.states)
    assert difference(found, true.states) < 4e-5


@pytest.mark.parametrize("scene", [OBLATE, DRAGGED], ids=["second order", "first order"])
def test_a_loop_of_stages_is_the_same_step(scene):
    """For the derivatives of many runs."""
    states = [at_periapsis(e) for e in (0.1, 0.7, 0.9)]
    y0 = jax.tree.map(lambda *x: jnp.stack(x, axis=-1), *states)
    whole = scene.regularised()
    z = whole.to_regularised(y0)
    form = form_in(whole, z)
    assert isinstance(form, AbstractSecondOrderForm) is (scene is OBLATE)
    h = jnp.array([0.3, -0.2, 0.1])
    step = eqx.filter_jit(trial_step)
    one, other = (step(form, 0.0, 10.0, z, h, rolled) for rolled in (False, True))
    # Sums of up to 17 terms in another order.
    np.testing.assert_allclose(one.z, other.z, rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(one.rate, other.rate, rtol=1e-14)


@pytest.mark.sweep
def test_derivatives_of_many_runs():
    """In a batch, whose stages are a loop there, as alone."""
    states = [at_periapsis(e) for e in (0.5, 0.7, 0.9)]
    y0s = jax.tree.map(lambda *x: jnp.stack(x, axis=-1), *states)
    ts = jnp.array([0.0, 9.0])

    def together(y):
        run = simulate_batch(OBLATE, y, ts, accuracy=accuracy(OWN, 1e-11))
        return jnp.sum(run.final.position)

    def alone(y):
        return jnp.sum(simulate(OBLATE, y, ts, accuracy=accuracy(OWN, 1e-11)).final.position)

    found, one = jax.jit(jax.grad(together))(y0s), jax.jit(jax.grad(alone))
    for k, y in enumerate(states):
        expected = one(y).velocity
        size = np.max(np.abs(expected))
        np.testing.assert_allclose(found.velocity[:, k], expected, rtol=0.0, atol=1e-8 * size)


@pytest.mark.sweep
def test_a_thrust_that_comes_and_goes():
    """Steps end where it is switched; without its times the jump costs the accuracy, or steps."""

    def push(t, y, body):
        on = (t > 3.0) & (t < 5.5)
        return Load(acceleration_N=jnp.where(on, 1e-3, 0.0) * y.velocity)

    thrust = Custom(push, break_times=jnp.array([3.0, 5.5]))
    scene = Scene((*OBLATE.effects, thrust))
    y0, ts = at_periapsis(0.7), jnp.array([0.0, 1.0, 4.0, 20.0])
    run = simulate(scene, y0, ts, accuracy=accuracy(OWN))
    true = simulate(scene, y0, ts, accuracy=accuracy(DOP853(), 1e-13))
    assert difference(run.states, true.states) < 2e-11


def flight(kick, method, rtol, y0=None):
    """To the apoapsis, an impulse along the path, and on; for a batch of `y0`, too."""
    apoapsis = Event(lambda t, y: dot(y.position, y.velocity), direction=-1, within=8.0)

    def jump(t, y):
        return BodyState(y.position, kick * y.velocity)

    mission = Mission([Phase(OBLATE, apoapsis, jump, "up"), Phase(OBLATE, 9.0, name="round")])
    how = accuracy(method, rtol)
    if y0 is not None:
        return simulate_mission_batch(mission, y0, accuracy=how)
    return simulate_mission(mission, at_periapsis(0.7), accuracy=how)


@pytest.mark.sweep
def test_missions_and_their_derivatives():
    """Alone and in a batch of very different orbits, against RKN 12(10)."""
    run, true = flight(1.1, OWN, 1e-12), flight(1.1, RKN1210(), 1e-13)
    np.testing.assert_allclose(run["up"].ts[-1], true["up"].ts[-1], rtol=1e-12)
    assert difference(run.final, true.final) < 1e-11
    states = [at_periapsis(e) for e in (0.5, 0.7, 0.9)]
    y0s = jax.tree.map(lambda *x: jnp.stack(x, axis=-1), *states)
    together, true = (flight(1.1, m, r, y0s) for m, r in ((OWN, 1e-12), (RKN1210(), 1e-13)))
    np.testing.assert_allclose(together.final.position[:, 1], run.final.position, atol=1e-11)
    assert difference(together.final, true.final) < 1e-10

    total = jax.jit(lambda kick: jnp.sum(flight(kick, OWN, 1e-12).final.position))
    ends = [float(total(1.1 + h)) for h in (-1e-5, 1e-5)]
    slope = jax.grad(lambda kick: jnp.sum(flight(kick, OWN, 1e-12).final.position))(1.1)
    np.testing.assert_allclose(slope, (ends[1] - ends[0]) / 2e-5, rtol=1e-6)


@pytest.mark.sweep
def test_second_derivatives():
    """Forwards over reverse and over forwards, against those of RKN 12(10) in time."""

    def end(x, method, rtol):
        scene = Scene((PointGravity(1.0 + x[0]), Oblateness(1.0 + x[0], J2, RADIUS)))
        y0 = at_periapsis(0.7)
        start = BodyState(y0.position.at[0].add(x[1]), y0.velocity)
        ts = jnp.array([0.0, 7.0 + x[2]])
        run = simulate(scene, start, ts, accuracy=accuracy(method, rtol), throw=False)
        return jnp.sum(jnp.array([1.0, 2.0, 3.0]) * run.final.position)

    x = jnp.zeros(3)
    truth = jax.jit(jax.hessian(lambda x: end(x, RKN1210(), 1e-13)))(x)
    for mode in (jax.hessian, lambda f: jax.jacfwd(jax.jacfwd(f))):
        found = jax.jit(mode(lambda x: end(x, OWN, 1e-12)))(x)
        np.testing.assert_allclose(found, truth, atol=1e-8 * float(jnp.max(jnp.abs(truth))))
