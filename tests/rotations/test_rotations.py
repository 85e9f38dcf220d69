"""The rotation group: its laws, its descriptions against an independent library, Euler's angles at
their singular places."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from jaxspace import rotations
from jaxspace.core import InputError
from jaxspace.rotations import Quaternion
from jaxspace.rotations.euler_angles import (
    SEQUENCES,
    euler_rates_from_omega,
    omega_from_euler_rates,
)

# A few roundings of numbers of order one.
ROUNDING = 2e-14

turns = arrays(float, 3, elements=st.floats(-6.0, 6.0, allow_subnormal=False)) | st.just(
    np.zeros(3)
)
vectors = arrays(float, 3, elements=st.floats(-10.0, 10.0))


@functools.partial(jax.jit, static_argnums=0)
def call(f, *arguments):
    return f(*arguments)


def turn(v):
    return Quaternion.from_rotation_vector(v)


def same(p, q):
    """Whether two unit quaternions are one orientation: q and -q are."""
    np.testing.assert_allclose(
        np.abs(np.sum(np.asarray(p) * np.asarray(q), axis=0)), 1.0, atol=ROUNDING
    )


def laws(a, b, c, v):
    p, q, r = turn(a), turn(b), turn(c)
    return {
        "associative": p.then(q).then(r).wxyz - p.then(q.then(r)).wxyz,
        "identity": p.then(Quaternion.identity()).wxyz - p.wxyz,
        "inverse": p.then(p.inverse()).wxyz - Quaternion.identity().wxyz,
        "inverse of a product": p.then(q).inverse().wxyz - q.inverse().then(p.inverse()).wxyz,
        "action": p.then(q).rotate(v) - p.rotate(q.rotate(v)),
        "rotate_back undoes rotate": p.rotate_back(p.rotate(v)) - v,
        "matrix": p.matrix() @ v - p.rotate(v),
        "homomorphism": p.then(q).matrix() - p.matrix() @ q.matrix(),
        "orthogonal": p.matrix() @ p.matrix().T - jnp.eye(3),
        "proper": jnp.linalg.det(p.matrix()) - 1.0,
        "length does not matter": Quaternion(3.0 * p.wxyz).rotate(v) - p.rotate(v),
        "storage": Quaternion.from_xyzw(p.xyzw()).wxyz - p.wxyz,
    }


@given(turns, turns, turns, vectors)
def test_group_laws(a, b, c, v):
    for law, violation in call(laws, a, b, c, v).items():
        np.testing.assert_allclose(
            violation, np.zeros_like(violation), atol=20 * ROUNDING, err_msg=law
        )


def descriptions(v):
    q = turn(v)
    return q.wxyz, q.matrix(), q.rotation_vector(), Quaternion.from_matrix(q.matrix()).wxyz


@given(turns)
def test_descriptions_agree_with_scipy(v):
    peer = Rotation.from_rotvec(v)
    wxyz, matrix, vector, again = call(descriptions, v)
    same(wxyz, np.roll(peer.as_quat(), 1))
    same(again, wxyz)
    np.testing.assert_allclose(matrix, peer.as_matrix(), atol=ROUNDING)
    # At half a turn both directions of the axis are right.
    np.testing.assert_allclose(
        Rotation.from_rotvec(np.array(vector)).as_matrix(), peer.as_matrix(), atol=ROUNDING
    )
    assert np.linalg.norm(vector) <= np.pi + ROUNDING


def test_rotation_vector_round_trip_and_slope():
    """At no turn at all, and on both sides of the place where the series hands over to the closed
    form."""
    v = np.array([[0.6], [0.0], [-0.8]]) * np.array([0.0, 1e-200, 1e-9, 1e-4, 2e-3, 0.3, 3.0])

    def round_trip(x):
        return turn(x).rotation_vector()

    np.testing.assert_allclose(jax.jit(round_trip)(v), v, rtol=1e-13, atol=0.0)
    for mode in (jax.jacfwd, jax.jacrev):
        slopes = jax.jit(jax.vmap(mode(round_trip), in_axes=1))(v)
        np.testing.assert_allclose(slopes, np.broadcast_to(np.eye(3), (7, 3, 3)), atol=1e-12)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_half_turns_from_a_matrix(axis):
    """Shepperd's choice: the trace is -1 here, and the form that divides by it would lose
    everything."""
    half = Quaternion.about(axis, jnp.array(np.pi))
    same(call(lambda m: Quaternion.from_matrix(m).wxyz, half.matrix()), half.wxyz)
    slope = call(
        jax.jacfwd(lambda a: Quaternion.from_matrix(Quaternion.about(axis, a).matrix()).wxyz),
        jnp.array(np.pi),
    )
    np.testing.assert_allclose(np.abs(slope[0]), 0.5, atol=ROUNDING)


def both_rates(v, omega):
    def later(dt):
        return turn(v).then(turn(omega * dt)).wxyz

    return jax.jvp(later, (0.0,), (1.0,))[1], turn(v).rate(omega).wxyz


@given(turns, vectors)
def test_rate_is_the_derivative_of_the_turn(v, omega):
    """q' = q (0, omega)/2 with omega in body axes: the orientation after the small turn omega dt
    about the body's own axes."""
    derivative, rate = call(both_rates, v, omega)
    np.testing.assert_allclose(rate, derivative, atol=20 * ROUNDING)


