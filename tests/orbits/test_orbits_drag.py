"""Drag: closed forms of motion in air of one density, decay of a circle, and what is singular."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jaxspace import Scene, load, simulate
from jaxspace.bodies import BodyState, ExponentialAtmosphere, RigidBody, StandardAtmosphere
from jaxspace.bodies.atmosphere import exponential_density
from jaxspace.bodies.standard_atmosphere import standard_atmosphere
from jaxspace.core import InputError
from jaxspace.orbits import Drag, PointGravity
from jaxspace.orbits.drag import circular_decay_rate, drag_acceleration
from jaxspace.orbits.elements import angular_momentum, semi_major_axis, specific_energy

MU, RADIUS = 3.986004418e14, 6378137.0
AIR = Drag(
    50.0, ExponentialAtmosphere(3.725e-12, 4.0e5, 5.8515e4), RADIUS
)  # Vallado, table 8-4, at 400 km


def test_the_density_of_the_table():
    """Vallado's table 8-4: 3.725e-12 kg/m^3 at 400 km, and 1.585e-12 at 450 km, where the next row
    begins; the scale height is rounded to five digits there."""
    density = exponential_density(4.5e5, 3.725e-12, 4.0e5, 5.8515e4)
    assert float(density) == pytest.approx(1.585e-12, rel=1e-3)


@pytest.mark.parametrize("t", [1.0, 30.0, 1000.0])
def test_a_straight_way_in_air_of_one_density(t):
    """v' = -k v^2 has v = v0 / (1 + k v0 t) and x = ln(1 + k v0 t) / k, k = rho / (2 B)."""
    drag = Drag(20.0, ExponentialAtmosphere(0.01, 0.0, 1e18), RADIUS)
    k, v0 = 0.01 / 40.0, 300.0
    y0 = BodyState(jnp.array([7.0e6, 1.0, -2.0]), v0 * jnp.array([0.6, 0.0, 0.8]))
    run = simulate(Scene([drag]), y0, jnp.array([0.0, t]), accuracy=1e-11)
    way = np.log1p(k * v0 * t) / k
    direction = np.array([0.6, 0.0, 0.8])
    # Some tens of steps, each within 1e-11; the position is known to 1e-9 m.
    np.testing.assert_allclose(
        run.final.velocity, v0 / (1.0 + k * v0 * t) * direction, rtol=0, atol=1e-7
    )
    np.testing.assert_allclose(
        run.final.position - y0.position, way * direction, rtol=1e-8, atol=1e-6
    )


def test_a_circle_decays_at_its_rate():
    """One revolution at 400 km: the fall of the semi-major axis is 2 pi a^2 rho / B (King-Hele
    4.2), to first order in the fall over the scale height, 1e-3."""
    a = RADIUS + 4.0e5
    speed = np.sqrt(MU / a)
    period = 2.0 * np.pi * a / speed
    y0 = BodyState(jnp.array([a, 0.0, 0.0]), jnp.array([0.0, speed, 0.0]))
    run = simulate(Scene([PointGravity(MU), AIR]), y0, jnp.array([0.0, period]), accuracy=1e-13)
    fall = semi_major_axis(run.final.position, run.final.velocity, MU) - a
    expected = -2.0 * np.pi * a * a * 3.725e-12 / 50.0
    assert float(fall) == pytest.approx(expected, rel=3e-3)
    rate = circular_decay_rate(a, 3.725e-12, 50.0, MU)
    assert float(rate) * period == pytest.approx(expected, rel=1e-12)


def test_the_load_takes_energy_and_turns_with_the_air():
    """The rate of the energy is a . v; air that turns with the body does not brake it."""
    omega = 7.292115e-5
    r = jnp.array([6.6e6, 3.0e5, -2.0e5])
    turning = Drag(50.0, ExponentialAtmosphere(1e-10, 2.0e5, 4.0e4), RADIUS, omega)
    along = omega * jnp.array([-r[1], r[0], 0.0])
    still = turning.load(0.0, BodyState(r, along), RigidBody())
    np.testing.assert_array_equal(still.acceleration_N, np.zeros(3))
    v = jnp.array([-300.0, 6900.0, 3600.0])
    load = turning.load(0.0, BodyState(r, v), RigidBody()).acceleration_N
    _, slope = jax.jvp(lambda v: specific_energy(r, v, MU), (v,), (load,))
    relative = v - along
    height = np.linalg.norm(r) - RADIUS
    rho = 1e-10 * np.exp((2.0e5 - height) / 4.0e4)
    power = -0.5 * rho / 50.0 * np.linalg.norm(relative) * np.dot(relative, v)
    assert float(slope) == pytest.approx(power, rel=1e-12)


