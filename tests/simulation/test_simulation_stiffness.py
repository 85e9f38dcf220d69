"""Which runs are taken for slow motion beside a fast linear one, and that they are right."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from systems import GYRO, TOP, Integrated, rocket_scene, rocket_state
from test_solvers_exponential import CompassState, Damped, Gyrocompass, Modes, Pendulum, Swing

from jaxspace.attitude import Top
from jaxspace.integration import select_method
from jaxspace.integration.stiffness import InitialConditions, is_stiff
from jaxspace.simulation import (
    Event,
    Mission,
    Phase,
    Status,
    simulate,
    simulate_batch,
    simulate_mission,
)
from jaxspace.simulation._batch import SAMPLED
from jaxspace.solvers import DOP853, ExponentialRosenbrock, Tsit5

COMPASS = Gyrocompass(jnp.array(1e3))
MODES = Modes(jnp.array([1e3, 37.0, 0.3]), 0.0, 2.0)
RING = Swing(jnp.array([1.0, 0.5, -1.0]), jnp.zeros(3))
ONE = jnp.array(1.0)
SWING = Swing(ONE, jnp.array(0.0))
STIFF = ExponentialRosenbrock


def quarter(compass=COMPASS):
    """A quarter of the slow period."""
    return np.array([0.0, 0.5 * np.pi / compass.slow_rate()])


@pytest.mark.parametrize(
    ("system", "state", "span", "rtol", "method"),
    [
        (COMPASS, Gyrocompass.start(0.3), 5e3, 1e-9, STIFF),
        (COMPASS, Gyrocompass.start(0.3), -5e3, 1e-9, STIFF),
        (COMPASS, Gyrocompass.start(0.3, 1e-3), 5e3, 1e-4, STIFF),
        (COMPASS, Gyrocompass.start(0.3), 15.0, 1e-9, STIFF),
        (COMPASS, Gyrocompass.start(0.3), 5.0, 1e-9, DOP853),
        (COMPASS, Gyrocompass.start(0.3), 5.0, 1e-4, Tsit5),
        (MODES, RING, 500.0, 1e-9, STIFF),
        (eqx.tree_at(lambda m: m.c, MODES, 20.0), RING, 500.0, 1e-9, STIFF),
        (Damped(1e6), ONE, 1.0, 1e-9, STIFF),
        (Damped(1e6), ONE, -1.0, 1e-9, DOP853),  # backwards it is not damped
        (Damped(1e2), ONE, 1.0, 1e-9, DOP853),
        # A small nutation is linear as far as can be told; a large one, or a large swing, is not.
        (GYRO, GYRO.state(1.05, 0.0, 1e-5, 0.0), 2e3, 1e-9, STIFF),
        (GYRO, GYRO.state(1.05, 0.0, 1.0, 0.0), 2e3, 1e-9, DOP853),
        (
            Pendulum(jnp.array(1e6)),
            eqx.tree_at(lambda y: y.x, SWING, 1e-2 * ONE),
            500.0,
            1e-9,
            DOP853,
        ),
        # Nor is a body that spins, however long.
        (
            Integrated(TOP),
            Top.state(jnp.array([0.2, 0.7, 0.1]), jnp.array([1.0, 0.3, 149.0])),
            1e5,
            1e-9,
            DOP853,
        ),
        (rocket_scene(), rocket_state(), 1e6, 1e-9, DOP853),
    ],
)
def test_stiff_runs_are_known_by_their_numbers(system, state, span, rtol, method):
    assert isinstance(select_method(system, state, rtol, np.array([0.0, span])), method)
    assert not isinstance(select_method(system, state, rtol), STIFF)


def test_a_slow_spin_in_balance_is_not_taken_for_a_linear_motion():
    """Nothing but the attitude moves, at a constant rate: its derivatives would be wrong, for the
    Jacobian turns with it."""
    still = Integrated(Top(0.002, 0.0008, 0.0))
    assert isinstance(
        select_method(
            Integrated(still),
            Top.state(jnp.zeros(3), jnp.array([0.0, 0.0, 100.0])),
            1e-6,
            [0.0, 1e5],
        ),
        DOP853,
    )


def test_many_states_asked_for_leave_the_exponential_method_no_room():
    start = Gyrocompass.start(0.3)
    assert isinstance(select_method(COMPASS, start, 1e-9, np.linspace(0.0, 5e3, 1001)), STIFF)
    assert isinstance(select_method(COMPASS, start, 1e-9, np.linspace(0.0, 5e3, 100001)), DOP853)


def test_a_gyrocompass_by_default():
    run = simulate(COMPASS, Gyrocompass.start(1e-3), quarter())
    assert isinstance(run.config.method, STIFF)
    assert run.stats["steps"] < 30
    # Not linear in the heading to the second order of 1e-3, and the root not exact to Omega / n.
    np.testing.assert_allclose(run.final.psi, 0.0, atol=3e-9)


def test_it_stops_at_an_event():
    north = Event(lambda t, y: y.psi, direction=-1)
    run = simulate(COMPASS, Gyrocompass.start(1e-3), 2.0 * quarter(), events=(north,))
    assert isinstance(run.config.method, STIFF)
    assert run.status == Status.EVENT
    np.testing.assert_allclose(run.ts[-1], quarter()[1], rtol=1e-5)


def test_where_numbers_are_not_known_the_structure_decides():
    ts = np.array([0.0, 0.05])
    seen = []

    @jax.jit
    def end(psi):
        run = simulate(COMPASS, CompassState(psi, 0.0 * psi, 0.0 * psi, 0.0 * psi), ts)
        seen.append(run.config.method)
        simulate(
            COMPASS, Gyrocompass.start(0.3), 1e5 * ts, throw=False
        )  # concrete, and yet within a traced program
        return run.final.psi

    jax.eval_shape(end, jnp.array(0.3))
    assert isinstance(seen[0], DOP853)
    mission = simulate_mission(Mission([Phase(COMPASS, until=0.05)]), Gyrocompass.start(0.3))
    assert isinstance(mission.phases[0].config.method, DOP853)


def test_a_batch_is_judged_by_its_runs():
    """Short runs beside stiff ones, and one that is not a number: every row is right, or marked."""
    n = jnp.array([1e3, 1e4, 1.0, 1e3])
    psi = jnp.array([1e-3, 2e-3, 1e-3, jnp.nan])
    y0s = CompassState(psi, 0.0 * psi, 7.2921e-5 * jnp.sin(psi), 0.0 * psi)
    ts = jnp.stack([jnp.asarray(quarter(Gyrocompass(x))) for x in n], axis=-1)
    batch = simulate_batch(Gyrocompass(n), y0s, ts)
    assert isinstance(batch.config.method, STIFF)
    assert batch.status.tolist() == [Status.COMPLETED] * 3 + [Status.NOT_FINITE]
    # As above; and beside a rotor of one radian a second the nutation itself is of 7e-8.
    assert np.all(np.abs(batch.final.psi[:3]) < [3e-9, 1e-8, 5e-7])


def few_among_many(few, system, of):
    """Forty runs: `few` where no sample falls, and the others short."""
    places, spans = np.array([1, 22, 24])[: len(few)], np.full(40, 1e-2)
    assert not set(places) & set(np.linspace(0, 39, SAMPLED).astype(int))
    x = np.full(40, 1e-3)

    def ends(x, spans):
        return simulate_batch(
            system,
            jax.vmap(of, out_axes=-1)(jnp.asarray(x)),
            jnp.outer(jnp.array([0.0, 1.0]), spans),
        )

    alone = ends(x, spans).final
    x[places], spans[places] = np.transpose(few)
    run = ends(x, spans)
    others = np.setdiff1d(np.arange(40), places)
    assert np.all(run.status[others] == Status.COMPLETED)
    for a, b in zip(jax.tree.leaves(run.final), jax.tree.leaves(alone), strict=True):
        np.testing.assert_allclose(a[..., others], b[..., others], rtol=1e-9, atol=1e-12)
    return jax.tree.map(lambda x: x[places], run.status), jax.tree.map(
        lambda x: x[..., places], run.final
    )


@pytest.mark.sweep
def test_stiff_runs_among_others_that_no_sample_shows_are_taken_by_themselves():
    def start(p):
        return CompassState(p, 0.0 * p, 7.2921e-5 * jnp.sin(p), 0.0 * p)

    status, final = few_among_many([(1e-3, quarter()[1]), (2e-3, quarter()[1])], COMPASS, start)
    assert status.tolist() == [Status.COMPLETED] * 2
    np.testing.assert_allclose(final.psi, 0.0, atol=1e-8)


def test_runs_that_no_method_brings_to_their_end_say_so():
    """A pendulum of k = 1e6 with a large swing: fast, and not linear."""
    status, _ = few_among_many(
        [(1.0, 500.0)], Pendulum(jnp.array(1e6)), lambda x: Swing(x, 0.0 * x)
    )
    assert status.tolist() == [Status.MAX_STEPS]


def test_one_run_that_needs_small_steps_keeps_all_explicit():
    """A pendulum of k = 1e6 swings linearly where its swing is small enough for the tolerance."""
    amplitude, rows = np.array([1e-5, 1e-5, 1.0]), np.arange(3)
    y0s, system = Swing(jnp.asarray(amplitude), jnp.zeros(3)), Pendulum(jnp.array(1e6))

    def stiff(spans, rows):
        ts = jnp.asarray(np.outer([0.0, 1.0], spans))
        axes = (jax.tree.map(lambda _: 0, system), jax.tree.map(lambda _: 1, y0s), 1)
        return is_stiff(InitialConditions((system, y0s, ts), axes, rows), 1e-5)

    assert stiff([500.0] * 3, rows[:2])
    assert not stiff([500.0] * 3, rows)
    assert stiff([500.0, 500.0, 0.5], rows)
    assert not stiff([0.5] * 3, rows)


def test_a_batch_is_stiff_that_shares_a_number_of_each_component():
    """Three frequencies, (3, 1), beside states, (3, runs): a run of it is not taken as (3,)."""
    system = eqx.tree_at(lambda m: m.w, MODES, MODES.w[:, None])
    y0s = jax.tree.map(lambda x: jnp.stack([x, 0.5 * x], axis=-1), RING)
    axes = (jax.tree.map(lambda _: 0, system), jax.tree.map(lambda _: 1, y0s), 0)
    for end, stiff in ((500.0, True), (0.5, False)):
        starts = InitialConditions((system, y0s, jnp.array([0.0, end])), axes, np.arange(2))
        assert is_stiff(starts, 1e-9) == stiff


def test_single_precision_is_judged_in_its_own():
    def one(x):
        return jnp.asarray(x, jnp.float32)

    assert isinstance(select_method(Damped(one(1e6)), one(1.0), 1e-5, one([0.0, 1.0])), STIFF)
    assert isinstance(select_method(Damped(one(1e2)), one(1.0), 1e-5, one([0.0, 1.0])), DOP853)
