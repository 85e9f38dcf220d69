"""Parts of a vehicle of another kind are refused by a sentence that names them."""

import jax.numpy as jnp
import pytest
from unchecked import unchecked

from jaxspace.core import InputError
from jaxspace.rockets import Motor, Thrust
from jaxspace.vehicles import FinSet, LaunchSite, Recovery, Vehicle, sounding_flight

FINS = FinSet(4, 0.1, 0.12, 0.06, 0.02, 0.06, -1.0)
MOTOR = Motor(jnp.array([0.0, 1.0, 2.0]), jnp.array([0.0, 100.0, 0.0]), 0.5)
GIVEN = {
    "motor": MOTOR,
    "radius": 0.05,
    "mass": 4.0,
    "inertia": [1.0, 1.0, 0.01],
    "centre": 0.0,
    "case_mass": 0.5,
    "case_station": -0.5,
    "propellant_station": -0.5,
    "grain": (0.02, 0.01, 0.2),
    "exit_station": -0.7,
    "exit_radius": 0.01,
    "drag": 0.4,
}


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("mass", "14 kg", "mass is '14 kg': it must be a number in kg"),
        ("inertia", ["1 kg m^2", 1.0, 1.0], "inertia is .* an array of numbers in kg m\\^2"),
        ("grain", ("20 mm", 0.01, 0.2), "grain is .* an array of numbers in m"),
        ("exit_station", "-0.7", "exit_station is '-0.7': it must be a number in m"),
        ("nose", "von_karman", "nose is 'von_karman': it must be a NoseCone or None"),
        ("nose", FINS, "nose is of type FinSet: it must be a NoseCone or None"),
        ("table", "drag.csv", "table is 'drag.csv': it must be an AerodynamicTable or None"),
        ("fins", (FINS, "canards"), "a part 'canards'.*: it must be a FinSet"),
        ("tail", [FINS], "a part of type FinSet.*: it must be a RadiusChange"),
        ("motor", 5.0, "motor is 5.0"),
        ("motor", {"thrust": 5.0}, "motor is of type dict"),
        ("drag", "0.4", "drag"),
    ],
)
def test_parts_of_another_kind_are_refused(name, value, words):
    with unchecked(), pytest.raises(InputError, match=words):
        Vehicle.model_rocket(**{**GIVEN, name: value})


def test_arguments_of_a_flight_of_another_kind_are_refused():
    rocket, site = Vehicle.model_rocket(**GIVEN), LaunchSite(5.0, 1.5)
    for given, words in (
        ((rocket.body, site), "vehicle is of type BurningBody: it must be a Vehicle"),
        ((rocket, 5.0), "site is 5.0: it must be a LaunchSite"),
        (
            (rocket, site, Recovery(2.0)),
            "recovery is of type Recovery: it must be a list or a tuple",
        ),
        ((rocket, site, ["drogue"]), "recovery 1 is 'drogue': it must be a Recovery"),
    ):
        with unchecked(), pytest.raises(InputError, match=words):
            sounding_flight(*given)


def test_fields_of_another_kind_are_refused():
    rocket = Vehicle.model_rocket(**GIVEN)
    assert isinstance(rocket.motor, Thrust)
    for name, value in (("motor", "M1670"), ("nose", "von_karman"), ("body", 14.0)):
        given = {"body": rocket.body, "motor": rocket.motor, "area": 0.01, "drag": 0.4}
        with unchecked(), pytest.raises(InputError, match=f"Vehicle.{name} is"):
            Vehicle(**{**given, name: value})
