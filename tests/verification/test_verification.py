"""The hard cases, the laws and the fuzz tests: a sample of each, and that each of them can fail."""

import dataclasses
import fnmatch
import functools
import json
import math

import equinox as eqx
import forms
import forms.public
import forms.systems
import fuzz_errors
import fuzz_nan
import fuzz_page
import jax
import jax.numpy as jnp
import mp_trace
import numpy as np
import pytest
import truths
from forms.form import Form
from mpmath import mp, mpf
from systems import SAMPLES

from jaxspace.cli import main
from jaxspace.core import AbstractSystem, InputError
from jaxspace.core.vectors import unit
from jaxspace.orbits import TwoBody
from jaxspace.verification import CASES, run_cases, verify
from jaxspace.verification.report import Verification

BY_NAME = {case.name: case for case in CASES}
QUICK = (
    *("core: angle of the origin", "core: end of a range", "core: (e^x - 1)/x at its branch"),
    *("attitude: no cord for no change", "rockets: gain of a grain"),
)
STORED = json.loads(truths.TRUTHS.read_text())
SAMPLE = tuple(BY_NAME[name] for name in QUICK)


def test_there_are_cases_of_every_room():
    packages = {name.split(":")[0] for name in BY_NAME}
    assert len(CASES) == len(BY_NAME) >= 60
    assert packages == {
        *("core", "rotations", "bodies", "orbits", "attitude", "gyros", "rockets"),
        *("simulation", "dispersion", "optimization"),
    }


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_every_case_has_a_truth_of_its_shape(case):
    value, slopes = case.truth()
    assert case.value is not None or truths.stored(case, STORED)
    assert not any(math.isnan(x) for x in value)
    assert not slopes or np.shape(slopes) == (len(value), len(case.inputs))
    assert case.why


@pytest.mark.parametrize(
    "name",
    [
        "core: Stumpff functions near zero",
        "attitude: cones of 1e-12 rad",
        "rockets: damping, l = k",
    ],
)
def test_the_stored_truths_are_those_that_the_script_computes(name):
    found, (value, slopes) = truths.truth(BY_NAME[name]), BY_NAME[name].truth()
    assert tuple(map(float, found["value"])) == value
    assert np.array_equal(np.asarray(found["slopes"], float), slopes)


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_a_sample_of_the_cases_holds(precision):
    result = run_cases(SAMPLE, precision=precision)
    assert result.passed, str(result)
    assert {row.verdict for row in result.rows} <= {"holds", "left out"}
    left_out = {row.name for row in result.rows if row.verdict == "left out"}
    assert left_out == ({"rockets: gain of a grain"} if precision == "float32" else set())
    assert all(f"skipped, {name}" in str(result) for name in left_out)


def wrong(case, **changes):
    return dataclasses.replace(case, **changes)


@pytest.mark.parametrize(
    "changes",
    [
        {"value": (1e-15,)},
        {"slopes": ((0.0, 1e-13),)},
        {"slopes": ((0.0, math.inf),)},
        {"value": (math.nan,)},
    ],
)
def test_a_wrong_case_fails(changes):
    (row,) = run_cases([wrong(BY_NAME["core: angle of the origin"], **changes)]).rows
    assert row.verdict == "fails"


