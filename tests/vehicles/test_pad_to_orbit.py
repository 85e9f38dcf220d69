"""Missions from the pad to orbit: the gradient from end to end against differences of a mapped
batch, many runs at once with a failed one among them, and a kick with a gravity turn from a file.
"""

from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate

from jaxspace import load, simulate_mission_batch
from jaxspace.bodies import StandardAtmosphere
from jaxspace.constants import MU_EARTH
from jaxspace.simulation import Status, simulate_compact

pytestmark = pytest.mark.sweep

SCENES = Path(__file__).resolve().parents[2] / "examples" / "scenes"
FILE = SCENES / "pad_to_orbit.toml"
INPUTS = ("lift-off mass", "drag area", "thrust", "dropped stage", "pitch", "tangent")


@pytest.fixture(scope="module")
def pad():
    file = load(FILE)
    return file.mission, file.y0


def places(given):
    """What the inputs multiply: in every phase, the first stage, the second."""
    mission, y0 = given
    first, coast, second = (phase.system.effects for phase in mission.phases[:3])
    return (
        *(y0.mass, first[1].area, coast[1].area, second[1].area, first[2].mean_thrust),
        *(mission.phases[0].then.dropped, first[2].steering.angles, second[2].steering.tangent),
    )


def changed(given, x):
    """Mission and start with their inputs multiplied by `x`, (6, *runs); the area is the same in
    three phases."""
    factors = [x[k] for k in (0, 1, 1, 1, 2, 3, 4, 5)]
    new = [jnp.multiply.outer(a, f) for a, f in zip(places(given), factors, strict=True)]
    return eqx.tree_at(places, given, tuple(new))


def apoapsis(given, x):
    """Its distance from the centre, m, where the mission ends."""
    flight = simulate_compact(*changed(given, x), steps=60)
    return jnp.linalg.norm(flight.final.position), flight.error


def test_gradient_from_end_to_end(pad):
    """Reverse mode through four phases, two separations and an event, against central differences
    of 1e-5, whose error is some 1e-8 of the value."""
    one = jnp.ones(len(INPUTS))
    (value, error), slopes = jax.jit(jax.value_and_grad(lambda x: apoapsis(pad, x), has_aux=True))(
        one
    )
    assert 9.4e6 < value < 9.6e6 and error < 1e-4
    step = 1e-5
    moved = 1.0 + step * np.concatenate([np.eye(6), -np.eye(6)])
    far = jax.jit(jax.vmap(lambda x: apoapsis(pad, x)[0]))(jnp.asarray(moved))
    np.testing.assert_allclose(slopes, (far[:6] - far[6:]) / (2.0 * step), rtol=1e-5, atol=20.0)


def test_many_runs_from_the_pad(pad):
    """Runs on the last axis, of every state of every phase, against the fixed steps of single runs;
    a run without a mass is marked, and is NaN from end to end, alone."""
    x = np.ones((len(INPUTS), 4))
    x[2, 1], x[5, 2], x[0, 3] = 1.01, 0.9, np.nan
    run = simulate_mission_batch(*changed(pad, jnp.asarray(x)), accuracy=1e-7)
    good = [0, 1, 2]
    assert run.status.tolist() == [Status.EVENT] * 3 + [Status.NOT_FINITE]
    assert run.final.position.shape == (3, 4) and run.end.shape == (4,)
    assert all(phase.states.velocity.shape == (3, 2, 4) for phase in run.phases)
    assert np.all(np.isnan(run.final.position[:, 3])) and np.all(np.isfinite(run.end[:3]))
    alone = jax.jit(jax.vmap(lambda x: simulate_compact(*changed(pad, x), steps=60)))(x.T[good])
    # Both err by some 1e-5 where the flight crosses the kinks of its tables.
    np.testing.assert_allclose(run.final.position[:, good].T, alone.final.position, atol=1e3)
    np.testing.assert_allclose(run.end[:3], alone.end, rtol=1e-4)
    np.testing.assert_allclose(run.final.mass[:3], alone.final.mass, rtol=1e-9)
    assert np.all(np.ptp(run.end[:3]) > 10.0)


