"""What a failed run reports: phase, quantity, value and limit; and starts that no run can have."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace import BodyState, Mission, Phase, Scene, simulate, simulate_batch, simulate_mission
from jaxspace.attitude import RollingDisk
from jaxspace.bodies import Load
from jaxspace.core import AbstractSystem, InputError
from jaxspace.core.limits import Limit
from jaxspace.gyros import TwoGimbalGyro
from jaxspace.gyros.gimbal_state import GimbalState
from jaxspace.orbits import ClassicalElements, PointGravity, TwoBody
from jaxspace.orbits.initial import orbit_from_radius
from jaxspace.orbits.station import Station
from jaxspace.rockets import SteeredThrust
from jaxspace.rockets.steering import UserSteering
from jaxspace.scene import Custom
from jaxspace.simulation import SimulationError, Status

MU_EARTH = 3.986e14


def up(t, y):
    return jnp.array([0.0, 0.0, 1.0])


def burn(duration, burnout_mass=None):
    """20 kg/s of a body without a dry mass."""
    return Scene(
        [SteeredThrust(UserSteering(up), 2000.0, 100.0, duration, burnout_mass=burnout_mass)]
    )


def start(mass):
    return BodyState([0, 0, 1], [0, 0, 1], mass=mass)


def test_a_burn_beyond_the_propellant_is_named_with_its_phase():
    at_45 = r"At t = 45 s the mass of the body is -\S+ kg: it must be above 0 kg"
    with pytest.raises(SimulationError, match=at_45):
        simulate(burn(50.0), start(900.0), [0, 60])
    mission = Mission([Phase(burn(5.0), 5.0, name="kick"), Phase(burn(50.0), 50.0, name="burn")])
    with pytest.raises(
        SimulationError,
        match=r"At t = 55 s the mass of the body is -100 kg: it must be .* The phase 'burn' starts",
    ):
        simulate_mission(mission, start(900.0))


def test_a_start_below_the_burnout_mass_is_refused():
    """In a system and in the first phase of a mission; a run of a batch is marked instead."""
    sentence = r"y0.mass is below .* SteeredThrust.burnout_mass\) is 900 kg: it must be at least"
    with pytest.raises(InputError, match=sentence):
        simulate(burn(5.0, 950.0), start(900.0), [0, 1])
    with pytest.raises(InputError, match=sentence):
        simulate_mission(Mission([Phase(burn(5.0, 950.0), 1.0)]), start(900.0))


def test_the_quantity_that_has_left_a_range_is_named():
    disk = RollingDisk.uniform(1.0, 1.0, 9.81)
    with pytest.raises(SimulationError, match=r"the height of the centre is -\S+ m: it must be at"):
        simulate(disk, disk.state([0, 1, 0], [0, 0, 0]), [0, 3])
    limit = Limit("the mass", "kg", np.array(99.9999999), 100.0)
    # With as many digits as the difference needs.
    assert limit.sentence() == "the mass is 99.9999999 kg: it must be at least 100 kg"
    assert Limit("x", "", jnp.array([1.0, 3.0, jnp.nan]), high=2.0).passed().tolist() == [
        *(False, True, False)
    ]


class Bounded(AbstractSystem):
    """A user's system that grows beyond its range."""

    def vector_field(self, t, y):
        return y

    def invariants(self, t, y):
        return {}

    def limits(self, t, y):
        return (Limit("the growth", "m", y, high=2.0),)


def test_a_users_system_declares_its_limits():
    with pytest.raises(SimulationError, match=r"the growth is \S+ m: it must be at most 2 m"):
        simulate(Bounded(), jnp.array(1.0), [0.0, 1.0])
    found = simulate_batch(Bounded(), jnp.array([1.0, 0.1]), jnp.array([0.0, 1.0]), throw=False)
    assert found.status.tolist() == [Status.OUTSIDE_MODEL, Status.COMPLETED]


def test_a_motion_through_the_centre_is_named():
    scene = Scene([PointGravity(1.0)])
    for system in (TwoBody(1.0), scene):
        with pytest.raises(SimulationError, match="straight line through the centre, and passes r"):
            simulate(system, BodyState([1, 0, 0], [0, 0, 0]), [0, 3])


def test_the_quantity_that_is_not_finite_is_named():
    gyro = TwoGimbalGyro(1.0, 2.0, 3.0)
    # Gimbal lock, without the check of `state`.
    lock = GimbalState(0.0, 0.0, 0.0, 6.0)
    with pytest.raises(SimulationError, match="the derivative of psi, theta_rate is not finite"):
        simulate(gyro, lock, [0.0, 1.0])
    load = Custom(lambda t, y, body: Load(acceleration_N=jnp.log(1.0 - t) * y.position))
    with pytest.raises(SimulationError, match="There velocity changes fastest"):
        simulate(Scene([load]), BodyState([1, 0, 0], [0, 1, 0]), [0, 3])


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (
            lambda: RollingDisk.uniform(1.0, 1.0, 9.81).state([0, 0, 0], [0, 0, 1]),
            "RollingDisk.state: theta, the second angle, is 0 rad, where the disk lies flat",
        ),
        (
            lambda: TwoGimbalGyro(1.0, 2.0, 3.0).state(0, 0, 0, 0),
            "TwoGimbalGyro.state: theta is 0 rad, gimbal lock: .* give inner_zeta or outer",
        ),
        (
            lambda: ClassicalElements(7e6, 0.1, 28.5, 0, 0, 0),
            r"inclination is 28.5: it must be .* at most 3.14159.* in rad \(jnp.deg2rad\)",
        ),
        (
            lambda: orbit_from_radius(7e6, MU_EARTH, inclination=51.6),
            "inclination is 51.6: it must be .* angles are in rad",
        ),
        (lambda: Station(48.0, 0.2, 6.4e6, 1 / 298, 7e-5), "latitude is 48: .* angles are in rad"),
    ],
)
def test_singular_places_and_degrees_are_refused(make, sentence):
    with pytest.raises(InputError, match=sentence):
        make()


def test_kilometres_are_doubted():
    """Where the gravitational parameter is that of a planet."""
    scene = Scene([PointGravity(MU_EARTH)])
    with pytest.warns(UserWarning, match="y0.position is 7000 m, deep within .* radius of Earth"):
        simulate(scene, BodyState([7000.0, 0.0, 0.0], [0.0, 7.5, 0.0]), [0.0, 1.0])
    with pytest.warns(UserWarning, match="periapsis_radius is 7000 m.* multiply kilometres"):
        orbit_from_radius(7000.0, MU_EARTH)
    # A planet without a name, and a right distance.
    orbit_from_radius(7000.0, 1e10)
    orbit_from_radius(7e6, MU_EARTH)
