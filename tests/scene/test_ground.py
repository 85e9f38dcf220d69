"""A path through the planet is told in a sentence; a launch and a landing are not."""

import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace import Mission, Phase, Scene, load, simulate, simulate_batch, simulate_mission
from jaxspace.bodies import BodyState
from jaxspace.cli import main
from jaxspace.orbits import AtAltitude, Oblateness, PointGravity, SphereGravity
from jaxspace.orbits.initial import orbit_from_radius
from jaxspace.orbits.kepler import kepler_flow
from jaxspace.scene.ground_check import ground_warning, lowest_below_ground
from jaxspace.simulation import Event, Status

MU, RADIUS, J2 = 3.986e14, 6.378e6, 1.0826e-3
SCENE = Scene([PointGravity(MU), Oblateness(MU, J2, RADIUS)])
FILE = """
[planet]
mu = "398600 km^3/s^2"
radius = "6378 km"

[effects.{}]

[initial.orbit]
periapsis_radius = "{} km"
eccentricity = 0.1
true_anomaly = "170 deg"

[times]
end = "2 h"
"""


def state(q, e, f):
    return BodyState(*orbit_from_radius(q, MU, e, 0.5, true_anomaly=f))


def closed_form_track(n, T, q, e, f):
    """Times and states of runs in closed form, (3, times, runs)."""
    ts = np.linspace(0.0, 1.0, n)[:, None] * T
    y = jax.jit(state)(q, e, f)
    flow = jax.jit(kepler_flow)
    r, v = flow(y.position[:, None], y.velocity[:, None], jnp.asarray(ts), MU)
    return ts, BodyState(np.asarray(r), np.asarray(v))


def test_the_lowest_place_between_two_states():
    """Of ellipses and hyperbolas, forwards and backwards, from both ends alone, against
    a thousand states of each. Those between the two limits may be told or not."""
    g = np.random.default_rng(1)
    n = 400
    q, e = RADIUS * g.uniform(0.9, 1.1, n), g.uniform(0.0, 1.6, n)
    f = g.uniform(-1.0, 1.0, n) * np.where(e < 1.0, np.pi, 0.9 * np.arccos(-1.0 / np.maximum(e, 1)))
    T = g.uniform(0.0, 8e3, n) * g.choice([-1.0, 1.0], n)
    ts, ends = closed_form_track(2, T, q, e, f)
    _, dense = closed_form_track(1000, T, q, e, f)
    r = np.sqrt(np.sum(np.asarray(dense.position) ** 2, axis=0))
    lowest, end = r.min(axis=0), np.minimum(r[0], r[-1])
    depth = lowest_below_ground(ts, ends, RADIUS, MU)
    told = np.isfinite(depth)
    # A run alone needs no closer look where it stays above: what it gets is the same.
    for i in range(n):
        one = BodyState(ends.position[..., i], ends.velocity[..., i])
        np.testing.assert_array_equal(lowest_below_ground(ts[:, i], one, RADIUS, MU), depth[i])
    assert bool(ground_warning(np.where(told, lowest, np.inf), RADIUS, "")) == np.any(told)
    # A state that is saved below the surface is not told until it is deep.
    deep = (end < 0.989 * RADIUS) | ((lowest < 0.998 * RADIUS) & (lowest < end - 1.0))
    high = (lowest > 0.9995 * RADIUS) | ((lowest > 0.991 * RADIUS) & (lowest == end))
    assert np.all(told[deep]) and not np.any(told[high])
    assert deep.sum() > 80 and high.sum() > 80


def test_a_run_through_the_planet_is_told():
    """Saved at both ends alone, high above; a landing ends at the ground, and is not told."""
    y, ts = state(6.2e6, 0.1, 3.0), np.array([0.0, 6000.0])
    with pytest.warns(UserWarning, match=r"below the surface, 6\.\de\+06 m .*Oblateness.radius"):
        below = simulate(SCENE, y, ts, accuracy=1e-6)
    # Not a failure: its states are there.
    assert Status(int(below.status)) == Status.BELOW_GROUND and Status.BELOW_GROUND.good
    assert np.all(np.isfinite(below.final.position)) and "below the surface" in repr(below)
    landing = simulate(SCENE, y, ts, accuracy=1e-6, events=(Event(AtAltitude(0.0, RADIUS)),))
    assert int(landing.status) == 1
    # From the ground, along the way on which it came.
    launch = BodyState(landing.final.position, -landing.final.velocity)
    simulate(SCENE, launch, ts / 4.0, accuracy=1e-6)


