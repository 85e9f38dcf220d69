"""Ways between orientations, their mean, and the rates of the rotation vector."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from both_modes import both_modes
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation, Slerp

from jaxspace import rotations
from jaxspace.core import InputError
from jaxspace.rotations import Quaternion

# A few roundings of numbers of order one.
ROUNDING = 2e-14


def turn(v):
    return Quaternion.from_rotation_vector(v)


def peer(q):
    return Rotation.from_quat(np.asarray(q.xyzw()).T)


def same(found, expected, atol=ROUNDING):
    """Of one orientation or many, q and -q being one."""
    assert_allclose(np.abs(np.sum(np.asarray(found) * np.asarray(expected), 0)), 1.0, atol=atol)


@jax.jit
def there_and_back(v, rate):
    omega = rotations.rotation_vector.omega_from_rotation_vector_rate(v, rate)
    return omega, rotations.rotation_vector.rotation_vector_rate(v, omega)


# At no turn, where the series hand over, at half a turn and beyond it.
LENGTHS = np.array([0.0, 1e-200, 1e-9, 0.3, 0.32, 1.0, np.pi - 1e-9, np.pi, 3.3, 5.0])


def test_rates_of_the_rotation_vector():
    v = np.array([[0.6], [0.0], [-0.8]]) * LENGTHS
    rate = np.array([[0.3], [-0.8], [1.1]]) + 0.0 * v
    omega, back = there_and_back(v, rate)
    q, q_rate = jax.jvp(lambda x: turn(x).wxyz, (jnp.asarray(v),), (jnp.asarray(rate),))
    assert_allclose(Quaternion(q).rate(omega).wxyz, q_rate, atol=ROUNDING)
    # Near a whole turn, at 5 rad, the inverse has a condition of a few.
    assert_allclose(back, rate, atol=5 * ROUNDING)


def test_slopes_of_the_rates_at_no_turn():
    """d omega / d theta at zero: the first term, -theta x rate / 2."""
    rate = jnp.array([0.3, -0.8, 1.1])

    def omega(v):
        return rotations.rotation_vector.omega_from_rotation_vector_rate(v, rate)

    found = jax.jit(jax.jacrev(omega))(jnp.zeros(3))
    assert_allclose(found.T, [0.5 * np.cross(rate, e) for e in np.eye(3)], atol=1e-16)


def logarithms(v):
    """The rotation vector back from the quaternion and from the matrix, with the slopes of both."""

    def both(v):
        q = turn(v)
        return jnp.stack(
            [q.rotation_vector(), Quaternion.from_matrix(q.matrix()).rotation_vector()]
        )

    return both(v), jax.jacfwd(both)(v)


def test_the_logarithm_at_half_a_turn():
    """It returns the vector or the one to the other side, v - 2 pi v/|v|, each with its slope."""
    direction = np.array([2.0, -1.0, 2.0]) / 3.0
    f = jax.jit(logarithms)
    for length in (np.pi, np.nextafter(np.pi, 0.0), np.nextafter(np.pi, 4.0)):
        for found, slope in zip(*f(length * direction), strict=True):
            side = np.sign(found @ direction)
            assert_allclose(found, side * np.pi * direction, rtol=1e-13)
            across = np.eye(3) - np.outer(direction, direction)
            expected = np.eye(3) - (2.0 * across if side < 0.0 else 0.0)
            assert_allclose(slope, expected, atol=1e-13)


def test_axis_and_angle():
    v = np.random.default_rng(5).uniform(-1.7, 1.7, (3, 20))
    axis, angle = turn(jnp.asarray(v)).axis_angle()
    length = np.linalg.norm(v, axis=0)
    assert_allclose(axis * angle, v, atol=ROUNDING)
    assert_allclose(np.linalg.norm(axis, axis=0), 1.0, atol=ROUNDING)
    again = Quaternion.from_axis_angle(jnp.asarray(3.0 * v), jnp.asarray(length))
    same(again.wxyz, turn(jnp.asarray(v)).wxyz)
    # One axis for many angles, more than a whole turn among them.
    many = Quaternion.from_axis_angle(jnp.array([0.0, 0.0, 2.0]), jnp.array([0.1, 7.0]))
    same(many.wxyz, Quaternion.about(2, jnp.array([0.1, 7.0])).wxyz)
    axis, angle = Quaternion.identity().axis_angle()
    assert_allclose(axis, np.zeros(3))
    assert angle == 0.0


ENDS = np.random.default_rng(3).normal(size=(2, 4, 6))
ENDS /= np.linalg.norm(ENDS, axis=1, keepdims=True)


def test_slerp_agrees_with_scipy():
    start, end = (Quaternion(jnp.asarray(q)) for q in ENDS)
    shares = np.linspace(0.0, 1.0, 5)
    found = jax.jit(rotations.interpolation.slerp)(start, end, jnp.asarray(shares[:, None])).wxyz
    assert found.shape == (4, 5, 6)
    for i in range(6):
        ends = Rotation.from_quat(np.roll(ENDS[:, :, i], -1, axis=1))
        expected = np.roll(Slerp([0.0, 1.0], ends)(shares).as_quat(), 1, axis=1).T
        same(found[:, :, i], expected)


def test_slerp_between_equal_orientations():
    """The slope is that of the share: s by the end, and 1 - s by the start."""
    q = turn(jnp.array([0.4, -0.2, 0.9]))

    def moved(x):
        ends = q.then(turn(x[:3])), q.then(turn(x[3:]))
        return q.inverse().then(rotations.interpolation.slerp(*ends, 0.3)).rotation_vector()

    for found in both_modes(moved)(np.zeros(6))[1:]:
        assert_allclose(found, np.hstack([0.7 * np.eye(3), 0.3 * np.eye(3)]), atol=ROUNDING)


def tumbling(t):
    """An orientation that is no cubic of anything."""
    return turn(jnp.array([0.3, -0.2, 0.5])).then(
        turn(jnp.stack([jnp.sin(t), 0.4 * t * t, jnp.cos(1.3 * t)]))
    )


def tumbling_omega(t):
    q, rate = jax.jvp(lambda t: tumbling(t).wxyz, (t,), (jnp.ones_like(t),))
    return 2.0 * Quaternion(q).inverse().then(Quaternion(rate)).wxyz[1:]


@jax.jit
def cubic(t, start, duration):
    end = start + duration

    def at(t):
        q, omega = rotations.interpolation.interpolate_attitude(
            t, duration, tumbling(start), tumbling_omega(start), tumbling(end), tumbling_omega(end)
        )
        return q.wxyz, omega

    (q, omega), (rate, _) = jax.jvp(at, (t,), (jnp.ones_like(t),))
    exact = tumbling(start + t)
    error = exact.inverse().then(Quaternion(q)).rotation_vector()
    return error, omega - tumbling_omega(start + t), Quaternion(q).rate(omega).wxyz - rate


def test_the_cubic_meets_both_ends_with_their_rates():
    for t in (0.0, 0.7):
        error, rate_error, _ = cubic(jnp.array(t), jnp.array(0.2), jnp.array(0.7))
        assert_allclose(error, np.zeros(3), atol=ROUNDING)
        assert_allclose(rate_error, np.zeros(3), atol=ROUNDING)


def test_the_cubic_is_of_fourth_order():
    errors = []
    for duration in (0.2, 0.1):
        error, _, slip = cubic(jnp.array(0.5 * duration), jnp.array(0.4), jnp.array(duration))
        errors.append(np.linalg.norm(error))
        # Its angular velocity is the rate of its orientation.
        assert_allclose(slip, np.zeros(4), atol=ROUNDING)
    # Of a fourth power of the step 16; the fifth adds a few percent.
    assert 14.0 < errors[0] / errors[1] < 18.0
    assert errors[0] < 2e-5


def test_the_cubic_of_many_runs_is_that_of_each():
    rng = np.random.default_rng(8)
    q0, q1 = (jnp.asarray(q) for q in ENDS[:, :, :4])
    w0, w1 = (jnp.asarray(x) for x in rng.normal(size=(2, 3, 4)))
    durations, times = jnp.array([1.0, 2.0, 3.0, 4.0]), jnp.linspace(0.0, 1.0, 3)[:, None]
    f = jax.jit(
        lambda t, T, a, u, b, w: rotations.interpolation.interpolate_attitude(
            t, T, Quaternion(a), u, Quaternion(b), w
        )
    )
    q, omega = f(times * durations, durations, q0, w0, q1, w1)
    assert q.wxyz.shape == (4, 3, 4) and omega.shape == (3, 3, 4)
    one = f(times * durations[1:2], durations[1:2], *(x[:, 1:2] for x in (q0, w0, q1, w1)))
    assert_allclose(q.wxyz[:, :, 1:2], one[0].wxyz, atol=ROUNDING)
    assert_allclose(omega[:, :, 1:2], one[1], atol=1e-13)


def test_the_mean_agrees_with_scipy():
    rng = np.random.default_rng(4)
    spread = turn(jnp.asarray(rng.normal(scale=0.5, size=(3, 7, 2))))
    weights = rng.uniform(0.1, 1.0, (7, 2))
    found = jax.jit(rotations.mean.mean_attitude)(spread, jnp.asarray(weights)).wxyz
    plain = rotations.mean.mean_attitude(Quaternion(spread.wxyz[:, :, 0])).wxyz
    for i in range(2):
        group = peer(Quaternion(spread.wxyz[:, :, i]))
        same(found[:, i], np.roll(group.mean(weights[:, i]).as_quat(), 1))
    same(plain, np.roll(peer(Quaternion(spread.wxyz[:, :, 0])).mean().as_quat(), 1))
    # The signs of the quaternions do not matter.
    signs = jnp.asarray(np.where(np.arange(7) % 2, 1.0, -1.0))
    same(rotations.mean.mean_attitude(Quaternion(spread.wxyz[:, :, 0] * signs)).wxyz, plain)


def test_the_mean_of_two_is_half_way():
    start, end = (Quaternion(jnp.asarray(q[:, 0])) for q in ENDS)
    pair = Quaternion(jnp.stack([start.wxyz, end.wxyz], axis=1))
    same(
        rotations.mean.mean_attitude(pair).wxyz, rotations.interpolation.slerp(start, end, 0.5).wxyz
    )


def moved_mean(x):
    q = turn(jnp.array([0.4, -0.2, 0.9]))
    group = q.then(turn(x))
    return q.inverse().then(rotations.mean.mean_attitude(group)).rotation_vector()


mean_slopes = both_modes(moved_mean)


def test_the_mean_of_equal_orientations_has_slopes():
    """Three of the four eigenvalues are equal there; the mean moves by the mean of the turns, and
    to second order not at all."""
    zero = np.zeros((3, 4))
    for found in mean_slopes(zero)[1:]:
        assert_allclose(found, 0.25 * np.stack([np.eye(3)] * 4, axis=-1), atol=ROUNDING)
    # Along one direction the mean of angles; its curvature is zero.
    line = jnp.zeros((3, 4)).at[0].set(jnp.array([1.0, -0.5, 2.0, 0.3]))
    second = jax.jit(jax.hessian(lambda s: moved_mean(s * line)[0]))(0.0)
    assert_allclose(second, 0.0, atol=1e-12)


def test_slopes_of_the_mean():
    x = np.random.default_rng(6).normal(scale=0.7, size=(3, 4))
    direction = np.random.default_rng(7).normal(size=(3, 4))
    found, reverse = (
        np.einsum("kij,ij->k", np.asarray(slopes), direction) for slopes in mean_slopes(x)[1:]
    )
    assert_allclose(reverse, found, atol=1e-12)

    def exact(s):
        """The same mean along a line, by the eigenvectors of 30 digits."""
        total = mpmath.zeros(4)
        for i in range(4):
            v = [mpmath.mpf(x[k, i]) + s * mpmath.mpf(direction[k, i]) for k in range(3)]
            length = mpmath.sqrt(sum(a * a for a in v))
            q = mpmath.matrix(
                [mpmath.cos(length / 2), *(mpmath.sin(length / 2) * a / length for a in v)]
            )
            total += q * q.T
        values, vectors = mpmath.eigsy(total)
        best = max(range(4), key=lambda k: values[k])
        q = vectors[:, best] * mpmath.sign(vectors[0, best])
        sine = mpmath.sqrt(sum(a * a for a in q[1:]))
        return [2 * mpmath.atan2(sine, q[0]) * a / sine for a in q[1:]]

    with mpmath.workdps(30):
        h = mpmath.mpf(10) ** -10
        ends = exact(h), exact(-h)
        slope = [float((a - b) / (2 * h)) for a, b in zip(*ends, strict=True)]
    assert_allclose(found, slope, rtol=1e-11, atol=1e-12)


def test_single_precision_stays_single():
    q = turn(jnp.array([[0.1, 0.2], [0.3, -0.4], [0.5, 0.1]], jnp.float32))
    ends = [Quaternion(q.wxyz[:, i]) for i in range(2)]
    omega = jnp.ones(3, jnp.float32)
    mean = rotations.mean.mean_attitude(q)
    way, rate = rotations.interpolation.interpolate_attitude(
        jnp.float32(0.3), jnp.float32(1.0), ends[0], omega, ends[1], omega
    )
    assert all(x.dtype == jnp.float32 for x in (mean.wxyz, way.wxyz, rate))


def test_the_mean_of_a_single_quaternion_is_refused():
    with pytest.raises(InputError, match="mean_attitude: the number of axes is 1"):
        rotations.mean.mean_attitude(Quaternion.identity())
