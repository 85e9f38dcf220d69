"""Motors that are lit a delay after the start of their phase, which may be the time of an event."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace import Event, Mission, Phase, Scene, load, simulate_mission, simulate_mission_batch
from jaxspace.bodies import BodyState, RigidBody
from jaxspace.core import InputError
from jaxspace.dispersion import disperse
from jaxspace.io import SceneError
from jaxspace.orbits import UniformGravity
from jaxspace.rockets import SteeredThrust, Thrust
from jaxspace.rockets.steering import FixedDirection
from jaxspace.simulation import simulate_compact
from jaxspace.studies import propagate_covariance

G, EXHAUST, BURN, MASS, FLOW = 9.8, 2000.0, 10.0, 100.0, 4.0
UP = jnp.array([0.0, 0.0, 1.0])
SPEEDS, DELAYS = np.array([49.0, 98.0, 196.0]), np.array([2.0, 0.0, 5.0])


def flight(delay):
    """A throw upwards; from its apex on, a motor that burns after a delay."""
    gravity = UniformGravity(-G * UP)
    motor = SteeredThrust(FixedDirection(UP), FLOW * EXHAUST, EXHAUST, BURN, delay=delay)
    coast = Scene([gravity], RigidBody(mass=MASS), carry=("mass",))
    apex = Event(lambda t, y: y.velocity[2], direction=-1, within=60.0)
    burn = Scene([gravity, motor], RigidBody(mass=MASS))
    return Mission([Phase(coast, apex, name="coast"), Phase(burn, delay + BURN, name="burn")])


def start(speed):
    zero = 0.0 * speed
    return BodyState(
        jnp.stack([zero, zero, zero]), jnp.stack([zero, zero, speed]), mass=MASS + zero
    )


def closed_form(speed, delay):
    """Height, speed and time at the burnout, and their slopes by speed and delay."""
    ratio = MASS / (MASS - FLOW * BURN)
    height = speed**2 / (2.0 * G) - 0.5 * G * (delay + BURN) ** 2
    height += EXHAUST * BURN * (1.0 - np.log(ratio) / (ratio - 1.0))
    last = -G * (delay + BURN) + EXHAUST * np.log(ratio) + 0.0 * speed
    one = np.ones_like(speed)
    by_speed = speed / G, 0.0 * one, one / G
    by_delay = -G * (delay + BURN), -G * one, one
    return (height, last, speed / G + delay + BURN), by_speed, by_delay


def ends_of(run):
    return run.final.position[2], run.final.velocity[2], run.end


@jax.jit
def flown(speeds, delays, more):
    def ends(speeds, delays):
        return ends_of(simulate_mission_batch(flight(delays), start(speeds)))

    return jax.jvp(ends, (speeds, delays), more)


def test_each_run_of_a_batch_ignites_after_its_own_event():
    """Every run has its own apex: heights, speeds and times, and their slopes, in closed form."""
    true, by_speed, by_delay = closed_form(SPEEDS, DELAYS)
    # By the delay too where it can move to both sides; at zero the slope is the mean of both.
    also = (DELAYS > 0.0).astype(float)
    found, slopes = flown(SPEEDS, DELAYS, (np.ones(3), also))
    # The tolerance of the runs is 1e-9; lengths are thousands of metres.
    np.testing.assert_allclose(found, true, rtol=1e-7)
    expected = np.array(by_speed) + also * np.array(by_delay)
    np.testing.assert_allclose(slopes, expected, rtol=1e-6, atol=1e-6)


@pytest.mark.sweep
def test_the_gradient_of_a_run():
    """Reverse mode, of one run that records its steps."""

    def height(speed, delay):
        return simulate_mission(flight(delay), start(speed)).final.position[2]

    slopes = jax.jit(jax.grad(height, (0, 1)))(98.0, 2.0)
    _, by_speed, by_delay = closed_form(np.array(98.0), np.array(2.0))
    np.testing.assert_allclose(slopes, (by_speed[0], by_delay[0]), rtol=1e-6)


def test_the_rolled_stages_of_an_optimisation():
    """With its gradient, in reverse mode."""

    def height(speed, delay):
        run = simulate_compact(flight(delay), start(speed))
        return run.final.position[2], ends_of(run)

    (_, ends), slopes = jax.jit(jax.value_and_grad(height, (0, 1), has_aux=True))(49.0, 2.0)
    true, by_speed, by_delay = closed_form(np.array(49.0), np.array(2.0))
    # Forty fixed steps of eighth order for smooth fields.
    np.testing.assert_allclose(ends, true, rtol=1e-8)
    np.testing.assert_allclose(slopes, (by_speed[0], by_delay[0]), rtol=1e-8)


FILE = """
[body]
mass = "100 kg"

