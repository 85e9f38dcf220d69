"""Pictures hold what they are given: the right panels, labels with units, every run that is good,
and no global state."""

import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace.bodies import BodyState
from jaxspace.dispersion import Dispersion
from jaxspace.plots import dispersion_figure, dispersion_page, trajectory_figure
from jaxspace.rotations import Quaternion
from jaxspace.simulation import MissionTrajectory, Status, Trajectory


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
        "perigee height against apogee height",
        "tumble rate [rad/s]",
        "impulse",
    ):
        assert expected in text
    assert "nothing scatters" in text  # the constant output has no contributors
    assert figure.axes[0].collections[0].get_offsets().shape == (399, 2)
    assert ("matplotlib.pyplot" in sys.modules) == before


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
    assert "no good run" in words(dispersion_figure(lost))


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
    assert page.count("Plotly.newPlot(") >= 4 and "<td>apogee height</td><td>km</td>" in page
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
    """A trajectory in the layout of the border: (runs, times, components)."""
    states = jax.tree.map(lambda x: jnp.moveaxis(x, 0, -1) if x.ndim > 1 else x, body(t))
    if not runs:
        return Trajectory(t, states, jnp.array(0), jnp.array(-1), {})
    many = jax.tree.map(lambda x: jnp.stack([x] * runs), (t, states))
    return Trajectory(*many, jnp.zeros(runs, int), -jnp.ones(runs, int), {}, shared=())


def test_trajectory_figure_of_a_mission(tmp_path):
    phases = tuple(trajectory(jnp.linspace(a, b, 50)) for a, b in ((0.0, 2.0), (2.0, 3.0)))
    mission = MissionTrajectory(
        phases, ("burn", "coast"), phases[1].final, jnp.array(3.0), jnp.array(0)
    )
    figure = trajectory_figure(mission, title="Flight")
    figure.savefig(tmp_path / "t.png", dpi=40)
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert labels == ["position\n[m]", "attitude", "Euler angles 3-1-3\n[deg]", "mass\n[kg]"]
    assert (
        figure.axes[-1].get_xlabel() == "time [s]"
        and "burn" in words(figure)
        and "coast" in words(figure)
    )
    psi, theta, _ = (line.get_ydata() for line in figure.axes[2].get_lines()[:3])
    t = np.linspace(0.0, 2.0, 50)
    np.testing.assert_allclose(psi, np.degrees(0.5 * t), atol=1e-9)
    np.testing.assert_allclose(theta, np.degrees(0.3), atol=1e-9)


def test_trajectory_figure_of_a_batch_and_of_any_state():
    figure = trajectory_figure(trajectory(jnp.linspace(0.0, 1.0, 5), runs=6), runs=4)
    assert len(figure.axes[0].get_lines()) == 3 * 4
    bare = Trajectory(jnp.arange(3.0), {"angle": jnp.arange(3.0)}, jnp.array(0), jnp.array(-1), {})
    figure = trajectory_figure(bare, units={"angle": "rad"})
    assert [axes.get_ylabel() for axes in figure.axes] == ["angle\n[rad]"]
