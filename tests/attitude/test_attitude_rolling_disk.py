"""The rolling disk beyond the reference cases: power of the resistance, steady circles, the force
of the plane, and the coin that settles."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxspace import Event, simulate, simulate_batch
from jaxspace.attitude import RollingDisk
from jaxspace.attitude.disk_tilt import disk_tilt, lies_flat
from jaxspace.core.vectors import cross, dot
from jaxspace.simulation import Status

M, R, G = 0.01, 0.0153, 9.80665
COIN = RollingDisk.uniform(M, R, G)
A, C = float(COIN.transverse_inertia), float(COIN.axial_inertia)


def rolling(disk, theta, rate, spin):
    """The state with the precession `rate` and the spin."""
    return disk.state(
        jnp.array([0.3, theta, 0.2]), jnp.array([rate, 0.0, spin - rate * np.cos(theta)])
    )


def test_the_resistance_takes_its_power():
    disk = RollingDisk(M, R, A, C, G, contour_damping=2e-9, contour_friction=3e-3)
    y = disk.state(jnp.array([0.3, 0.8, 0.2]), jnp.array([5.0, 1.5, -9.0]))
    _, power = jax.jvp(disk.energy, (y,), (disk.vector_field(0.0, y),))
    assert_allclose(power, -(2e-9 * 81.0 + 3e-3 * M * G * R * 9.0), rtol=1e-12)
    assert "energy" not in disk.invariants(0.0, y)


def test_steady_circles():
    disk = RollingDisk.hoop(1.0, 0.3, G)
    for theta, rate in ((1.2, 2.0), (0.4, 6.0), (2.0, -1.5)):
        spin = disk.steady_spin(theta, rate)
        assert_allclose(disk.tilt_acceleration(theta, rate, spin), 0.0, atol=1e-12)
        found = disk.steady_precession_rates(theta, spin)
        assert_allclose(min(abs(p - rate) for p in found), 0.0, atol=1e-12)
    # The small oscillation by differences of the equations along psi'(theta), n(theta).
    theta, rate, step = 1.2, 2.0, 1e-5
    A, C, mRR = 0.045, 0.09, 0.09
    spin = float(disk.steady_spin(theta, rate))
    by_rate = (C * spin - 2 * A * rate * np.cos(theta)) / (A * np.sin(theta))
    by_spin = mRR * rate * np.sin(theta) / (C + mRR)
    ends = [
        disk.tilt_acceleration(theta + h, rate + by_rate * h, spin + by_spin * h)
        for h in (-step, step)
    ]
    kappa = disk.tilt_stiffness(theta, rate, spin)
    assert_allclose(kappa, (ends[0] - ends[1]) / (2 * step), rtol=1e-8)
    # The limits of the motions that stand upright are those where kappa vanishes.
    upright = 0.5 * np.pi
    least = disk.least_rolling_spin, disk.least_standing_spin
    assert_allclose(disk.tilt_stiffness(upright, 0.0, least[0]), 0.0, atol=1e-12)
    assert_allclose(disk.tilt_stiffness(upright, least[1], 0.0), 0.0, atol=1e-12)


def test_slopes_of_the_growth_rate():
    """By the disk itself, its tilt, precession and spin: a slow hoop that stands upright falls at
    the rate of its own stiffness. Central differences: truncation 1e-10, rounding 1e-10."""
    x = jnp.array([1.1, 0.3, G, 0.5 * np.pi - 0.1, 0.2, 0.4])

    def growth(x):
        return RollingDisk.hoop(*x[:3]).growth_rate(*x[3:])

    h = 1e-5
    points = x + h * np.concatenate([np.eye(6), -np.eye(6), np.zeros((1, 6))])
    values = jax.jit(jax.vmap(growth))(points)
    assert float(values[-1]) > 1.0
    slopes = jax.jit(lambda x: (jax.grad(growth)(x), jax.jvp(growth, (x,), (jnp.ones(6),))[1]))(x)
    expected = (values[:6] - values[6:12]) / (2 * h)
    assert_allclose(slopes[0], expected, rtol=1e-7, atol=1e-8)
    assert_allclose(slopes[1], jnp.sum(expected), rtol=1e-7)


def test_the_plane_turns_the_disk():
    """The moment of the plane's force about the centre changes the angular momentum."""
    y = COIN.state(jnp.array([0.3, 0.8, 0.2]), jnp.array([5.0, 1.5, -9.0]))

    def momentum(y):
        return y.attitude.rotate(jnp.array([A, A, C]) * y.omega)

    _, change = jax.jvp(momentum, (y,), (COIN.vector_field(0.0, y),))
    moment = cross(COIN.contact(y) - y.position, COIN.contact_force(y))
    assert_allclose(moment, change, rtol=1e-10, atol=1e-12 * float(jnp.max(jnp.abs(change))))
    assert_allclose(COIN.contact(y)[2], 0.0, atol=1e-16)
    # The contact rests: the velocity of the centre is that of a turn about it.
    omega = y.attitude.rotate(y.omega)
    assert_allclose(COIN.velocity(y), cross(omega, y.position - COIN.contact(y)), atol=1e-14)
    assert float(dot(COIN.velocity(y), COIN.velocity(y))) > 0.0


