"""Laws: against linear theory, conservation and the scene files that fly them."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspace
from jaxspace import BodyState, Scene, Status
from jaxspace.attitude import ReactionWheels
from jaxspace.bodies import RigidBody
from jaxspace.control import ClosedLoop, CommandedEngine, CommandedMotor, CommandedTorque
from jaxspace.control.attitude_laws import (
    MomentumDumping,
    NutationControl,
    QuaternionFeedback,
    SpinRateControl,
    error_vector,
)
from jaxspace.control.point_laws import LeastEffortGuidance, Together
from jaxspace.core.vectors import dot, norm
from jaxspace.io import SceneError
from jaxspace.orbits import UniformGravity
from jaxspace.rotations import Quaternion
from jaxspace.simulation import SimulationError

SCENES = Path(__file__).resolve().parents[2] / "examples" / "scenes"
BODY = RigidBody(inertia=[3.0, 3.0, 5.0])
FREE = Scene([CommandedTorque()], BODY)


def test_small_errors_obey_the_linear_equation():
    """J e'' + k_d e' + k_p e = 0 for a fast sample, critically damped about the third axis."""
    k, c = 0.5, 2.0 * np.sqrt(0.5 * 5.0)
    angle = 1e-3
    y0 = BodyState(attitude=Quaternion.about(2, jnp.array(angle)), omega=jnp.zeros(3))
    ts = np.linspace(0.0, 20.0, 11)
    run = ClosedLoop(FREE, QuaternionFeedback(k, c), period=2e-3).simulate(y0, ts, accuracy=1e-8)
    rate = np.sqrt(k / 5.0)
    expected = angle * (1.0 + rate * ts) * np.exp(-rate * ts)
    error = error_vector(run.states.attitude, jnp.array([1.0, 0.0, 0.0, 0.0]))[2]
    # Half a sample of delay changes the damping by k T / 2 over c: 3e-4 of it.
    np.testing.assert_allclose(error, expected, atol=1e-3 * angle)


def test_the_short_way_round():
    """Two quaternions of one attitude give one command."""
    q = Quaternion.from_rotation_vector(jnp.array([0.3, -2.0, 1.1])).wxyz
    target = jnp.array([0.5, 0.5, -0.5, 0.5])
    a, b = (error_vector(Quaternion(s * q), target) for s in (1.0, -1.0))
    np.testing.assert_allclose(a, b, atol=1e-15)
    assert norm(a) <= 2.0


def test_spin_and_nutation():
    """The spin comes to its rate and the rest dies out, exponentially with gain over moment."""
    y0 = BodyState(attitude=Quaternion.identity(), omega=jnp.array([0.1, -0.05, 0.4]))
    nutation = ClosedLoop(FREE, NutationControl(0.6), period=0.01)
    across = jnp.hypot(*nutation.simulate(y0, [0.0, 10.0], accuracy=1e-8).final.omega[:2])
    # The transverse rate turns in the body at 0.27 rad/s, so that a sample of 0.01 s is late by
    # some 1e-3 of it.
    np.testing.assert_allclose(across / jnp.hypot(*y0.omega[:2]), np.exp(-0.2 * 10.0), rtol=5e-3)
    spin = ClosedLoop(FREE, SpinRateControl(1.0, 1.0), period=0.01)
    final = spin.simulate(y0, [0.0, 10.0], accuracy=1e-8).final.omega
    np.testing.assert_allclose(1.0 - final[2], 0.6 * (1.0 - 0.01 / 5.0) ** 1000, rtol=1e-6)


AXES = jnp.eye(3)


def wheels(**limits):
    return ReactionWheels(AXES, [0.05] * 3, [100.0, -50.0, 20.0], motor=CommandedMotor(), **limits)


def test_dumping_empties_the_wheels_while_the_attitude_is_held():
    """Momentum dies out as exp(-k t), by two controllers of two parts at once."""
    scene = Scene([wheels(), CommandedTorque()], BODY)
    y0 = scene.start(BodyState(attitude=Quaternion.identity(), omega=jnp.zeros(3)))
    laws = Together([QuaternionFeedback(2.0, 4.0, axes=AXES), MomentumDumping(0.05, AXES)])
    run = ClosedLoop(scene, laws, period=0.05).simulate(y0, [0.0, 60.0], accuracy=1e-7)
    before, after = y0.parts["wheels"], run.final.parts["wheels"]
    # The wheels follow the attitude, which lags by seconds: a few percent of three time constants.
    np.testing.assert_allclose(norm(after) / norm(before), np.exp(-3.0), rtol=0.15)
    assert norm(run.final.omega) < 1e-3


def test_saturated_wheels():
    """Wheels at their limits turn no faster; the loop says what it asked for and is finite. The
    momentum of all is kept, whatever the controller asks."""
    scene = Scene([wheels(torque_limit=0.02, speed_limit=120.0)], BODY)
    y0 = scene.start(BodyState(attitude=Quaternion.identity(), omega=jnp.array([0.3, 0.2, -0.4])))
    law = QuaternionFeedback(2.0, 4.0, integral=0.1, axes=AXES)
    loop = ClosedLoop(scene, law, period=0.5, limit=0.02)
    ts = np.linspace(0.0, 300.0, 301)
    run = loop.simulate(y0, ts, accuracy=1e-6)
    assert run.status == Status.COMPLETED
    speeds = scene.effects[0].speeds(run.states)
    assert jnp.abs(speeds).max() < 120.5 and jnp.abs(run.commands).max() <= 0.02
    kept = scene.invariants(0.0, run.states)
    name = next(name for name in kept if "momentum" in name)
    momentum = np.asarray(kept[name]).reshape(-1, ts.size)
    # The tolerance of the steps over three hundred seconds.
    np.testing.assert_allclose(momentum, momentum[:, :1] * np.ones(ts.size), rtol=1e-4)


