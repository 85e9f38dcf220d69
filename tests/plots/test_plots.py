"""Figures hold what they are given: the right panels, labels with units, every good run, and no
global state."""

import dataclasses
import sys
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace import Accuracy, simulate
from jaxspace.attitude import TorqueFreeBody
from jaxspace.bodies import BodyState
from jaxspace.core import AbstractSystem
from jaxspace.dispersion import Dispersion
from jaxspace.gyros import GimbalState
from jaxspace.orbits import TwoBody
from jaxspace.plots import _resolution, dispersion_figure, dispersion_page, trajectory_figure
from jaxspace.rotations import Quaternion, to_euler_angles
from jaxspace.simulation import Status
from jaxspace.solvers import DOP853


@pytest.fixture
def dispersion():
    r = np.random.default_rng(1)
    a, b = r.standard_normal(400), r.standard_normal(400)
    outputs = {
        "apogee_height": 46000.0 + 800.0 * a,
        "perigee_height": 183.0 + b,
        "tumble_rate": np.full(400, 0.5),
    }
    outputs["apogee_height"][3] = np.nan
    status = np.zeros(400, int)
    status[3] = Status.NOT_FINITE
    units = {
        "apogee_height": "km",
        "perigee_height": "km",
        "tumble_rate": "rad/s",
        "impulse": "N s",
    }
    inputs = {"impulse": a, "misalignment": b}
    return Dispersion(
        inputs, outputs, status, np.ones(400, int), units, 5, 1.0, {"description": "a <b>stage</b>"}
    )


def words(figure):
    """Everything that is written on the axes."""
    found = []
    for axes in figure.axes:
        found += [
            axes.get_title(loc="left"),
            axes.get_xlabel(),
            axes.get_ylabel(),
            *(t.get_text() for t in axes.texts),
        ]
        found += [t.get_text() for t in axes.get_yticklabels()]
    return " | ".join(found)


def test_dispersion_figure(dispersion, tmp_path):
    before = "matplotlib.pyplot" in sys.modules
    figure = dispersion_figure(dispersion)
    figure.savefig(tmp_path / "d.png", dpi=40)
    assert (tmp_path / "d.png").stat().st_size > 5000
    text = words(figure)
    assert len(figure.axes) == 1 + 2 * 3
    for expected in (
        "apogee height [km]",
        "perigee height vs. apogee height",
        "tumble rate [rad/s]",
        "impulse",
    ):
        assert expected in text
    assert "no dispersion" in text  # the constant output has no contributors
    assert figure.axes[0].collections[0].get_offsets().shape == (399, 2)
    assert ("matplotlib.pyplot" in sys.modules) == before


def test_dispersion_figure_marks_what_is_required(dispersion):
    """A limit among the runs by a line, one far away at the edge: the axis stays that of the
    runs."""
    limits = {"perigee_height": (182.0, None), "apogee_height": (None, 1e6)}
    asked = dataclasses.replace(
        dispersion, attributes=dispersion.attributes | {"requirements": limits}
    )
    figure = dispersion_figure(asked, ["perigee_height", "apogee_height"])
    near, far = (axes for axes in figure.axes if axes.get_ylabel() == "runs")
    assert any(np.allclose(line.get_xdata(), 182.0) for line in near.lines)
    assert "required 1e+06 →" in [t.get_text() for t in far.texts]
    assert far.get_xlim()[1] < 51000.0


def test_a_long_title_is_not_cut(dispersion):
    title = "A kick stage with a very long name, " * 5
    figure = dispersion_figure(dispersion, ["perigee_height"], title=title)
    figure.draw_without_rendering()
    assert figure._suptitle.get_window_extent().x1 < figure.bbox.x1


def test_dispersion_figure_of_chosen_outputs(dispersion):
    figure = dispersion_figure(
        dispersion, ["perigee_height"], scatter=("impulse", "perigee_height"), title="Stage"
    )
    assert len(figure.axes) == 3 and figure.axes[0].get_xlabel() == "impulse [N s]"
    with pytest.raises(ValueError, match="height"):
        dispersion_figure(dispersion, ["height"])


def test_dispersion_figure_without_a_good_run(dispersion):
    lost = Dispersion(
        dispersion.inputs, dispersion.outputs, np.full(400, 5), dispersion.evaluations, {}, 0
    )
    assert "no successful run" in words(dispersion_figure(lost))


