"""Wheels, dampers, gyros and masses that move in a body: the momentum and the energy of all by
direct sums, the closed form of the gyrostat, saturation, and stability."""

import dataclasses
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from systems import TENSOR, turned

from jaxspace import Accuracy, Scene, load, simulate
from jaxspace.attitude import ControlMomentGyros, MovingMasses, NutationDamper, ReactionWheels
from jaxspace.attitude.motors import ConstantTorque, PointingControl
from jaxspace.attitude.wheels import gyrostat_nutation_rate, rotor_moment
from jaxspace.bodies import BodyState, InertiaTensor, RigidBody
from jaxspace.core import InputError
from jaxspace.rotations import Quaternion
from jaxspace.solvers import Tsit5

OMEGA = np.array([0.4, -0.3, 1.2])
MASS, R0, U = 4.0, np.array([0.8, 0.3, -0.2]), np.array([0.48, -0.6, 0.64])
BODY = RigidBody(200.0, InertiaTensor(40.0 * TENSOR))


def damper(c=2.0, **more):
    return NutationDamper(MASS, R0, U, 24.5, c, displacement=0.07, rate=-0.3, **more)


def moving_parts() -> tuple[Scene, BodyState]:
    """A satellite with wheels near their limits, a damper and gyros, and a state of it."""
    wheels = ReactionWheels(
        [[1.0, 0.0, 0.6], [0.0, 1.0, 0.6], [0.0, 0.2, 0.5]],
        [0.4, 0.5, 0.3],
        [20.0, -30.0, 48.0],
        friction=0.01,
        torque_limit=0.5,
        speed_limit=49.0,
        motor=PointingControl([0.6, -0.3, 0.7, 0.2], 2.0, 30.0),
    )
    gyros = ControlMomentGyros(
        [[0.0, 1.0], [0.0, 0.0], [1.0, 0.0]],
        [[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]],
        [3.0, 2.0],
        [0.3, -0.4],
        [0.02, 0.03],
    )
    scene = Scene((wheels, damper(), gyros), RigidBody(200.0, [40.0, 50.0, 60.0]))
    return scene, scene.start(BodyState(attitude=turned(), omega=jnp.array([0.2, -0.1, 0.5])))


def spinning(scene, omega=OMEGA):
    return scene.start(BodyState(attitude=turned(), omega=jnp.asarray(omega)))


def along_the_motion(scene, y, measure):
    """The rate of a measure of the state along the vector field."""
    rate = jax.jit(lambda y: scene.vector_field(jnp.zeros(()), y))(y)
    return jax.jvp(measure, (y,), (rate,))[1]


def test_the_momentum_of_all_stays_whatever_moves():
    """Wheels with motors at their limits, a damper, gyros and masses on paths: to rounding."""
    scene, y = moving_parts()

    def path(t):
        return jnp.array([[0.3, -0.2], [0.1, 0.4], [0.2, 0.0]]) * jnp.cos(t + 0.3)

    scene = Scene((*scene.effects, MovingMasses(path, [3.0, 5.0])), scene.body)
    y = scene.start(y)

    def momentum(clock):
        t, y = clock
        return scene.invariants(t, y)["rotational_momentum"]

    @jax.jit
    def at_start(y):
        zero = jnp.zeros(())
        rate = scene.vector_field(zero, y)
        change = jax.jvp(momentum, ((zero, y),), ((zero + 1.0, rate),))
        return change, scene.loads(zero, y).torque_B

    change, torque = at_start(y)
    assert_allclose(change[1], 0.0, atol=1e-12 * float(jnp.max(jnp.abs(change[0]))))
    # Without the torques of the parts it would change.
    assert float(jnp.max(jnp.abs(torque))) > 0.1


def test_a_batch_of_parts_is_its_runs(key):
    """Of states, and of the speeds and stiffnesses that carry runs."""
    scene, y = moving_parts()
    keys = iter(jax.random.split(key, 9))
    states = jax.tree.map(
        lambda x: x[..., None] * (1.0 + 0.1 * jax.random.normal(next(keys), (*x.shape, 3))), y
    )
    many = eqx.tree_at(
        lambda s: (s.effects[0].inertia, s.effects[1].stiffness, s.effects[2].momentum),
        scene,
        (
            jnp.array([[0.4], [0.5], [0.3]]) * jnp.array([1.0, 1.1, 0.9]),
            jnp.array([24.5, 30.0, 20.0]),
            jnp.array([[3.0], [2.0]]) * jnp.array([1.0, 0.5, 2.0]),
        ),
    )
    field = eqx.filter_jit(lambda s, y: s.vector_field(jnp.zeros(()), y))
    together = field(many, states)
    for i in range(3):
        runs = jax.tree.map(lambda x, i=i: x[..., i], states)
        one = eqx.tree_at(
            lambda s: (s.effects[0].inertia, s.effects[1].stiffness, s.effects[2].momentum),
            scene,
            (
                many.effects[0].inertia[:, i],
                many.effects[1].stiffness[i],
                many.effects[2].momentum[:, i],
            ),
        )
        alone = field(one, runs)
        for a, b in zip(jax.tree.leaves(together), jax.tree.leaves(alone), strict=True):
            assert_allclose(a[..., i], b, rtol=1e-11, atol=1e-13)