def test_finite_rotations_do_not_commute():  # T1.3-rot
    x, y = Quaternion.about(0, jnp.pi / 2.0), Quaternion.about(1, jnp.pi / 2.0)
    # About fixed axes the later turn stands on the left.
    first_x, first_y = y.then(x), x.then(y)
    vector = first_x.rotation_vector()
    np.testing.assert_allclose(np.degrees(np.linalg.norm(vector)), 120.0, rtol=1e-9)
    np.testing.assert_allclose(
        vector / np.linalg.norm(vector), np.array([1.0, 1.0, -1.0]) * 0.5773502691896257, rtol=1e-9
    )
    between = first_x.inverse().then(first_y).rotation_vector()
    np.testing.assert_allclose(np.degrees(np.linalg.norm(between)), 120.0, rtol=1e-9)


def test_two_turns_are_one():  # T5.1
    q = Quaternion.about(1, jnp.radians(60.0)).then(Quaternion.about(0, jnp.radians(40.0)))
    wxyz = [0.8137976813493737, 0.29619813272602386, 0.4698463103929542, -0.17101007166283436]
    np.testing.assert_allclose(q.wxyz, wxyz, rtol=1e-9)
    vector = q.rotation_vector()
    np.testing.assert_allclose(np.degrees(np.linalg.norm(vector)), 71.06269552560836, rtol=1e-9)
    axis = [0.50967737206234, 0.808479211365493, -0.294262367960053]
    np.testing.assert_allclose(vector / np.linalg.norm(vector), axis, rtol=1e-9)


def euler(sequence, angles):
    q = rotations.from_euler_angles(angles, sequence)
    back = rotations.to_euler_angles(q, sequence)
    return q.matrix(), back, rotations.from_euler_angles(back, sequence).matrix()


euler = jax.jit(euler, static_argnums=0)


def samples(sequence):
    """Angles all over their ranges and, in the last columns, exactly on, and closely beside, the
    singular positions."""
    rng = np.random.default_rng(7)
    symmetric = sequence[0] == sequence[2]
    regular = rng.uniform(-1.0, 1.0, (3, 40)) * np.array([[3.1], [1.55], [3.1]])
    regular[1] += 1.571 if symmetric else 0.0
    poles = np.array([0.0, np.pi] if symmetric else [-np.pi / 2.0, np.pi / 2.0])
    beside = [poles, poles + 1e-9, poles - 1e-9, poles + 1e-5, poles - 1e-5]
    middles = np.concatenate(beside)
    singular = np.stack([np.full_like(middles, 0.4), middles, np.full_like(middles, -1.1)])
    return regular, singular


# The rates below ask each sequence for its own axes; here are both kinds of them.
@pytest.mark.slow
@pytest.mark.parametrize("sequence", rotations.euler_angles.SEQUENCES)
def test_euler_angles_agree_with_scipy(sequence):
    regular, singular = samples(sequence)
    angles = np.concatenate([regular, singular], axis=1)
    matrix, back, again = euler(sequence, angles)
    letters = "".join("XYZ"[int(c) - 1] for c in sequence)
    peer = Rotation.from_euler(letters, angles.T).as_matrix()
    np.testing.assert_allclose(np.moveaxis(matrix, -1, 0), peer, atol=ROUNDING)
    np.testing.assert_allclose(back[:, :40], regular, atol=1e-12)
    # Whatever the singular position leaves open, the angles describe the same orientation, to one
    # rounding: the third angle is read from what the first two leave, and not from two small
    # numbers.
    np.testing.assert_allclose(again, matrix, atol=ROUNDING)
    low, high = (0.0, np.pi) if sequence[0] == sequence[2] else (-np.pi / 2.0, np.pi / 2.0)
    assert np.all((back[1] >= low - ROUNDING) & (back[1] <= high + ROUNDING))


