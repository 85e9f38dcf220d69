"""Models that report when a run leaves the range for which they are valid, also where the end of
the run is inside again."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from jaxspace import Accuracy, simulate, simulate_batch, simulate_mission
from jaxspace.attitude import RollingDisk
from jaxspace.attitude.disk_tilt import disk_tilt
from jaxspace.attitude.swinging import SwingingCords
from jaxspace.attitude.unwinding import StretchingCords
from jaxspace.gyros import (
    Gyrocompass,
    Gyropendulum,
    GyropendulumState,
    PlatformAxis,
    RateGyro,
    RateGyroState,
    StablePlatform,
    TwoGimbalGyro,
)
from jaxspace.gyros.bearing import BearingFriction
from jaxspace.mechanics import BarOnSpring, BarOnString, ElasticPendulum, LandingLegs
from jaxspace.simulation import Event, Mission, Phase, Status
from jaxspace.solvers import Tsit5
from jaxspace.studies import propagate_covariance
from jaxspace.studies.covariance import MeanRoot, UncertainRoot

INSIDE, LEFT = Status.COMPLETED, Status.OUTSIDE_MODEL
G = 9.81
FAST = Accuracy(1e-7, method=Tsit5(), max_steps=256)
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


def rate_gyros():
    """Two that swing to 2 H w/K and back, to 0.15 and 1.2 rad, and their period, s."""
    gyro = RateGyro(1e-4, 0.0, 0.01, spring=0.04, input_rate=np.array([0.3, 2.4]))
    return gyro, 2.0 * math.pi * math.sqrt(1e-4 / 0.04)


def test_gyros():
    """A rate gyro in closed form; a compass whose axis is past the vertical; and dry friction
    without the events of its slip."""
    gyro, period = rate_gyros()
    still = RateGyroState(jnp.zeros(2), jnp.zeros(2))
    run = simulate_batch(gyro, still, np.linspace(0.0, period, 5), throw=False)
    assert_array_equal(run.status, [INSIDE, LEFT])
    compass = Gyrocompass(339.0, 0.2, 0.2, 8.5, 0.8)
    # Its constructor rejects a tilt beyond the vertical.
    y0 = dataclasses.replace(compass.state(jnp.array([0.1, 1.5]), 0.0), tilt=jnp.array([0.1, 1.7]))
    run = simulate_batch(compass, y0, np.array([0.0, 0.004]), accuracy=1e-6, throw=False)
    assert_array_equal(run.status, [INSIDE, LEFT])
    gyro = TwoGimbalGyro(1e-4, 2e-4, 500.0, inner_bearing=BearingFriction(dry=1e-3))
    y0 = gyro.state(math.radians(70.0), 0.0, 0.5, 0.0)
    ts = np.array([0.0, 0.05])
    assert simulate(gyro, y0, ts, throw=False).status == LEFT
    margin = Event(gyro.friction_margin, direction=-1, terminal=False, then=gyro.stick_or_slip)
    assert simulate(gyro, y0, ts, events=(margin,), throw=False).status == INSIDE


def tilted_pendulums(peaks):
    """Pendulums from rest at the vertical, with the plumb line tilted by half of `peaks`, (2, n):
    the axis precesses about it through the tilt of twice that, and back."""
    system = Gyropendulum(
        200.0, 0.01, 4.0, acceleration_theta=0.5 * G * peaks[0],
        acceleration_phi=0.5 * G * peaks[1], gravity=G,
    )  # fmt: skip
    rest = GyropendulumState(*(jnp.zeros(peaks.shape[1]) for _ in range(4)))
    return system, rest, 2.0 * math.pi / float(system.frequencies[0])


def test_a_gyropendulum_that_tilts_by_more_than_a_radian():
    """In either tilt, in both directions. The nutation is below 1e-6 rad."""
    peaks = np.array([[0.99, 1.01, 0.0, 0.0, -1.01], [0.0, 0.0, 0.99, -1.01, 0.0]])
    system, rest, period = tilted_pendulums(peaks)
    run = simulate_batch(system, rest, np.linspace(0.0, period, 33), throw=False)
    # Half a circle about the plumb line crosses each tilt by its radius alone.
    assert_array_equal(run.status, [INSIDE, LEFT, INSIDE, LEFT, LEFT])
    inside = np.asarray(run.status) == INSIDE
    assert_allclose(np.stack([run.final.theta, run.final.phi])[:, inside], 0.0, atol=1e-5)


def test_platforms_whose_gyros_turn_by_more_than_a_radian():
    """Free platforms nutate: a gyro that starts at the rate a n turns by a sin(n t), to a and back
    within half a period."""
    inertia, own, h = 0.5, 1e-3, 0.8
    peaks = np.array([0.99, 1.01, -1.01])
    axis = PlatformAxis(inertia, own, h)
    n = h / math.sqrt(inertia * own)
    ts = np.linspace(0.0, math.pi / n, 9)
    rest = jax.tree.map(lambda x: jnp.zeros(3) + x, axis.at_rest)
    y0 = dataclasses.replace(rest, gyro_rate=jnp.asarray(peaks * n))
    run = simulate_batch(axis, y0, ts, throw=False)
    assert_array_equal(run.status, [INSIDE, LEFT, LEFT])
    assert_allclose(run.final.gyro_angle[0], 0.0, atol=1e-6)
    # About each axis of three in turn: the innermost gimbals turn alone, with their own inertia.
    platform = StablePlatform([inertia - 0.1] * 3, 0.1, own, h)
    y0 = platform.state(*jnp.zeros((3, 4)))
    peaks = np.array([[1.01, 0.0, 0.0, 0.0], [0.0, -1.01, 0.0, 0.99], [0.0, 0.0, 1.01, 0.0]])
    y0 = dataclasses.replace(y0, gyro_rates=jnp.asarray(peaks * n))
    run = simulate_batch(platform, y0, ts, accuracy=FAST, throw=False)
    assert_array_equal(run.status, [LEFT, LEFT, LEFT, INSIDE])
    assert_allclose(run.final.gyro_angles[:, 3], 0.0, atol=1e-5)


def test_a_mean_that_leaves_the_range():
    """The covariance, and its root, are propagated about a mean that the model describes."""
    gyro, period = rate_gyros()
    y0 = RateGyroState(jnp.zeros(2), jnp.zeros(2))
    ts = np.linspace(0.0, period, 5)
    P = np.eye(2) * 1e-6
    run, _ = propagate_covariance(gyro, y0, ts, P, batch=True, accuracy=FAST, throw=False)
    assert_array_equal(run.status, [INSIDE, LEFT])
    root = MeanRoot(y0, 1e-3 * jnp.eye(2)[..., None] * jnp.ones(2))
    run = simulate_batch(UncertainRoot(gyro), root, ts, accuracy=FAST, throw=False)
    assert_array_equal(run.status, [INSIDE, LEFT])