def test_momentum_and_energy_of_a_damper_are_those_of_its_particles():
    """A direct sum over the rest of the body and the mass, about the mass centre of both."""
    scene = Scene((damper(),), BODY)
    y, m, mu = spinning(scene), 200.0, MASS * (1.0 - MASS / 200.0)
    motion = damper().motion(y, BODY)
    assert_allclose([motion.displacement, motion.rate], [0.07, -0.3], rtol=1e-13)
    place, rate = R0 + 0.07 * U, -0.3 * U
    centre, drift = MASS / m * 0.07 * U, MASS / m * rate
    velocity = np.cross(OMEGA, place) + rate
    # Of the rest: the tensor of all less that of the mass at rest, about the first mass centre;
    # its linear momentum about the common centre is the opposite of that of the mass.
    rest = 40.0 * TENSOR - MASS * (R0 @ R0 * np.eye(3) - np.outer(R0, R0))
    shift = np.cross(OMEGA, centre) + drift
    h = rest @ OMEGA + MASS * np.cross(place, velocity) - m * np.cross(centre, shift)
    found = scene.invariants(jnp.zeros(()), y)["rotational_momentum"]
    assert_allclose(y.attitude.rotate_back(found), h, rtol=1e-12)
    twice = OMEGA @ rest @ OMEGA + MASS * velocity @ velocity - m * shift @ shift
    energy = 0.5 * (twice + 24.5 * 0.07**2)
    assert_allclose(damper().energy(y, BODY), energy, rtol=1e-12)
    # With the momentum above, this fixes all four accelerations: the loss is that of the dashpot.
    for c in (2.0, 0.0):
        lossy = damper(c)
        loss = along_the_motion(
            Scene((lossy,), BODY), y, lambda y, lossy=lossy: lossy.energy(y, BODY)
        )
        assert_allclose(loss, -c * 0.3**2, atol=1e-12 * energy)
    assert mu > 0.0


def test_a_thrust_pushes_the_body_and_not_the_damper():
    """The energy changes by the work of the thrust at its line, which moves from the mass centre by
    -m0 z u/m, and by that of the dashpot; at rest the damper falls back by m0 F/(m k)."""
    F, share = jnp.array([30.0, -20.0, 50.0]), MASS / 200.0
    pushed = damper(thrust=F)
    scene = Scene((pushed,), BODY)
    y = spinning(scene)
    work = along_the_motion(scene, y, lambda y: pushed.energy(y, BODY))
    z, rate, _ = pushed.motion(y, BODY)
    line_rate = -share * (jnp.cross(y.omega, z * U) + rate * U)
    expected = jnp.dot(F, line_rate) - 2.0 * rate**2
    assert_allclose(work, expected, rtol=1e-11)
    along = NutationDamper(MASS, [0.0, 0.0, 0.4], [0, 0, 1], 24.5, 2.0, thrust=[0, 0, 50.0])
    back = dataclasses.replace(along, displacement=-share * 50.0 / 24.5)
    still = Scene((back,), BODY)
    end = still.vector_field(jnp.zeros(()), spinning(still, [0.0, 0.0, 0.0]))
    for rest in (*jax.tree.leaves(end.parts), end.omega):
        assert_allclose(rest, 0.0, atol=1e-14)


def test_a_damper_needs_the_axis_of_the_greatest_moment():
    """Decay for C > A, growth for C < A; between, (C - A) k = (m0 x0 n)^2 decides, below which the
    mass that rests off its place tilts the axis of least energy. At C = A nothing is exponential.
    """
    one = NutationDamper(MASS, [0.8, 0.0, 0.0], [0.0, 0.0, 1.0], 100.0, 10.0)
    critical = (MASS * 0.8 * 5.0) ** 2 / 100.0
    gaps = jnp.array([20.0, 1.02 * critical, 0.98 * critical, 0.0, -20.0])

    def greatest(gap):
        moments = jnp.stack([60.0 + 0.0 * gap, 60.0 + 0.0 * gap, 60.0 + gap])
        return jnp.max(one.eigenvalues(moments, 200.0, 5.0)[0])

    growth = jax.jit(jax.vmap(greatest))(gaps)
    assert (np.asarray(growth) > 1e-7).tolist() == [False, False, True, False, True]


