"""The free rigid body: Thomson 5.8 to 5.12, 6.2 (impulses), a check case of a flight simulation,
and what must be conserved."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jax.flatten_util import ravel_pytree
from numpy.testing import assert_allclose
from reference_run import check_derivatives, drifts, long_run, run

from jaxspace.attitude import TorqueFreeBody
from jaxspace.attitude.polhode import Polhode
from jaxspace.attitude.principal_spins import cone_bounds
from jaxspace.attitude.torque_free import (
    body_precession_rate,
    cone_angles,
    coning_omega,
    precession_rate,
    space_cone_angle,
    symmetric_flow,
)
from jaxspace.bodies import BodyState, InertiaTensor, PrincipalInertia
from jaxspace.core import InputError
from jaxspace.core.elliptic import complete_elliptic
from jaxspace.rotations import Quaternion

CASE = 1e-9  # relative tolerance of the reference cases


def start(omega):
    return BodyState(attitude=Quaternion.identity(), omega=jnp.asarray(omega, dtype=float))


def test_symmetric_body_rates_and_cones():  # T5.8
    omega = jnp.array([0.8, -0.6, 6.0])
    assert_allclose(body_precession_rate(6.0, 2.0, 3.0), 3.0, rtol=CASE)
    assert_allclose(
        cone_angles(omega, 2.0, 3.0), [0.11065722117389565, 0.16514867741462683], rtol=CASE
    )
    assert_allclose(precession_rate(omega, 2.0, 3.0), 9.055385138137417, rtol=CASE)
    expected = [-0.2175776261927869, 0.9760430198409863, 6.0]
    assert_allclose(symmetric_flow(5.0, start(omega), 2.0, 3.0).omega, expected, rtol=CASE)
    assert_allclose(
        run(TorqueFreeBody([2.0, 2.0, 3.0]), start(omega), [0.0, 5.0]).omega[:, -1],
        expected,
        rtol=CASE,
    )


def test_thin_disk_wobbles_twice_per_turn():  # T5.9-P1
    omega = coning_omega(0.0, 1.0, 1.0, 2.0)
    assert_allclose(1.0 / omega[2], 2.0, rtol=CASE)
    assert_allclose(-1.0 / body_precession_rate(omega[2], 1.0, 2.0), -2.0, rtol=CASE)


def test_wobbling_disk():  # T5.9-P2
    theta, psi_rate = 0.3490658503988659, 12.566370614359172
    omega = coning_omega(theta, psi_rate, 1.0, 2.0)
    angle, gamma = cone_angles(omega, 1.0, 2.0)
    size = jnp.linalg.norm(omega)
    assert_allclose(omega[2], 5.904262868187098, rtol=CASE)
    assert_allclose(-body_precession_rate(omega[2], 1.0, 2.0), -5.904262868187098, rtol=CASE)
    assert_allclose([angle, precession_rate(omega, 1.0, 2.0)], [theta, psi_rate], rtol=CASE)
    assert_allclose(size, 7.30292478172074, rtol=CASE)
    assert_allclose(size * jnp.cos(gamma - angle), 7.018178365943514, rtol=CASE)
    assert_allclose(size * jnp.sin(gamma - angle), 2.019376832409775, rtol=CASE)
    assert_allclose(jnp.hypot(omega[0], omega[1]), 4.297951878606596, rtol=CASE)
    rate = TorqueFreeBody([1.0, 1.0, 2.0]).vector_field(0.0, start(omega))
    assert_allclose(jnp.linalg.norm(rate.omega), 25.37623768611191, rtol=CASE)


def test_disk_released_askew():  # T5.9-P3
    omega = 10.0 * jnp.array([np.sin(np.pi / 6), 0.0, np.cos(np.pi / 6)])
    theta, gamma = cone_angles(omega, 1.0, 2.0)
    psi_rate = precession_rate(omega, 1.0, 2.0)
    assert_allclose([theta, gamma], [0.28103490150281357, 0.5235987755982989], rtol=CASE)
    assert_allclose(psi_rate, 18.027756377319946, rtol=CASE)
    assert_allclose(2.0 * np.pi / psi_rate, 0.3485284122811993, rtol=CASE)


def test_thick_disk():  # T5.9-P4
    A, C, theta = 13.0 / 48.0, 0.5, 0.26179938779914946
    direction = coning_omega(theta, 1.0, A, C)
    omega = 31.41592653589793 * direction / jnp.linalg.norm(direction)
    angle, gamma = cone_angles(omega, A, C)
    assert_allclose(C / A, 1.8461538461538463, rtol=CASE)
    assert_allclose([angle, gamma], [theta, 0.45937888898266754], rtol=CASE)
    assert_allclose(space_cone_angle(omega, A, C), 0.19757950118351814, rtol=CASE)
    assert_allclose(omega[1:], [13.929553951524703, 28.15897666500859], rtol=CASE)
    kept = TorqueFreeBody([A, A, C]).invariants(0.0, start(omega))
    assert_allclose(kept["energy"], 224.50722246293384, rtol=CASE)
    assert_allclose(
        kept["angular_momentum"][1:], [3.7725875285379407, 14.079488332504296], rtol=CASE
    )


def test_two_impulses_turn_the_axis():  # T6.2-P6
    A, C, n, impulse = 0.002, 0.0008, 500.0, 0.05
    first = BodyState(attitude=Quaternion.identity(), omega=jnp.array([impulse / A, 0.0, n]))
    theta, _ = cone_angles(first.omega, A, C)
    spacing = np.pi / precession_rate(first.omega, A, C)
    assert_allclose(theta, 0.12435499454676144, rtol=CASE)
    assert_allclose(space_cone_angle(first.omega, A, C), -0.07439659882481868, rtol=CASE)
    assert_allclose(spacing, 0.015586664439016684, rtol=CASE)
    turned = symmetric_flow(spacing, first, A, C)
    axis = turned.attitude.rotate(jnp.array([0.0, 0.0, 1.0]))
    assert_allclose(
        jnp.arctan2(jnp.hypot(axis[0], axis[1]), axis[2]), 0.24870998909352288, rtol=CASE
    )
    # The transverse rate has turned with the body: the same impulse, opposed to it, leaves a pure
    # spin.
    h_Z = TorqueFreeBody([A, A, C]).invariants(0.0, turned)["angular_momentum"]
    assert_allclose(h_Z, [impulse, 0.0, C * n], atol=1e-15)


def test_poinsot():  # T5.10
    body, y = TorqueFreeBody([3.0, 2.0, 1.0]), start([0.4, 0.0, 2.0])
    polhode = Polhode.of(jnp.array([3.0, 2.0, 1.0]), y.omega)
    kept = body.invariants(0.0, y)
    two_t, h = 2.0 * kept["energy"], jnp.linalg.norm(kept["angular_momentum"])
    assert_allclose([two_t, h], [4.48, 2.3323807579381204], rtol=CASE)
    assert_allclose(polhode.plane_distance, 1.920784153596099, rtol=CASE)
    assert_allclose(polhode.herpolhode_radii, [0.6859943405700354, 0.5573044368153888], rtol=CASE)
    moments = np.array([3.0, 2.0, 1.0])
    assert_allclose(
        np.sqrt(two_t / moments),
        [1.2220201853215573, 1.4966629547095767, 2.1166010488516727],
        rtol=CASE,
    )
    assert_allclose(
        h / moments, [0.77746025264604, 1.1661903789690602, 2.3323807579381204], rtol=CASE
    )


def test_the_herpolhode_keeps_its_digits_beside_a_steady_turn():
    a, b, c = moments = (3.0, 2.0, 1.0)
    for omega in ((1.0, 1e-9, 2e-9), (1e-7, 3e-7, 1.0)):
        radii = Polhode.of(jnp.array(moments), jnp.array(omega)).herpolhode_radii
        with mpmath.workdps(50):
            w = [mpmath.mpf(x) for x in omega]
            two_t, h2 = (sum(m**n * x * x for m, x in zip(moments, w, strict=True)) for n in (1, 2))
            # Where the polhode crosses two planes of principal axes: |v|^2 there.
            below, above = two_t * a - h2, h2 - two_t * c
            squares = [above / (a * (a - c)) + below / (c * (a - c))]
            middle = two_t * b - h2
            if middle > 0:
                squares.append(above / (b * (b - c)) + middle / (c * (b - c)))
            else:
                squares.append(-middle / (a * (a - b)) + below / (b * (a - b)))
            expected = [float(mpmath.sqrt(v2 - two_t**2 / h2)) for v2 in squares]
        assert_allclose(radii, expected, rtol=1e-14)


def test_cone_of_the_least_axis():  # T5.12-P8
    moments, omega = jnp.array([3.0, 2.0, 1.0]), jnp.array([0.4, 0.0, 2.0])
    least, greatest = cone_bounds(moments, omega)
    assert_allclose([greatest[2], least[2]], [0.6361320628050102, 0.5404195002705842], rtol=CASE)
    first, second = Polhode.of(moments, omega).vertices
    assert_allclose([first[0], second[1]], [0.4, 0.6928203230275509], rtol=CASE)


ASYMMETRIC = {
    "T5.11-a": dict(
        omega=[0.4, 0.0, 2.0],
        ratio=1.2142857142857142,
        k=0.34641016151377546,
        N=1.1547005383792515,
        period=5.616670588052069,
        states=[
            [0.17024323172771694, -0.6269383750837946, 1.8991967443757087],
            [0.3044997641991259, 0.4492657129227982, 1.948886943666043],
            [-0.369457082164374, 0.26552663391035, 1.9822955396923636],
        ],
        matrix=[
            [-0.3894623849878296, 0.909734844844061, 0.14388037654985836],
            [-0.8634775905475163, -0.3062783381684302, -0.400749335858497],
            [-0.3205081922538526, -0.28031427299608375, 0.9048195439162682],
        ],
        precession=5.554122900597321,
        about_least=True,
    ),
    "T5.11-b": dict(
        omega=[2.0, 0.0, 0.9],
        ratio=2.873536299765808,
        k=0.25980762113533157,
        N=2.0,
        period=3.1967194322672636,
        states=[
            [1.9413264090915736, -0.8329197560934961, -0.34094674057563734],
            [1.989291009442881, 0.3579997754875972, -0.8257337105573624],
            [1.931430344342845, -0.8992944316824366, -0.035630396362704785],
        ],
        matrix=[
            [0.9666763418734095, -0.2241760658098575, 0.12362015038114696],
            [-0.255921453158708, -0.8341491000782988, 0.4885688167000426],
            [-0.006407798013214609, -0.5039249650062587, -0.8637236651661473],
        ],
        precession=12.892444994059057,
        about_least=False,
    ),
}


@pytest.mark.parametrize("case", ASYMMETRIC.values(), ids=ASYMMETRIC)
def test_asymmetric_body(case):
    body, y = TorqueFreeBody([3.0, 2.0, 1.0]), start(case["omega"])
    polhode = Polhode.of(jnp.array([3.0, 2.0, 1.0]), y.omega)
    period = float(polhode.period)
    ts = (
        [0.0, 1.0, case["period"], 5.0, 20.0]
        if case["period"] < 5.0
        else [0.0, 1.0, 5.0, case["period"], 20.0]
    )
    states = run(body, y, ts)
    kept = body.invariants(0.0, y)
    momentum = np.asarray(kept["angular_momentum"])
    assert_allclose(momentum @ momentum / (2.0 * kept["energy"]), case["ratio"], rtol=CASE)
    assert_allclose(polhode.modulus_squared, case["k"] ** 2, rtol=CASE)
    assert_allclose(polhode.complement, 1.0 - case["k"] ** 2, rtol=CASE)
    assert_allclose([polhode.rate, period], [case["N"], case["period"]], rtol=CASE)
    assert bool(polhode.about_least) is case["about_least"]
    at = [ts.index(t) for t in (1.0, 5.0, 20.0)]
    assert_allclose(states.omega[:, at].T, case["states"], rtol=CASE)
    assert_allclose(
        Quaternion(states.attitude.wxyz[:, -1]).matrix(), case["matrix"], rtol=1e-8, atol=1e-9
    )
    # After one period omega is back in the body, so that the attitude has turned about h alone,
    # through the precession.
    turn = np.asarray(
        Quaternion(states.attitude.wxyz[:, ts.index(case["period"])]).rotation_vector()
    )
    angle = turn @ momentum / np.linalg.norm(momentum)
    assert_allclose(angle % (2.0 * np.pi), case["precession"] % (2.0 * np.pi), rtol=CASE)
    assert (
        max(drifts(body, states, ts).values()) < 1e-11
    )  # DOP853 at rtol 1e-12 over some ten turns


def test_long_run():  # T5.11-long
    body, ts = TorqueFreeBody([1.0, 2.0, 3.0]), np.linspace(0.0, 1000.0, 8001)
    states = long_run(body, start([2.0, 0.0, 0.4]), 1000.0, 8000)
    assert_allclose(
        states.omega[:, -1], [1.9915528151423405, 0.1836229411011009, 0.3856953095823099], rtol=1e-7
    )
    assert max(drifts(body, states, ts).values()) < 1e-10  # the case's own demand


def test_separatrix():  # T5.12-P3
    omega = jnp.array([1.0, 0.0, 1.7320508075688772])
    states = run(TorqueFreeBody([3.0, 2.0, 1.0]), start(omega), [0.0, 1.0, 15.0])
    assert_allclose(
        states.omega[:, 1], [0.6480542736638853, -1.31911977286292, 1.122462928047995], rtol=CASE
    )
    assert_allclose(Polhode.of(jnp.array([3.0, 2.0, 1.0]), omega).rate, 1.0, rtol=CASE)
    # Rounding grows as exp(t): at t = 15 from 1e-16 to 1e-9, and the distance from the limit falls
    # as exp(-t).
    assert_allclose(states.omega[1, 2], -1.7320508075688772, rtol=1e-8)


def test_moments_in_rising_order():  # T5.12-P9
    moments, omega = [1.0, 2.0, 3.0], [2.0, 0.0, 0.4]
    polhode = Polhode.of(jnp.array(moments), jnp.array(omega))
    expected = [0.12, 1.1547005383792515, 5.616670588052069]
    assert_allclose([polhode.modulus_squared, polhode.rate, polhode.period], expected, rtol=CASE)
    state = run(TorqueFreeBody(moments), start(omega), [0.0, 5.0]).omega[:, -1]
    assert_allclose(state, [1.948886943666043, -0.4492657129227982, 0.3044997641991259], rtol=CASE)


def test_space_station():  # JEOD-2, torque-free
    T = np.array(
        [
            [0.1412307175854331, -0.9892782736897275, 0.03718039289432347],
            [-0.7726919750981249, -0.13363312232427016, -0.6205556383087864],
            [0.6188707425862547, 0.05891252687959728, -0.7832804849780176],
        ]
    )
    inertia = np.array(
        [[1.02e8, -6.96e6, -5.48e6], [-6.96e6, 9.1e7, 5.9e5], [-5.48e6, 5.9e5, 1.64e8]]
    )
    y = BodyState(
        attitude=Quaternion.from_matrix(jnp.asarray(T.T)),
        omega=jnp.array([0.0, -0.001134454274550824, 0.0]),
    )
    states = run(TorqueFreeBody(inertia), y, [0.0, 28800.0], atol=1e-18)
    omega = [-0.0007963417068132182, -0.0007912816280812424, -0.0001860246400745597]
    assert_allclose(states.omega[:, -1], omega, rtol=0, atol=1e-12)
    # The case's quaternion is that of the left transformation, inertial to body: the conjugate of
    # ours.
    q = np.asarray(states.attitude.wxyz[:, -1]) * [1.0, -1.0, -1.0, -1.0]
    expected = np.array(
        [-0.3473503134814249, -0.5588902518164917, 0.36482923903863, 0.658702567545739]
    )
    assert_allclose(q * np.sign(q @ expected), expected, rtol=0, atol=1e-9)


def test_period_near_the_separatrix_keeps_its_digits():
    for complement in (1.0, 0.5, 1e-3, 1e-12, 1e-40):
        with mpmath.workdps(60):
            expected = float(mpmath.ellipk(1 - mpmath.mpf(complement)))
        assert_allclose(complete_elliptic(complement), expected, rtol=1e-15)
    assert complete_elliptic(0.0) == jnp.inf
    check_derivatives(lambda m: complete_elliptic(m[0])[None], [0.3])


@pytest.mark.parametrize(
    ("A", "C"), [(2.0, 3.0), (3.0, 1.0), (2.0, 2.0)], ids=["oblate", "prolate", "sphere"]
)
def test_symmetric_flow_is_the_integral(A, C):
    y = BodyState(
        attitude=Quaternion(jnp.array([0.6, 0.0, -0.8, 0.0])), omega=jnp.array([0.3, -0.7, 1.1])
    )
    last = jax.tree.map(lambda x: x[..., -1], run(TorqueFreeBody([A, A, C]), y, [0.0, 4.0]))
    exact = symmetric_flow(4.0, y, A, C)
    assert_allclose(
        ravel_pytree(exact)[0], ravel_pytree(last)[0], atol=1e-11
    )  # some rad at rtol 1e-12


@given(
    st.floats(0.5, 3.0),
    st.floats(0.5, 3.0),
    st.lists(st.floats(-5.0, 5.0), min_size=3, max_size=3),
    st.floats(-9.0, 9.0),
)
def test_symmetric_flow_keeps_the_invariants_and_returns(A, C, omega, duration):
    y = start(omega)
    later = symmetric_flow(duration, y, A, C)
    back = symmetric_flow(-duration, later, A, C)
    assert_allclose(
        ravel_pytree(back)[0], ravel_pytree(y)[0], atol=1e-12
    )  # rounding of some 50 rad
    body = TorqueFreeBody(PrincipalInertia(jnp.array([A, A, C]))) if 2 * A >= C else None
    if body is not None:
        for name, value in body.invariants(0.0, y).items():
            assert_allclose(body.invariants(duration, later)[name], value, rtol=1e-12, atol=1e-12)


def test_a_tensor_in_other_axes_is_the_same_body():
    turn = Quaternion(jnp.array([0.5, 0.5, -0.5, 0.5])).then(Quaternion.about(0, 0.3))
    C = turn.matrix()
    omega = jnp.array([0.4, 0.2, 2.0])
    principal = TorqueFreeBody([3.0, 2.0, 1.0]).vector_field(0.0, start(omega)).omega
    tensor = C @ jnp.diag(jnp.array([3.0, 2.0, 1.0])) @ C.T
    rotated = (
        TorqueFreeBody(InertiaTensor((tensor + tensor.T) / 2.0))
        .vector_field(0.0, start(C @ omega))
        .omega
    )
    assert_allclose(C.T @ rotated, principal, atol=1e-14)


def rates_and_invariants(v):
    y = BodyState(attitude=Quaternion(jnp.array([0.8, 0.0, 0.6, 0.0])), omega=v[3:])
    body = TorqueFreeBody(PrincipalInertia(v[:3]))
    kept = body.invariants(0.0, y)
    return jnp.concatenate(
        [
            ravel_pytree(body.vector_field(0.0, y))[0],
            kept["energy"][None],
            kept["angular_momentum"],
        ]
    )


def symmetric_end(v):
    y = BodyState(attitude=Quaternion(jnp.array([0.8, 0.0, 0.6, 0.0])), omega=v[3:])
    return ravel_pytree(symmetric_flow(1.5, y, v[0], v[2]))[0]


@pytest.mark.parametrize(
    "x",
    [
        [3.0, 2.0, 1.0, 0.4, 0.1, 2.0],
        [2.0, 2.0, 2.0, 0.4, 0.1, 2.0],
        [3.0, 2.0, 2.0, 0.0, 0.0, 0.0],
    ],
    ids=["asymmetric", "equal moments", "at rest"],
)
def test_derivatives(x):
    check_derivatives(rates_and_invariants, x)
    check_derivatives(symmetric_end, x)


def test_derivatives_of_the_polhode_and_the_cones():
    def quantities(v):
        polhode = Polhode.of(v[:3], v[3:])
        return jnp.stack(
            [
                polhode.period,
                polhode.plane_distance,
                *polhode.herpolhode_radii,
                *cone_angles(v[3:], v[0], v[2]),
            ]
        )

    check_derivatives(quantities, [3.0, 2.0, 1.0, 0.4, 0.1, 2.0], rtol=1e-6)
    slopes = jax.jit(jax.jacfwd(lambda v: jnp.stack(cone_angles(v[3:], v[0], v[2]))))
    for x in ([2.0, 2.0, 3.0, 0.0, 0.0, 0.0], [2.0, 2.0, 3.0, 0.0, 0.0, 1.0]):
        assert np.all(np.isfinite(slopes(jnp.array(x))))


def test_single_precision_stays():
    y = BodyState(attitude=Quaternion(jnp.ones(4, jnp.float32)), omega=jnp.ones(3, jnp.float32))
    body = TorqueFreeBody(PrincipalInertia(jnp.array([3.0, 2.0, 1.0], jnp.float32)))
    for tree in (
        body.vector_field(0.0, y),
        body.invariants(0.0, y),
        symmetric_flow(1.0, y, 2.0, 3.0),
    ):
        assert {x.dtype for x in jax.tree.leaves(tree)} == {jnp.dtype("float32")}
    polhode = Polhode.of(body.inertia.moments, y.omega)
    assert polhode.period.dtype == jnp.float32


def test_a_batch_is_a_loop():
    rng = np.random.default_rng(1)
    moments = jnp.array([[3.0, 2.0, 1.0], [2.0, 2.0, 2.0], [1.0, 2.0, 2.5], [1.0, 1.0, 2.0]]).T
    omega, q = jnp.asarray(rng.normal(size=(3, 4))), jnp.asarray(rng.normal(size=(4, 4)))

    def everything(moments, omega, q):
        y = BodyState(attitude=Quaternion(q), omega=omega)
        body = TorqueFreeBody(PrincipalInertia(moments))
        polhode = Polhode.of(moments, omega)
        flow = symmetric_flow(2.0, y, moments[0], moments[2])
        return (
            body.vector_field(0.0, y),
            body.invariants(0.0, y),
            polhode,
            polhode.herpolhode_radii,
            flow,
        )

    batch = everything(moments, omega, q)
    for i in range(4):
        one = everything(moments[:, i], omega[:, i], q[:, i])
        jax.tree.map(
            lambda a, b, i=i: assert_allclose(a[..., i], b, rtol=1e-14, atol=1e-14), batch, one
        )


def test_bad_input_is_named():
    with pytest.raises(InputError, match="PrincipalInertia.moments"):
        TorqueFreeBody([1.0, 1.0, 3.0])
    with pytest.raises(InputError, match="attitude and omega"):
        TorqueFreeBody([1.0, 1.0, 1.0]).vector_field(0.0, BodyState(omega=jnp.ones(3)))
