"""Bearings that rub, a motor, gimbal lock and impulses of the gyro in two gimbals."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

from jaxspace import Event, Status, simulate
from jaxspace.gyros import TwoGimbalGyro
from jaxspace.gyros.bearing import BearingFriction, RotorMotor
from jaxspace.gyros.gimbal_state import near_gimbal_lock
from jaxspace.studies import modes

UPRIGHT = 0.5 * np.pi
MASSES = (0.002, 0.0008, 500.0, 0.0006, 0.0005, 0.0004, 0.0015)
J, H = 0.0026, 0.4  # kg m^2, kg m^2/s


STUCK = (0.0, 10.0)


def gyro(inner=STUCK, outer=STUCK, motor=0.0, **more):
    """All with the same parts, so that one program serves."""
    given = {"moment_inner": 0.0, "spin_rate": MASSES[2]} | more
    return jax.tree.map(
        jnp.asarray,
        TwoGimbalGyro(
            *MASSES[:2],
            *(given["spin_rate"], *MASSES[3:], given["moment_inner"]),
            inner_bearing=BearingFriction(*inner),
            outer_bearing=BearingFriction(*outer),
            motor=RotorMotor(motor, 400.0),
        ),
    )


@eqx.filter_jit
def slipping(made, start, end):
    """The run from zero to `end` with its stops and slips."""
    y = made.state(*start)
    event = Event(
        made.friction_margin, direction=-1, terminal=False, then=made.stick_or_slip, capacity=8
    )
    return simulate(made, y, jnp.stack([0.0 * end, end]), events=(event,))


def ran(made, start, end):
    return slipping(made, [jnp.asarray(x) for x in start], jnp.asarray(end))


def stopped(dry):
    """Angle and time at which the inner gimbal comes to rest, without spin."""
    run = ran(gyro((0.01, dry), spin_rate=0.0), (1.0, 0.0, 3.0, 0.0), 1.0)
    return jnp.stack([run.final.theta, run.crossings[0].ts[0], run.final.slip_inner])


def stopped_exactly(dry):
    """r = r0 e^(-t/T) - M/c (1 - e^(-t/T)) with T = J/c, then rest."""
    time = J / 0.01 * jnp.log1p(3.0 * 0.01 / dry)
    return jnp.stack([1.0 + J / 0.01 * 3.0 - dry / 0.01 * time, time, 0.0 * dry])


def test_dry_friction_stops_a_gimbal_where_the_closed_form_does():
    assert_allclose(stopped(0.02), stopped_exactly(0.02), rtol=1e-9)


@pytest.mark.sweep
def test_derivatives_go_through_a_stop():
    _, slope = jax.jvp(stopped, (0.02,), (1.0,))
    assert_allclose(slope, jax.jacfwd(stopped_exactly)(0.02), rtol=1e-7)
    assert_allclose(jax.grad(lambda m: stopped(m)[0])(0.02), slope[0], rtol=1e-9)


def test_a_stuck_outer_gimbal_takes_the_stiffness_and_lets_go():
    """Clamped, the rotor's axis falls as if it did not spin; the gyroscopic moment H theta' tears
    the bearing loose at the time M_d J / (H M_xi)."""
    made = gyro((0.0, 0.0), (0.0, 0.02), moment_inner=0.05)
    run = ran(made, (UPRIGHT, 0.0, 0.0, 0.0), 0.02)
    loose, y = run.crossings[0].ts[0], jax.tree.map(lambda x: x[0], run.crossings[0].states)
    # To the second order in the angle of 3e-5 rad.
    assert_allclose(loose, 0.02 * J / (H * 0.05), rtol=1e-8)
    assert_allclose([y.theta_rate, y.psi], [0.05 * loose / J, 0.0], rtol=1e-8)
    # M_xi makes it precess with the sign of M_xi: the friction acts against that.
    assert run.final.slip_outer == 1.0


def by_scipy(friction, t, start):
    """theta, psi and rates from Lagrange's equations with friction, each piece of one sign."""
    A, C, n, Ai, Bi, Ci, C0 = MASSES

    def rates(t, x):
        theta, _, v, w = x
        s, c = np.sin(theta), np.cos(theta)
        inertia = (A + Bi) * s * s + Ci * c * c + C0
        (ci, mi), (co, mo) = friction
        tilt = (A + Bi - Ci) * w * w * s * c - C * n * w * s - ci * v - mi * np.sign(v)
        turn = C * n * s * v - 2.0 * (A + Bi - Ci) * s * c * v * w - co * w - mo * np.sign(w)
        return [v, w, tilt / (A + Ai), turn / inertia]

    crossings = [lambda t, x, k=k: x[k] for k in (2, 3)]
    x, begin, seen = np.asarray(start), 0.0, []
    for event in crossings:
        event.terminal = True
    while begin < t:
        found = solve_ivp(
            rates,
            (begin, t),
            x,
            "DOP853",
            events=crossings,
            rtol=1e-12,
            atol=1e-14,
            first_step=1e-9,
        )
        x, begin = found.y[:, -1].copy(), found.t[-1]
        if found.status == 1:
            seen.append(begin)
            k = 2 if found.t_events[0].size else 3
            # Beyond zero: no moment of these holds a bearing.
            x = x + 1e-12 * np.asarray(rates(begin, np.where(np.arange(4) == k, 0.0, x)))
            begin += 1e-12
    return x, seen


