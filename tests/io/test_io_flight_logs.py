"""Flight logs: reading, alignment, residuals, and the test against the runs of a campaign."""

import re

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import kstest

from jaxspace import Mission, Phase, Scene, simulate, simulate_mission
from jaxspace.bodies import BodyState, RigidBody
from jaxspace.core import InputError, output
from jaxspace.dispersion import Campaign, Normal
from jaxspace.io.flight_logs import read_log
from jaxspace.io.log_comparison import compare_log
from jaxspace.plots.flight_log import log_figure
from jaxspace.statistics.curves import curve_test
from jaxspace.vehicles.ground_gravity import GroundGravity

FOOT = 0.3048
G = 9.8


def start(speed=50.0):
    return BodyState(jnp.array([0.0, 0.0, 0.0]), jnp.array([3.0, 0.0, speed]))


def thrown():
    """A body thrown upwards with 50 m/s for 10 s; the run saves its ends alone."""
    return simulate(Scene([GroundGravity(G)], RigidBody(1.0)), start(), jnp.array([0.0, 10.0]))


def height(t, speed=50.0):
    return speed * t - 0.5 * G * t**2


def written(folder, times, values, head="time (s),Height (ft)"):
    path = folder / "log.csv"
    rows = [f"{t!r},{x!r}" for t, x in zip(times.tolist(), values.tolist(), strict=True)]
    path.write_text("\n".join([head, *rows]) + "\n")
    return path


def test_a_log_of_the_closed_form_has_no_residuals(tmp_path):
    t = np.linspace(0.5, 9.5, 60)
    path = written(tmp_path, t, height(t) / FOOT)
    found = compare_log(thrown(), path, {"Height": "position.2"})
    (channel,) = found.channels
    # The cubic between a thousand states is exact for a parabola.
    np.testing.assert_allclose(channel.predicted, height(t) / FOOT, rtol=1e-9)
    assert np.abs(channel.residual).max() < 1e-6 and found.outside == 0
    (row,) = found.rows
    assert row.samples == 60 and row.phase == "run" and row.unit == "ft"
    greatest, least = found.extremes
    assert greatest.measured == pytest.approx(50.0**2 / (2.0 * G) / FOOT, rel=1e-6)
    assert greatest.measured_time == pytest.approx(50.0 / G, abs=1e-6)
    assert least.difference == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("align", ["fit", "greatest Height", "Height > 100 ft", "Height > 30 m"])
def test_alignments_find_the_offset_of_the_clocks(tmp_path, align):
    t = np.linspace(0.0, 9.0, 400)
    path = written(tmp_path, t + 1234.5, height(t) / FOOT)
    found = compare_log(thrown(), path, {"Height": "position.2"}, align=align)
    # A crossing is interpolated linearly between samples.
    assert found.offset == pytest.approx(-1234.5, abs=2e-4)
    assert found.alignment == ("by least squares" if align == "fit" else align)


def test_residuals_and_missing_fields(tmp_path):
    """A bias and a missing field; a known offset; and a column that is named as the state."""
    t = np.arange(0.0, 8.0, 0.5)
    path = written(tmp_path, t - 2.0, height(t) + 3.0, "t [s];position.2 [m]")
    path.write_text(re.sub(r"^0\.5;.*$", "0.5;nan", path.read_text().replace(",", ";"), flags=re.M))
    found = compare_log(thrown(), path, align=2.0)
    (row,) = found.rows
    np.testing.assert_allclose([row.mean, row.rms], 3.0, rtol=1e-9)
    assert found.missing == {"position.2": 1} and row.samples == t.size - 1
    assert "1 samples of position.2 are missing" in str(found)


def test_channels_by_phase_and_functions_of_the_state(tmp_path):
    """Two phases with different gravity: each sample belongs to its phase."""
    scenes = [Scene([GroundGravity(g)], RigidBody(1.0)) for g in (G, 2.0 * G)]
    mission = Mission([Phase(scenes[0], 4.0, name="up"), Phase(scenes[1], 3.0, name="down")])
    run = simulate_mission(mission, start(), 0.0, num_saved=2)

    @output("m/s")
    def sink_rate(velocity):
        return -velocity[2]

    t = np.array([1.0, 4.0, 5.0, 7.0, 8.0])
    exact = np.where(t <= 4.0, G * t - 50.0, G * 4.0 - 50.0 + 2.0 * G * (t - 4.0))
    path = written(tmp_path, t, exact + [1.0, 1.0, -2.0, -2.0, 0.0], "time (s),sink (m/s)")
    found = compare_log(run, path, {"sink": sink_rate})
    up, down, every = found.rows
    assert (up.phase, up.samples, down.phase, down.samples) == ("up", 2, "down", 2)
    np.testing.assert_allclose([up.mean, down.mean, every.rms], [1.0, -2.0, 2.5**0.5], rtol=1e-9)
    assert found.outside == 1


def drop(samples):
    scene = Scene([GroundGravity(G)], RigidBody(1.0))
    zero = 0.0 * samples["speed"]
    velocity = jnp.stack([zero, zero, samples["speed"]])
    y0 = BodyState(jnp.zeros_like(velocity), velocity)
    return Mission([Phase(scene, 8.0)]), y0