RADIUS, AIR_RATE = 6378137.0, 7.2921159e-5
MACH, DRAG = (0.0, 0.8, 1.1, 1.5, 2.5, 5.0), (0.30, 0.32, 0.55, 0.48, 0.35, 0.25)
air_at = jax.jit(lambda height: StandardAtmosphere().air_at(height))


def ascent_rate(t, y, thrust, impulse, law):
    """The equations of the file, written out: position, velocity and mass."""
    r, v, m = y[:3], y[3:6], y[6]
    up = r / np.linalg.norm(r)
    w = v - AIR_RATE * np.array([-r[1], r[0], 0.0])
    air, speed = air_at(np.linalg.norm(r) - RADIUS), np.linalg.norm(w)
    coefficient = np.interp(speed / air.sound_speed, MACH, DRAG)
    force = -0.5 * float(air.density) * coefficient * 1.13 * speed * w
    east = np.array([-up[1], up[0], 0.0])
    if law == "tangent":
        pitch = np.arctan(0.45 - 0.0016 * (t - 155.0))
        along = np.cos(pitch) * east + np.sin(pitch) * up
    else:
        along = up if law == "up" else w / speed
    a = (force + thrust * along) / m - MU_EARTH * r / np.linalg.norm(r) ** 3
    return np.concatenate([v, a, [-thrust / (impulse * 9.80665)]])


def test_a_kick_and_a_gravity_turn_from_a_file():
    """The phases of the file up to the last burnout, against SciPy's steps of the equations written
    out above, with the kick as a turn by three degrees towards the east."""
    file = load(SCENES / "gravity_turn.toml")
    flown = simulate_compact(file.mission, file.y0, steps=60)
    first = 9250.0 * 311.0 * 9.80665 / 190e3
    last = 2050.0 * 343.0 * 9.80665 / 25.8e3
    y = np.array([RADIUS, 0.0, 0.0, 0.0, 465.1, 0.0, 12744.0])
    legs = [
        (0.0, 12.0, (190e3, 311.0, "up"), 0.0),
        (12.0, first, (190e3, 311.0, "air"), 950.0),
        (first, first + 6.5, (0.0, 311.0, "up"), 44.0),
        # Ignition is at 155 s, a little after the coast.
        (first + 6.5, 155.0, (0.0, 343.0, "tangent"), 0.0),
        (155.0, 155.0 + last, (25.8e3, 343.0, "tangent"), 0.0),
    ]
    for start, end, given, dropped in legs:
        options = {"args": given, "method": "DOP853", "rtol": 1e-8, "atol": 1e-6}
        y = scipy.integrate.solve_ivp(ascent_rate, (start, end), y, **options).y[:, -1]
        y[6] -= dropped
        if start == 0.0:
            up = y[:3] / np.linalg.norm(y[:3])
            wind = AIR_RATE * np.array([-y[1], y[0], 0.0])
            k, w = np.radians(3.0), y[3:6] - wind
            across = np.array([-w[1], w[0], 0.0])
            assert abs(w @ up / np.linalg.norm(w) - 1.0) < 1e-3
            y[3:6] = np.cos(k) * w + np.sin(k) * across + wind
    found = flown.phases[3].before
    # Both err by some 1e-5 where the flight crosses the kinks of the table of its drag.
    np.testing.assert_allclose(found.position, y[:3], atol=100.0)
    np.testing.assert_allclose(found.velocity, y[3:6], atol=1.0)
    np.testing.assert_allclose(found.mass, y[6], rtol=1e-9)
    r, v = (np.asarray(x) for x in (flown.final.position, flown.final.velocity))
    # At the apogee of an orbit whose perigee is above the air.
    assert abs(r @ v) / np.linalg.norm(r) < 1e-3 and flown.phases[4].happened
    energy, momentum = v @ v / 2.0 - MU_EARTH / np.linalg.norm(r), np.linalg.norm(np.cross(r, v))
    axis = -0.5 * MU_EARTH / energy
    perigee = axis * (1.0 - np.sqrt(1.0 - momentum**2 / (MU_EARTH * axis)))
    assert perigee - RADIUS > 150e3
