"""No constructor decides by a number: everything is built within a trace, with all of its numbers
traced, with none of them (made outside of it, as by the author of a campaign), and with every
second one. Nothing is compiled."""

import inspect
import sys
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from more_systems import MORE
from systems import SAMPLES

import jaxspace
from jaxspace.attitude import ReactionWheels, RollingDisk
from jaxspace.bodies import BurningBody, RigidBody
from jaxspace.core import InputError
from jaxspace.dispersion import Campaign, Normal, disperse
from jaxspace.io._mission.build import build_mission
from jaxspace.io._mission.building import Runs, replaced
from jaxspace.io._requests.inputs import measures
from jaxspace.orbits import TabulatedPath
from jaxspace.rockets import (
    BackPressure,
    Gimbal,
    GimballedThrust,
    SpinningRocket,
    SteeredThrust,
    Thrust,
    ThrustProfile,
    read_motor,
)
from jaxspace.rockets.steering import AlongVelocity
from jaxspace.vehicles import LaunchSite, NoseCone, Recovery, Vehicle, Wind, sounding_flight
from jaxspace.vehicles.ground_gravity import GroundGravity

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
sys.path.insert(0, str(EXAMPLES / "model_rockets"))
from rockets import CALISTO, recovery, site, vehicle  # noqa: E402

# Which numbers of a list are traced.
PATTERNS = {
    "all": lambda k: True,
    "none": lambda k: False,
    "even": lambda k: k % 2 == 0,
    "odd": lambda k: k % 2 == 1,
}


def trace(build, numbers):
    """Trace `build(numbers)` with every pattern of traced numbers."""
    numbers = [np.asarray(x) for x in numbers]
    for name, traced in PATTERNS.items():

        def built(given, traced=traced):
            mixed = [x if traced(k) else jnp.asarray(numbers[k]) for k, x in enumerate(given)]
            return eqx.filter(build(mixed), eqx.is_array)

        try:
            jax.eval_shape(built, numbers)
        except jax.errors.JAXTypeError as error:
            pytest.fail(f"with {name} of its numbers traced: {error}")


def arguments_of(x):
    """What the constructor of this object was given, by name."""
    # The argument of a rigid body has the name of one of its methods.
    renamed = {"inertia": "moment_of_inertia"} if isinstance(x, RigidBody) else {}
    names = list(inspect.signature(type(x)).parameters)
    return {name: getattr(x, renamed.get(name, name)) for name in names}


def again(x, numbers):
    """The object made anew by its constructors, with these numbers in the place of its own."""
    if isinstance(x, eqx.Module):
        return type(x)(**{k: again(v, numbers) for k, v in arguments_of(x).items()})
    if isinstance(x, tuple | list):
        made = [again(v, numbers) for v in x]
        return type(x)(*made) if hasattr(x, "_fields") else type(x)(made)
    if isinstance(x, dict):
        return {name: again(v, numbers) for name, v in x.items()}
    return next(numbers) if eqx.is_array(x) else x


def numbers_of(x):
    """The numbers of an object, in the order in which `again` takes them."""
    if isinstance(x, eqx.Module):
        return [n for v in arguments_of(x).values() for n in numbers_of(v)]
    if isinstance(x, tuple | list):
        return [n for v in x for n in numbers_of(v)]
    if isinstance(x, dict):
        return [n for v in x.values() for n in numbers_of(v)]
    return [x] if eqx.is_array(x) else []


@pytest.mark.parametrize("sample", SAMPLES + MORE, ids=lambda sample: sample.name)
def test_every_system_and_effect_is_built_of_traced_numbers(sample):
    given = (sample.system, sample.state)
    trace(lambda numbers: again(given, iter(numbers)), numbers_of(given))


MOTOR = read_motor(EXAMPLES / "model_rockets" / CALISTO["motor_file"])
MADE = {
    "profile": (ThrustProfile.of_table, (np.array([0.0, 1.0, 3.0]), np.array([1.0, 2.0, 0.0]))),
    "total impulse": (Thrust.of_motor, (1e5, 10.0, 100.0, -1.0, [0.01, 0.02])),
    "specific impulse": (Thrust.of_specific_impulse, (1e4, 250.0, 10.0, -1.0, [0.01, 0.02])),
    "motor": (MOTOR.thrust, (2.0,)),
    "lengths": (SpinningRocket.of_lengths, (1.0, 0.01, 1.0, 0.5, 2.0, 0.1)),
    "impulses": (BackPressure.of_impulses, (1e5, 300.0, 260.0, 6e6)),
    "steered": (
        lambda *x: SteeredThrust.of_propellant(AlongVelocity(), *x),
        (1e4, 250.0, 100.0, 0.9),
    ),
    "gimballed": (
        lambda a, b, *x: GimballedThrust.of_propellant(Gimbal(AlongVelocity(), a, b), *x),
        (2.0, 1.0, 1e4, 250.0, 100.0, -1.0, 0.9),
    ),
    "rotor": (ReactionWheels.rotor, ([0.1, 0.0, 1.0], 8.0, 20.0)),
    "disk": (RollingDisk.uniform, (1.0, 0.3, 9.8)),
    "path": (TabulatedPath.of_table, ([0.0, 1.0, 2.0, 3.0], np.ones((3, 4)))),
    "nose": (lambda *x: NoseCone.of_shape(*x, "von_karman"), (0.06, 1.0, 0.5)),
    "latitude": (GroundGravity.of_latitude, (0.5, 100.0)),
}