def test_a_gyrostat_nutates_by_its_closed_form():
    """omega_12' = i lambda omega_12 of a symmetric body with a rotor along its axis."""
    A, C, n = 220.0, 160.0, 0.3
    rotor = ReactionWheels.rotor([0.0, 0.0, 2.0], 80.0, 6.0)
    scene = Scene((rotor,), RigidBody(inertia=[A, A, C]))
    y = spinning(scene, [0.1, -0.2, n])
    rate = jax.jit(lambda y: scene.vector_field(jnp.zeros(()), y))(y).omega
    turn = gyrostat_nutation_rate(n, A, C, 80.0 * 6.0)
    assert_allclose(rate, [0.2 * turn, 0.1 * turn, 0.0], rtol=1e-13, atol=1e-15)
    assert_allclose(rotor.speeds(y), [6.0], rtol=1e-14)
    # The same from the moment that the rotor takes: J omega' = -omega x J omega - M_p.
    moment = rotor_moment(y.omega, jnp.array([0.0, 0.0, 1.0]), 80.0, 6.0, 0.0)
    inertia = np.array([A, A, C])
    by_hand = (np.cross(inertia * y.omega, y.omega) - moment) / inertia
    assert_allclose(rate, by_hand, rtol=1e-13, atol=1e-15)


def test_friction_takes_what_the_wheels_have_more():
    """Energy falls by f w^2 for each wheel, and by nothing else."""
    wheels = ReactionWheels(np.eye(3)[:, :2], [0.5, 0.7], [30.0, -20.0], friction=0.01)
    scene = Scene((wheels,), BODY)
    y = spinning(scene)

    def energy(y):
        load = wheels.load(0.0, y, BODY)
        spin = jnp.asarray(40.0 * TENSOR) @ y.omega + load.inertia_B @ y.omega
        return 0.5 * (y.omega @ spin + jnp.sum(y.part("wheels") ** 2 / wheels.inertia))

    loss = along_the_motion(scene, y, energy)
    assert_allclose(loss, -0.01 * (30.0**2 + 20.0**2), rtol=1e-10)


def test_the_torque_of_the_gyros_is_that_of_their_turning_momentum():
    """At rest J omega' = -h d' t, and the axes turn about the gimbals."""
    gimbal, spin = np.eye(3)[:, [2, 0]], np.eye(3)[:, [0, 1]]
    one = ControlMomentGyros(gimbal, spin, [5.0, 3.0], [0.4, -0.2], [0.1, 0.3])
    scene = Scene((one,), RigidBody(inertia=[10.0, 12.0, 8.0]))
    y = spinning(scene, np.zeros(3))
    t = [[-np.sin(0.4), np.cos(0.4), 0.0], [0.0, np.sin(0.2), np.cos(0.2)]]
    expected = -(5.0 * 0.1 * np.array(t[0]) + 3.0 * 0.3 * np.array(t[1])) / [10.0, 12.0, 8.0]
    rate = scene.vector_field(jnp.zeros(()), y)
    assert_allclose(rate.omega, expected, rtol=1e-13, atol=1e-16)
    assert_allclose(rate.parts["gimbals"], [0.1, 0.3], rtol=1e-15)
    # A law of the rates sees the state and the matrix of torques.
    steered = ControlMomentGyros(
        *(gimbal, spin, [5.0, 3.0], [0.4, -0.2], [0.0, 0.0]),
        steering=lambda t, y, torques: torques[2] * y.omega[2],
    )
    y = spinning(Scene((steered,), BODY))
    rates = steered.load(0.0, y, BODY).parts_rate["gimbals"]
    assert_allclose(rates, 1.2 * np.array([0.0, 3.0 * np.cos(0.2)]), rtol=1e-13)


def test_masses_on_paths_are_particles():
    """The momentum of all by a direct sum over the rest and the masses, about the mass centre."""
    weights = np.array([3.0, 5.0])

    def path(t):
        first = jnp.stack([0.5 * jnp.sin(t), 0.2 * t, 0.1 + 0.0 * t])
        return jnp.stack([first, jnp.stack([0.1 * t * t, -0.3 + 0.0 * t, jnp.cos(t)])], axis=1)

    t = jnp.array(0.7)
    scene = Scene((MovingMasses(path, weights),), BODY)
    y = BodyState(attitude=Quaternion.identity(), omega=jnp.asarray(OMEGA))
    r, v = (np.asarray(x).T for x in jax.jvp(path, (t,), (jnp.ones(()),)))
    velocities = np.cross(OMEGA, r) + v
    centre, drift = weights @ r / 200.0, weights @ velocities / 200.0
    h = 40.0 * TENSOR @ OMEGA + weights @ np.cross(r, velocities)
    h = h - 200.0 * np.cross(centre, drift)
    assert_allclose(scene.invariants(t, y)["rotational_momentum"], h, rtol=1e-12)