def test_dispersion_page_stands_alone(dispersion, tmp_path):
    page = dispersion_page(dispersion, tmp_path / "d.html", title="Kick & coast").read_text(
        encoding="utf-8"
    )
    assert (
        page.startswith("<!DOCTYPE html>")
        and "Kick &amp; coast" in page
        and "a &lt;b&gt;stage&lt;/b&gt;" in page
    )
    assert 'src="http' not in page and "<link" not in page  # nothing is fetched
    assert '<td class=text data-head="output">apogee height [km]</td>' in page
    assert page.count('<div class="plot') >= 5
    assert Status.NOT_FINITE.sentence in page and "399" in page


def body(t):
    """A body whose Euler angles 3-1-3 are 0.5 t, 0.3 rad and 2 t."""
    spin = (
        Quaternion.about(2, 0.5 * t)
        .then(Quaternion.about(0, 0.3 + 0.0 * t))
        .then(Quaternion.about(2, 2.0 * t))
    )
    zero = jnp.zeros_like(t)
    return BodyState(jnp.stack([t, zero, zero]), None, spin, None, 10.0 - t)


def trajectory(t, runs=0):
    """What a figure reads of a trajectory: components first, then times, then runs."""
    states = body(t)
    if not runs:
        return SimpleNamespace(ts=t, states=states, status=jnp.array(0))
    ts, states = jax.tree.map(lambda x: jnp.stack([x] * runs, axis=-1), (t, states))
    return SimpleNamespace(ts=ts, states=states, status=jnp.zeros(runs, int))


def test_trajectory_figure_of_a_mission(tmp_path):
    phases = tuple(trajectory(jnp.linspace(a, b, 50)) for a, b in ((0.0, 2.0), (2.0, 3.0)))
    mission = SimpleNamespace(phases=phases, names=("burn", "coast"))
    figure = trajectory_figure(mission, title="Flight")
    figure.savefig(tmp_path / "t.png", dpi=40)
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert labels == ["position\n[m]", "Euler angles 3-1-3\n[deg]", "mass\n[kg]"]
    assert (
        figure.axes[-1].get_xlabel() == "time [s]"
        and "burn" in words(figure)
        and "coast" in words(figure)
    )
    psi, theta, _ = (line.get_ydata() for line in figure.axes[1].get_lines()[:3])
    t = np.linspace(0.0, 2.0, 50)
    np.testing.assert_allclose(psi, np.degrees(0.5 * t), atol=1e-9)
    np.testing.assert_allclose(theta, np.degrees(0.3), atol=1e-9)


def test_trajectory_figure_of_a_batch():
    t = jnp.linspace(0.0, 1.0, 5)
    batch = trajectory(t, runs=6)
    figure = trajectory_figure(batch, runs=4)
    lines = figure.axes[0].get_lines()
    assert len(lines) == 3 * 4
    # The first run's x is the time itself.
    np.testing.assert_allclose(lines[0].get_ydata(), t)
    # Runs that share their times, and differ in their values.
    shared = SimpleNamespace(
        ts=t, states={"x": jnp.outer(t, jnp.arange(3.0))}, status=jnp.zeros(3, int)
    )
    lines = trajectory_figure(shared).axes[0].get_lines()
    for run, line in enumerate(lines):
        np.testing.assert_allclose(line.get_xdata(), t)
        np.testing.assert_allclose(line.get_ydata(), run * t)
    assert len(lines) == 3


def test_trajectory_figure_of_any_state():
    t = jnp.arange(3.0)
    bare = SimpleNamespace(ts=t, states={"angle": t}, status=jnp.array(0))
    figure = trajectory_figure(bare, units={"angle": "rad"})
    assert [axes.get_ylabel() for axes in figure.axes] == ["angle\n[rad]"]
    alone = SimpleNamespace(ts=t, states=t, status=jnp.array(0))
    assert [axes.get_ylabel() for axes in trajectory_figure(alone).axes] == ["state"]