def test_slips_are_those_of_an_integration_piece_by_piece():
    friction, start = ((0.002, 0.01), (0.001, 0.02)), (1.05, 0.0, 4.0, 0.3)
    made = gyro(*friction)
    run = ran(made, start, 0.06)
    x, seen = by_scipy(friction, 0.06, start)
    assert len(seen) >= 3 and int(run.crossings[0].count) == len(seen)
    assert_allclose(run.crossings[0].ts[: len(seen)], seen, rtol=1e-7)
    end = run.final
    found = [end.theta, end.psi, end.theta_rate, made.outer_rate(end)]
    assert_allclose(found, x, rtol=1e-6, atol=1e-8)


def test_smooth_friction_takes_the_energy_that_it_says():
    made = TwoGimbalGyro(
        *MASSES,
        inner_bearing=BearingFriction(0.01, 0.02, creep=0.1),
        outer_bearing=BearingFriction(0.02, 0.03, creep=0.2),
    )
    y = made.state(1.0, 0.2, 0.3, -0.1)
    _, power = jax.jvp(made.energy, (y,), (made.vector_field(0.0, y),))
    inner = 0.01 * 0.3 + 0.02 * np.tanh(3.0)
    outer = 0.02 * 0.1 + 0.03 * np.tanh(0.5)
    assert_allclose(power, -(inner * 0.3 + outer * 0.1), rtol=1e-12)
    assert made.invariants(0.0, y) == {}


def test_viscous_friction_damps_the_nutation_by_the_mean_of_both_bearings():
    made = TwoGimbalGyro(
        *MASSES,
        inner_bearing=BearingFriction(0.004, creep=1.0),
        outer_bearing=BearingFriction(0.002, creep=1.0),
    )
    found = modes(made, made.state(UPRIGHT, 0.0, 0.0, 0.0))
    decay = 0.5 * (0.004 / J + 0.002 / float(made.outer_inertia(UPRIGHT)))
    assert_allclose(found.eigenvalues.real[-2:], -decay, rtol=1e-10)


def test_a_motor_changes_the_spin_and_no_momentum():
    made = gyro(STUCK, (0.0, 0.0), motor=1e-3)
    start = (1.0, 0.0, 0.0, 0.2)
    y = made.state(*start)
    # Of a stuck inner gimbal psi' follows from the momentum: H' = K (n_0 - H/C + psi' cos).
    end = ran(made, start, 0.5).final
    c, inertia = np.cos(1.0), float(made.outer_inertia(1.0))
    h = float(y.angular_momentum)
    rate = 1e-3 * (1.0 / 0.0008 + c * c / inertia)
    rest = 1e-3 * (400.0 + h * c / inertia) / rate
    assert_allclose(end.spin_momentum, rest + (0.4 - rest) * np.exp(-0.5 * rate), rtol=1e-8)
    assert_allclose(end.angular_momentum, h, rtol=1e-15)
    free = TwoGimbalGyro(*MASSES, motor=RotorMotor(1e-3, 400.0))
    assert set(free.invariants(0.0, free.state(1.0, 0.0, 0.0, 0.2))) == {"angular_momentum"}


def test_two_impulses_turn_the_axis():  # T6.2-P6
    bare = TwoGimbalGyro(0.002, 0.0008, 500.0)
    turn = 2.0 * np.arctan(0.05 / 0.4)
    impulse, time = bare.attitude_change(turn)
    assert_allclose([impulse, time], [0.05, np.pi * 0.002 / np.hypot(0.4, 0.05)], rtol=1e-14)
    y = bare.struck(bare.state(UPRIGHT, 0.0, 0.0, 0.0), impulse)
    half = jax.tree.map(lambda x: x, simulate(bare, y, jnp.stack([0.0, time])).final)
    end, inner, outer = bare.arrested(half)

    def axis(y):
        s = jnp.sin(y.theta)
        return jnp.stack([s * jnp.cos(y.psi), s * jnp.sin(y.psi), jnp.cos(y.theta)])

    assert_allclose(axis(end) @ axis(y), np.cos(turn), rtol=1e-9)
    # The second impulse is as large, and leaves both gimbals at rest.
    across = jnp.hypot(inner, outer / jnp.sin(half.theta))
    assert_allclose(across, impulse, rtol=1e-8)
    assert_allclose([end.theta_rate, bare.outer_rate(end)], 0.0, atol=1e-9)


def test_gimbal_lock_is_an_event_and_no_nan():
    bare = TwoGimbalGyro(0.002, 0.0008, 0.5)
    y = bare.state(0.5, 0.0, -3.0, 0.0)
    lock = Event(near_gimbal_lock, direction=-1)
    # With no momentum about Z and next to no spin it falls through the pole.
    run = simulate(
        bare,
        bare.struck(y, 0.0, 0.0004 * (1.0 - np.cos(0.5))),
        jnp.array([0.0, 1.0]),
        events=(lock,),
    )
    assert Status(int(run.status)) == Status.EVENT
    assert_allclose(run.final.theta, 1e-3, rtol=1e-5)
    assert all(np.all(np.isfinite(x)) for x in jax.tree.leaves(run.final))


@pytest.mark.parametrize("runs", [3])
def test_bearings_of_a_batch_stop_each_at_its_time(runs):
    dry = jnp.linspace(0.02, 0.05, runs)
    made = TwoGimbalGyro(0.002, 0.0008, 0.0, 0.0006, inner_bearing=BearingFriction(0.0, dry))
    y = made.state(1.0, 0.0, jnp.full(runs, 3.0), 0.0)
    margin = made.friction_margin(0.0, y)
    assert margin.shape == (runs,)
    rate = made.vector_field(0.0, y)
    assert_allclose(rate.theta_rate, -dry / J, rtol=1e-14)
    stopped = made.stick_or_slip(0.0, eqx.tree_at(lambda y: y.theta_rate, y, 0.0 * dry))
    assert_allclose(stopped.slip_inner, 0.0)
