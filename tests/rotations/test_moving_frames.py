"""Moving frames against derivatives of the inertial path, frames of the turning earth, plane
motion, impact."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace.mechanics.impact import (
    contact_impulse,
    contact_inverse_mass,
    crushable_pad,
    impact_energy_loss,
)
from jaxspace.mechanics.moving_point import moment_about_moving_point, momentum_about
from jaxspace.orbits.point_gravity import point_gravity
from jaxspace.orbits.rotating_earth import (
    local_frame,
    navigation_rates,
    planet_frame,
    plumb_line_deviation,
)
from jaxspace.rotations import MovingFrame, Quaternion, from_euler_angles
from jaxspace.rotations.euler_angles import omega_from_euler_rates
from jaxspace.rotations.moving_frame import instantaneous_centre, path_components, polar_components

ONE = jnp.ones(())


def rates(path, t=0.0):
    """First and second derivative of a path."""

    def first(t):
        return jax.jvp(path, (t,), (ONE,))[1]

    return jax.jvp(first, (jnp.asarray(t),), (ONE,))


def _general(t):
    """Rates relative to inertial space of the point of T2.5-gen, by the frame."""

    def angles(t):
        return jnp.stack([0.3 + 0.5 * t, 0.8 + 0.2 * t**2, -0.4 + 1.1 * t])

    def omega(t):
        return omega_from_euler_rates(angles(t), jax.jvp(angles, (t,), (ONE,))[1])

    def point(t):
        return jnp.stack([1.0 + t, 2.0 - t**2, 0.5 * t**3])

    def origin(t):
        return jnp.stack([t**2, 3.0 * t, jnp.sin(t)])

    w, w_rate = jax.jvp(omega, (t,), (ONE,))
    frame = MovingFrame(from_euler_angles(angles(t)), w, w_rate, origin(t), *rates(origin, t))
    relative = (point(t), *rates(point, t))
    inertial = frame.to_inertial(*relative)
    return w, inertial, relative, frame.from_inertial(*inertial)


def test_general_motion():  # T2.5-gen
    omega, (_, v, a), relative, again = jax.jit(_general)(jnp.asarray(0.6))
    np.testing.assert_allclose(
        omega, [0.33034622299119853, 0.308242994773583, 1.4216483003661953], rtol=1e-13
    )
    np.testing.assert_allclose(
        v, [-0.04492408651936601, 2.1247626219461417, 1.7171558714011494], rtol=1e-13
    )
    np.testing.assert_allclose(
        a, [5.780077465255265, -2.975651014176255, -0.29500518064679554], rtol=1e-13
    )
    for x, y in zip(relative, again, strict=True):
        np.testing.assert_allclose(x, y, rtol=1e-13, atol=1e-14)


def test_many_points_in_one_frame():
    rng = np.random.default_rng(3)
    r, v, a = jnp.asarray(rng.normal(size=(3, 3, 5)))
    vectors = jnp.asarray(rng.normal(size=(5, 3)))
    frame = MovingFrame(Quaternion.from_rotation_vector(jnp.array([0.2, -0.5, 0.9])), *vectors)
    many = frame.to_inertial(r, v, a)
    for i in range(5):
        one = frame.to_inertial(r[:, i], v[:, i], a[:, i])
        np.testing.assert_allclose([x[:, i] for x in many], one, rtol=1e-14, atol=1e-15)
    for x, y in zip(frame.from_inertial(*many), (r, v, a), strict=True):
        np.testing.assert_allclose(x, y, rtol=1e-12, atol=1e-13)


def test_a_place_on_the_turning_earth():
    rate, radius, latitude = 0.7, 2.0, 0.4

    def place(t):
        east = 0.3 + rate * t
        c = jnp.cos(latitude)
        return radius * jnp.stack(
            [c * jnp.cos(east), c * jnp.sin(east), jnp.sin(latitude) + 0.0 * t]
        )

    frame = local_frame(latitude, 0.3, radius, rate)
    velocity, acceleration = rates(place)
    np.testing.assert_allclose(frame.position, place(0.0), rtol=1e-14)
    np.testing.assert_allclose(frame.velocity, velocity, rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(frame.acceleration, acceleration, rtol=1e-13, atol=1e-15)
    spin = rate * np.array([-np.cos(latitude), 0.0, np.sin(latitude)])
    np.testing.assert_allclose(frame.omega, spin, atol=1e-15)
    up = frame.attitude.rotate(jnp.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(up, place(0.0) / radius, rtol=1e-14)
    east = frame.attitude.rotate(jnp.array([0.0, 1.0, 0.0]))
    np.testing.assert_allclose(east, velocity / jnp.linalg.norm(velocity), atol=1e-15)
    # The place is at rest in the axes of the planet.
    _, still, slow = planet_frame(0.3, rate).from_inertial(
        frame.position, frame.velocity, frame.acceleration
    )
    np.testing.assert_allclose(still, 0.0, atol=1e-15)
    np.testing.assert_allclose(slow, 0.0, atol=1e-15)


def test_rates_of_the_navigation_frame():
    def latitude(t):
        return 0.7 + 0.2 * t + 0.05 * t**2

    def rates_at(t):
        return navigation_rates(latitude(t), 0.2 + 0.1 * t, 0.3 - 0.06 * t, 0.07, 0.1, -0.06)

    (_, omega_rate), ((change, _)) = (
        rates_at(jnp.asarray(0.0)),
        jax.jvp(rates_at, (jnp.asarray(0.0),), (ONE,))[1],
    )
    np.testing.assert_allclose(omega_rate, change, rtol=1e-14)


def test_plumb_line():
    mu, radius, rate = 3.986e14, 6.371e6, 7.29e-5
    k = rate**2 * radius**3 / mu
    best = 0.5 * np.arccos(k / (2.0 - k))
    latitudes = jnp.array([0.0, 0.4, best, -0.4, 0.5 * np.pi])
    found = plumb_line_deviation(latitudes, mu, radius, rate)
    r = radius * jnp.stack([jnp.cos(latitudes), 0.0 * latitudes, jnp.sin(latitudes)])
    pull = point_gravity(r, mu) + rate**2 * r * jnp.array([1.0, 1.0, 0.0])[:, None]
    across = -jnp.sin(latitudes) * pull[0] + jnp.cos(latitudes) * pull[2]
    np.testing.assert_allclose(
        jnp.sin(found), -across / jnp.linalg.norm(pull, axis=0), rtol=1e-12, atol=1e-16
    )
    slope = jax.grad(lambda x: plumb_line_deviation(x, mu, radius, rate))(best)
    assert abs(float(slope)) < 1e-15


def test_components():
    """A logarithmic spiral r = e^(0.3 theta), theta = 0.2 t^2: the angle to the radius is fixed."""
    b = 0.3

    def angle(t):
        return 0.2 * t**2

    def radius(t):
        return jnp.exp(b * angle(t))

    def place(t):
        x = angle(t)
        return radius(t) * jnp.stack([jnp.cos(x), jnp.sin(x), 0.0 * t])

    t = jnp.asarray(1.7)
    v, a = polar_components(radius(t), *rates(radius, t), *rates(angle, t))
    velocity, acceleration = rates(place, t)
    back = Quaternion.about(2, angle(t)).rotate_back
    np.testing.assert_allclose(v, back(velocity)[:2], rtol=1e-13)
    np.testing.assert_allclose(a, back(acceleration)[:2], rtol=1e-13)
    along, across, curvature = path_components(velocity, acceleration)
    expected = 1.0 / (float(radius(t)) * np.sqrt(1.0 + b * b))
    assert float(curvature) == pytest.approx(expected, rel=1e-13)
    assert float(across) == pytest.approx(float(curvature * (v[0] ** 2 + v[1] ** 2)), rel=1e-13)
    speed, growth = jax.jvp(
        lambda t: jnp.linalg.norm(jax.jvp(place, (t,), (ONE,))[1]), (t,), (ONE,)
    )
    assert float(along) == pytest.approx(float(growth), rel=1e-13)
    straight = path_components(velocity, 2.0 * velocity)
    assert float(straight[0]) == pytest.approx(2.0 * float(speed), rel=1e-13)
    assert abs(float(straight[2])) < 1e-15


def test_instantaneous_centre():
    """A wheel that slips: v_0 / w_0 from its centre, whichever point is known."""
    omega = jnp.array([0.0, 0.0, -4.0])
    velocity = jnp.array([3.0, 0.0, 0.0])
    for x in ([0.0, 0.0, 0.0], [0.5, -0.3, 0.0]):
        x = jnp.array(x)
        found = instantaneous_centre(x, velocity + jnp.cross(omega, x), omega)
        np.testing.assert_allclose(found, [0.0, -0.75, 0.0], atol=1e-15)
    assert np.all(np.isnan(instantaneous_centre(x, velocity, 0.0 * omega)))


def test_impact_of_a_turning_body():
    """The balance of energy, and the contact's speed after the impact, of any body on a wall."""
    rng = np.random.default_rng(4)
    mass, inertia = 2.3, jnp.array([[3.0, 0.1, -0.2], [0.1, 2.0, 0.15], [-0.2, 0.15, 1.5]])
    arm, v, omega = jnp.asarray(rng.normal(size=(3, 3)))
    normal = jnp.array([0.6, 0.0, 0.8])

    def approach(v, omega):
        return -normal @ (v + jnp.cross(omega, arm))

    def energy(v, omega):
        return 0.5 * mass * v @ v + 0.5 * omega @ inertia @ omega

    v = v - (1.0 + normal @ (v + jnp.cross(omega, arm))) * normal  # approaches at 1 m/s
    inverse = contact_inverse_mass(mass, inertia, arm, normal)
    impulse = contact_impulse(approach(v, omega), inverse, 0.4) * normal
    after = v + impulse / mass, omega + jnp.linalg.solve(inertia, jnp.cross(arm, impulse))
    assert float(approach(*after)) == pytest.approx(-0.4, rel=1e-13)
    lost = impact_energy_loss(approach(v, omega), inverse, 0.4)
    assert float(energy(v, omega) - energy(*after)) == pytest.approx(float(lost), rel=1e-12)
    assert float(contact_impulse(-1.0, inverse, 0.4)) == 0.0
    assert float(contact_inverse_mass(mass, inertia, 3.0 * normal, normal)) == pytest.approx(
        1.0 / mass, rel=1e-14
    )