def test_labels_have_the_units_that_a_state_declares():
    t = jnp.arange(3.0)
    states = GimbalState(t, t, t, t)
    figure = trajectory_figure(SimpleNamespace(ts=t, states=states, status=jnp.array(0)))
    assert [axes.get_ylabel() for axes in figure.axes] == [
        "theta\n[rad]",
        "psi\n[rad]",
        "theta rate\n[rad/s]",
        "angular momentum\n[kg m^2/s]",
    ]


def test_lengths_and_times_have_units_that_are_read():
    """Far lengths in km, or what a file says; the event that ends a run has its line."""
    t = jnp.linspace(0.0, 120.0, 5)
    states = BodyState(jnp.stack([7e6 + t, t, t]), jnp.stack([t, t, t]))
    run = SimpleNamespace(ts=t, states=states, status=jnp.array(0), event=jnp.array(0))
    figure = trajectory_figure(run)
    assert [a.get_ylabel() for a in figure.axes] == ["position\n[km]", "velocity\n[m/s]"]
    np.testing.assert_allclose(figure.axes[0].get_lines()[0].get_ydata(), 7e3 + 1e-3 * t)
    assert figure.axes[0].get_lines()[-1].get_xdata()[0] == 120.0 and "event" in words(figure)
    shown = {"position": ("mi", 1.0 / 1609.344), "velocity": ("m/s", 1.0), "time": ("min", 1 / 60)}
    figure = trajectory_figure(run, scale=lambda name, unit: shown[name])
    assert figure.axes[0].get_ylabel() == "position\n[mi]"
    assert figure.axes[-1].get_xlabel() == "time [min]"
    line = figure.axes[0].get_lines()[0]
    np.testing.assert_allclose(line.get_xdata(), t / 60.0)
    np.testing.assert_allclose(line.get_ydata(), (7e6 + t) / 1609.344)


def test_a_block_has_one_unit_in_all_phases():
    """A launch whose first phase stays below 100 km, where lengths are shown in m alone; a block
    of one name in another unit has a panel of its own."""
    low, high = (
        SimpleNamespace(ts=t, states=BodyState(1e3 * jnp.stack([t] * 3)), status=jnp.array(0))
        for t in (jnp.linspace(0.0, 50.0, 5), jnp.linspace(50.0, 300.0, 5))
    )
    figure = trajectory_figure(SimpleNamespace(phases=(low, high), names=("low", "high")))
    assert [axes.get_ylabel() for axes in figure.axes] == ["position\n[km]"]
    for line in figure.axes[0].get_lines()[:6]:
        np.testing.assert_allclose(line.get_ydata(), line.get_xdata())
    t = jnp.arange(3.0)
    other = SimpleNamespace(ts=t, states={"position": t}, status=jnp.array(0))
    figure = trajectory_figure(SimpleNamespace(phases=(low, other), names=("low", "other")))
    assert [axes.get_ylabel() for axes in figure.axes] == ["position\n[m]", "position"]


def test_trajectory_figure_of_a_run():
    """Of a run of `simulate`, as it stands."""
    from jaxspace import simulate
    from jaxspace.orbits import TwoBody

    y0 = BodyState(jnp.array([1.0, 0.0, 0.0]), jnp.array([0.0, 1.0, 0.0]))
    run = simulate(TwoBody(1.0), y0, jnp.linspace(0.0, 6.0, 20))
    figure = trajectory_figure(run)
    assert [axes.get_ylabel() for axes in figure.axes] == ["position\n[m]", "velocity\n[m/s]"]
    t, x = figure.axes[0].get_lines()[0].get_data()
    # The circle of unit rate: x = cos t, to the tolerance of a closed form.
    np.testing.assert_allclose(x, np.cos(t), atol=1e-12)
    assert set(np.asarray(run.ts)) <= set(t)


SPINNER = TorqueFreeBody(jnp.array([10.0, 11.0, 6.0]))
FAST = BodyState(attitude=Quaternion.identity(), omega=jnp.array([0.3, 0.1, 2.3 * jnp.pi]))
TIMES = jnp.linspace(0.0, 100.0, 102)


def phi(figure):
    """Times of the third of Euler's angles, as they are drawn, with the line's style and what the
    panel says."""
    axes = figure.axes[0]
    line = axes.get_lines()[2]
    return line.get_xdata(), line.get_linestyle(), axes.get_title(loc="right")