def test_an_orbit_agrees_with_another_integration():
    """Scipy's DOP853 on the equations written once more. A few hundred steps at 1e-11 of 7e6 m."""
    y0 = np.array([6.6e6, 4.0e5, -3.0e5, -300.0, 6900.0, 3600.0])
    omega = 7.292115e-5
    drag = Drag(50.0, ExponentialAtmosphere(1e-9, 2.0e5, 4.0e4), RADIUS, omega)

    def rate(t, y):
        r, v = y[:3], y[3:]
        length = np.linalg.norm(r)
        relative = v - np.cross([0.0, 0.0, omega], r)
        rho = 1e-9 * np.exp((2.0e5 - (length - RADIUS)) / 4.0e4)
        a = -MU * r / length**3 - 0.5 * rho / 50.0 * np.linalg.norm(relative) * relative
        return np.concatenate([v, a])

    other = solve_ivp(rate, (0.0, 5000.0), y0, method="DOP853", rtol=1e-12, atol=1e-8).y[:, -1]
    run = simulate(
        Scene([PointGravity(MU), drag]),
        BodyState(jnp.array(y0[:3]), jnp.array(y0[3:])),
        jnp.array([0.0, 5000.0]),
        accuracy=1e-12,
    )
    np.testing.assert_allclose(run.final.position, other[:3], atol=1e-2)
    assert float(jnp.linalg.norm(angular_momentum(run.final.position, run.final.velocity))) < float(
        np.linalg.norm(np.cross(y0[:3], y0[3:]))
    )


def test_derivatives_at_rest_are_zero():
    """|v| v is differentiable at rest, with the derivative zero; in both modes."""
    for derivative in (jax.jacfwd, jax.jacrev):
        slope = derivative(lambda v: drag_acceleration(v, 1.0, 50.0))(jnp.zeros(3))
        np.testing.assert_array_equal(slope, np.zeros((3, 3)))


def test_the_derivative_in_the_coefficient_agrees_with_differences():
    """Forward and reverse mode of the end of half an orbit, against central differences of order
    four: truncation 1e-12 for a step of 1e-3, rounding 1e-9 m over 1e-1."""
    y0 = BodyState(jnp.array([6.6e6, 0.0, 0.0]), jnp.array([0.0, 7700.0, 0.0]))

    def end(coefficient):
        drag = Drag(coefficient, ExponentialAtmosphere(1e-9, 2.0e5, 4.0e4), RADIUS)
        scene = Scene([PointGravity(MU), drag])
        run = simulate(scene, y0, jnp.array([0.0, 2500.0]), accuracy=1e-12)
        return run.final.position[0]

    b, h = 50.0, 0.1
    expected = (8.0 * (end(b + h) - end(b - h)) - (end(b + 2 * h) - end(b - 2 * h))) / (12.0 * h)
    assert float(jax.grad(end)(b)) == pytest.approx(float(expected), rel=1e-6)


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: Drag(0.0, AIR.atmosphere, 1.0), "Drag.ballistic_coefficient is 0: it must be pos"),
        (
            lambda: ExponentialAtmosphere(-1.0, 0.0, 1.0),
            "ExponentialAtmosphere.density is -1: it must be zero or positive",
        ),
        (lambda: ExponentialAtmosphere(1.0, 0.0, 0.0), "ExponentialAtmosphere.scale_height is 0"),
        (lambda: ExponentialAtmosphere(1.0, np.nan, 1.0), "reference_height is nan"),
    ],
)
def test_bad_input_is_named(make, sentence):
    with pytest.raises(InputError, match=sentence):
        make()


def test_drag_in_a_file(tmp_path):
    """Its radius is that of the planet; its coefficient scatters."""
    path = tmp_path / "drag.toml"
    path.write_text(
        """
[planet]
mu = "398600.4418 km^3/s^2"
radius = "6378.137 km"
[effects.point_gravity]
[effects.drag]
ballistic_coefficient = "50 kg/m^2"
[effects.drag.atmosphere]
density = "3.725e-12 kg/m^3"
reference_height = "400 km"
scale_height = "58.515 km"
[initial.orbit]
periapsis_altitude = "400 km"
[times]
end = "90 min"
[dispersion]
outputs = ["semi_major_axis"]
[dispersion.inputs]
"effects.drag.ballistic_coefficient" = { deviation = "5 %" }
"""
    )
    file = load(path)
    drag = file.system.effects[1]
    assert float(drag.radius) == RADIUS
    scene, _ = file.build({"effects.drag.ballistic_coefficient": jnp.array([40.0, 60.0])})
    np.testing.assert_array_equal(
        scene.phases[0].system.effects[1].ballistic_coefficient, [40.0, 60.0]
    )


def test_the_standard_atmosphere_in_a_file(tmp_path):
    """By its name, with a factor that scatters; the drag is that of its density."""
    path = tmp_path / "drag.toml"
    path.write_text(
        """
[planet]
mu = "398600.4418 km^3/s^2"
radius = "6378.137 km"
[effects.point_gravity]
[effects.drag]
ballistic_coefficient = "50 kg/m^2"
atmosphere = { model = "us_1976", density_factor = 2.0 }
air_rate = 7.292115e-5
[initial.orbit]
periapsis_altitude = "200 km"
[times]
end = "90 min"
[dispersion]
outputs = ["semi_major_axis"]
[dispersion.inputs]
"effects.drag.atmosphere.density_factor" = { deviation = "10 %" }
"""
    )
    drag = load(path).system.effects[1]
    r = jnp.array([RADIUS + 2.0e5, 0.0, 0.0])
    expected = 2.0 * float(standard_atmosphere(2.0e5).density)
    assert isinstance(drag.atmosphere, StandardAtmosphere)
    assert float(drag.density_at(r)) == pytest.approx(expected, rel=1e-12)
    assert float(drag.scaled(0.5).density_at(r)) == pytest.approx(0.5 * expected, rel=1e-12)
