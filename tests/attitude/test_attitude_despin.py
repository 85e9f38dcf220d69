"""The yo-yo of Thomson 7.5 against the book's numbers, the Lagrange equations, and its place as a
jump of the state."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree
from numpy.testing import assert_allclose
from reference_run import check_derivatives
from scipy.integrate import solve_ivp

from jaxspace.attitude import YoYo
from jaxspace.attitude.despin import zero_spin_cord_length
from jaxspace.bodies import BodyState
from jaxspace.core import InputError
from jaxspace.rotations import Quaternion

G = 386.4  # in/s^2
I, R, M = 92.0 / G, 5.0, 0.025 / G  # lbf s^2 in, in, lbf s^2/in
W0, W_F = 41.8879020478639, 0.5759586531581287  # rad/s: 400 and 5.5 rpm


def pioneer(length=60.03744207821231):
    return YoYo(axial_inertia=I, radius=R, mass=M, cord_length=length)


def lagrange(t, y, I, R, m):  # noqa: E741
    """Thomson 7.5 in w and phi: T = I w^2/2 + m R^2 [w^2 + phi^2 (w + phi')^2]/2, written out for
    w' and phi''."""
    w, phi, phi_rate = y
    # d/dt of phi^2 (w + phi') = phi (w + phi')^2, and of (I + m R^2) w + m R^2 phi^2 (w + phi') = 0
    sum_rate = (phi * (w + phi_rate) ** 2 - 2.0 * phi * phi_rate * (w + phi_rate)) / phi**2
    w_rate = -m * R * R * phi * (w + phi_rate) ** 2 / (I + m * R * R)
    return [w_rate, phi_rate, sum_rate - w_rate]


def test_unwinding_obeys_the_lagrange_equations():  # T7.5-dyn
    yoyo = pioneer()
    assert_allclose(yoyo.spin_rate(0.5, W0), 41.74681783753093, rtol=1e-12)
    start = [41.74681783753093, 0.5, 41.88790204786391]
    end = solve_ivp(
        lagrange,
        (0.01193662073189215, 0.28665767032022527),
        start,
        "DOP853",
        args=(I, R, M),
        rtol=1e-13,
        atol=1e-13,
    ).y[:, -1]
    assert_allclose(end[1:], [12.007488415642463, 41.88790204786391], rtol=1e-9)
    assert_allclose(end[0], 0.5759586531581286, rtol=1e-8)
    y = yoyo(0.0, BodyState(omega=jnp.array([0.0, 0.0, W0])))
    assert_allclose(y.omega[2], 0.5759586531581286, rtol=1e-8)
    phi = jnp.sqrt(yoyo.inertia_ratio / 3.0)
    assert_allclose(phi, 7.0285133563222315, rtol=1e-12)
    assert_allclose(yoyo.tension(phi, W0), 8.915705462974516, rtol=1e-11)
    assert_allclose(jax.grad(yoyo.tension)(phi, W0), 0.0, atol=1e-13)


def test_unwinding_keeps_energy_and_momentum():
    yoyo, phi = pioneer(), jnp.linspace(0.0, 12.0, 7)
    w = yoyo.spin_rate(phi, W0)
    assert_allclose(
        I * w**2 + M * yoyo.mass_speed(phi, W0) ** 2, (I + M * R * R) * W0**2, rtol=1e-13
    )
    assert_allclose(I * w + M * R * R * (w + phi**2 * (w + W0)), (I + M * R * R) * W0, rtol=1e-13)


@pytest.mark.parametrize("rate", [3.0, -70.0, 0.0])
def test_zero_spin_cord_stops_any_spin(rate):
    yoyo = pioneer(zero_spin_cord_length(I, R, M))
    assert_allclose(
        yoyo(0.0, BodyState(omega=jnp.array([0.1, 0.2, rate]))).omega, [0.1, 0.2, 0.0], atol=1e-13
    )


def test_the_jump_touches_spin_and_mass_only():
    y = BodyState(
        position=jnp.ones(3),
        velocity=2.0 * jnp.ones(3),
        attitude=Quaternion.identity(),
        omega=jnp.array([0.3, -0.2, W0]),
        mass=jnp.asarray(1.0),
        parts={"slosh": jnp.ones(2)},
    )
    after = pioneer()(0.0, y)
    assert_allclose(
        after.omega, [0.3, -0.2, W_F], rtol=1e-10
    )  # the small difference of 42 rad/s loses two digits
    assert_allclose(after.mass, 1.0 - M, rtol=1e-15)
    for name in ("position", "velocity", "attitude", "parts"):
        assert_allclose(
            ravel_pytree(getattr(after, name))[0], ravel_pytree(getattr(y, name))[0], rtol=0.0
        )
    assert pioneer()(0.0, BodyState(omega=y.omega)).present == ("omega",)


def test_derivatives():
    def after(v):
        return YoYo(v[0], v[1], v[2], v[3])(0.0, BodyState(omega=v[4:7], mass=v[7])).omega

    for rate in (1.5, 0.0):
        check_derivatives(after, [2.0, 0.5, 0.3, 1.4, 0.1, 0.2, rate, 5.0])
    # dw/dl = -4 w0 C phi / ((C + phi^2)^2 R)
    C, phi = 148.2, 60.0 / R
    slope = jax.grad(
        lambda length: pioneer(length)(0.0, BodyState(omega=jnp.array([0.0, 0.0, W0]))).omega[2]
    )(60.0)
    assert_allclose(slope, -4.0 * W0 * C * phi / ((C + phi**2) ** 2 * R), rtol=1e-12)


def test_single_precision_stays():
    y = BodyState(omega=jnp.ones(3, jnp.float32), mass=jnp.ones((), jnp.float32))
    assert {x.dtype for x in jax.tree.leaves(pioneer()(0.0, y))} == {jnp.dtype("float32")}


def test_a_batch_is_a_loop():
    omega, lengths = (
        jnp.asarray(np.random.default_rng(2).normal(size=(3, 4))),
        jnp.array([10.0, 30.0, 60.0, 61.0]),
    )
    batch = pioneer(lengths)(0.0, BodyState(omega=omega, mass=jnp.ones(4)))
    for i in range(4):
        one = pioneer(lengths[i])(0.0, BodyState(omega=omega[:, i], mass=jnp.asarray(1.0)))
        assert_allclose(batch.omega[:, i], one.omega, rtol=1e-14, atol=1e-15)


def test_bad_input_is_named():
    with pytest.raises(InputError, match=r"YoYo\.radius is -1"):
        YoYo(1.0, -1.0, 1.0, 1.0)
    with pytest.raises(InputError, match="must have omega"):
        pioneer()(0.0, BodyState(mass=jnp.asarray(1.0)))
