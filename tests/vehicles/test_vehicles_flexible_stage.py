"""The flexible stage in a scene: its planes are the planar loop, its body moves as a rigid one."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxspace import BodyState, Scene, simulate
from jaxspace.bodies import RigidBody
from jaxspace.core import InputError
from jaxspace.mechanics import FlexibleMissile
from jaxspace.mechanics.missile_loop import MissileLoop
from jaxspace.orbits import UniformGravity
from jaxspace.rotations import Quaternion, from_euler_angles
from jaxspace.studies import modes
from jaxspace.vehicles import FlexibleStage

ROLL = 5e3
GRAVITY = UniformGravity([0.0, 0.0, -9.8])


def planar(thrust=4e5, pitch=1.0, rate=0.1, slosh=1500.0, actuator=4e4, damping=0.005):
    missile = FlexibleMissile(
        *(2e4, 20.0, 2e8, 1.5, 0.0, thrust),
        actuator_stiffness=3e6,
        actuator_damping=actuator,
        damping_ratio=damping,
        modes=2,
    )
    return jax.tree.map(jnp.asarray, MissileLoop(missile, pitch, rate, 2.0, slosh, 2.5, 0.01, 4.0))


def scene(loop, **more):
    stage = FlexibleStage(loop, **more)
    return Scene((stage, GRAVITY), stage.body(ROLL))


def launched(made, attitude=None, omega=(0.0, 0.0, 0.0), **parts):
    still = jnp.zeros(3)
    turned = Quaternion.identity() if attitude is None else attitude
    y = made.start(BodyState(still, still, turned, jnp.asarray(omega)))
    part = {**y.parts["flexible"], **{k: jnp.asarray(v) for k, v in parts.items()}}
    return eqx.tree_at(lambda y: y.parts["flexible"], y, part)


field = eqx.filter_jit(lambda made, y: made.vector_field(0.0, y))


def test_linearised_it_is_the_planar_loop_in_two_planes():
    loop = planar()
    found = np.asarray(eqx.filter_jit(modes)(scene(loop), launched(scene(loop))).eigenvalues)
    truth = np.asarray(eqx.filter_jit(modes)(loop, loop.state()).eigenvalues)
    # Besides both planes: place, velocity and roll, which nothing restores.
    assert found.size == 2 * truth.size + 8
    for root in truth:
        assert_allclose(np.sort(np.abs(found - root))[:2], 0.0, atol=1e-11 * np.abs(root))
    assert np.sum(np.abs(found) < 1e-6) == 8


def test_tail_wags_dog_in_a_stiff_stage():
    loop = eqx.tree_at(lambda s: s.missile.bending_stiffness, planar(slosh=0.0), jnp.asarray(2e14))
    made = scene(eqx.tree_at(lambda s: (s.pitch_gain, s.rate_gain), loop, (0.0, 0.0)))

    def swivelled(made, u):
        return eqx.tree_at(lambda s: s.effects[0].command, made, jnp.stack([u, 0.0 * u]))

    def inclination(y):
        # Of the straight beam, as a gyro on it feels it.
        part = y.parts["flexible"]
        turn = loop.missile.engine["turn"]
        return 2.0 * y.attitude.wxyz[2] - turn * part["engine"][0]

    found = eqx.filter_jit(modes)(made, launched(made), inputs=(swivelled,), outputs=(inclination,))
    zeros = found.zeros()
    expected = float(loop.missile.tail_wags_dog_frequency)
    # What the bending leaves, which falls as the inverse of its stiffness.
    assert np.abs(zeros - 1j * expected).min() < 1e-8 * expected


def test_no_thrust_leaves_no_force_and_a_roll_leaves_the_plane_in_space():
    made = scene(planar(0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    shaken = {"engine": [0.02, 0.0], "bending": [[0.1, -0.03], [0.0, 0.0]]}
    # In axes that do not roll the stage swings in one plane: at the start the rates there are zero.
    ends = [
        eqx.filter_jit(simulate)(
            made,
            launched(made, omega=(0.0, 0.0, w), **shaken),
            jnp.array([0.0, 0.3]),
            accuracy=1e-11,
        ).final
        for w in (0.0, 4.0)
    ]
    c, s = np.cos(1.2), np.sin(1.2)
    for name in ("engine", "bending"):
        still, rolled = (np.asarray(y.parts["flexible"][name]) for y in ends)
        assert_allclose(still[1], 0.0, atol=1e-15)
        assert_allclose(rolled, [c * still[0], -s * still[0]], atol=1e-9)
    for y, w in zip(ends, (0.0, 4.0), strict=True):
        assert_allclose(y.omega, [0.0, 0.0, w], atol=1e-14)
        assert_allclose(y.velocity, [0.0, 0.0, -9.8 * 0.3], atol=1e-12)


def test_a_swivelled_engine_pushes_the_rigid_limit_as_a_lever():
    """Static bending of a stiff beam with a stiff actuator: the engine stays where it is put."""
    loop = eqx.tree_at(
        lambda s: s.missile.bending_stiffness, planar(slosh=0.0, pitch=0.0, rate=0.0), 1e15
    )
    made, attitude = scene(loop), from_euler_angles(jnp.array([0.3, 0.4, -0.7]))
    y = launched(made, attitude, engine=[0.02, -0.01])
    rate = field(made, y)
    missile = loop.missile
    engine, d = missile.engine, np.array([0.02, -0.01])
    lever = float(missile.lever + engine["shift"])
    # F across at the hinge, which lies beside the mass centre by C_1 d.
    torque = 4e5 * lever * np.array([-d[1], d[0]]) * -1.0
    assert_allclose(rate.omega[:2], torque / missile.inertia, rtol=1e-12)
    force = 4e5 * np.array([*(d * (1.0 - float(engine["turn"]))), 1.0])
    assert_allclose(
        rate.velocity, attitude.rotate(jnp.asarray(force)) / 2e4 - np.array([0, 0, 9.8]), rtol=1e-12
    )


def test_axial_thrust_carries_the_propellant_that_sloshes():
    made = scene(planar())
    rate = field(made, launched(made))
    assert_allclose(rate.velocity, [0.0, 0.0, 4e5 / 21.5e3 - 9.8], rtol=1e-12)


@pytest.mark.sweep
def test_a_flight_with_derivatives():
    """The autopilot brings the stage to its target; the slope of the end by a gain."""

    @jax.jit
    def end(gain):
        loop = eqx.tree_at(lambda s: s.pitch_gain, planar(), gain)
        made = scene(loop, target=[0.03, -0.02, 1.0])
        return simulate(made, launched(made), jnp.array([0.0, 4.0]), accuracy=1e-11).final.position

    _, slope = jax.jvp(end, (1.0,), (1.0,))
    assert_allclose(slope, (end(1.0 + 1e-4) - end(1.0 - 1e-4)) / 2e-4, rtol=1e-5, atol=1e-7)
    # Towards the target, to x and against y.
    assert end(1.0)[0] > 1.0 and end(1.0)[1] < -0.5


def test_another_body_is_refused():
    stage = FlexibleStage(planar())
    wrong = Scene((stage,), RigidBody(2e4, [1e6, 1e6, ROLL]))
    with pytest.raises(InputError, match="moment of inertia across its axis of the body is"):
        launched(wrong)