@pytest.fixture
def few(monkeypatch, tmp_path, settings_stay):
    """The command line, with the sample in the place of all cases."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))

    def use(cases):
        monkeypatch.setattr("jaxspace.verification.run_cases", functools.partial(run_cases, cases))

    return use


def test_the_command_prints_writes_and_ends_with_0_or_1(few, capsys, tmp_path):
    few(SAMPLE)
    path = tmp_path / "found.json"
    assert main(["verify", "--json", str(path)]) == 0
    printed = capsys.readouterr().out
    assert all(name in printed for name in QUICK) and "5 hold, 0 fail" in printed
    assert json.loads(path.read_text())["passed"]
    few((*SAMPLE, wrong(SAMPLE[0], name="wrong", value=(0.5,))))
    assert main(["verify", "--json", str(path)]) == 1
    assert "1 fail" in capsys.readouterr().out
    kept = json.loads(path.read_text())
    assert [row["name"] for row in kept["cases"] if row["verdict"] == "fails"] == ["wrong"]


def test_a_device_that_is_not_there_is_named(few, capsys):
    few(SAMPLE[:1])
    assert main(["verify", "--device", "tpu"]) == 2
    assert "tpu" in capsys.readouterr().err


def test_a_precision_that_does_not_exist_is_refused():
    with pytest.raises(InputError, match="float16"):
        run_cases(SAMPLE, precision="float16")


def test_json_holds_what_is_infinite():
    (row,) = run_cases([wrong(SAMPLE[0], value=(math.inf,))]).rows
    text = Verification((row,), "float64", "cpu", 1.0).json()
    assert json.loads(text)["cases"][0]["error"] == "inf"


# Laws.


class Leaking(AbstractSystem):
    """A two-body system whose field is not that of its invariants."""

    rest: TwoBody
    loss: float = eqx.field(static=True)

    def vector_field(self, t, y):
        rate = self.rest.vector_field(t, y)
        return eqx.tree_at(lambda r: r.velocity, rate, rate.velocity - self.loss * y.velocity)

    def invariants(self, t, y):
        return self.rest.invariants(t, y)


def test_the_laws_hold_for_a_system_and_find_a_leak():
    orbit = next(s for s in SAMPLES if s.name == "two_body")
    report = verify(orbit.system, orbit.state, 600.0)
    assert report.passed, report
    assert "closed form" in repr(report) and "all laws are satisfied" in repr(report)
    leak = verify(Leaking(orbit.system, 1e-6), orbit.state, 600.0)
    failed = {law.name for law in leak.laws if not law.holds}
    assert "invariants: energy" in failed and "reversibility" not in failed
    assert "FAILS" in repr(leak) and not leak.passed


def test_the_laws_refuse_single_precision():
    orbit = SAMPLES[0]
    with pytest.raises(InputError, match="float64"):
        verify(orbit.system, jnp.float32(1.0), 1.0)


# The fuzz tests.


def test_the_trace_in_mpmath_is_the_function():
    with mp.workdps(40):
        for name in ("orbits: parabola, exact", "attitude: pendulum of no amplitude"):
            case = BY_NAME[name]
            trace = mp_trace.traced(case.function, case.inputs)
            found = mp_trace.evaluate(trace, [np.asarray(case.inputs)])[0]
            assert isinstance(found[0], mpf)
            np.testing.assert_allclose(
                np.asarray(found, float), case.truth()[0], rtol=1e-15, atol=1e-15
            )


FEW = fuzz_errors.Limits(places=8, ascents=6, slopes=3)


def test_the_search_finds_nothing_in_a_sample_and_a_loss_where_there_is_one():
    def lossy(x):
        return (1.0 - jnp.cos(x[:1])) / x[:1] ** 2

    def kinked(x):
        return jnp.abs(x[:1] - 1.0), jnp.sqrt(x[:1])

    names = ("exponential_quotient", "quickest", "principal_moments", "best_ratio")
    some = [form for form in forms.forms() if form.name in names]
    assert len(some) == len(names)
    with mp.workdps(fuzz_errors.DIGITS):
        rows = [fuzz_errors.search(fuzz_errors.Subject(form), FEW) for form in some]
        for row in rows:
            assert row.places > 8 and row.slope_places > 0, row
            assert row.value < fuzz_page.DEFECT and row.slopes < fuzz_page.DEFECT, row
        bad = fuzz_errors.search(fuzz_errors.Subject(Form(lossy, ("core.lossy",), [(1e-5,)])), FEW)
        assert bad.value > fuzz_page.DEFECT and bad.slopes > fuzz_page.DEFECT
        # A kink and the end of a range are no error.
        odd = fuzz_errors.search(
            fuzz_errors.Subject(Form(kinked, ("core.kinked",), [(1.0,), (0.0,)])), FEW
        )
        assert odd.value < fuzz_page.DEFECT and odd.slopes < fuzz_page.DEFECT
    page = fuzz_page.page([*rows, bad])
    assert all(row.name in page for row in (*rows, bad))
    assert str(bad.inputs[0]) in page and str(rows[0].inputs[0]) not in page


def test_the_search_rounds_a_vector_by_its_length():
    # Along itself the derivative of a direction vanishes, and a rounding of 1 is left.
    place = (-2.777988453424925e-10, -2.3458952040163563e-16, 0.0013241234888774634)

    def error(vectors):
        subject = fuzz_errors.Subject(Form(unit, ("core.unit",), [place], vectors=vectors))
        return subject.slope_error(np.array(place), np.random.default_rng(0))

    with mp.workdps(fuzz_errors.DIGITS):
        assert error((3,)) < 2.0 and error(()) > fuzz_page.DEFECT


def test_the_search_finds_a_wrong_rule_of_a_derivative_and_a_silent_nan():
    @jax.custom_jvp
    def square(x):
        return x * x

    square.defjvps(lambda d, _, x: 2.0 * x * d * (1.0 + 1e-12))

    def holed(x):
        return jnp.where(x[:1] == 2.0, jnp.nan, x[:1]) * 1.0

    with mp.workdps(fuzz_errors.DIGITS):
        subject = fuzz_errors.Subject(Form(lambda x: square(x[:1]), ("core.square",), [(3.0,)]))
        found = fuzz_errors.search(subject, FEW)
        assert found.value < fuzz_page.DEFECT < found.slopes
        # The twin has a value where the function has none.
        subject = fuzz_errors.Subject(Form(holed, ("core.holed",), [(2.0,)], exact=lambda x: x[:1]))
        assert subject.error(np.array([2.0])) == math.inf


def test_every_public_formula_is_searched_or_left_out_for_a_reason():
    every = (*forms.forms(), *forms.systems.forms())
    searched = {name for form in every for name in form.computes}
    public = forms.public.public_names()
    rest = public - searched
    left_out = forms.public.left_out(rest)
    assert searched <= public
    assert rest == {name for some in left_out.values() for name in some}
    patterns = [p for some in forms.public.LEFT_OUT.values() for p in some]
    idle = [p for p in patterns if not any(fnmatch.fnmatch(name, p) for name in rest)]
    assert not idle
    cases = {case.function.__name__ for case in CASES}
    assert forms.OF_CASES.keys() <= cases
    # A run is judged by its status, a distribution has no formula to search.
    assert cases - forms.OF_CASES.keys() == {
        *("stepped", "time_of_apoapsis", "burnt", "fall_into_the_centre", "out_of_steps"),
        *("beside_a_failure", "tails"),
    }
    starts = {form.name: form.starts for form in every}
    assert len(starts) == len(every) and all(starts.values())


@pytest.mark.slow
@pytest.mark.parametrize(
    "sample", [s for s in SAMPLES if not s.sweep], ids=lambda sample: sample.name
)
def test_no_run_ends_well_and_is_no_number(sample):
    valid, invalid = fuzz_nan.count(sample, 24)
    for row in (valid, invalid):
        assert row.silent == row.wrong == 0, row
        assert row.good + sum(row.failed.values()) == row.runs
    assert valid.refused == 0 < invalid.refused
    assert sum(invalid.failed.values()) >= invalid.runs // 3
    page = fuzz_nan.page([valid, invalid])
    assert page.count(sample.name) == 2


def test_a_number_that_is_not_valid_is_refused_or_ends_with_a_status():
    sample = next(s for s in SAMPLES if s.name == "two_body")
    key = np.random.default_rng(0)
    (system, state), refused = fuzz_nan.poisoned(*fuzz_nan.valid_inputs(sample, 64, key), key)
    mu = np.asarray(system.mu)
    # What construction refuses is the parameter; the state is read by the run.
    assert np.array_equal(refused, ~(np.isfinite(mu) & (mu > 0.0)))
    numbers = np.concatenate([mu[None], state.position, state.velocity])
    odd = ~np.isfinite(numbers) | (np.abs(numbers) > 1e200) | (numbers[:1] <= 0.0)
    assert np.all(np.any(odd, axis=0))