def test_a_campaign_gives_mean_deviation_and_probability(tmp_path):
    """The height scatters by t times the deviation of the speed; a log of 3 deviations has that
    chi-square."""
    campaign = Campaign(drop, {"speed": Normal(50.0, 2.0)}, lambda run, _: {"t": run.end})
    run = campaign.replay(0, seed=1, num_saved=50).trajectory
    t = np.linspace(0.1, 7.9, 40)
    path = written(tmp_path, t, height(t, 56.0), "time (s),z (m)")
    found = compare_log(run, path, {"z": "position.2"}, campaign=campaign, runs=400)
    (x,) = found.channels
    # The standard errors of 400 runs: 0.1 m/s of the mean, 0.07 m/s of the deviation.
    np.testing.assert_allclose(x.mean, height(t, 50.0), atol=0.3 * 8.0)
    np.testing.assert_allclose(x.deviation / t, 2.0, rtol=0.12)
    assert x.test.modes == 1 and x.test.share > 0.999
    assert x.test.chi_square == pytest.approx(9.0, rel=0.4) and x.test.probability < 0.02
    assert x.share_inside == 0.0
    # An error of measurement adds to the deviation along the mode, 2 |t|.
    wide = compare_log(
        run, path, {"z": "position.2"}, campaign=campaign, runs=400, noise={"z": 100.0}
    )
    expected = x.test.chi_square / (1.0 + (100.0 / (2.0 * np.linalg.norm(t))) ** 2)
    assert wide.channels[0].test.chi_square == pytest.approx(expected, rel=0.25)
    assert "chi-square" in str(found)
    assert len(log_figure(found, "A throw").axes) == 2


def test_the_probability_of_curves_of_the_same_kind_is_uniform():
    """Curves of two modes, and another one of the same kind: by many repetitions."""
    rng = np.random.default_rng(3)
    t = np.linspace(0.0, 1.0, 50)
    shapes = np.stack([t, np.sin(5.0 * t)])
    found = []
    for _ in range(300):
        curves = rng.standard_normal((41, 2)) @ shapes
        test = curve_test(curves[0], curves[1:])
        assert test.modes == 2
        found.append(test.probability)
    assert kstest(found, "uniform").pvalue > 0.01


BAD = {
    "": "no heading with a column time",
    "Height (ft)\n1\n": "no heading with a column time",
    "time (s),Height (ft)\n": "no rows below its heading",
    "time,Height (ft)\n0,1\n": "time has no unit: it must be in a unit of time",
    "time (m),Height (ft)\n0,1\n": "time is in m: it must be in a unit of time",
    "time (s),Height (ft)\n0,1\n0,2\n": "line 3: the time is 0 s after 0 s: it must increase",
    "time (s),Height (ft)\n0,1\n,2\n": "line 3 has no time",
    "time (s),Height (ft)\n0,high\n": "line 2: Height is 'high': it must be a finite number",
    "time (s),Height (ft)\n0,1e999\n": "Height is '1e999': it must be a finite number",
    "time (s),Height (ft)\n0,1,2\n": "line 2 has 3 fields: it must have 2",
    "time (s),Height (ft),Height (m)\n0,1,1\n": "two columns 'Height'",
    "time (s),t (s),Height (ft)\n0,0,1\n": "several columns of times",
    "time (s),Height\n0,1\n": "the column Height has no unit: its heading must be such as",
    "time (s),Height (kg)\n0,1\n": "Height is in kg: it must be in a unit of its channel",
    "time (s),Height (ft)\n0,nan\n1,\n": "the column Height has no number",
    "time (s),Height (ft)\n20,1\n30,2\n": "they have no time in common",
    "time (s),Depth (ft)\n0,1\n": "has no column 'Height': it has Depth",
}


@pytest.mark.parametrize("text", BAD, ids=list(BAD.values()))
def test_logs_that_cannot_be_compared(tmp_path, run_of_a_throw, text):
    path = tmp_path / "log.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=re.escape(BAD[text])):
        compare_log(run_of_a_throw, path, {"Height": "position.2"})


@pytest.fixture(scope="module")
def run_of_a_throw():
    return thrown()


def test_requests_that_cannot_be_met(tmp_path, run_of_a_throw):
    t = np.linspace(0.0, 9.0, 20)
    path = written(tmp_path, t, height(t))
    log = read_log(path)
    run, z = run_of_a_throw, {"Height": "position.2"}
    with pytest.raises(InputError, match="no column with the name of a quantity of the run"):
        compare_log(run, log)
    with pytest.raises(InputError, match="one of position, velocity"):
        compare_log(run, log, {"Height": "altitude"})
    with pytest.raises(InputError, match="must be a single number"):
        compare_log(run, log, {"Height": "position"})
    with pytest.raises(InputError, match="declare it with jaxspace"):
        compare_log(run, log, {"Height": lambda position: position[2]})
    with pytest.raises(InputError, match="channels is empty"):
        compare_log(run, log, {})
    with pytest.raises(InputError, match="must be a number of seconds"):
        compare_log(run, log, z, align="apogee")
    with pytest.raises(InputError, match="align names 'Depth'"):
        compare_log(run, log, z, align="greatest Depth")
    with pytest.raises(InputError, match="which does not occur in the log"):
        compare_log(run, log, z, align="Height > 9000")
    with pytest.raises(InputError, match="must be a number, alone or with a unit"):
        compare_log(run, log, z, align="Height > 3 kg")
    with pytest.raises(InputError, match="finite number of seconds"):
        compare_log(run, log, z, align=np.inf)
