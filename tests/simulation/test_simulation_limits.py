"""Models that report when a run leaves the range for which they are valid, also where the end of
the run is inside again."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from jaxspace import simulate, simulate_batch, simulate_mission
from jaxspace.attitude import RollingDisk
from jaxspace.attitude.disk_tilt import disk_tilt
from jaxspace.attitude.swinging import SwingingCords
from jaxspace.attitude.unwinding import StretchingCords
from jaxspace.gyros import Gyrocompass, RateGyro, RateGyroState, TwoGimbalGyro
from jaxspace.gyros.bearing import BearingFriction
from jaxspace.mechanics import BarOnSpring, BarOnString, ElasticPendulum, LandingLegs
from jaxspace.simulation import Event, Mission, Phase, Status

INSIDE, LEFT = Status.COMPLETED, Status.OUTSIDE_MODEL
G = 9.81
# A uniform disk, a hoop and a disk that rolls fast enough to stay upright.
AXIAL = np.array([0.5, 1.0, 0.5]) * 0.37 * 0.2**2
DISKS = RollingDisk(0.37, 0.2, 0.5 * AXIAL, AXIAL, G)
RATES = np.array([[0.0, 0.0, 0.2], [0.0, 0.0, 0.0], [0.0, 0.0, 30.0]])
ANGLES = np.array([[0.0] * 3, [math.radians(89.0)] * 3, [0.0] * 3])


def tilt(t, y):
    return disk_tilt(y.attitude) - 0.1


def test_a_disk_that_falls_lifts_off_or_lies_flat():
    """From rest at s_0 = sin(theta_0) the plane pushes with 1 - k cos^2 - 2 k s (s_0 - s) weights,
    k = m R^2/(A + m R^2): 4/5 of a disk, which lifts off between s = 1/6 and 1/2 and is pressed on
    again below, and 2/3 of a hoop, which is pressed on all the way and passes through the plane."""
    y0 = DISKS.state(ANGLES, RATES)
    s, s0 = np.sin(0.7), np.sin(ANGLES[1, 0])
    k = np.array([0.8, 2.0 / 3.0])
    rate = np.sqrt(2.0 * k * (s0 - s) * G / 0.2)
    falling = np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 0.0]])
    falling[1] = -rate
    two = jax.tree.map(lambda x: x[..., :2] if x.ndim else x, DISKS)
    y = two.state(np.array([[0.0] * 2, [0.7] * 2, [0.0] * 2]), falling)
    push = 1.0 - k * np.cos(0.7) ** 2 - 2.0 * k * s * (s0 - s)
    assert_allclose(two.contact_force(y)[2], push * 0.37 * G, rtol=1e-12)
    # Up to the tilt of 0.1 rad the hoop is inside; the disk is inside again, and has lifted off.
    ts = np.array([0.0, 1.2])
    run = simulate_batch(DISKS, y0, ts, events=(Event(tilt),), throw=False)
    assert_array_equal(run.status, [LEFT, Status.EVENT, INSIDE])
    # The run that stays inside keeps its numbers.
    assert np.isfinite(run.final.position[:, 2]).all()
    assert np.isnan(run.final.position[:, 0]).all()
    # An event ends the run of the disk where it lifts off, before the model is left.
    lift = Event(lambda t, y: DISKS.contact_force(y)[2])
    run = simulate_batch(DISKS, y0, ts, events=(lift,), throw=False)
    assert_array_equal(run.status, [Status.EVENT, LEFT, INSIDE])
    # The root of 1 - k - 2 k s s_0 + 3 k s^2 of the disk from which on it pulls.
    root = (s0 + np.sqrt(s0 * s0 - 0.75)) / 3.0
    assert_allclose(np.sin(disk_tilt(run.final.attitude))[0], root, rtol=1e-6)


def string_of(ratio):
    """A light bar on a string, that starts from below with the speed v^2 = ratio g a."""
    system = BarOnString(1.0, 2.0, 1e-4, G)
    rate = jnp.sqrt(jnp.asarray(ratio) * G / 2.0)
    return system, system.state(0.0, 0.0, rate, rate)


def test_a_string_that_becomes_slack():
    """That of a point is slack on the way for 2 < v^2/(g a) < 5, and taut again below."""
    ratios = np.array([1.8, 2.3, 4.7, 5.4])
    system, y0 = string_of(ratios)
    assert_allclose(system.tension(y0), G * (1.0 + ratios), rtol=1e-3)
    ts = np.array([0.0, 3.0])

    # Under jit and mapped.
    @jax.jit
    def status(ratio):
        system, y0 = string_of(ratio)
        return simulate(system, y0, ts, throw=False).status

    assert_array_equal(jax.vmap(status)(ratios), [INSIDE, LEFT, LEFT, INSIDE])
    # In a mission, whose later phase is not run.
    system, y0 = string_of(2.3)
    mission = Mission([Phase(system, 3.0, name="swing"), Phase(system, 3.0, name="later")])
    run = simulate_mission(mission, y0, throw=False)
    assert run.status == run.phases[0].status == LEFT


def test_a_spring_without_length():
    """Upwards and downwards through the pivot, and not so far."""
    rates = np.array([-0.5, -30.0])
    pendulum = ElasticPendulum(1.0, 100.0, 1.0, G)
    ts = np.array([0.0, 1.0])
    y0 = pendulum.state(1.1, 0.0, rates, 0.0)
    assert_array_equal(simulate_batch(pendulum, y0, ts, throw=False).status, [INSIDE, LEFT])
    bar = BarOnSpring(1.0, 100.0, 1.0, 1e-2, G)
    y0 = bar.state(1.1, 0.0, 0.0, rates)
    assert_array_equal(simulate_batch(bar, y0, ts, throw=False).status, [INSIDE, LEFT])


def test_legs_that_lift_off():
    """Of legs without mass the ground carries the springs alone, n k (theta - theta_0)/(l sin):
    they lift off when they are back at theta_0."""
    legs = LandingLegs(100.0, 0.0, 1.5, 0.6, 4000.0, 1.6)
    touched = legs.touchdown(2.0)
    y = legs.state(jnp.array([0.7, 0.9]), jnp.array([0.3, -0.6]))
    springs = 4.0 * 4000.0 * (y.coordinates[0] - 0.6) / (1.5 * np.sin(y.coordinates[0]))
    assert_allclose(legs.ground_force(y), springs, rtol=1e-10)
    spread = float(legs.spreading_time(2.0))
    ends = np.array([1.0, 1.9, 2.2]) * spread
    two = jax.tree.map(lambda x: jnp.repeat(x[..., None], 3, axis=-1), touched)
    run = simulate_batch(legs, two, np.stack([0.0 * ends, ends]), throw=False)
    assert_array_equal(run.status, [INSIDE, INSIDE, LEFT])
    # Fast enough, they come to lie flat.
    run = simulate(legs, legs.touchdown(12.0), np.array([0.0, 0.5]), throw=False)
    assert run.status == LEFT


def test_cords_that_become_slack_or_meet_the_drum():
    cords = SwingingCords(1.0, 0.3, 0.2, 0.8)
    y0 = cords.state(2.0, 3.0)
    inside = simulate(cords, y0, np.linspace(0.0, 0.4, 9))
    assert np.all(np.asarray(cords.tension(inside.states)) > 0.0)
    end = Event(lambda t, y: y.angle - 0.5 * math.pi)
    run = simulate(cords, y0, np.array([0.0, 20.0]), events=(end,), throw=False)
    assert run.status == Status.EVENT
    run = simulate(cords, y0, np.array([0.0, 20.0]), throw=False)
    assert run.status == LEFT
    elastic = StretchingCords(1.0, 0.3, 0.2, 500.0)
    y0 = elastic.state(2.0, 0.5)
    hit = dataclasses.replace(y0, stretch_rate=y0.stretch_rate - 1.0)
    for y, status in ((y0, INSIDE), (hit, LEFT)):
        run = simulate(elastic, y, np.array([0.0, 0.3]), throw=False)
        assert run.status == status


def test_gyros():
    """A rate gyro that swings to 2 H w/K and back, in closed form; a compass whose axis is past the
    vertical; and dry friction without the events of its slip."""
    gyro = RateGyro(1e-4, 0.0, 0.01, spring=0.04, input_rate=np.array([0.3, 2.4]))
    period = 2.0 * math.pi * math.sqrt(1e-4 / 0.04)
    still = RateGyroState(jnp.zeros(2), jnp.zeros(2))
    run = simulate_batch(gyro, still, np.linspace(0.0, period, 5), throw=False)
    assert_array_equal(run.status, [INSIDE, LEFT])
    compass = Gyrocompass(339.0, 0.2, 0.2, 8.5, 0.8)
    y0 = compass.state(jnp.array([0.1, 1.7]), 0.0)
    run = simulate_batch(compass, y0, np.array([0.0, 0.004]), accuracy=1e-6, throw=False)
    assert_array_equal(run.status, [INSIDE, LEFT])
    gyro = TwoGimbalGyro(1e-4, 2e-4, 500.0, inner_bearing=BearingFriction(dry=1e-3))
    y0 = gyro.state(math.radians(70.0), 0.0, 0.5, 0.0)
    ts = np.array([0.0, 0.05])
    assert simulate(gyro, y0, ts, throw=False).status == LEFT
    margin = Event(gyro.friction_margin, direction=-1, terminal=False, then=gyro.stick_or_slip)
    assert simulate(gyro, y0, ts, events=(margin,), throw=False).status == INSIDE
