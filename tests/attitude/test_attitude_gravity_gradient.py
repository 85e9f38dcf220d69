"""The torque of the gravity gradient: against the torque by hand, libration in closed form, and two
check cases."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxspace import Scene, simulate
from jaxspace.attitude import GravityGradient
from jaxspace.attitude.gravity_gradient import (
    gravity_gradient_energy,
    gravity_gradient_torque,
    pitch_libration_period,
)
from jaxspace.attitude.libration import jacobi_integral
from jaxspace.bodies import BodyState, InertiaTensor, PrincipalInertia, RigidBody
from jaxspace.core import InputError
from jaxspace.orbits import PointGravity
from jaxspace.rotations import Quaternion, from_euler_angles, to_euler_angles
from jaxspace.simulation import Accuracy
from jaxspace.solvers import DOP853, Splitting

MU, RADIUS = 398600441800000.0, 6778000.0  # of the cases T7.4-P14 and -P15
MOMENTS = jnp.array([1000.0, 1200.0, 400.0])
N = 0.0011314009553257084  # their w0
TENSOR = np.array([[3.0, 0.1, -0.2], [0.1, 2.0, 0.15], [-0.2, 0.15, 1.5]])
# Axis 1 along the velocity, 2 along the normal, 3 outwards, when the body is on the inertial x axis
# and moves along y.
ORBITAL = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def scene(inertia) -> Scene:
    return Scene((PointGravity(MU), GravityGradient(MU)), RigidBody(inertia=inertia))


def on_circle(angles, rates=(0.0, 0.0, 0.0)) -> BodyState:
    """In the circular orbit of the cases, turned from the orbital axes by 3-2-1 angles (about 3
    first), at relative `rates`."""
    frame = Quaternion.from_matrix(jnp.asarray(ORBITAL))
    turn = from_euler_angles(jnp.asarray(angles[::-1]), "321")
    r, v = jnp.array([RADIUS, 0.0, 0.0]), jnp.array([0.0, N * RADIUS, 0.0])
    return BodyState(
        r, v, frame.then(turn), turn.rotate_back(jnp.array([0.0, N, 0.0])) + jnp.asarray(rates)
    )


def end(system, y, span, accuracy=Accuracy(rtol=1e-11, method=DOP853())) -> BodyState:  # noqa: B008
    return simulate(system, y, jnp.array([0.0, span]), accuracy=accuracy).final


@pytest.mark.parametrize(
    "inertia", [PrincipalInertia(MOMENTS), InertiaTensor(TENSOR)], ids=["principal", "tensor"]
)
def test_the_torque_by_hand(inertia, key):
    """In numpy, from the matrix of the attitude; batched runs are runs one by one."""
    r, q = (
        7e6 * jax.random.normal(key, (3, 5)),
        Quaternion(jax.random.normal(key, (4, 5))).normalised(),
    )
    effect, body = GravityGradient(MU), RigidBody(inertia=inertia)
    wide = jax.tree.map(lambda x: x[..., None], inertia)
    batched = effect.load(0.0, BodyState(position=r, attitude=q), RigidBody(inertia=wide)).torque_B
    for k in range(5):
        r_B = np.asarray(q.matrix())[..., k].T @ np.asarray(r)[:, k]
        size = np.linalg.norm(r_B)
        expected = 3.0 * MU / size**5 * np.cross(r_B, np.asarray(inertia.matrix()) @ r_B)
        alone = effect.load(
            0.0, BodyState(position=r[:, k], attitude=Quaternion(q.wxyz[:, k])), body
        ).torque_B
        assert_allclose(alone, expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())
        assert_allclose(batched[:, k], alone, rtol=1e-13, atol=1e-13 * np.abs(expected).max())


def test_the_torque_is_the_slope_of_the_energy():
    """Along a turn of the body about its own axes."""
    r, inertia = jnp.array([2.0, -1.0, 0.7]), InertiaTensor(TENSOR)
    attitude = Quaternion(jnp.array([0.8, -0.5, 0.3, 0.1]))  # not of unit length, as within a step

    def turned(x):
        return attitude.then(Quaternion.from_rotation_vector(x))

    slope = jax.grad(lambda x: gravity_gradient_energy(r, turned(x), inertia, 1.3))(jnp.zeros(3))
    assert_allclose(gravity_gradient_torque(r, attitude, inertia, 1.3), -slope, rtol=1e-13)


@jax.jit
def linearised(moments):
    """The matrix of the motion about the orbital axes: of (x, omega), where x is the relative
    turn."""
    system, y = scene(PrincipalInertia(moments)), on_circle(np.zeros(3))

    def field(z):
        turn = Quaternion.from_rotation_vector(z[:3])
        turned = BodyState(y.position, y.velocity, y.attitude.then(turn), z[3:])
        relative = z[3:] - turn.rotate_back(jnp.array([0.0, N, 0.0]))
        return jnp.concatenate([relative, system.vector_field(jnp.zeros(()), turned).omega])

    return jax.jacfwd(field)(jnp.array([0.0, 0.0, 0.0, 0.0, N, 0.0]))


def linear_rates(moments):
    """Its eigenvalues, in orbit rates."""
    return np.linalg.eigvals(np.asarray(linearised(jnp.asarray(moments)))) / N


# T7.4-P14-15: pitch sqrt(3 (I_1 - I_3) / I_2), and the two of roll and yaw
def test_small_librations():
    found = linear_rates(MOMENTS)
    expected = [0.6944460469498098, 1.2247448713915892, 1.8214677290239822]
    assert_allclose(np.sort(found.imag)[3:], expected, rtol=1e-11)
    assert_allclose(found.real, 0.0, atol=1e-11)
    small = 2.0 * np.pi / pitch_libration_period(1e-9, MOMENTS, N)
    assert_allclose(small, 0.0013856775175227058, rtol=1e-12)


def test_an_unstable_attitude():  # T7.4-P14-unst
    assert_allclose(linear_rates([1000.0, 600.0, 800.0]).real.max(), 0.437295970730166, rtol=1e-9)


# T7.4-P15-pitch: over one period of the closed form the pitch returns
def test_a_wide_libration_in_pitch():
    period = float(pitch_libration_period(np.radians(40.0), MOMENTS, N))
    assert_allclose(period, 5157.820957012799, rtol=1e-10)
    back = end(scene(MOMENTS), on_circle([0.0, np.radians(40.0), 0.0]), period)
    turned = Quaternion.about(2, N * period).then(on_circle([0.0, np.radians(40.0), 0.0]).attitude)
    assert_allclose(back.attitude.inverse().then(turned).wxyz[1:], 0.0, atol=1e-9)
    assert_allclose(back.omega, [0.0, N, 0.0], atol=1e-9 * N)


# T7.4-GG-sim
TURN = 5553.45589695987
START, ANGLES = (
    np.array([0.3, 0.4, -0.2]),
    [-0.07108245424357944, 0.21967568162159634, 0.9707333230244836],
)
OMEGA = [0.000919610830307778, 0.00024109515300713076, 0.0009666582374718867]


def test_one_revolution_from_rest():  # T7.4-GG-sim
    y = on_circle(START)
    run = simulate(
        scene(MOMENTS), y, jnp.array([0.0, TURN]), accuracy=Accuracy(rtol=1e-11, method=DOP853())
    )
    frame = Quaternion.about(2, N * TURN).then(Quaternion.from_matrix(jnp.asarray(ORBITAL)))
    found = to_euler_angles(frame.inverse().then(run.final.attitude), "321")[::-1]
    assert_allclose(found, ANGLES, rtol=1e-8, atol=1e-8)
    assert_allclose(run.final.omega, OMEGA, rtol=1e-8)
    jacobi = [jacobi_integral(x, PrincipalInertia(MOMENTS), MU) for x in (y, run.final)]
    assert_allclose(jacobi, 0.0003604685397835526, rtol=1e-9)
    assert set(run.drift()) == {"orbital_energy", "angular_momentum", "quaternion_norm"}
    assert all(float(np.max(drift)) < 1e-9 for drift in run.drift().values())


def test_a_cylinder_librates_over_eight_hours():  # JEOD-10A
    r, v = [-4292653.41, 955168.47, 5139356.57], [109.649663, -7527.72649, 1484.521489]
    q = np.array(
        [0.29495548345739353, -0.30133975713777233, 0.5879739300516265, -0.6902769524808205]
    )
    expected = np.array(
        [-0.08088465634744321, 0.6544148616587985, -0.7285587498795035, 0.1854750904614061]
    )
    # The case's quaternion is that of the left transformation, inertial to body: the conjugate of
    # ours.
    ours = jnp.asarray(q * [1.0, -1.0, -1.0, -1.0])
    y = BodyState(
        jnp.array(r),
        jnp.array(v),
        Quaternion(ours),
        jnp.array([-1.9798957083974596e-05, -0.0011342814916699571, 0.0]),
    )
    mu = 3.986004415e14
    system = Scene(
        (PointGravity(mu), GravityGradient(mu)), RigidBody(inertia=[500.0, 12250.0, 12250.0])
    )
    final = end(system, y, 28800.0, Accuracy(rtol=3e-13, method=DOP853()))
    found = np.asarray(final.attitude.wxyz) * [1.0, -1.0, -1.0, -1.0]
    assert_allclose(found * np.sign(found @ expected), expected, rtol=0, atol=1e-9)
    assert_allclose(
        final.position,
        [-1024262.411095882, -6151093.565368023, 2599975.06217899],
        rtol=0,
        atol=1e-3,
    )
    assert_allclose(
        final.omega,
        [-1.97989570839746e-05, -0.001080027400090759, -0.0007098670173048437],
        rtol=0,
        atol=1e-12,
    )


def forwards(final, direction):
    return jax.jit(lambda p: jax.jvp(final, (p,), (direction,))[1])(jnp.zeros(7))


def in_reverse(final, direction):
    return jax.jit(jax.grad(final))(jnp.zeros(7)) @ direction


@pytest.mark.slow
@pytest.mark.parametrize("way", [forwards, in_reverse])
@pytest.mark.sweep
def test_derivatives_through_a_splitting(way):
    """Of the attitude after a quarter of a turn, by the start, the gravitational parameter and the
    moments, against differences."""

    def final(p):
        body = RigidBody(inertia=PrincipalInertia(MOMENTS * (1.0 + p[4:])))
        system = Scene((PointGravity(MU), GravityGradient(MU * (1.0 + p[3]))), body)
        how = Accuracy(rtol=1e-3, method=Splitting(4, steps=8, estimate=False))
        ts = jnp.array([0.0, 0.25 * TURN])
        return simulate(
            system, on_circle(START + p[:3]), ts, accuracy=how, throw=False
        ).final.attitude.wxyz @ jnp.arange(4.0)

    value, step, direction = jax.jit(final), 1e-5, jnp.array([0.3, -0.5, 0.2, 0.7, 0.4, -0.1, 0.6])
    difference = (value(step * direction) - value(-step * direction)) / (2.0 * step)
    assert_allclose(way(final, direction), difference, rtol=1e-8)


def test_what_it_refuses():
    with pytest.raises(InputError, match="GravityGradient.mu is -1"):
        GravityGradient(-1.0)
    with pytest.raises(
        InputError, match="GravityGradient requires a rotating body, and the body has no inertia"
    ):
        Scene((PointGravity(1.0), GravityGradient(1.0)), RigidBody(1.0))