def test_pad_takes_the_energy_of_the_fall():
    area, depth, duration = crushable_pad(900.0, 6.0, 10.0, 3e5, 9.8)
    assert float(area * 3e5 * depth) == pytest.approx(900.0 * (6.0 + depth), rel=1e-14)
    assert float(duration) == pytest.approx(2.0 * depth / np.sqrt(2.0 * 9.8 * 6.0), rel=1e-14)


def test_moment_about_a_moving_point():  # Thomson 4.4-3 to -5
    """About the pivot of a pendulum that is shaken, about the centre of mass and about a point that
    accelerates towards it: always the moment of the forces that move the particles."""
    masses = jnp.array([2.0, 3.0, 0.5])

    def places(t):
        c, s = jnp.cos(1.3 * t), jnp.sin(0.7 * t)
        return jnp.stack([
            jnp.stack([c, t * t, s]), jnp.stack([s * c, 0.3 * t, 1.0 + c]),
            jnp.stack([t**3, 2.0 - s, c]),
        ])  # fmt: skip

    def centre(t):
        return places(t) @ masses / jnp.sum(masses)

    def to_centre(t):
        # At t = 0.4 its acceleration is along the arm to the centre of mass.
        return 1.7 * (t - 0.4) ** 2 * (centre(jnp.asarray(0.4)) - 1.0)

    points = (
        lambda t: jnp.stack([jnp.sin(2.0 * t), t, 0.1 * t**3]),
        lambda t: jnp.stack([3.0 * t, 1.0 - t, 2.0 + 0.0 * t]),
        centre,
        to_centre,
    )

    @jax.jit
    def found_at(t):
        forces = masses * rates(places, t)[1]
        return [about(point, t, forces) for point in points]

    def about(point, t, forces):
        def momentum(t):
            v, w = rates(places, t)[0], rates(point, t)[0]
            return momentum_about(masses, places(t), v, point(t), w)

        _, turning = jax.jvp(momentum, (t,), (jnp.ones(()),))
        arm = centre(t) - point(t)
        found = moment_about_moving_point(turning, jnp.sum(masses), arm, rates(point, t)[1])
        truth = jnp.sum(jnp.cross(places(t) - point(t)[:, None], forces, axis=0), axis=1)
        return turning, found, truth

    rows = found_at(jnp.asarray(0.4))
    for (turning, found, truth), free in zip(rows, (False, True, True, None), strict=True):
        np.testing.assert_allclose(found, truth, atol=1e-12)
        if free is not None:
            assert free == bool(np.allclose(turning, truth, atol=1e-12))