# A program for each sequence: in the sample one of each kind.
@pytest.mark.parametrize(
    "sequence",
    [
        pytest.param(s, marks=[pytest.mark.sweep] * (s not in ("313", "321")))
        for s in rotations.euler_angles.SEQUENCES
    ],
)
def test_euler_angles_have_no_nan(sequence):
    """Values and both modes of derivative, on the singular positions as well."""
    _, singular = samples(sequence)

    def round_trip(a):
        return rotations.to_euler_angles(rotations.from_euler_angles(a, sequence), sequence)

    regular = np.array([[0.3, -2.0], [0.7, 1.2], [-0.4, 1.9]])
    points = np.concatenate([regular, singular[:, :2], np.zeros((3, 1))], axis=1)
    for mode in (jax.jacfwd, jax.jacrev):
        # Five points do not repay an optimised program.
        quick = {"xla_backend_optimization_level": 0}
        slopes = jax.jit(jax.vmap(mode(round_trip), in_axes=1), compiler_options=quick)(points)
        assert np.isfinite(slopes).all()
        np.testing.assert_allclose(slopes[:2], np.broadcast_to(np.eye(3), (2, 3, 3)), atol=1e-12)


@pytest.mark.parametrize("sequence", rotations.euler_angles.SEQUENCES)
def test_euler_rates_are_the_rates_of_the_quaternion(sequence):
    angles, rates = np.array([0.5, 0.7, -0.4]), np.array([0.3, -0.8, 1.1])

    @jax.jit
    def both(angles, rates):
        q, q_rate = jax.jvp(
            lambda a: rotations.from_euler_angles(a, sequence).wxyz, (angles,), (rates,)
        )
        omega = rotations.euler_angles.omega_from_euler_rates(angles, rates, sequence)
        return (
            q_rate,
            Quaternion(q).rate(omega).wxyz,
            rotations.euler_angles.euler_rates_from_omega(angles, omega, sequence),
        )

    derivative, rate, back = both(angles, rates)
    np.testing.assert_allclose(rate, derivative, atol=ROUNDING)
    np.testing.assert_allclose(back, rates, atol=1e-13)


def test_euler_rates_from_omega():  # T3.5
    psi, theta, phi = np.radians([45.0, 30.0, 30.0])
    omega = jnp.array([0.3, -0.7, 1.9])
    rates = rotations.euler_angles.euler_rates_from_omega(jnp.array([psi, theta, phi]), omega)
    np.testing.assert_allclose(
        rates, [-0.9124355652982141, 0.6098076211353316, 2.690192378864668], rtol=1e-9
    )


def test_euler_rates_near_the_singular_angle():  # T3.5-sing
    psi_rate, _, phi_rate = rotations.euler_angles.euler_rates_from_omega(
        jnp.array([0.0, 1e-6, 0.3]), jnp.array([0.01, 0.02, 1.0])
    )
    np.testing.assert_allclose(
        [psi_rate, phi_rate], [22061.931849129192, -22060.931849118162], rtol=1e-9
    )
    np.testing.assert_allclose(psi_rate + phi_rate, 1.000000011030966, rtol=1e-8)


def test_rates_of_direction_cosines():  # T3-P15
    psi, theta, phi = np.radians([45.0, 30.0, 30.0])
    q = rotations.from_euler_angles(jnp.array([psi, theta, phi]))
    rate = q.rate(jnp.array([0.3, -0.7, 1.9]))
    _, c_rate = jax.jvp(lambda wxyz: Quaternion(wxyz).matrix(), (q.wxyz,), (rate.wxyz,))
    want = [-1.4318912319027588, 0.08838834764831845, -0.3049038105676658]
    np.testing.assert_allclose([c_rate[0, 0], c_rate[1, 0], c_rate[2, 2]], want, rtol=1e-9)


def test_direction_cosines_of_many_bodies(key):  # T3-P15
    """Their rates are those of the quaternion, the way back finds omega, and their exact motion
    keeps the six conditions; a part of C' that no turn has changes nothing."""
    one, two, three = jax.random.split(key, 3)
    wxyz, omega = jax.random.normal(one, (4, 5)), jax.random.normal(two, (3, 5))
    q = Quaternion(wxyz).normalised()
    c, c_rate = q.matrix(), rotations.direction_cosines.cosine_rates(q.matrix(), omega)
    _, truth = jax.jvp(Quaternion.matrix, (q,), (q.rate(omega),))
    np.testing.assert_allclose(c_rate, truth, atol=1e-14)
    np.testing.assert_allclose(
        rotations.direction_cosines.omega_from_cosine_rates(c, c_rate), omega, atol=1e-14
    )
    stretch = jax.random.normal(three, (3, 3, 5))
    stretch = jnp.einsum("ijr,jkr->ikr", c, stretch + jnp.swapaxes(stretch, 0, 1))
    found = rotations.direction_cosines.omega_from_cosine_rates(c, c_rate + stretch)
    np.testing.assert_allclose(found, omega, atol=1e-13)
    missed, missed_rate = jax.jvp(rotations.direction_cosines.cosine_conditions, (c,), (c_rate,))
    np.testing.assert_allclose(missed, 0.0, atol=1e-15)
    np.testing.assert_allclose(missed_rate, 0.0, atol=1e-14)
    longer = rotations.direction_cosines.cosine_conditions(c.at[:, 1].multiply(2.0))
    np.testing.assert_allclose(longer, np.outer([0, 3, 0, 0, 0, 0], np.ones(5)), atol=1e-14)