def test_runs_through_the_planet_are_counted():
    y = state(jnp.array([6.2e6, 6.6e6, 6.3e6]), 0.1, 3.0)
    with pytest.warns(UserWarning, match="2 of 3 runs pass below the surface"):
        batch = simulate_batch(SCENE, y, np.array([0.0, 6000.0]), accuracy=1e-6)
    assert batch.status.tolist() == [Status.BELOW_GROUND, 0, Status.BELOW_GROUND]


def test_the_phase_below_the_ground_has_the_status():
    """And the mission: high above, then through the planet."""
    y = state(6.2e6, 0.1, 0.9 * np.pi)
    mission = Mission([Phase(SCENE, 100.0, name="high"), Phase(SCENE, 6000.0, name="low")])
    with pytest.warns(UserWarning, match="below the surface"):
        flight = simulate_mission(mission, y, accuracy=1e-6)
    assert int(flight["high"].status) == 0
    assert int(flight["low"].status) == int(flight.status) == Status.BELOW_GROUND


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_a_time_that_does_not_resolve_the_run_is_a_status(dtype):
    """A hundred seconds around an epoch so far away that there are less than sixteen numbers of the
    time between start and end; one of a batch leaves the others as they are."""
    far = 0.1 * 100.0 / np.finfo(dtype).eps
    y = jax.tree.map(lambda x: jnp.asarray(x, dtype), state(7e6, 0.1, 0.3))
    scene = jax.tree.map(lambda x: jnp.asarray(x, dtype), SCENE)
    starts = np.array([0.0, far, 1e20, 1e3], dtype)
    ts = jnp.asarray(np.stack([starts, starts + np.asarray([100.0, 100.0, 100.0, 0.0], dtype)]))
    batch = simulate_batch(
        scene, jax.tree.map(lambda x: x[:, None] * np.ones(4, dtype), y), ts, accuracy=1e-4
    )
    lost = int(Status.TIME_UNRESOLVED)
    assert batch.status.tolist() == [0, lost, lost, 0]
    assert np.all(np.isfinite(batch.states.position[..., [0, 3]]))
    assert np.all(np.isnan(batch.final.position[..., 1:3]))
    mission = Mission([Phase(scene, dtype(100.0), name="coast")])
    flight = simulate_mission(mission, y, dtype(far), accuracy=1e-4, throw=False)
    assert int(flight.status) == lost


def test_what_moves_the_state_besides_leaves_the_saved_states_alone():
    """Between two states a jump or a command may have raised the orbit."""
    ts, ends = closed_form_track(2, 6000.0, 6.2e6, 0.1, 3.0)
    assert SCENE.warning(ts[:, 0], jax.tree.map(lambda x: x[..., 0], ends), True)
    assert not SCENE.warning(ts[:, 0], jax.tree.map(lambda x: x[..., 0], ends), False)
    # Inside of a sphere without a hard surface nothing is wrong.
    sphere = Scene([SphereGravity(MU, RADIUS), Oblateness(MU, J2, RADIUS)])
    assert not sphere.warning(ts[:, 0], jax.tree.map(lambda x: 0.1 * x[..., 0], ends), True)


@pytest.mark.usefixtures("settings_stay")
def test_the_command_line_says_it_in_a_line(tmp_path, capsys):
    path = tmp_path / "orbit.toml"
    path.write_text(FILE.format("point_gravity", 6300))
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        assert main(["run", str(path), "--out", str(tmp_path)]) == 0
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("The run passes below the surface, 6.3e+06 m from the centre")


@pytest.mark.parametrize(
    "kind, periapsis, told",
    [
        ("point_gravity", 6300, True),
        ("point_gravity", 6700, False),
        ("sphere_gravity", 6300, False),
    ],
)
def test_a_file_knows_the_radius_of_its_planet(kind, periapsis, told, tmp_path):
    path = tmp_path / "orbit.toml"
    path.write_text(FILE.format(kind, periapsis))
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        load(path).simulate()
    assert ["planet.radius" in str(w.message) for w in found] == [True] * told