LIMIT = 40.0


def slew(torque_limit, ts):
    """A turn by 120 degrees about a skew axis by three wheels."""
    control = PointingControl([0.5, -0.5, 0.5, -0.5], 2.0, 30.0)
    wheels = ReactionWheels(
        np.eye(3), [0.1] * 3, [10.0, 0.0, -5.0], 0.0, torque_limit, LIMIT, motor=control
    )
    scene = Scene((wheels,), RigidBody(inertia=[80.0, 100.0, 60.0]))
    y0 = scene.start(BodyState(attitude=Quaternion.identity(), omega=jnp.array([0.01, 0.0, 0.02])))
    return wheels, simulate(scene, y0, ts, accuracy=Accuracy(1e-9, method=Tsit5()))


@pytest.mark.sweep
def test_a_slew_by_wheels_ends_at_its_target_and_saturation_stops_at_the_limit():
    ts = jnp.linspace(0.0, 500.0, 101)
    wheels, run = slew(0.3, ts)
    assert_allclose(jnp.abs(run.final.attitude.wxyz), 0.5, atol=1e-6)
    assert_allclose(run.final.omega, 0.0, atol=1e-7)
    for name, drift in run.drift().items():
        assert float(drift.max()) < 1e-9, name
    speeds = np.abs(wheels.speeds(run.states))
    # The wheels stop at the limit. The torque of the others turns the body further, and with it
    # their speed by no more than its rate.
    assert speeds.max() > 0.97 * LIMIT
    assert speeds.max() < LIMIT + float(jnp.max(jnp.abs(run.states.omega)))
    # At the end all momentum is in the wheels, at rest.
    total = run.final.attitude.rotate(0.1 * wheels.speeds(run.final))
    expected = np.array([80.0 * 0.01, 0.0, 60.0 * 0.02]) + 0.1 * np.array([10.0, 0.0, -5.0])
    assert_allclose(total, expected, atol=1e-6)


def test_a_motor_drives_no_further_at_the_limit_and_brakes_in_full():
    axes = jnp.eye(3)[:, :1]

    def torque(speed, wanted):
        wheel = ReactionWheels(
            axes, [0.1], [0.0], torque_limit=0.2, speed_limit=100.0, knee=0.9,
            motor=ConstantTorque(wanted),
        )  # fmt: skip
        y = BodyState(omega=jnp.zeros(3))
        return float(wheel.limited(0.0, y, axes, jnp.array([speed]))[0])

    # Below the knee, halfway to the limit, at it, beyond it; and against the speed.
    for speed, share in ((50.0, 1.0), (95.0, 0.5), (100.0, 0.0), (130.0, 0.0), (-100.0, 1.0)):
        assert_allclose(torque(speed, 5.0), 0.2 * share, atol=1e-15)
        assert_allclose(torque(-speed, -5.0), -0.2 * share, atol=1e-15)


def test_parts_are_told_apart():
    two = Scene((damper(), damper(part="second")), BODY)
    assert set(spinning(two).parts) == {"damper", "second"}
    with pytest.raises(
        InputError, match="another effect of the scene integrates a part of this name"
    ):
        spinning(Scene((damper(), damper()), BODY))
    with pytest.raises(InputError, match="no part 'damper': Scene.start adds"):
        y = BodyState(attitude=turned(), omega=jnp.asarray(OMEGA), parts={})
        Scene((damper(),), BODY).vector_field(jnp.zeros(()), y)
    # What an effect of another phase integrates stays as it is.
    y = spinning(Scene((damper(),), BODY))
    rate = Scene((), BODY, ("attitude", "parts")).vector_field(jnp.zeros(()), y)
    assert jax.tree.leaves(rate.parts) == [0.0, 0.0]


def test_scene_files_hold_what_moves():
    """The rotor of a dual-spin satellite and its damper, and three wheels with a control: as the
    files start them."""
    files = Path(__file__).parents[2] / "examples" / "scenes"
    for name, parts, momentum in (
        ("dual_spin", {"wheels", "damper"}, 80.0 * (2.0 * np.pi + np.pi / 180.0)),
        ("wheel_slew", {"wheels"}, 0.02 * (500.0 * np.pi / 30.0 - 0.1 * np.pi / 180.0)),
    ):
        file = load(files / f"{name}.toml")
        assert set(file.y0.parts) == parts
        assert_allclose(file.y0.parts["wheels"][-1], momentum, rtol=1e-12)
        rate = eqx.filter_jit(lambda s, y: s.vector_field(jnp.zeros(()), y))(file.system, file.y0)
        assert all(bool(jnp.all(jnp.isfinite(x))) for x in jax.tree.leaves(rate))