def test_moving_euler_frame():  # T2.5-gen, rotation only
    def angles(t):
        return jnp.stack([0.3 + 0.5 * t, 0.8 + 0.2 * t**2, -0.4 + 1.1 * t])

    a, rates = jax.jvp(angles, (0.6,), (1.0,))
    omega = rotations.euler_angles.omega_from_euler_rates(a, rates)
    np.testing.assert_allclose(
        omega, [0.33034622299119853, 0.308242994773583, 1.4216483003661953], rtol=1e-9
    )
    matrix = [
        [0.7042160337468965, -0.5632020640588163, 0.43229991077223107],
        [0.6821580434373152, 0.36793223987753726, -0.6318910274979953],
        [0.19682525647783075, 0.7398846544554004, 0.6432966007323906],
    ]
    np.testing.assert_allclose(rotations.from_euler_angles(a).matrix(), matrix, rtol=1e-9)


def test_yaw_pitch_roll():  # T7.4-P11; the case lists the matrix from inertial to body axes
    angles, rates = jnp.array([0.3, -0.2, 0.5]), jnp.array([0.11, -0.07, 0.05])
    matrix = [
        [0.9362933635841992, 0.28962947762551555, 0.19866933079506122],
        [-0.3503364588118941, 0.8102391858702562, 0.4698689469495153],
        [-0.02488177918333981, -0.5095362866083979, 0.8600893382050473],
    ]
    np.testing.assert_allclose(
        rotations.from_euler_angles(angles, "321").matrix().T, matrix, rtol=1e-12
    )
    omega = rotations.euler_angles.omega_from_euler_rates(angles, rates, "321")
    np.testing.assert_allclose(
        omega, [0.07185362638745674, -0.009745195167879417, 0.1281696149048494], rtol=1e-12
    )


def test_runs_trail(key):
    v, w = jax.random.normal(key, (2, 3, 5))
    q = turn(v)
    assert q.wxyz.shape == (4, 5) and q.matrix().shape == (3, 3, 5)
    np.testing.assert_allclose(q.rotate(w)[:, 2], turn(v[:, 2]).rotate(w[:, 2]), atol=ROUNDING)
    angles = rotations.to_euler_angles(q, "321")
    np.testing.assert_allclose(
        angles[:, 2], rotations.to_euler_angles(turn(v[:, 2]), "321"), atol=ROUNDING
    )
    same(Quaternion.from_matrix(q.matrix()).wxyz, q.wxyz)


def test_single_precision_stays_single():
    v = jnp.array([0.1, -0.2, 0.3], jnp.float32)
    q = turn(v)
    for x in (
        q.wxyz,
        q.matrix(),
        q.rotation_vector(),
        q.normalised().wxyz,
        rotations.to_euler_angles(q),
    ):
        assert x.dtype == jnp.float32


@pytest.mark.parametrize("sequence", ["112", "31", "xyz"])
def test_unknown_sequence(sequence):
    with pytest.raises(InputError, match="it must be one of 313, 321"):
        rotations.from_euler_angles(jnp.zeros(3), sequence)


@pytest.mark.parametrize("sequence", SEQUENCES)
def test_euler_rates_in_the_singular_position(sequence):
    """The rate of the middle angle exists there, and so does the whole turn about the common axis
    of the outer ones."""
    proper = sequence[0] == sequence[2]
    # Exactly singular at zero only: pi/2 is rounded.
    angles = jnp.array([0.0, 0.0, 0.3]) if proper else jnp.array([0.4, 0.2, 0.3])
    rates = jnp.array([0.0, 0.7, -0.2]) if proper else jnp.array([0.5, 0.7, -0.2])
    omega = omega_from_euler_rates(angles, rates, sequence)
    found = euler_rates_from_omega(angles, omega, sequence)
    np.testing.assert_allclose(found, rates, atol=ROUNDING)
    if proper:
        across = omega + jnp.cross(omega, jnp.eye(3)[int(sequence[2]) - 1])
        found = euler_rates_from_omega(angles, across, sequence)
        assert np.isfinite(found[1]) and not np.isfinite(found[0])
    still = euler_rates_from_omega(jnp.zeros(3), jnp.zeros(3), sequence)
    np.testing.assert_array_equal(still, 0.0)
