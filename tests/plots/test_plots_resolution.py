"""Lines of figures and pages show the run itself between its saved times, however few these are."""

import json
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import ellipj

from jaxspace import Accuracy, Event, Mission, Phase, Scene, simulate, simulate_mission
from jaxspace.attitude import TorqueFreeBody
from jaxspace.bodies import BodyState
from jaxspace.constants import J2_EARTH, MU_EARTH, RADIUS_EARTH
from jaxspace.control import ClosedLoop, CommandedAcceleration
from jaxspace.control.point_laws import PID
from jaxspace.core import InputError
from jaxspace.mechanics import SimplePendulum
from jaxspace.orbits import Oblateness, PointGravity, TwoBody
from jaxspace.plots import trajectory_figure, view_page
from jaxspace.rotations import Quaternion
from jaxspace.simulation import simulate_batch
from jaxspace.solvers import DOP853

# Of what a component spans: a line is right to a thousandth, and the numbers are written to five
# digits; a page of many revolutions takes fewer frames.
LINE = 3e-3
EARTH = Scene((PointGravity(MU_EARTH), Oblateness(MU_EARTH, J2_EARTH, RADIUS_EARTH)))
# A transfer to the geostationary orbit, inclined by 28 degrees.
PERIGEE = BodyState(
    jnp.array([6.578e6, 0.0, 0.0]),
    10247.0 * jnp.array([0.0, np.cos(0.49), np.sin(0.49)]),
)
HOURS = 3600.0


def data_of(page):
    return json.loads(re.search(r"const data = (.*);\n", page.read_text()).group(1))


def drawn_at(data, name, ts):
    """Numbers of a page between its frames, as its script interpolates, (components, times)."""
    rows = np.array(data["readings"][name] if name in data["readings"] else data[name]).T
    return np.stack([np.interp(ts, data["times"], row) for row in rows])


def places(t0, t1):
    """Fifty times within a run, at no simple fractions of its duration."""
    return t0 + (t1 - t0) * (np.arange(50) + 0.37) / 50.5


def check_page(page, truth, planet=RADIUS_EARTH, error=LINE):
    """Position, altitude and speed of a page at fifty times against the run, `truth(t)`."""
    data = data_of(page)
    assert data["coarse"] == []
    ts = places(data["times"][0], data["times"][-1])
    y = truth(jnp.asarray(ts))
    position, speed = np.asarray(y.position), np.linalg.norm(y.velocity, axis=0)
    altitude = np.linalg.norm(position, axis=0) - planet
    shown = drawn_at(data, "position", ts)
    assert np.max(np.abs(shown - position)) < error * np.ptp(position, axis=1).max()
    np.testing.assert_allclose(drawn_at(data, "speed", ts)[0], speed, rtol=0.03)
    if "altitude" in data["readings"]:
        # To a hundredth of the altitude itself, also where it is least.
        np.testing.assert_allclose(drawn_at(data, "altitude", ts)[0], altitude, rtol=0.03)
    return data


def along(system, y0, t0=0.0):
    """The states of another run, which saves them at the times that are asked for."""
    return lambda ts: jax.tree.map(
        lambda x: x[..., 1:], simulate(system, y0, jnp.append(t0, ts)).states
    )


@pytest.mark.parametrize("system", [TwoBody(MU_EARTH), EARTH], ids=["closed form", "scene"])
def test_a_page_of_two_saved_times_shows_the_run(system, tmp_path):
    run = simulate(system, PERIGEE, jnp.array([0.0, 25.0 * HOURS]))
    page = view_page(run, tmp_path / "run.html", planet_radius=RADIUS_EARTH)
    data = check_page(page, along(system, PERIGEE))
    # Half a revolution after its start it is at 35,800 km.
    assert np.max(data["readings"]["altitude"]) > 3.5e7


def test_a_page_of_a_run_backwards_has_a_clock_that_runs_forwards(tmp_path):
    system = TwoBody(MU_EARTH)
    run = simulate(system, PERIGEE, jnp.array([0.0, -8.0 * HOURS]))
    page = view_page(run, tmp_path / "run.html", planet_radius=RADIUS_EARTH)
    back = along(system, PERIGEE)
    check_page(page, lambda ts: jax.tree.map(lambda x: x[..., ::-1], back(ts[::-1])))