[effects.uniform_gravity]
acceleration = [0.0, 0.0, -9.8]

[effects.steered_thrust]
mean_thrust = "8 kN"
exhaust_velocity = "2 km/s"
burn_time = "10 s"
delay = "2 s"
steering = { along = [0.0, 0.0, 1.0] }

[initial]
position = [0.0, 0.0, "1 km"]
velocity = [0.0, 0.0, "98 m/s"]

[[phase]]
name = "coast"
effects = ["uniform_gravity"]
until = "apoapsis"
within = "60 s"

[[phase]]
name = "burn"
effects = ["uniform_gravity", "steered_thrust"]
until = "burnout"
"""


def test_a_file_ends_a_phase_at_the_burnout_of_a_delayed_motor(tmp_path):
    """The result holds the motor with the time at which it was lit."""
    path = tmp_path / "flight.toml"
    path.write_text(FILE)
    file = load(path)
    np.testing.assert_array_equal(file.mission.phases[1].until, 12.0)
    run: Any = file.simulate()
    (height, speed, end), _, _ = closed_form(np.array(98.0), np.array(2.0))
    np.testing.assert_allclose(ends_of(run), (1e3 + height, speed, end), rtol=1e-7)
    motor = run.phases[1].system.effects[1]
    rates = [float(motor.mass_rate(t, 1.0)) for t in (11.99, 12.01, 21.99, 22.01)]
    np.testing.assert_allclose(rates, (0.0, -FLOW, -FLOW, 0.0))


def test_a_motor_with_a_time_of_ignition_cannot_end_a_phase_of_unknown_start(tmp_path):
    path = tmp_path / "flight.toml"
    path.write_text(FILE.replace('delay = "2 s"', 'ignition = "5 s"'))
    with pytest.raises(
        SceneError,
        match=r"ends at an event. Give effects.steered_thrust a delay",
    ):
        load(path)
    path.write_text(FILE.replace('delay = "2 s"', 'delay = "2 s"\nignition = "5 s"'))
    with pytest.raises(SceneError, match=r"thrust.ignition is 5: it must be omitted when"):
        load(path)


def test_a_delay_beside_an_ignition_is_refused():
    with pytest.raises(InputError, match=r"Thrust.ignition is 5: it must be omitted when a del"):
        Thrust(1.0, 1.0, 1.0, ignition=5.0, delay=1.0)
    assert float(Thrust(1.0, 1.0, 2.0, delay=1.0).burnout()) == 3.0


def test_a_covariance_needs_a_time_of_the_mission():
    """The delay of a run moves the ignition, which the covariance of a mission does not hold."""
    with pytest.raises(InputError, match="Phase 'burn' has a time relative to its start"):
        propagate_covariance(flight(2.0), start(jnp.array(98.0)), jnp.eye(7))


OUTPUTS = """
[dispersion]
outputs = [
    "proper_acceleration",
    { name = "greatest", output = "proper_acceleration", take = "greatest", at = "burn" },
]
inputs."effects.steered_thrust.delay" = { distribution = "uniform", low = "1 s", high = "3 s" }
"""


@pytest.mark.sweep
def test_outputs_see_the_motor_up_to_the_burnout(tmp_path):
    """The burnout ends the phase, in each run at its own time, to a rounding of which the motor
    burns or does not."""
    path = tmp_path / "flight.toml"
    path.write_text(FILE + OUTPUTS)
    file = load(path)
    result = disperse(file.campaign(), 16)
    last = FLOW * EXHAUST / (MASS - FLOW * BURN)
    # Tolerance of the runs.
    np.testing.assert_allclose(result.outputs["proper_acceleration"], last, rtol=1e-7)
    np.testing.assert_allclose(result.outputs["greatest"], last, rtol=1e-7)
    found = file.nominal_outputs(file.nominal_mission())
    assert [x for x, _ in found.values()] == pytest.approx([last, last], rel=1e-7)