def test_least_effort_guidance_is_optimal():
    """Without limits and with constant mass: the closed form of the optimal acceleration, linear
    in time, reached in the limit of fast samples."""
    g = jnp.array([0.0, 0.0, -1.62])
    x, v, end = np.array([100.0, -50.0, 400.0]), np.array([-5.0, 2.0, -10.0]), 40.0
    engine = CommandedEngine(1e6, 1e12, 1.0)  # burns nothing to speak of
    scene = Scene([UniformGravity(g), engine], RigidBody())
    y0 = BodyState(jnp.asarray(x), jnp.asarray(v), mass=jnp.array(10.0))
    law = LeastEffortGuidance(end, g, least_time=0.5)
    ts = np.linspace(0.0, 38.0, 20)
    run = ClosedLoop(scene, law, period=0.05).simulate(y0, ts)
    miss, slip = -x - end * v - 0.5 * end**2 * np.asarray(g), -v - end * np.asarray(g)
    start = 6.0 / end**2 * miss - 2.0 / end * slip
    slope = (6.0 / end**2 * slip - 12.0 / end**3 * miss)[:, None]
    expected = start[:, None] + slope * ts
    # The sample holds what falls by 1e-3 within it; the gain grows as 1 / t_go towards the end.
    np.testing.assert_allclose(run.commands / 10.0, expected, atol=5e-3)


def test_scene_file_of_a_slew():
    file = jaxspace.load(SCENES / "sampled_slew.toml")
    run = file.simulate()
    assert run.status == Status.COMPLETED and file.loop.delay == 0.1
    error = error_vector(run.final.attitude, jnp.full(4, 0.5))
    # The star tracker's 20 seconds of arc, and half a quantum over the stiffness: 26 of them.
    assert norm(error) < np.radians(100.0 / 3600.0) and norm(run.final.omega) < 1e-4
    assert jnp.abs(run.commands).max() <= 0.2 and run.ts.shape == (601,)


def test_scene_file_of_a_landing(tmp_path):
    run = jaxspace.load(SCENES / "powered_landing.toml").simulate()
    assert run.status == Status.EVENT and jnp.abs(run.final.position[2]) < 1e-9
    assert norm(run.final.velocity) < 1.0 and norm(run.final.position) < 0.1
    # The rocket equation, for the thrust that was commanded within the engine's limit.
    size = np.minimum(np.linalg.norm(np.asarray(run.commands), axis=0), 6500.0)
    ts = np.asarray(run.ts)
    burnt = np.sum(0.5 * (size[1:] + size[:-1]) * np.diff(ts)) / 3050.0
    # The commands are known each 0.2 s, at two samples.
    np.testing.assert_allclose(2000.0 - run.final.mass, burnt, rtol=2e-3)
    text = (SCENES / "powered_landing.toml").read_text()
    # One that never happens: too little time.
    late = tmp_path / "late.toml"
    late.write_text(text.replace('end = "60 s"', 'end = "30 s"'))
    file = jaxspace.load(late)
    assert file.simulate(throw=False).status == Status.EVENT_MISSED
    with pytest.raises(SimulationError, match="did not occur"):
        file.simulate()


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('period = "0.1 s"', 'period = "-0.1 s"', "control.period"),
        ("[control.law.least_effort_guidance]", "[control.law.least_effort]", "control.law"),
        ('until = "touchdown"', 'until = "landing"', "control.until"),
        ('period = "0.1 s"', 'period = "0.1 s"\nhold = "second"', "control.hold"),
    ],
)
def test_what_a_file_may_not_say(tmp_path, old, new, words):
    path = tmp_path / "scene.toml"
    path.write_text((SCENES / "powered_landing.toml").read_text().replace(old, new))
    with pytest.raises(SceneError, match=words):
        jaxspace.load(path)


def test_flax_networks_are_controllers():
    """By the line that the manual gives; the gradient reaches the weights."""
    nnx = pytest.importorskip("flax.nnx")
    graph, weights = nnx.split(nnx.Linear(3, 3, rngs=nnx.Rngs(0), param_dtype=float))
    y0 = BodyState(attitude=Quaternion.identity(), omega=jnp.array([0.1, -0.05, 0.4]))

    @jax.jit
    @jax.grad
    def slope(weights):
        policy = jax.tree_util.Partial(lambda w, z: nnx.merge(graph, w)(z.omega), weights)
        final = ClosedLoop(FREE, policy, period=0.1).simulate(y0, [0.0, 1.0], accuracy=1e-5).final
        return dot(final.omega, final.omega)

    leaves = jax.tree.leaves(slope(weights))
    assert all(bool(jnp.all(jnp.isfinite(x))) for x in leaves) and jnp.abs(leaves[1]).max() > 1e-3
