"""The turn from the nominal attitude to that of a run, as outputs of a campaign."""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspace
from jaxspace.attitude.outputs import (
    attitude_error,
    attitude_error_x,
    attitude_error_y,
    attitude_error_z,
)
from jaxspace.dispersion import disperse
from jaxspace.rotations import Quaternion

NOMINAL = SimpleNamespace(attitude=Quaternion(jnp.array([[0.6], [-0.3], [0.7], [0.2]])))
AXIS = np.array([2.0, -1.0, 2.0]) / 3.0


def errors(turn):
    """Angle and rotation vector of attitudes that lie these rotation vectors, (3, runs), away."""
    attitude = NOMINAL.attitude.then(Quaternion.from_rotation_vector(turn))
    parts = (attitude_error_x, attitude_error_y, attitude_error_z)
    vector = jnp.stack([part(attitude, NOMINAL) for part in parts])
    return attitude_error(attitude, NOMINAL), vector


@jax.jit
def values_and_slopes(turns):
    slopes = jax.jacfwd(lambda t: jnp.vstack(errors(t[:, None])))
    back = jax.jacrev(lambda t: jnp.vstack(errors(t[:, None])))
    return errors(turns), jax.vmap(slopes, -1)(turns), jax.vmap(back, -1)(turns)


def test_errors_are_the_turns_that_were_made():
    """From none over a billionth to a millionth less than half a turn: angle and vector, and their
    derivatives, which are the axis and one."""
    sizes = np.array([0.0, 1e-12, 1e-6, 2e-3, 0.7, 3.0, np.pi - 1e-6])
    turns = jnp.asarray(AXIS[:, None] * sizes)
    (angle, vector), forward, reverse = values_and_slopes(turns)
    # Products of four unit quaternions' components, each rounded.
    np.testing.assert_allclose(angle, sizes, rtol=0.0, atol=2e-15)
    np.testing.assert_allclose(vector, turns, rtol=0.0, atol=2e-15)
    for slopes in (forward, reverse):
        # Beside half a turn, and of a vector over its own small sine, more of the rounding is seen.
        expected = np.broadcast_to(np.eye(3), (len(sizes), 3, 3))
        np.testing.assert_allclose(slopes[:, 1:, 0, :], expected, rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(slopes[2:, 0, 0], np.tile(AXIS, (5, 1)), rtol=0.0, atol=1e-9)
        # The angle has a corner here: of its slopes in all directions rounding decides on one.
        assert np.linalg.norm(slopes[0, 0, 0]) < 1.0 + 1e-9


def test_slopes_of_the_axis_beside_half_a_turn():
    """A billionth beside half a turn, about an axis a hundredth off the body's x axis: changes of
    the attitude along the axis of the turn leave the axis as it is. What is left of these slopes is
    a rounding of an off-axis component times pi, where it was one of the axis itself."""
    w, tilt = 1e-9, 8.7e-3
    nominal = SimpleNamespace(attitude=Quaternion(jnp.array([1.0, 0.0, 0.0, 0.0])))
    parts = (attitude_error_x, attitude_error_y, attitude_error_z)

    def vector(q):
        return jnp.stack([part(Quaternion(q), nominal) for part in parts])

    q = jnp.array([w, 1.0, -tilt, 0.0])
    # phi = theta e, e = (1, -tilt, 0)/s: d(phi_x)/d(q_1) = theta tilt^2/s^3 + 2 w/(s^2 + w^2)/s^2.
    s = np.hypot(1.0, tilt)
    theta = 2.0 * np.arctan2(s, w)
    expected = theta * tilt**2 / s**3 + 2.0 * w / (s**2 + w**2) / s**2
    for slopes in jax.jit(lambda q: (jax.jacfwd(vector)(q), jax.jacrev(vector)(q)))(q):
        np.testing.assert_allclose(slopes[0, 1], expected, rtol=1e-14)
        np.testing.assert_allclose(slopes[2, 3], theta / s, rtol=1e-14)


def test_half_a_turn_and_more():
    """Half a turn is the largest error; beyond, the shorter turn is the other way."""
    (angle, vector), *_ = values_and_slopes(jnp.asarray(AXIS[:, None] * (2.0 * np.pi - 0.5)))
    np.testing.assert_allclose(angle, 0.5, rtol=1e-14)
    np.testing.assert_allclose(vector[:, 0], -0.5 * AXIS, rtol=1e-14)
    (angle, vector), *slopes = values_and_slopes(jnp.asarray(AXIS[:, None] * np.pi))
    np.testing.assert_allclose(angle, np.pi, rtol=1e-14)
    # Of two opposite vectors either is right.
    np.testing.assert_allclose(np.abs(vector[:, 0]), np.pi * np.abs(AXIS), rtol=1e-14)
    assert all(np.all(np.isfinite(x)) for x in slopes)


SCENE = """
accuracy = 1e-10
[body]
inertia = ["5 kg m^2", "5 kg m^2", "3 kg m^2"]
[initial]
omega = ["0 rad/s", "0 rad/s", "2 rad/s"]
[initial.attitude]
angles = ["0.3 rad", "0.4 rad", "0.5 rad"]
[times]
end = "2 s"
[dispersion]
runs = 16
outputs = [{ output = "attitude_error", unit = "deg" }, "attitude_error_x", "attitude_error_y",
  "attitude_error_z"]
[dispersion.inputs]
"initial.omega.2" = { deviation = "0.01 rad/s" }
"""


# The errors themselves are in the tests above, campaigns in tests of their own.
@pytest.mark.sweep
def test_a_campaign_of_attitude_errors(tmp_path):
    """A steady spin that is wrong by d is wrong by the angle d t about the axis of the spin."""
    (tmp_path / "scene.toml").write_text(SCENE)
    flown = disperse(jaxspace.load(tmp_path / "scene.toml").campaign(), 16, accuracy=1e-10)
    turn = 2.0 * (flown.inputs["initial.omega.2"] - 2.0)
    found = {name: flown.outputs[f"attitude_error_{name}"] for name in "xyz"}
    # Some ten steps of 1e-10 each, of the run and of the nominal one.
    np.testing.assert_allclose(found["z"], turn, rtol=0.0, atol=1e-8)
    for name in "xy":
        np.testing.assert_allclose(found[name], 0.0, atol=1e-8)
    angle = np.deg2rad(flown.outputs["attitude_error"])
    np.testing.assert_allclose(angle, np.abs(turn), rtol=0.0, atol=1e-8)
    assert flown.units["attitude_error"] == "deg"