def doubled(t, y):
    """A branch: another body at the same place, faster by a hundredth."""
    return BodyState(y.position, 1.01 * y.velocity)


def test_pages_of_a_mission_and_its_branch_show_each_phase(tmp_path):
    apogee = Event(lambda t, y: jnp.vdot(y.position, y.velocity), within=20.0 * HOURS, direction=-1)
    branch = Mission([Phase(TwoBody(MU_EARTH), 12.0 * HOURS, name="fall")], doubled, "stage")
    mission = Mission(
        [
            Phase(EARTH, 500.0, name="first"),
            Phase(EARTH, apogee, doubled, name="climb", branches=(branch,)),
            Phase(TwoBody(MU_EARTH), 0.0, name="no time"),
            Phase(EARTH, 12.0 * HOURS, name="orbit"),
        ]
    )
    result = simulate_mission(mission, PERIGEE)
    end = float(result["climb"].end)
    after = result["climb"].final
    after = BodyState(after.position, 1.01 * after.velocity)

    def truth(ts):
        # Before the end of the climb by a run of its own, of as many times.
        first = along(EARTH, PERIGEE)(jnp.minimum(ts, end))
        second = along(EARTH, after, end)(jnp.maximum(ts, end))
        return jax.tree.map(lambda a, b: jnp.where(ts < end, a, b), first, second)

    page = view_page(result, tmp_path / "run.html", planet_radius=RADIUS_EARTH)
    data = check_page(page, truth)
    assert [name for _, name in data["phases"]] == ["first", "climb", "no time", "orbit"]
    own = view_page(result["stage"], tmp_path / "stage.html", planet_radius=RADIUS_EARTH)
    check_page(own, along(TwoBody(MU_EARTH), after, end))
    # Phases of two saved times are not drawn as lines between these in a figure either.
    line = trajectory_figure(result).axes[0].get_lines()[0]
    assert len(line.get_xdata()) > 10


def test_jumps_in_place_are_shown_where_they_happen(tmp_path):
    """A burn at each crossing of the equator: the states between come from the last jump."""
    system = TwoBody(MU_EARTH)
    event = Event(lambda t, y: y.position[2], terminal=False, then=doubled, capacity=4)
    ts = jnp.array([600.0, 30.0 * HOURS])
    run = simulate(system, PERIGEE, ts, events=[event])
    more = jnp.linspace(*ts, 1001)
    fine = simulate(system, PERIGEE, more, events=[event]).states.position
    page = view_page(run, tmp_path / "run.html", planet_radius=RADIUS_EARTH)
    shown = drawn_at(data_of(page), "position", more)
    # The states of the fine run are those after each jump, which moves no place.
    assert np.max(np.abs(shown - fine)) < LINE * np.ptp(fine, axis=1).max()
    with pytest.raises(InputError, match="jumps"):
        run.at(700.0)


def test_many_revolutions_have_frames_for_each(tmp_path):
    """Two hundred: 1500 frames would be chords of a fifth of a circle."""
    system = TwoBody(MU_EARTH)
    y0 = BodyState(jnp.array([7e6, 0.0, 0.0]), jnp.array([0.0, 7.6e3, 0.0]))
    run = simulate(system, y0, jnp.array([0.0, 200.0 * 5900.0]))
    page = view_page(run, tmp_path / "run.html", planet_radius=RADIUS_EARTH)
    data = check_page(page, along(system, y0), error=1e-2)
    assert len(data["times"]) < 10_000


