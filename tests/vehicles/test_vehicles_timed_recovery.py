"""Parachutes that open at a time after the ignition."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace import Accuracy, Mission, simulate_mission
from jaxspace.bodies import BurningBody
from jaxspace.core import InputError
from jaxspace.rockets import Thrust
from jaxspace.vehicles import LaunchSite, Recovery, Vehicle, sounding_flight
from jaxspace.vehicles.air_drag import descent_rate
from jaxspace.vehicles.flights import flight_phases
from jaxspace.vehicles.ground_gravity import STANDARD_GRAVITY

DART = Vehicle(
    BurningBody(3.0, [0.3, 0.3, 0.01], [0.1, 0.1, 0.02], -0.3, 0.5),
    Thrust.of_motor(300.0, 2.5, 0.5),
    area=0.005,
    drag=0.4,
)
SITE = LaunchSite(2.0, 1.5)


def flight(*chutes):
    return sounding_flight(
        DART, SITE, chutes, rail_within=1.0, ascent_within=30.0, descent_within=400.0
    )


def test_the_phases_of_parachutes_with_times():
    names = flight_phases([Recovery(1.0, time=9.0), Recovery(9.0, lag=0.5, time=20.0)])
    assert names == ["rail", "ascent", "parachute 1", "wait 2", "parachute 2"]
    mission, _ = flight(Recovery(1.0, time=9.0), Recovery(9.0, lag=0.5, time=20.0))
    assert [phase.name for phase in mission.phases] == names
    with pytest.raises(InputError, match=r"Recovery\.time is given together with a height: omit"):
        Recovery(1.0, height=300.0, time=9.0)
    with pytest.raises(InputError, match=r"Recovery\.time is -1: it must be positive"):
        Recovery(1.0, time=-1.0)


def test_parachutes_open_at_their_times():
    """The first one on the way up, the second one half a second after its time, and the third one,
    whose time is over, as soon as the second one is open."""
    chutes = Recovery(0.02, time=4.0), Recovery(0.1, lag=0.5, time=12.0), Recovery(1.0, time=12.2)
    mission, y0 = flight(*chutes)
    run = simulate_mission(mission, y0, accuracy=Accuracy(1e-6))
    ends = {name: float(run[name].ts[-1]) for name in run.names}
    # The zero of a line: roundings of a time of 12 s.
    for name, end in (("ascent", 4.0), ("parachute 1", 12.0), ("wait 2", 12.5)):
        assert ends[name] == pytest.approx(end, abs=1e-12)
    assert ends["parachute 2"] == ends["wait 2"]
    assert float(run["ascent"].final.velocity[2]) > 20.0
    assert abs(float(run.final.position[2])) < 1e-6
    # The steady rate of the third one; air that thins over 8.5 km lags behind by v^2/(2 g) over it.
    rate = descent_rate(3.0, 1.0, 1.225, STANDARD_GRAVITY)
    np.testing.assert_allclose(-run.final.velocity[2], rate, rtol=2e-3)


def test_the_end_of_the_ascent_moves_with_the_time():
    """By the velocity there; a time on the rail ends the ascent at once, and moves nothing."""

    def end(time):
        mission, y0 = flight(Recovery(1.0, time=time))
        run = simulate_mission(Mission(mission.phases[:2]), y0, accuracy=Accuracy(1e-8))
        return run.final.position, (run.final.velocity, run.end)

    slopes = jax.jit(lambda time: jax.jvp(end, (time,), (1.0,), has_aux=True))
    _, slope, (velocity, _) = slopes(jnp.asarray(6.0))
    np.testing.assert_allclose(slope, velocity, rtol=1e-9, atol=1e-9)
    _, slope, (_, at) = slopes(jnp.asarray(0.01))
    assert float(at) > 0.1 and np.all(np.asarray(slope) == 0.0)
