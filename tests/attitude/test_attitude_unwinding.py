"""Yo-yos as systems: the unwinding in closed form and by integration, stretched cords, the swing to
the radius, and arms that swing out."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import quad, solve_ivp

from jaxspace.attitude import YoYo
from jaxspace.attitude.swinging import (
    SwingingCords,
    SwingOutArms,
    SwingState,
    radial_release_spin,
    zero_spin_radial_cord,
)
from jaxspace.attitude.unwinding import CordState, StretchingCords, UnwindingCords
from jaxspace.bodies import BodyState

I, R, M, W0 = 0.264, 0.127, 0.01134, 41.9  # noqa: E741
CORDS = UnwindingCords(I, R, M)
flow = jax.jit(lambda t, y: CORDS.closed_form().flow(t, y))


def numbers(y):
    return np.stack([np.asarray(x) for x in jax.tree.leaves(y)])


def integrate(system, y, span, rtol=1e-11):
    """By SciPy, from the vector field alone."""
    kind = type(y)
    field = jax.jit(lambda x: jnp.stack(jax.tree.leaves(system.vector_field(0.0, kind(*x)))))
    run = solve_ivp(lambda t, x: field(x), (0.0, span), numbers(y), "DOP853", rtol=rtol, atol=1e-12)
    return run.y[:, -1]


# On the motion of a yo-yo; from a cord that unwinds faster, and one that is wound up at first.
@pytest.mark.parametrize("start", [(30.0, 3.0, 41.0), (5.0, 2.0, 9.0), (5.0, 2.0, -1.0)])
def test_the_closed_form_is_the_motion(start):
    y = CordState(*(jnp.asarray(x) for x in start))
    assert_allclose(numbers(flow(0.2, y)), integrate(CORDS, y, 0.2), rtol=1e-9)
    out, rate = jax.jvp(lambda t: flow(t, y), (0.1,), (1.0,))
    assert_allclose(numbers(rate), numbers(CORDS.vector_field(0.1, out)), rtol=1e-10)


def test_from_the_drum_the_cord_unwinds_at_the_first_spin():
    """phi = w0 t, whatever rate is given at phi = 0; the jump `YoYo` is the end of it."""
    for rate in (W0, 0.0):
        y = flow(0.2, CordState(jnp.array(W0), jnp.array(0.0), jnp.array(rate)))
        assert_allclose([y.angle, y.angle_rate], [0.2 * W0, W0], rtol=1e-14)
    yoyo = YoYo(I, R, M, 1.3)
    end = flow(yoyo.unwinding_time(W0), CORDS.state(W0))
    jumped = yoyo(0.0, BodyState(omega=jnp.array([0.0, 0.0, W0])))
    assert_allclose(end.spin, jumped.omega[2], rtol=1e-12)
    assert_allclose(CORDS.tension(end), yoyo.tension(1.3 / R, W0), rtol=1e-12)
    # Finite and right at the drum: dw/dt = 0, dphi/dt = w0.
    slope = jax.jvp(lambda t: flow(t, CORDS.state(W0)), (0.0,), (1.0,))[1]
    assert_allclose(numbers(slope)[0], 0.0, atol=1e-12)
    assert np.isfinite(numbers(jax.jacrev(lambda w: flow(0.1, CORDS.state(w)))(W0))).all()


def test_the_tension_slows_the_body():
    y = CordState(jnp.array(20.0), jnp.array(6.0), jnp.array(41.0))
    assert_allclose(-R * CORDS.tension(y) / I, CORDS.vector_field(0.0, y).spin, rtol=1e-14)


def test_stretched_cords():
    """Energy and momentum have no rate; stiff cords unwind as inextensible ones."""
    soft = StretchingCords(I, R, M, 40.0)
    y = soft.state(W0, 2.0)
    y = CordState(y.spin, y.angle, y.angle_rate + 1.0, y.stretch * 1.3, y.stretch_rate - 0.2)

    def kept(y):
        return soft.invariants(0.0, y)

    values, rates = jax.jvp(kept, (y,), (soft.vector_field(0.0, y),))
    for name, value in values.items():
        assert abs(float(rates[name])) < 1e-12 * W0 * abs(float(value)), name
    assert_allclose(soft.vector_field(0.0, y).spin, -R * soft.tension(y) / I, rtol=1e-15)

    def apart(k):
        stiff = StretchingCords(I, R, M, k)
        end = integrate(stiff, stiff.state(W0, 1.0), 0.15, 1e-9)
        return abs(end[0] - float(flow(0.15 + 1.0 / W0, CORDS.state(W0)).spin))

    assert apart(1e5) < 0.02
    assert 5.0 < apart(1e4) / apart(1e5) < 20.0


def test_masses_that_swing_to_the_radius():
    """From the end of the unwinding to g = 0: the spin of the radial release."""
    cord = 1.1
    loose = SwingingCords(I, R, M, cord)
    end = flow(cord / (R * W0), CORDS.state(W0))
    y = loose.state(end.spin, end.angle_rate)
    # The same tension, energy and momentum on both sides.
    assert_allclose(loose.tension(y), CORDS.tension(end), rtol=1e-11)
    for name, value in loose.invariants(0.0, y).items():
        assert_allclose(value, CORDS.invariants(0.0, end)[name], rtol=1e-12)
    field = jax.jit(lambda x: jnp.stack(jax.tree.leaves(loose.vector_field(0.0, SwingState(*x)))))

    def radial(t, x):
        return x[1]

    radial.terminal = True  # pyright: ignore
    run = solve_ivp(
        lambda t, x: field(x), (0.0, 1.0), numbers(y), "DOP853", rtol=1e-11, atol=1e-12,
        events=radial,
    )  # fmt: skip
    assert_allclose(run.y_events[0][0, 0], radial_release_spin(W0, cord, I, R, M), rtol=1e-9)
    stop = zero_spin_radial_cord(I, R, M)
    assert_allclose(stop, np.sqrt(R * R + I / M) - R, rtol=1e-14)
    assert_allclose(radial_release_spin(W0, stop, I, R, M), 0.0, atol=1e-12)
    # No cord takes no spin.
    assert_allclose(radial_release_spin(W0, 0.0, I, R, M), W0, rtol=1e-14)


def test_arms_that_swing_out():
    arms = SwingOutArms(2.0, 0.2, 0.5, 0.8)
    # Along the axis the acceleration is -theta (l theta'^2 + w^2 (r_0 + l theta) theta).
    near = arms.outward_acceleration(SwingState(*map(jnp.asarray, (10.0, 1e-9, 2.0))))
    assert_allclose(near, -1e-9 * (0.8 * 4.0 + 100.0 * 0.5 * 1e-9), rtol=1e-14)
    for theta in (1e-3, 0.6, 0.5 * np.pi):
        y = SwingState(arms.spin_rate(theta, 10.0), jnp.array(theta), arms.angle_rate(theta, 10.0))
        first = arms.invariants(0.0, arms.state(10.0))
        for name, value in arms.invariants(0.0, y).items():
            assert_allclose(value, first[name], rtol=1e-13)
        time = quad(
            lambda u: 2.0 * u / float(arms.angle_rate(u * u, 10.0)), 0.0, np.sqrt(theta),
            epsabs=0.0, epsrel=1e-12,
        )[0]  # fmt: skip
        # Several spins, and several bodies, take one angle: the time is as the inverse of the spin.
        assert_allclose(
            arms.swing_time(theta, jnp.array([10.0, 20.0])), [time, 0.5 * time], rtol=1e-11
        )
    end = integrate(arms, arms.state(10.0), float(arms.swing_time(0.6, 10.0)))
    expected = [arms.spin_rate(0.6, 10.0), 0.6, arms.angle_rate(0.6, 10.0)]
    assert_allclose(end, expected, rtol=1e-9)


def test_arms_on_the_axis_have_not_swung_yet():
    """No time at the angle zero, and not 0/0; its slope is infinite, that by the spin zero."""
    arms = SwingOutArms(2.0, 0.2, 0.5, 0.8)
    time, slopes = jax.jit(jax.value_and_grad(arms.swing_time, (0, 1)))(0.0, 10.0)
    assert time == 0.0 and slopes == (np.inf, 0.0)
    # Beside it theta'' = w0^2 r_0/l, so t = sqrt(2 theta l/r_0)/w0, to the order of theta.
    near = arms.swing_time(jnp.asarray(1e-9), 10.0)
    np.testing.assert_allclose(near, 0.1 * np.sqrt(2.0 * 1e-9 * 0.8 / 0.5), rtol=1e-8)