@pytest.mark.parametrize("name", MADE)
def test_every_named_constructor_takes_traced_numbers(name):
    make, given = MADE[name]
    numbers, tree = jax.tree.flatten(given)
    trace(lambda x: make(*jax.tree.unflatten(tree, x)), numbers)


@pytest.mark.parametrize("path", sorted((EXAMPLES / "scenes").glob("*.toml")), ids=lambda p: p.stem)
def test_every_mission_of_a_file_is_built_of_traced_numbers(path):
    parsed = jaxspace.load(path).parsed
    known = {p: float(m) for p, m in measures(parsed.values) if not p.startswith("dispersion")}

    def mission(numbers):
        given = dict(zip(known, numbers, strict=True))
        return build_mission(parsed, replaced(parsed.values, given), Runs())

    trace(mission, known.values())


def test_a_vehicle_and_its_flight_are_built_of_traced_numbers():
    """Its recovery, too, whether it is made outside of the trace or within."""
    given = (vehicle(CALISTO), site(CALISTO), recovery(CALISTO))
    trace(lambda x: sounding_flight(*again(given, iter(x))), numbers_of(given))
    known = {"mass": CALISTO["mass"], "centre": CALISTO["centre"]}
    trace(
        lambda x: vehicle(CALISTO | dict(zip(known, x, strict=True))).as_body(site(CALISTO).air),
        known.values(),
    )


def phases(*chutes):
    return [p.name for p in sounding_flight(vehicle(CALISTO), site(CALISTO), chutes)[0].phases]


def test_the_phases_follow_from_what_is_given_and_not_from_its_value():
    """A lag of zero has its phase, as the other runs of the same campaign have; no lag has none."""
    assert phases(Recovery(1.0, 0.0)) == phases(Recovery(1.0, 2.0))
    assert phases(Recovery(1.0, 0.0)) == ["rail", "ascent", "wait 1", "parachute 1"]
    assert phases(Recovery(1.0)) == ["rail", "ascent", "parachute 1"]
    assert phases(Recovery(1.0, height=300.0)) == ["rail", "ascent", "fall", "parachute 1"]
    with pytest.raises(InputError, match=r"Recovery\.height of parachute 2 is None"):
        phases(Recovery(1.0), Recovery(10.0))


def test_a_table_that_is_traced_gives_the_profile_of_a_known_one():
    """NumPy and JAX sum in another order: some roundings."""
    times, thrusts = np.array([1.0, 2.0, 5.0]), np.array([3.0, 2.0, 0.0])
    _, burn_time, mean = jax.jit(ThrustProfile.tabulated)(times, thrusts)
    # By trapezoids: (2.5 * 1 + 1 * 3)/4.
    np.testing.assert_allclose([burn_time, mean], [4.0, 1.375], rtol=1e-15)
    known = ThrustProfile.of_table(times, thrusts)
    np.testing.assert_allclose(known.level, thrusts / 1.375, rtol=1e-15)


# Outside of `build`, as an author writes it.
CHUTE = [Recovery(0.3, 1.0)]
DART = Vehicle(
    BurningBody(3.0, [0.3, 0.3, 0.01], [0.1, 0.1, 0.02], -0.3, 0.5),
    Thrust.of_motor(300.0, 2.5, 0.5),
    area=0.005,
    drag=0.4,
)


def launch(samples):
    wind = Wind([0.0, 1e4], [3.0, 3.0], [0.0, 0.0])
    start = LaunchSite(2.0, samples["inclination"], latitude=0.5, wind=wind)
    return sounding_flight(
        DART, start, CHUTE, rail_within=1.0, ascent_within=20.0, descent_within=150.0
    )


def landing(result, samples):
    x, y, z = result.final.position
    return {"east": x, "north": y, "height": z, "drift": result.end}


@pytest.mark.sweep
def test_a_landing_is_dispersed_with_a_parachute_from_outside():
    """Every run lands; a lower rail lands farther to the north, where it points; and the wind
    blows it to the east, no farther than it blows while the run lasts."""
    campaign = Campaign(launch, {"inclination": Normal(1.48, 0.01)}, landing)
    found = disperse(campaign, 6, seed=1, accuracy=1e-5)
    assert np.all(found.good)
    np.testing.assert_allclose(found.outputs["height"], 0.0, atol=1e-9)  # of Newton's correction
    order = np.argsort(found.inputs["inclination"])
    assert np.all(np.diff(found.outputs["north"][order]) < 0.0)
    drifts = found.outputs["east"] / (3.0 * found.outputs["drift"])
    assert np.all((drifts > 0.3) & (drifts < 1.0))