def test_lines_of_a_batch_show_each_of_its_runs():
    """Runs at different rates, of a scene and in closed form, saved at three times."""
    speeds = jnp.array([7.6e3, 8e3, 9e3])
    y0 = BodyState(
        jnp.array([7e6, 0.0, 0.0])[:, None] * jnp.ones(3),
        jnp.array([0.0, 0.6, 0.8])[:, None] * speeds,
    )
    ts = jnp.linspace(0.0, 5.0 * HOURS, 3)
    for system in (EARTH, TwoBody(MU_EARTH)):
        figure = trajectory_figure(simulate_batch(system, y0, ts))
        lines = figure.axes[0].get_lines()
        for run in range(3):
            one = jax.tree.map(lambda x, run=run: x[:, run], y0)
            for k in range(3):
                t, x = (np.asarray(z) for z in lines[3 * k + run].get_data())
                middle = places(t[0], t[-1])
                truth = np.asarray(along(system, one)(jnp.asarray(middle)).position[k]) / 1e3
                error = np.abs(np.interp(middle, t, x) - truth)
                assert np.max(error) < LINE * np.ptp(np.asarray(lines[run].get_ydata()))


def test_any_state_is_drawn_finer_than_it_was_saved():
    """A pendulum between three saved times, theta = 2 arcsin(k cd(w t)); its state is no position
    with its velocity."""
    system, span = SimplePendulum(1.0, 9.81), 40.0
    run = simulate(system, system.state(2.5), jnp.linspace(0.0, span, 3))
    line = trajectory_figure(run).axes[0].get_lines()[0]
    t, theta = (np.asarray(x) for x in line.get_data())
    ts = span * (np.arange(200) + 0.37) / 200.5
    k = np.sin(1.25)
    _, cn, dn, _ = ellipj(np.sqrt(9.81) * ts, k**2)
    truth = 2.0 * np.arcsin(k * cn / dn)
    assert np.max(np.abs(np.interp(ts, t, theta) - truth)) < LINE * 5.0


def test_a_closed_loop_of_few_saved_times_is_refused_and_says_what_to_write(tmp_path):
    """It cannot be repeated without its controller."""
    scene = Scene([CommandedAcceleration()])
    loop = ClosedLoop(scene, PID(1.2, 1.5), period=0.4)
    start = BodyState(jnp.array([1.0, -2.0, 0.5]), jnp.array([0.3, 0.1, -0.2]))
    with pytest.raises(InputError, match="num_saved"):
        view_page(loop.simulate(start, jnp.array([0.0, 40.0])), tmp_path / "run.html")
    with pytest.raises(InputError, match="num_saved"):
        mission = Mission([Phase(loop, 40.0)])
        view_page(simulate_mission(mission, start), tmp_path / "run.html")
    run = loop.simulate(start, jnp.linspace(0.0, 40.0, 201))
    data = data_of(view_page(run, tmp_path / "run.html"))
    shown = drawn_at(data, "position", np.asarray(run.ts))
    assert np.max(np.abs(shown - run.states.position)) < LINE * 2.0
    figure = trajectory_figure(loop.simulate(start, jnp.linspace(0.0, 40.0, 3)))
    assert figure.axes[0].get_title(loc="right").startswith("points only, not resolved")


def test_an_attitude_between_two_saved_times_is_that_of_the_run(tmp_path):
    free = TorqueFreeBody(jnp.array([2.0, 3.0, 4.0]))
    y0 = BodyState(attitude=Quaternion.identity(), omega=jnp.array([0.2, 1.0, 0.1]))
    accuracy = Accuracy(1e-6, method=DOP853())
    run = simulate(free, y0, jnp.array([0.0, 30.0]), accuracy=accuracy)
    data = data_of(view_page(run, tmp_path / "r.html"))
    assert data["coarse"] == []
    times, q = np.array(data["times"]), np.array(data["attitude"]).T
    ts = places(0.0, 30.0)
    low = np.searchsorted(times, ts) - 1
    share = (ts - times[low]) / (times[low + 1] - times[low])
    shown = q[:, low] + share * (q[:, low + 1] - q[:, low])
    shown = shown / np.linalg.norm(shown, axis=0)
    truth = simulate(free, y0, jnp.append(0.0, ts)).states.attitude.wxyz[:, 1:]
    # The cosine of half of the angle between them, of which 0.04 rad are not seen.
    assert np.max(1.0 - np.abs(np.sum(shown * truth, axis=0))) < 0.5 * 0.02**2
