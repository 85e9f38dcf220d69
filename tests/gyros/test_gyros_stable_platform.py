"""The stable platform about three axes: its axes, its loops, and what happens at gimbal lock."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxspace import simulate
from jaxspace.gyros import StablePlatform
from jaxspace.gyros.stable_platform import _vehicle_axes, gimbal_axes
from jaxspace.studies import modes

LOOP = dict(gain=2.0, rate_gain=0.05, gyro_damping=0.01)
J, I_G, I, H = (0.3, 0.4, 0.5), 0.02, 2e-4, 0.05
PLATFORM = StablePlatform(J, I_G, I, H, **LOOP)


@pytest.mark.parametrize("angles", [[0.3, -0.4, 0.7], [0.2, 0.3, -0.4, 0.7]])
def test_axes_of_gimbals_are_the_derivative_of_the_attitude(angles):
    angles = jnp.array(angles)

    def turn(x):
        moved = _vehicle_axes(angles).inverse().then(_vehicle_axes(angles + x))
        return moved.rotation_vector()

    assert_allclose(gimbal_axes(angles), jax.jacfwd(turn)(jnp.zeros_like(angles)), atol=1e-14)


def test_its_linearisation_has_the_transfer_functions_of_one_axis():
    """Thomson 6.8, by the same system: roll, yaw and pitch each as an axis of its own."""
    made = modes(PLATFORM, PLATFORM.state(), inputs=("torque",), outputs=("gyro_angles",))
    s = np.array([0.3j, 5.0j, 80.0j])
    response = made.transfer(jnp.asarray(s))
    for k, inertia in enumerate(np.array(J) + I_G):
        lead = LOOP["gain"] + (H + LOOP["rate_gain"]) * s
        truth = H / (inertia * s**2 * (I * s + LOOP["gyro_damping"]) + H * lead)
        assert_allclose(response[k, k], truth, rtol=1e-10)
    assert np.abs(response[0, 1]).max() < 1e-14 * np.abs(response[0, 0]).max()


def test_motors_hold_it_at_any_angle_but_the_lock():
    """The moment on a platform without gimbal inertia is minus the signal; with the book's
    resolver it grows as 1 / cos^2(yaw)."""
    light = eqx.tree_at(lambda p: p.gimbal_inertia, PLATFORM, jnp.asarray(1e-14))
    y = light.state(0.3, 1.2, 0.0)
    angles = y.angles
    y = eqx.tree_at(lambda y: y.gyro_angles, y, jnp.array([1e-3, 2e-3, -1e-3]))

    def moment(platform):
        rate = platform.vector_field(0.0, y)
        return jnp.array(J) * (gimbal_axes(angles) @ rate.angle_rates)

    assert_allclose(moment(light), -2.0 * y.gyro_angles, rtol=1e-9)
    book = StablePlatform(J, 1e-14, I, H, **LOOP, secant=True)
    axes = gimbal_axes(angles)
    truth = -jnp.linalg.inv(axes @ axes.T) @ (2.0 * y.gyro_angles)
    assert_allclose(moment(book), truth, rtol=1e-9)
    # Pitch and roll share a component along the platform's x axis at this pitch.
    assert moment(book)[0] / moment(light)[0] > 1.0 / np.cos(1.2) ** 2 - 1e-6


def run(platform, y, end, count=41):
    return simulate(platform, y, jnp.linspace(0.0, end, count), accuracy=1e-9)


@pytest.mark.sweep
def test_roll_flips_where_a_vehicle_passes_close_to_the_lock():
    """A vehicle yaws through 90 deg, rolled by 3 deg: its roll gimbal turns by nearly half a turn,
    while the platform stays."""
    miss = 0.05
    platform = StablePlatform(
        J, 2e-4, I, H, gain=40.0, rate_gain=2.0, gyro_damping=0.05, vehicle_rate=[0.0, 0.0, -0.5]
    )
    found = run(platform, platform.state(miss), 2.0 * np.pi)
    roll, yaw, _ = found.states.angles
    attitude = found.states.attitude.rotation_vector()
    # The flip shakes it for a moment.
    assert np.abs(attitude).max() < 1e-2 and np.abs(attitude[:, -1]).max() < 2e-4
    assert np.abs(yaw).max() > 0.5 * np.pi - 1.2 * miss
    assert np.abs(roll - roll[0]).max() > 2.9
    assert np.isfinite(found.states.angles).all()


@pytest.mark.sweep
def test_a_fourth_gimbal_keeps_away_from_the_lock():
    platform = StablePlatform(
        J,
        I_G,
        I,
        H,
        gain=40.0,
        rate_gain=2.0,
        gyro_damping=0.05,
        outer_gain=30.0,
        outer_damping=2.0,
        vehicle_rate=[0.0, 0.0, -0.5],
        fourth=True,
    )
    found = run(platform, platform.state(), 2.0 * np.pi)
    outer, _, yaw, _ = found.states.angles
    assert np.abs(yaw).max() < 0.1
    assert_allclose(outer[-1], np.pi, atol=0.1)
    assert np.abs(found.states.attitude.rotation_vector()).max() < 2e-3
