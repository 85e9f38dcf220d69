"""Hard places of flights with thrust: nearly everything burnt, thrust that jumps between the times
that are saved, a separation at the very end of a burn, no thrust, an apogee at rest.

No burning, and a mass ratio of zero, are in `test_singular_places.py`."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace import BodyState, Event, Mission, Phase, Scene, simulate, simulate_mission
from jaxspace.orbits import UniformGravity
from jaxspace.rockets import Separation, SteeredThrust
from jaxspace.rockets.steering import FixedDirection
from jaxspace.simulation import Status

UP, U, START = jnp.array([0.0, 0.0, 1.0]), 3000.0, 1000.0


def at_rest(mass=START):
    return BodyState(jnp.zeros(3), jnp.zeros(3), mass=jnp.asarray(mass))


@jax.jit
def burn(thrust, burn_time, ignition, ts):
    """A burn along z without any other force, whose gain is that of the masses alone; and the
    slopes of its last speed and height by thrust, burn time and ignition. One program for all."""

    def ends(x):
        motor = SteeredThrust(FixedDirection(UP), x[0], U, x[1], ignition=x[2])
        run = simulate(Scene((motor,)), at_rest(), ts, accuracy=1e-11)
        return jnp.stack([run.final.velocity[2], run.final.position[2]]), (run.states, run.final)

    x = jnp.stack([jnp.asarray(x) for x in (thrust, burn_time, ignition)])
    (speed, height), (states, final) = jax.jacrev(ends, has_aux=True)(x)
    return states, final, speed, height


def test_burnout_at_a_mass_ratio_of_a_thousand():
    """The acceleration grows a thousandfold: speed, height and the slope by the thrust."""
    time = 100.0
    thrust = 0.999 * START * U / time
    ts = jnp.array([0.0, 0.5 * time, time])
    _, final, slopes, _ = burn(thrust, time, 0.0, ts)
    np.testing.assert_allclose(final.mass, 1.0, rtol=1e-7)
    np.testing.assert_allclose(final.velocity[2], U * np.log(1e3), rtol=1e-9)
    height = U * time * (1.0 - np.log(1e3) / (1e3 - 1.0))
    np.testing.assert_allclose(final.position[2], height, rtol=1e-9)
    # d(u ln(m_0/m))/dF = u (t/u)/m.
    np.testing.assert_allclose(slopes[0], time, rtol=1e-6)


def test_thrust_that_jumps_between_the_times_that_are_saved():
    """Ignition and burnout lie within one interval, and nothing of the impulse is lost; the
    height has the slopes of the closed form by thrust, burn time and ignition."""
    ts = jnp.array([0.0, 30.0, 100.0])
    states, final, _, slopes = burn(200e3, 0.731, 40.117, ts)
    burnt = 200e3 * 0.731 / U
    np.testing.assert_allclose(final.mass, START - burnt, rtol=1e-12)
    gain = U * np.log(START / (START - burnt))
    np.testing.assert_allclose(final.velocity[2], gain, rtol=1e-11)
    np.testing.assert_array_equal(states.velocity[:, 1], np.zeros(3))

    def exact(x):
        thrust, time, ignition = x
        ratio = START / (START - thrust * time / U)
        way = U * time * (1.0 - jnp.log(ratio) / (ratio - 1.0))
        return way + U * jnp.log(ratio) * (100.0 - ignition - time)

    expected = jax.jit(jax.grad(exact))(jnp.array([200e3, 0.731, 40.117]))
    np.testing.assert_allclose(slopes, expected, rtol=1e-8)


def test_without_thrust_nothing_moves_and_slopes_are_finite():
    _, final, slopes, _ = burn(0.0, 10.0, 0.0, jnp.array([0.0, 5.0, 20.0]))
    np.testing.assert_array_equal(final.velocity, np.zeros(3))
    assert final.mass == START
    np.testing.assert_allclose(slopes[0], 10.0 / START, rtol=1e-10)


@pytest.mark.sweep
def test_a_separation_at_the_end_of_the_last_step_of_a_burn():
    """The phase ends at the burnout, which is a break as well: the dropped mass takes no part in
    the next burn, and the slope by the first burn time passes through the end."""

    @jax.jit
    def speed(first):
        one = SteeredThrust(FixedDirection(UP), 60e3, U, first)
        two = SteeredThrust(FixedDirection(UP), 30e3, U, 10.0, ignition=first)
        phases = [
            Phase(Scene((one,)), first, Separation(100.0), "first"),
            Phase(Scene((two,)), 10.0, name="second"),
        ]
        return simulate_mission(Mission(phases), at_rest(), accuracy=1e-11).final.velocity[2]

    def exact(first):
        left = START - 60e3 / U * first
        return U * (np.log(START / left) + np.log((left - 100.0) / (left - 200.0)))

    np.testing.assert_allclose(speed(20.0), exact(20.0), rtol=1e-10)
    expected = (exact(20.001) - exact(19.999)) / 2e-3
    np.testing.assert_allclose(jax.grad(speed)(20.0), expected, rtol=1e-6)


def test_an_apogee_at_rest():
    """Straight up, where the velocity vanishes at the event and has no direction: height and time
    of the apogee and their slopes."""

    def apogee(v):
        y = BodyState(jnp.zeros(3), v * UP)
        until = Event(lambda t, y: y.velocity[2], -1, within=30.0)
        flight = Mission([Phase(Scene((UniformGravity(-9.81 * UP),)), until, name="up")])
        run = simulate_mission(flight, y, accuracy=1e-11)
        found = jnp.stack([run.final.position[2], run.end])
        return found, (found, run.status)

    # The ends and their slopes from one program.
    slopes, (found, status) = jax.jit(jax.jacfwd(apogee, has_aux=True))(100.0)
    assert status == Status.EVENT
    np.testing.assert_allclose(found, [1e4 / 19.62, 100.0 / 9.81], rtol=1e-11)
    np.testing.assert_allclose(slopes, [100.0 / 9.81, 1.0 / 9.81], rtol=1e-9)
