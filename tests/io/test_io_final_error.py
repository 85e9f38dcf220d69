"""Scene files that ask for the error at the end: it is met, against the closed form; campaigns take
its tolerance; the report says what it took; and what makes no sense is refused by its key."""

import jax
import numpy as np
import pytest

from jaxspace.io import SceneError, load
from jaxspace.io._requests.final_error import rounded_down, tolerance_of
from jaxspace.io.reports.run import mission_report, run_report
from jaxspace.orbits import TwoBody
from jaxspace.simulation import Trajectory

ASKED = 'final_error = { position = "1 m", velocity = "1 mm/s" }'
# By a method of order eight, because the closed form would have no error.
SCENE = f"""
{ASKED}
method = "DOP853"

[planet]
mu = "398600.4418 km^3/s^2"

[effects.point_gravity]

[initial]
position = ["7000 km", "0 km", "0 km"]
velocity = ["0 km/s", "8 km/s", "1 km/s"]

[times]
end = "10 h"
samples = 3

[dispersion]
outputs = ["speed"]

[dispersion.inputs]
"initial.velocity.1" = {{ deviation = "1 m/s" }}
"""
MU = 398600.4418e9


def loaded(tmp_path, asked=ASKED, more=""):
    return load(tmp_path / "orbit.toml", text=SCENE.replace(ASKED, f"{asked}\n{more}"))


def errors(file, final):
    """The errors of position, m, and velocity, m/s, of the nominal run."""
    exact = jax.jit(lambda y: TwoBody(MU).closed_form().flow(36000.0, y))(file.y0)
    pairs = (final.position, exact.position), (final.velocity, exact.velocity)
    return [float(np.linalg.norm(np.asarray(a) - np.asarray(b))) for a, b in pairs]


def test_the_nominal_run_has_the_error_and_the_report_says_what_it_took(tmp_path):
    file = loaded(tmp_path)
    run = file.simulate()
    assert isinstance(run, Trajectory)
    position, velocity = errors(file, run.final)
    estimate = float(run.stats["final_error"])
    worst = max(position / 1.0, velocity / 1e-3)
    # Two runs do not tell how fast errors fall: the estimate may be too small by the spread of
    # that, and not by more than three times.
    assert worst <= 1.0 and estimate <= 1.0 and worst <= 3.0 * estimate
    report = run_report(file, run)
    assert "position 1 m, velocity 1 mm/s" in report
    assert f"position {estimate:.3g} m, velocity {estimate:.3g} mm/s" in report
    assert f"{int(run.stats['final_error_evaluations'])} evaluations in total" in report
    # The errors of a method of order eight fall with the eighth power of the steps.
    price = float(run.stats["final_error_price"])
    assert f"{price:.2g} times the evaluations" in report
    np.testing.assert_allclose(price, 10.0 ** (1.0 / 8.0), rtol=0.1)
    assert f"{100.0 - 100.0 / price:.0f} % fewer" in report
    # That the position is right to one metre says nothing about how it is to be read.
    assert "position [km]" in report and "velocity [km/s]" in report


def test_a_campaign_takes_the_tolerance_of_the_nominal_run(tmp_path):
    file = loaded(tmp_path, "final_error = 1e-7")
    nominal = file.nominal_mission()
    size = 1e-7 * np.linalg.norm(nominal.final.position)
    assert errors(file, nominal.final)[0] < size
    took = tolerance_of(nominal.phases[0])
    assert 0.9 * took <= file.tolerance <= took
    accuracy = file.campaign().accuracy
    assert accuracy is not None and accuracy.rtol == file.tolerance
    report = mission_report(file, nominal, nominal)
    assert "1e-07 of every part of the state" in report


@pytest.mark.parametrize(
    ("tolerance", "rounded"), [(1.0e-9, 1.0e-9), (3.999e-12, 3.9e-12), (9.99e-5, 9.9e-5)]
)
def test_a_tolerance_is_rounded_down(tolerance, rounded):
    assert rounded_down(tolerance) == rounded


@pytest.mark.parametrize(
    ("asked", "more", "said"),
    [
        ("final_error = -1", "", "final_error is -1: it must be a number"),
        ("final_error = 1e-20", "", "final_error is 1e-20: it must be a number at least"),
        ("final_error = true", "", "final_error is true: it must be a number"),
        ("final_error = {}", "", "final_error is {}: it must name a part"),
        (ASKED.replace("position", "positon"), "", "final_error.positon .* Did you mean position?"),
        (ASKED.replace('1 m"', '1 kg"'), "", "final_error.position is .* unit of length"),
        (ASKED.replace('1 m"', '0 m"'), "", 'final_error.position is "0 m".* positive'),
        ('final_error = { omega = "1 deg/s" }', "", "final_error.omega is not a known part"),
        ('final_error = { mass = "1 g" }', "", "one of position, velocity"),
        (ASKED, "accuracy = 1e-9", "final_error is given together with accuracy"),
    ],
)
def test_what_makes_no_sense_is_refused_by_its_key(tmp_path, asked, more, said):
    with pytest.raises(SceneError, match=said):
        loaded(tmp_path, asked, more)
