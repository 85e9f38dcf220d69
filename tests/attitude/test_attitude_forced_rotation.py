"""The torque of a prescribed rotation against the change of the angular momentum, and bearings that
hold a body on its shaft against the forces on its particles."""

import jax
import jax.numpy as jnp
import numpy as np
from numpy.testing import assert_allclose

from jaxspace.attitude.forced_rotation import bank_angle, bearing_reactions, required_torque
from jaxspace.bodies import PrincipalInertia
from jaxspace.bodies.inertia import as_inertia
from jaxspace.bodies.solids import particles
from jaxspace.rotations import from_euler_angles
from jaxspace.rotations.euler_angles import omega_from_euler_rates


def motion(t):
    """Euler's angles 3-1-3 of some motion."""
    return jnp.stack([0.3 + 0.5 * t * t, 0.9 - 0.3 * t, 1.3 + 7.0 * t - 0.2 * t**3])


@jax.jit
def both_torques(t):
    one = jnp.ones_like(t)
    tensor = as_inertia(jnp.array([[4.0, -0.5, 0.3], [-0.5, 5.0, -0.2], [0.3, -0.2, 6.0]]))

    def omega(t):
        return omega_from_euler_rates(*jax.jvp(motion, (t,), (one,)))

    def h(t):
        return from_euler_angles(motion(t)).rotate(tensor.times(omega(t)))

    w, w_rate = jax.jvp(omega, (t,), (one,))
    torque = from_euler_angles(motion(t)).rotate(required_torque(tensor, w, w_rate))
    return torque, jax.jvp(h, (t,), (one,))[1]


def test_torque_is_the_rate_of_the_momentum():
    torque, rate = both_torques(jnp.array(0.7))
    assert_allclose(torque, rate, rtol=1e-13)


@jax.jit
def in_both_axes(t):
    """The torque on a body of revolution in node axes, from body axes and from node axes."""
    one = jnp.ones_like(t)
    body = PrincipalInertia(jnp.array([2.0, 2.0, 0.8]))
    still = jnp.array([1.0, 1.0, 0.0])

    def spun(t):
        return omega_from_euler_rates(*jax.jvp(motion, (t,), (one,)))

    def node(t):
        angles, rates = jax.jvp(motion, (t,), (one,))
        return tuple(omega_from_euler_rates(angles * still, r) for r in (rates, rates * still))

    w, w_rate = jax.jvp(spun, (t,), (one,))
    turned = from_euler_angles(motion(t) * jnp.array([0.0, 0.0, 1.0]))
    (n, axes_rate), (n_rate, _) = jax.jvp(node, (t,), (one,))
    from_node = required_torque(body, n, n_rate, axes_rate)
    return turned.rotate(required_torque(body, w, w_rate)), from_node


def test_node_axes():
    from_body, from_node = in_both_axes(jnp.array(0.7))
    assert_allclose(from_node, from_body, rtol=1e-13)


def held(masses, places, shaft, stations, rate, acceleration):
    body = particles(masses, places)
    return bearing_reactions(
        body.inertia, body.mass, body.centre, shaft, stations, rate, acceleration
    )


def test_bearings_balance_the_particles():
    """Force and moment of the bearings are those that the accelerations of all particles take."""
    rng = np.random.default_rng(12)
    masses, places = rng.uniform(0.5, 1.5, 6), rng.normal(size=(3, 6))
    shaft, stations = np.array([1.0, -2.0, 2.0]), (-0.7, 1.9)
    rate, acceleration = np.array([3.0, -5.0]), np.array([0.0, 4.0])
    s = shaft / 3.0
    found = jax.jit(held)(
        *(jnp.asarray(x) for x in (masses, places, shaft)), stations, rate, acceleration
    )
    assert found.first.shape == (3, 2) and found.drive.shape == (2,)
    for i in range(2):
        w, a = rate[i] * s, acceleration[i] * s
        forces = masses * (np.cross(a, places.T) + np.cross(w, np.cross(w, places.T))).T
        first, second = np.asarray(found.first[:, i]), np.asarray(found.second[:, i])
        assert_allclose(first + second, forces.sum(axis=1), rtol=1e-12)
        moment = np.cross(stations[0] * s, first) + np.cross(stations[1] * s, second)
        total = np.cross(places.T, forces.T).sum(axis=0)
        # Sums of terms of a hundred newton metres.
        assert_allclose(moment + found.drive[i] * s, total, atol=1e-11)
        assert_allclose([first @ s, second @ s], 0.0, atol=1e-12)


def test_slopes_of_the_bank():
    """Straight flight needs none; there is a slope by the speed, of zero, too."""
    assert bank_angle(0.0, 100.0, 9.8) == 0.0
    slope = jax.jacrev(lambda v: bank_angle(v, 100.0, 9.8))
    assert_allclose([slope(0.0), slope(30.0)], [0.0, 60.0 * 980.0 / (900.0**2 + 980.0**2)])


def test_a_body_in_steady_turn_takes_no_torque_to_drive():
    inertia, shaft = PrincipalInertia([3.0, 2.0, 1.0]), np.array([0.1, 0.2, 1.0])
    centre, mass = np.array([0.01, -0.02, 0.1]), 4.0

    def drive(acceleration):
        given = inertia, mass, jnp.asarray(centre), jnp.asarray(shaft), (-0.5, 0.7)
        return bearing_reactions(*given, 5.0, acceleration).drive

    # The gyroscopic part is across the shaft: exactly, so that a small acceleration is seen.
    s = shaft / np.linalg.norm(shaft)
    about = np.sum([3.0, 2.0, 1.0] * s**2) + mass * np.sum(np.cross(s, centre) ** 2)
    assert drive(0.0) == 0.0
    assert_allclose(drive(1e-17), 1e-17 * about, rtol=1e-15)
    assert_allclose(jax.grad(drive)(1e-17), about, rtol=1e-15)
