"""Small motions: eigenvalues with derivatives, transfer functions, loci, equilibria."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxspace import BodyState
from jaxspace.attitude import TorqueFreeBody
from jaxspace.core import InputError
from jaxspace.gyros import PlatformAxis, RateGyro, RateGyroState
from jaxspace.mechanics import DoublePendulum, RotatingHoop
from jaxspace.rotations import Quaternion
from jaxspace.studies import equilibrium, modes
from jaxspace.studies._eigenvalues import eigenvalues

AXIS = PlatformAxis(0.4, 2e-4, 0.05)
GYRO = RateGyro(1e-4, 0.004, 0.05, spring=0.2)
W = np.array([1.0, 30.0, 200.0])


def rest(gyro):
    return RateGyroState(jnp.zeros(()), jnp.zeros(()))


def eigenvalues_and_slopes(make, x):
    """Eigenvalues, their slopes in both modes, and the greatest difference to central ones."""
    values = jax.jit(lambda x: eigenvalues(make(x)))
    forward = jax.jit(jax.jacfwd(lambda x: eigenvalues(make(x))))(x)
    reverse = jax.jit(jax.jacrev(lambda x: eigenvalues(make(x)).real))(x)
    return values(x), forward, reverse


def test_slopes_of_single_roots():
    def make(x):
        return jnp.array([[0.0, 1.0, 0.2], [-4.0, -0.3, 0.0], [0.5, 0.1, -3.0]]) + x * jnp.array(
            [[0.1, 0.0, 0.4], [-1.0, 0.2, 0.0], [0.3, 0.0, 0.7]]
        )

    _, forward, reverse = eigenvalues_and_slopes(make, 0.3)
    h = 1e-5
    ahead, behind = eigenvalues(make(0.3 + h)), eigenvalues(make(0.3 - h))
    assert_allclose(forward, (ahead - behind) / (2 * h), atol=1e-8)
    assert_allclose(reverse, forward.real, atol=1e-13)


def test_equal_roots_have_the_mean_slope_and_joined_shapes_none():
    # 1 + x and 1 - 3 x cross at zero, and 2 stands by.
    _, forward, reverse = eigenvalues_and_slopes(
        lambda x: jnp.diag(jnp.stack([1.0 + x, 1.0 - 3.0 * x, 2.0 + 5.0 * x])), 0.0
    )
    assert_allclose(forward, [-1.0, -1.0, 5.0], atol=1e-12)
    assert_allclose(reverse, [-1.0, -1.0, 5.0], atol=1e-12)

    # +- sqrt(x): an infinite slope; the third root is not touched by it.
    def joined(x):
        one = jnp.zeros(())
        return jnp.stack(
            [
                jnp.stack([one, one + 1.0, one]),
                jnp.stack([x, one, one]),
                jnp.stack([one, one, 3.0 + x]),
            ]
        )

    _, forward, reverse = eigenvalues_and_slopes(joined, 0.0)
    assert not np.any(np.isfinite(forward[:2]))
    assert_allclose(forward[2], 1.0)
    assert_allclose(reverse[2], 1.0)


def test_transfer_function_of_a_platform():
    found = eqx.filter_jit(modes)(AXIS, AXIS.at_rest, inputs=("torque",), outputs=("gyro_angle",))
    h, J, I = 0.05, 0.4, 2e-4
    s = 1j * W
    # Thomson 6.8-4; from the torque to the angle, with the platform's own pole at zero.
    assert_allclose(found.transfer(s)[0, 0], h / (J * I) / (s * (s**2 + h * h / (J * I))), 1e-11)
    assert_allclose(found.frequencies[-2:], AXIS.nutation_frequency, rtol=1e-12)
    magnitude, _ = found.bode(W)
    assert_allclose(magnitude[0, 0], 20 * np.log10(np.abs(found.transfer(s)[0, 0])), rtol=1e-12)
    assert found.states[0] == "gyro_angle" and found.inputs == ("torque",)
    assert not found.stable
    assert "damping ratio" in str(found)


def test_a_gain_alone_never_stabilises_a_platform():  # T6.11-P6
    @jax.jit
    def growth(gain, lead):
        axis = PlatformAxis(0.4, 2e-4, 0.05, gain=gain, rate_gain=lead)
        matrix = modes(axis, axis.at_rest).matrix
        # Without the platform's own angle and the integral, which only follow.
        keep = jnp.array([0, 2, 3])
        return jnp.max(eigenvalues(matrix[keep][:, keep]).real)

    for gain in (0.1, 10.0, 1e3):
        assert growth(gain, 0.0) > 0.0
    damped = jax.jit(
        lambda c: (
            modes(PlatformAxis(0.4, 2e-4, 0.05, gain=1.0, gyro_damping=c), AXIS.at_rest).matrix
        )
    )(0.01)
    keep = np.array([0, 2, 3])
    # s^3 + (c/I) s^2 + (h^2/JI) s + K h/JI: stable for K < c h / I.
    assert np.max(np.linalg.eigvals(np.asarray(damped)[np.ix_(keep, keep)]).real) < 0.0


def test_frequency_response_of_a_rate_gyro():
    found = eqx.filter_jit(modes)(GYRO, rest(GYRO), inputs=("input_rate",), outputs=("angle",))
    assert_allclose(found.transfer(1j * W)[0, 0], GYRO.frequency_response(W), rtol=1e-12)
    assert_allclose(found.frequencies, GYRO.natural_frequency, rtol=1e-13)
    assert_allclose(found.damping_ratios, GYRO.damping_ratio, rtol=1e-13)
    assert bool(found.stable)
    assert found.zeros().size == 0
    # The loop w_i = -k theta stiffens the spring: K + k H.
    locus = found.root_locus(jnp.array([0.0, 12.0]))
    assert_allclose(np.abs(locus[:, 1]), np.sqrt((0.2 + 12 * 0.05) / 1e-4), rtol=1e-12)


def test_a_zero_of_a_transfer_function():
    """Of the rate: a zero at the origin; of angle plus rate: at -1."""
    outputs = ("angle_rate", lambda y: y.angle + y.angle_rate)
    found = modes(GYRO, rest(GYRO), inputs=("input_rate",), outputs=outputs)
    assert_allclose(found.zeros(0), [0.0], atol=1e-9)
    assert_allclose(found.zeros(1), [-1.0], rtol=1e-9)


def test_a_batch_over_parameters_is_its_runs():
    lengths = jnp.array([0.7, 1.0, 1.6])
    still = DoublePendulum.state(0.0, 0.0)
    one = jax.jit(lambda l: modes(DoublePendulum(2.0, 1.0, l, 0.8, 9.8), still).frequencies)
    many = jax.jit(lambda l: modes(DoublePendulum(2.0, 1.0, l, 0.8, 9.8), still))(lengths)
    assert many.matrix.shape == (4, 4, 3)
    for i in range(3):
        assert_allclose(many.frequencies[:, i], one(lengths[i]), rtol=1e-12)


def test_transfer_functions_and_loci_of_a_batch_are_those_of_its_runs(tmp_path):
    spring = jnp.array([0.1, 0.2, 0.4])
    named = dict(inputs=("input_rate",), outputs=("angle",))
    gyros = RateGyro(1e-4, 0.004, 0.05, spring=spring)
    linear = eqx.filter_jit(modes)
    found = linear(gyros, rest(GYRO), **named)
    g = found.transfer(1j * W)
    assert g.shape == (1, 1, 3, 3)
    assert_allclose(g[0, 0], gyros.frequency_response(W[:, None]), rtol=1e-12)
    magnitude, phase = found.bode(W)
    assert_allclose(magnitude[0, 0], 20.0 * np.log10(np.abs(g[0, 0])), rtol=1e-12)
    # Past its resonance a rate gyro lags by a half turn, along the frequencies.
    assert_allclose(phase[0, 0], np.unwrap(np.angle(g[0, 0]), axis=0), atol=1e-14)
    locus = found.root_locus(jnp.array([0.0, 12.0]))
    assert locus.shape == (2, 2, 3)
    stiff = np.sqrt((np.asarray(spring) + 12 * 0.05) / 1e-4)
    assert_allclose(np.abs(locus[:, 1]), [stiff, stiff], rtol=1e-12)
    drawn = found.plot_bode(jnp.geomspace(1.0, 1e3, 60), "Rate gyros")
    drawn.savefig(tmp_path / "bode.png", dpi=40)
    curves = drawn.axes[0].lines
    assert [c.get_label() for c in curves] == [f"angle / input_rate, run {k}" for k in range(3)]
    one = linear(GYRO, rest(GYRO), **named)
    # Of positive feedback: the spring gives way at -4.
    picture = one.plot_root_locus(jnp.linspace(0.0, -8.0, 40))
    picture.savefig(tmp_path / "locus.png", dpi=40)
    roots = np.asarray(picture.axes[0].collections[0].get_offsets())
    assert roots.shape == (80, 2) and roots[:, 0].max() > 0.0


def test_spins_about_principal_axes_by_local_coordinates():
    """Thomson 5.12: about the middle axis a change grows at w0 sqrt((A - B)(B - C) / (A C))."""
    body = TorqueFreeBody([3.0, 2.0, 1.0])
    y = BodyState(attitude=Quaternion.identity(), omega=jnp.array([0.0, 0.1, 0.0]))
    found = eqx.filter_jit(modes)(body, y)
    assert found.matrix.shape == (6, 6)
    assert_allclose(found.growth, 0.1 * np.sqrt(1.0 / 3.0), rtol=1e-12)
    assert found.states[:3] == ("attitude[0]", "attitude[1]", "attitude[2]")


def test_equilibrium_of_a_bead_on_a_hoop():
    """The bifurcation: below W^2 = g / r the bottom is stable, above it a tilted place."""

    @jax.jit
    def angle(rate):
        hoop = RotatingHoop(1.0, 0.5, rate, 9.8)
        y = equilibrium(hoop, hoop.state(0.9))
        return y.coordinates[0], hoop.rest_angle, modes(hoop, y).frequencies[0]

    found, exact, w = angle(6.0)
    assert_allclose(found, exact, rtol=1e-13)
    # w^2 = W^2 sin^2(theta) about the tilted place.
    assert_allclose(w, 6.0 * np.sin(exact), rtol=1e-12)
    slopes = jax.jit(jax.jacfwd(lambda rate: angle(rate)[:2]))(6.0)
    assert_allclose(slopes[0], slopes[1], rtol=1e-11)
    assert RotatingHoop(1.0, 0.5, 3.0, 9.8).rest_angle == 0.0
    # At rest it stays at the bottom, and so it does for small rates.
    at_rest = jax.value_and_grad(lambda rate: RotatingHoop(1.0, 0.5, rate, 9.8).rest_angle)
    assert at_rest(0.0) == (0.0, 0.0)


def test_wrong_names_are_refused_in_a_sentence():
    with pytest.raises(InputError, match="inputs names 'torqe'"):
        modes(AXIS, AXIS.at_rest, inputs=("torqe",))
    with pytest.raises(InputError, match="outputs names 'angel'"):
        modes(AXIS, AXIS.at_rest, outputs=("angel",))