@pytest.mark.sweep
def test_a_coin_settles_until_it_is_all_but_flat():
    """From 1e-3 to 1e-4 rad in a hundred turns, by the law of slow resistance, and not before."""
    disk = RollingDisk(M, R, A, C, G, contour_damping=4e-12)
    theta = 1e-3
    rate, _ = disk.steady_precession_rates(theta, 0.0)
    y = rolling(disk, theta, rate, 0.0)
    time = float(disk.settling_time(theta) - disk.settling_time(1e-4))
    run = simulate(disk, y, jnp.array([0.0, 1.2 * time]), accuracy=1e-9, events=(Event(lies_flat),))
    assert run.status == Status.EVENT
    assert_allclose(disk_tilt(run.final.attitude), 1e-4, rtol=1e-6)
    # The law holds to the fall in one turn over the tilt: a hundredth at the end.
    assert_allclose(run.ts[-1], time, rtol=1e-2)
    fast = float(jnp.linalg.norm(disk.velocity(run.final)))
    assert fast < 0.05


@pytest.mark.sweep
def test_a_coin_that_falls_is_seen_wherever_the_samples_lie():
    """Almost without precession it comes down to 5e-5 rad and rises again, within 1e-4 of the time
    that is searched."""
    ends = jnp.linspace(0.06, 0.15, 46)
    one = jnp.ones_like(ends)
    angles = jnp.stack([0.0 * ends, 0.3 * one, 0.0 * ends])
    rates = jnp.stack([0.02 * one, 0.0 * ends, -0.02 * np.cos(0.3) * one])
    disk = RollingDisk.uniform(0.0113, 0.0153, G)
    ts = jnp.stack([0.0 * ends, ends])
    run = simulate_batch(disk, disk.state(angles, rates), ts, events=(Event(lies_flat),))
    assert np.all(np.asarray(run.status) == Status.EVENT)
    assert_allclose(run.ts[-1], run.ts[-1, 0], rtol=1e-9)
    assert_allclose(disk_tilt(run.final.attitude), 1e-4, rtol=1e-6)


@pytest.mark.sweep
def test_the_derivative_of_a_roll():
    disk = RollingDisk.uniform(1.0, 0.3, G)

    def tilt(spin):
        y = rolling(disk, 1.4, 0.5, spin)
        return disk_tilt(simulate(disk, y, jnp.array([0.0, 0.3])).final.attitude)

    value, slope = jax.jit(jax.value_and_grad(tilt))(12.0)
    step = 1e-4
    ends = [jax.jit(tilt)(12.0 + h) for h in (-step, step)]
    assert np.isfinite(value)
    assert_allclose(slope, (ends[1] - ends[0]) / (2 * step), rtol=1e-4)


def test_the_growth_rate_has_derivatives_by_the_disk():
    """Upright at rest theta'' = m g R/(A + m R^2) in the tilt: of a uniform disk sqrt(4 g/(5 R)),
    with the derivative by g of half of it over g."""

    def rate(gravity):
        return RollingDisk.uniform(1.0, 0.3, gravity).growth_rate(0.5 * jnp.pi, 0.0, 0.0)

    expected = np.sqrt(0.8 * 9.8 / 0.3)
    assert_allclose(jax.jit(rate)(9.8), expected, rtol=1e-12)
    for slope in (jax.jit(jax.grad(rate)), jax.jit(jax.jacfwd(rate))):
        assert_allclose(slope(9.8), 0.5 * expected / 9.8, rtol=1e-12)
