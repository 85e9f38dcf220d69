"""Roots by iteration: their second derivatives, which one step of Newton's alone does not carry,
against differences of the gradient."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace.attitude import AttitudeDrift
from jaxspace.attitude.top_relatives import best_crusher_tilt, gyro_on_a_string
from jaxspace.gyros.duffing import DuffingOscillator
from jaxspace.mechanics import GeneralisedState, RotatingHoop, SimplePendulum
from jaxspace.mechanics.discrete import variational_motion
from jaxspace.mechanics.variational import brachistochrone, hanging_chain
from jaxspace.studies import equilibrium


def swing(length, angle):
    """A pendulum after two discrete steps."""
    pendulum = SimplePendulum(length, 9.8)
    return variational_motion(
        pendulum, pendulum.state(angle, 0.3), jnp.array([0.0, 0.2]), steps=2
    ).coordinates[0, -1]


def rest_on_a_hoop(radius, rate):
    """The angle at which a bead rests beside the lowest point."""
    hoop = RotatingHoop(1.0, radius, rate, 9.8)
    start = GeneralisedState(jnp.array([1.2]), jnp.zeros(1))
    return equilibrium(hoop, start).coordinates[0]


ROOTS = {
    "drift of an axis": (lambda k, x: AttitudeDrift(k, 1.2, 0.05).angle_after(1.3, x), 0.5, 0.3),
    "harmonic balance": (
        lambda k, f: DuffingOscillator(1.0, k, 0.1, f, 1.0, 0.0).harmonic_balance(),
        *(4.0, 1.0),
    ),
    "hanging chain": (lambda d, h: hanging_chain(d, h)[1], 1.0, 1.3),
    "brachistochrone": (lambda d, h: brachistochrone(d, h, 9.8)[2], 2.0, 1.0),
    "tilt of a crusher": (lambda p, w: best_crusher_tilt(p, w, 0.4, 0.5, 3.0, 4.0), 4.0, 50.0),
    "gyro on a string": (
        lambda t, r: gyro_on_a_string(t, r, 1.0, 0.1, 0.02, 0.5, 0.3, 9.8)[0],
        *(1.2, 3.0),
    ),
    "discrete motion": (swing, 1.1, 0.7),
    "equilibrium": (rest_on_a_hoop, 0.5, 6.0),
}


@pytest.mark.parametrize("name", ROOTS)
def test_second_derivatives(name):
    function, *x = ROOTS[name]

    def gradient(x):
        return jax.grad(lambda x: function(*x))(x)

    # One program for the gradient and its derivatives, which traces the gradient once.
    both = jax.jit(jax.jacfwd(lambda x: 2 * (gradient(x),), has_aux=True))
    x, h = jnp.array(x), 1e-4
    found, _ = both(x)
    shifts = h * jnp.eye(2)
    # Central differences: truncation 1e-8, rounding 1e-12.
    columns = [(both(x + s)[1] - both(x - s)[1]) / (2.0 * h) for s in shifts]
    size = float(jnp.max(jnp.abs(found)))
    assert size > 1e-3
    np.testing.assert_allclose(found, jnp.stack(columns, axis=1), rtol=0.0, atol=1e-6 * size)