@pytest.mark.parametrize("dense", [None, False, True])
def test_a_fast_spin_is_drawn_as_it_turns(dense):
    """115 turns and 102 times: lines between these would be a slow motion that there is none of.
    The closed form and the dense output know what lies between; any other run is repeated."""
    how = {} if dense is None else {"dense": dense, "accuracy": Accuracy(1e-6, method=DOP853())}
    run = simulate(SPINNER, FAST, TIMES, **how)
    figure = trajectory_figure(run)
    ts, style, said = phi(figure)
    # A line is right to a thousandth of what the quaternion spans where it turns by a quarter of
    # a radian, of which each turn has 25; twice as many where the halves are too long.
    assert 115 * 20 < len(ts) < 115 * 60 and style == "-" and not said
    assert ts[0] == 0.0 and ts[-1] == 100.0
    if dense:
        theta = figure.axes[0].get_lines()[1].get_ydata()
        # Both are the same step from the same state, in another program.
        angles = np.degrees(np.asarray(to_euler_angles(run.at(ts[1000]).attitude)))
        assert abs(theta[1000] - angles[1]) < 1e-7


def test_a_fast_spin_under_a_controller_is_said_not_to_be_resolved():
    """What the commands do is not known; how fast an attitude turns its own rate says."""
    run = simulate(SPINNER, FAST, TIMES, accuracy=Accuracy(1e-6, method=DOP853()))
    ts, style, said = phi(trajectory_figure(dataclasses.replace(run, control={})))
    assert len(ts) == 102 and style == "None" and said.startswith("points only, not resolved")


@pytest.mark.parametrize("times, finer", [(402, False), (12, True)])
def test_any_part_of_a_state_is_drawn_at_times_that_resolve_it(times, finer):
    """One turn of an orbit has 40 of 402 times, or one, and then looks as if it stood still."""
    period = 2.0 * np.pi
    y0 = BodyState(jnp.array([1.0, 0.0, 0.0]), jnp.array([0.0, 1.0, 0.0]))
    accuracy = Accuracy(1e-6, method=DOP853())
    ts = jnp.linspace(0.0, 10.1 * period, times)
    figure = trajectory_figure(simulate(TwoBody(1.0), y0, ts, accuracy=accuracy))
    assert not any(axes.get_title(loc="right") for axes in figure.axes)
    t, x = (np.asarray(z) for z in figure.axes[0].get_lines()[0].get_data())
    assert (len(t) > times) == finer
    # The chord of a fortieth of a turn, and the tolerance of the run over ten of them.
    middle = 0.5 * (t[1:] + t[:-1])
    np.testing.assert_allclose(np.interp(middle, t, x), np.cos(middle), atol=5e-3)


class Towed(AbstractSystem):
    """A weight on a spring whose other end goes at 1 m/s: x = t + a cos(w t), w = 2 pi 1/s."""

    def vector_field(self, t, y):
        pull = -((2.0 * jnp.pi) ** 2) * (y.position - jnp.array([t, 0.0, 0.0]))
        return BodyState(y.velocity, pull)

    def invariants(self, t, y):
        return {}


@pytest.mark.parametrize("case", ["orbit", "spin", "once a turn"])
def test_the_vector_field_is_asked_where_the_states_do_not_show_that_they_are_resolved(
    case, monkeypatch
):
    """Its program takes longer than the figure. Saved once a turn, the weight goes evenly."""
    accuracy = Accuracy(1e-6, method=DOP853())
    if case == "orbit":
        y0 = BodyState(jnp.array([1.0, 0.0, 0.0]), jnp.array([0.0, 1.0, 0.0]))
        ts = jnp.linspace(0.0, 6.0, 102)
        run = simulate(TwoBody(1.0), y0, ts, accuracy=accuracy)
    elif case == "spin":
        run = simulate(SPINNER, FAST, 0.03 * TIMES, accuracy=accuracy)
    else:
        y0 = BodyState(jnp.array([1e-2, 0.0, 0.0]), jnp.array([1.0, 0.0, 0.0]))
        run = simulate(Towed(), y0, jnp.linspace(0.0, 101.0, 102), accuracy=accuracy)
    asked = []
    exactly = _resolution._derivatives
    monkeypatch.setattr(_resolution, "_derivatives", lambda p: asked.append(1) or exactly(p))
    trajectory_figure(run)
    assert bool(asked) == (case == "once a turn")
