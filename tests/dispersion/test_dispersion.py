"""Campaigns: distributions, independence of a run from how the campaign is cut, statistics with
known answers, the store."""

import os
import subprocess
import sys
from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats

from jaxspace.core import AbstractClosedForm, AbstractSystem, InputError, Scalar, quantity
from jaxspace.core.quantities import quantities
from jaxspace.dispersion import (
    Campaign,
    Constant,
    Dispersion,
    MultivariateNormal,
    Normal,
    TruncatedNormal,
    Uniform,
    disperse,
    open_store,
)
from jaxspace.dispersion._whole import check_whole
from jaxspace.dispersion.covariance import sampled
from jaxspace.dispersion.sensitivity import sobol_indices
from jaxspace.simulation import Event, Mission, Phase, SimulationError, Status

DURATION = 3.0


class Swing(eqx.Module):
    x: Scalar
    v: Scalar


@final
class Oscillator(AbstractSystem):
    """x'' = -w^2 x"""

    w: Scalar = quantity("rad/s", doc="angular frequency")

    def vector_field(self, t, y):
        return Swing(y.v, -self.w * self.w * y.x)

    def invariants(self, t, y):
        return {}


@final
class StraightLine(AbstractClosedForm):
    """x grows by v t."""

    def flow(self, duration, y):
        return Swing(y.x + duration * y.v, y.v)


@final
class Drift(AbstractSystem):
    """x' = v: linear in what scatters, and without any integration."""

    def vector_field(self, t, y):
        return Swing(y.v, jnp.zeros_like(y.v))

    def invariants(self, t, y):
        return {"v": y.v}

    def closed_form(self):
        return StraightLine()


class Stiffness(eqx.Module):
    """What the stiffness of an oscillator may be."""

    stiffness: Scalar = quantity("1/s^2", non_negative=True, doc="of the spring")

    @classmethod
    def limit(cls):
        return quantities(cls)["stiffness"]


def swings(samples):
    system = Oscillator(jnp.sqrt(samples["stiffness"]))
    return Mission([Phase(system, DURATION, name="swing")]), Swing(samples["x0"], samples["v0"])


def last(result, samples):
    return {"x": result.final.x, "v": result.final.v}


def drifts(samples):
    return Mission([Phase(Drift(), DURATION)]), Swing(samples["x0"], samples["v0"])


INPUTS = {
    "stiffness": Normal(4.0, 0.4),
    "x0": Uniform(0.9, 1.1),
    "v0": TruncatedNormal(0.0, 0.1, -0.1, 0.2),
}
UNITS = {"x": "m", "v": "m/s", "stiffness": "1/s^2", "x0": "m", "v0": "m/s"}
SWINGS = Campaign(swings, INPUTS, last, UNITS, description="a pendulum")
RUNS, CALL = 700, 512  # of a campaign, of one call


def exact(d: Dispersion) -> np.ndarray:
    """x of the oscillator in closed form."""
    w = np.sqrt(np.abs(d.inputs["stiffness"]))
    return d.inputs["x0"] * np.cos(w * DURATION) + d.inputs["v0"] * np.sin(w * DURATION) / w


@pytest.fixture(scope="module")
def whole() -> Dispersion:
    return disperse(SWINGS, RUNS, seed=7)


DISTRIBUTIONS = [
    pytest.param(Normal(84.1, 0.25), scipy.stats.norm(84.1, 0.25), id="normal"),
    pytest.param(Uniform(-2.0, 5.0), scipy.stats.uniform(-2.0, 7.0), id="uniform"),
    pytest.param(
        TruncatedNormal(1.0, 0.5, 0.0, 3.0),
        scipy.stats.truncnorm(-2.0, 4.0, 1.0, 0.5),
        id="truncated",
    ),
    pytest.param(
        TruncatedNormal(0.0, 1.0, 0.0, 1.0), scipy.stats.truncnorm(0.0, 1.0, 0.0, 1.0), id="half"
    ),
]


@pytest.mark.parametrize("distribution, reference", DISTRIBUTIONS)
def test_draws_follow_the_distribution(distribution, reference, key):
    """Mean and variance of 100 000 draws within five standard errors of the closed form: once in
    1.7 million by chance."""
    n = 100_000
    draws = np.asarray(jax.vmap(distribution.sample)(jax.random.split(key, n)))
    mean, variance, _, excess = (float(m) for m in reference.stats(moments="mvsk"))
    assert abs(draws.mean() - mean) < 5.0 * np.sqrt(variance / n)
    assert abs(draws.var() - variance) < 5.0 * variance * np.sqrt((excess + 2.0) / n)
    low, high = reference.support()
    assert np.all((draws >= low) & (draws <= high))


def test_mean_and_deviation_of_the_parameters():
    assert float(Uniform(1.0, 4.0).mean) == 2.5
    assert float(Uniform(1.0, 4.0).deviation) == pytest.approx(
        3.0 / np.sqrt(12.0), rel=1e-15
    )  # variance (b - a)^2 / 12
    assert (float(Constant(3.0).mean), float(Constant(3.0).deviation)) == (3.0, 0.0)


@pytest.mark.parametrize(
    "make, field",
    [
        (lambda: Normal(0.0, -1.0), "Normal.deviation"),
        (lambda: Normal(np.nan, 1.0), "Normal.mean"),
        (lambda: Uniform(1.0, 1.0), "Uniform.high"),
        (lambda: TruncatedNormal(0.0, 0.0, -1.0, 1.0), "TruncatedNormal.deviation"),
        (lambda: TruncatedNormal(2.0, 1.0, -1.0, 1.0), "TruncatedNormal.mean"),
        (lambda: Constant(np.inf), "Constant.value"),
        (lambda: Campaign(drifts, {}, last), "Campaign.inputs"),
        (lambda: Campaign(drifts, {"status": Constant(1.0)}, last), "status"),
        (lambda: disperse(SWINGS, 0), "runs"),
        (lambda: disperse(SWINGS, 5, chunk=-1), "chunk"),
        # The types that tests check let no fraction pass this far.
        (
            lambda: check_whole("runs", 1.5, 1),
            "runs is 1.5: it must be a whole number from 1 to 2147483647",
        ),
        (lambda: check_whole("seed", 1.0), "seed is 1.0: it must be a whole number"),
        (lambda: disperse(SWINGS, True), "runs is True"),
        (lambda: disperse(SWINGS, 5, seed=True), "seed is True: it must be a whole number"),
        (lambda: disperse(SWINGS, 5, samples=True), "samples is True"),
        (lambda: sampled(SWINGS, 0), "runs is 0"),
        (lambda: sobol_indices(SWINGS, True), "points is True"),
        (lambda: disperse(SWINGS, 5, accuracy=1e-20), "Accuracy.rtol"),
        (lambda: disperse(SWINGS, 5, devices=10**6), "devices"),
        (lambda: open_store("/no/such/place"), "store"),
    ],
)
def test_bad_input_names_its_field(make, field):
    with pytest.raises(InputError, match=field):
        make()


@pytest.mark.parametrize("name, words", [(("a", "b"), "the tuple"), ("a", "a joint distribution")])
def test_a_joint_distribution_in_place_of_its_inputs_is_rejected(name, words):
    """With how its inputs are named."""
    pair = MultivariateNormal(np.zeros(2), np.eye(2))
    with pytest.raises(InputError, match=rf"{words}.*\{{\*\*joint\.inputs\('a', 'b'\)"):
        # Without the checks of types that tests add.
        check_campaign({name: pair})


def check_campaign(inputs):
    campaign = object.__new__(Campaign)
    object.__setattr__(campaign, "inputs", inputs)
    campaign.__check_init__()


def test_an_output_may_not_have_the_name_of_an_input():
    clash = Campaign(
        drifts, {"x0": Normal(0.0, 1.0), "v0": Constant(1.0)}, lambda r, s: {"x0": r.final.x}
    )
    with pytest.raises(InputError, match="'x0'"):
        disperse(clash, 5)


def test_inputs_in_words_have_their_units_where_they_have_one():
    inputs = {"x0": Constant(1.0), "share": Constant(0.5)}
    campaign = Campaign(swings, inputs, last, {"x0": "m", "share": ""})
    assert campaign.text() == "x0 [m]: constant, value 1\nshare: constant, value 0.5"


def test_a_draw_depends_on_seed_number_and_name_alone(key):
    alone = Campaign(drifts, {"v0": INPUTS["v0"]}, last).samples(key, jnp.array([600, 3]))
    beside = SWINGS.samples(key, jnp.arange(700))
    np.testing.assert_array_equal(alone["v0"], beside["v0"][jnp.array([600, 3])])
    assert len(np.unique(np.asarray(beside["x0"]))) == 700


def test_runs_match_the_closed_form(whole):
    """The oscillation has some ten steps, each to 1e-9 of a state of size 1 and 2: their sum stays
    within 1e-8."""
    assert np.all(whole.status == Status.COMPLETED)
    np.testing.assert_allclose(whole.outputs["x"], exact(whole), rtol=0.0, atol=1e-8)
    assert list(whole.outputs) == ["x", "v"] and list(whole.inputs) == list(INPUTS)


@pytest.mark.parametrize("chunk, runs", [(1, RUNS), (300, 600), (4096, 900)])
def test_a_run_is_the_same_bit_for_bit_however_the_campaign_is_cut(whole, chunk, runs):
    other = disperse(SWINGS, runs, seed=7, chunk=chunk)
    n = min(runs, RUNS)
    for name in UNITS:
        np.testing.assert_array_equal(other.values(name)[:n], whole.values(name)[:n])
    assert not np.array_equal(disperse(SWINGS, 5, seed=8).outputs["x"], whole.outputs["x"][:5])


@pytest.mark.sweep
def test_devices_change_no_number():
    """In a process of its own, because the number of devices is fixed when the first one is
    touched."""
    code = """
import jax
jax.config.update("jax_enable_x64", True)
jax.config.update("jax_num_cpu_devices", 2)
from test_dispersion import SWINGS, disperse
one, two = (disperse(SWINGS, 300, devices=n) for n in (1, 2))
print(len(jax.devices()), all((one.values(k) == two.values(k)).all() for k in SWINGS.units))
"""
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    assert done.stdout.split() == ["2", "True"], done.stderr


def rarely_fast(samples):
    """One run in two hundred swings three times as fast as the others: its steps have to be that
    much shorter."""
    system = Oscillator(jnp.where(samples["luck"] > 0.995, 3.0, 1.0))
    return Mission([Phase(system, DURATION)]), Swing(samples["x0"], samples["v0"])


def test_a_fast_run_takes_steps_of_its_own():
    inputs = {"luck": Uniform(0.0, 1.0), "x0": Constant(1.0), "v0": Constant(0.0)}
    d = disperse(Campaign(rarely_fast, inputs, last), 600, seed=1)
    fast = d.inputs["luck"] > 0.995
    assert 1 <= fast.sum() < 10
    assert np.all(d.good) and np.all(d.evaluations[fast] > 2 * d.evaluations[~fast].max())
    w = np.where(fast, 3.0, 1.0)
    np.testing.assert_allclose(d.outputs["x"], np.cos(w * DURATION), rtol=0.0, atol=1e-8)


def stops(samples):
    mission, y0 = rarely_fast(samples)
    stop = Event(lambda t, y: t - 2.0, direction=1, within=DURATION, samples=4)
    system = mission.phases[0].system
    return Mission([Phase(system, stop, name="search"), Phase(system, 1.0, name="rest")]), y0


def test_a_mission_with_an_event_is_cut_into_chunks_alike():
    """Also where one run of a block takes three times the steps of the others."""
    inputs = {"luck": Uniform(0.0, 1.0), "x0": Uniform(0.5, 1.0), "v0": Constant(0.0)}
    campaign = Campaign(stops, inputs, lambda r, s: {"x": r.final.x, "t": r.phases[0].ts[-1]})
    one, two = (
        disperse(campaign, 600, seed=1, chunk=100),
        disperse(campaign, 600, seed=1, chunk=768),
    )
    fast = one.inputs["luck"] > 0.995
    assert np.any(fast) and np.all(one.evaluations[fast] > 2 * one.evaluations.min())
    for name in ("x", "t"):
        np.testing.assert_array_equal(one.outputs[name], two.outputs[name])
        # A run alone has the same bits, its neighbours fast or not.
        for number in (int(np.argmax(fast)), int(np.argmin(fast))):
            assert campaign.replay(number, seed=1).outputs[name] == one.outputs[name][number]
    assert np.all(one.status <= Status.EVENT)
    np.testing.assert_allclose(one.outputs["t"], 2.0, rtol=1e-9)
    np.testing.assert_allclose(
        one.outputs["x"], one.inputs["x0"] * np.cos(np.where(fast, 9.0, 3.0)), rtol=0.0, atol=1e-8
    )


def test_a_run_that_is_not_finite_marks_its_own_row():
    """A negative stiffness has no root: with this spread one run in six is NaN from the start."""
    d = disperse(Campaign(swings, {**INPUTS, "stiffness": Normal(2.0, 2.0)}, last), 300, seed=3)
    bad = d.inputs["stiffness"] < 0.0
    assert 20 < bad.sum() < 80 and np.any(bad[:15])
    np.testing.assert_array_equal(d.status, np.where(bad, Status.NOT_FINITE, Status.COMPLETED))
    np.testing.assert_allclose(d.outputs["x"][~bad], exact(d)[~bad], rtol=0.0, atol=1e-8)
    (failure,) = d.failed
    assert (failure.status, failure.count) == (
        Status.NOT_FINITE,
        bad.sum(),
    ) and "finite" in failure.sentence
    assert all(row.runs == 300 - bad.sum() and np.isfinite(row.std) for row in d.table())


def test_a_run_outside_the_range_of_its_input_is_refused():
    """Beyond its range a stiffness is not run: its row says so, and has no number. The other rows
    are those of the oscillator."""
    limits = {"stiffness": Stiffness.limit()}
    inputs = {**INPUTS, "stiffness": Normal(2.0, 2.0)}
    d = disperse(Campaign(swings, inputs, last, limits=limits), 300, seed=3)
    bad = d.inputs["stiffness"] < 0.0
    # A Gaussian draw lies a deviation below its mean in 16 % of 300 runs: 48 +- 5 times 6.3.
    assert 17 < bad.sum() < 79
    np.testing.assert_array_equal(d.status, np.where(bad, Status.REFUSED, Status.COMPLETED))
    assert np.all(np.isnan(d.outputs["x"][bad]))
    # As in `test_runs_match_the_closed_form`.
    np.testing.assert_allclose(d.outputs["x"][~bad], exact(d)[~bad], rtol=0.0, atol=1e-8)


def test_a_nominal_run_that_fails_is_an_error():
    with pytest.raises(SimulationError, match="nominal"):
        disperse(Campaign(swings, {**INPUTS, "stiffness": Normal(-4.0, 0.1)}, last), 5)


def test_shares_of_a_linear_problem():
    """x = x0 + 3 v0 with deviations 2 and 1: shares 4/13 and 9/13, to the sampling error of 4000
    runs (five standard errors of a share are below 5 / sqrt(4000) = 0.08). A linear law explains it
    all, and a constant contributes nothing."""
    inputs = {
        "x0": Normal(1.0, 2.0),
        "v0": Normal(-1.0, 1.0),
        "idle": Normal(0.0, 1.0),
        "fixed": Constant(2.0),
    }
    d = disperse(Campaign(drifts, inputs, last, {"x": "m"}), 4000)
    found = d.contributors("x")
    assert found.r_squared == pytest.approx(1.0, abs=1e-12)
    assert list(found.shares)[:2] == ["v0", "x0"] and "fixed" not in found.shares
    assert found.shares["x0"] == pytest.approx(4.0 / 13.0, abs=0.08)
    assert found.shares["v0"] == pytest.approx(9.0 / 13.0, abs=0.08)
    assert found.shares["idle"] < 1e-12
    row = d.table()[0]
    assert row.mean == pytest.approx(-2.0, abs=5.0 * np.sqrt(13.0 / 4000))
    assert row.std == pytest.approx(np.sqrt(13.0), rel=5.0 / np.sqrt(2 * 4000))
    # Two sided 99 % of a normal law: 2.5758 deviations; the error of such a quantile is some 0.08
    # deviations, here five times.
    assert (row.high - row.low) / row.std == pytest.approx(2 * 2.5758, abs=0.4)
    assert list(d.contributors("x", 1).shares) == ["v0"]
    with pytest.raises(InputError, match="height"):
        d.contributors("height")


def test_shares_of_a_magnitude():
    """y = sqrt(a^2 + 4 b^2 + 100): no linear law sees it, the squares do, with 1/17 and 16/17 of
    the variance of y^2. The root bends that by a few hundredths, the sample by five times 1 /
    sqrt(4000)."""
    a, b = np.random.default_rng(3).standard_normal((2, 4000))
    y = np.sqrt(a**2 + 4.0 * b**2 + 100.0)
    d = Dispersion({"a": a, "b": b}, {"y": y}, np.zeros(4000, int), np.ones(4000, int), {}, 0)
    found = d.contributors("y")
    assert found.r_squared > 0.95
    assert found.shares["b"] == pytest.approx(16.0 / 17.0, abs=0.08)
    assert found.shares["a"] == pytest.approx(1.0 / 17.0, abs=0.08)


def test_table_of_known_numbers():
    x = np.arange(201.0)
    status = np.where(x == 200.0, Status.MAX_STEPS, Status.COMPLETED)
    d = Dispersion(
        {"a": x},
        {"x": np.where(x == 200.0, 1e9, x), "flat": np.ones(201)},
        status,
        np.ones(201, int),
        {"x": "m"},
        0,
    )
    row = d.table()[0]
    assert row.name == "x" and row.unit == "m" and row.runs == 200
    # 0, 1 .. 199: mean (n - 1)/2, variance n (n + 1)/12, quantiles p (n - 1)
    expected = (99.5, np.sqrt(200 * 201 / 12), 0.005 * 199, 0.995 * 199, 0.0, 199.0)
    assert (row.mean, row.std, row.low, row.high, row.min, row.max) == pytest.approx(
        expected, rel=1e-12
    )
    assert d.contributors("flat").shares == {} and np.isnan(d.contributors("flat").r_squared)
    assert d.label("x") == "x [m]" and [r.name for r in d.table("inputs")] == ["a"]
    few = Dispersion({"a": x[:2]}, {"x": x[:2]}, status[:2], status[:2], {}, 0)
    with pytest.raises(InputError, match="too few"):
        few.contributors("x")


def test_what_is_stored_comes_back(whole, tmp_path):
    place = tmp_path / "campaign.zarr"
    disperse(SWINGS, 100, seed=1, store=place)
    seen = []
    disperse(
        SWINGS,
        RUNS,
        seed=7,
        chunk=CALL,
        store=place,
        overwrite=True,
        progress=lambda done, total: seen.append((done, total)),
    )
    # A chunk is whole blocks.
    assert seen == [(min(done, RUNS), RUNS) for done in range(CALL, RUNS + CALL, CALL)]
    back = open_store(place)
    assert back.runs == RUNS and back.seed == 7 and back.units == UNITS
    for name in (*back.inputs, *back.outputs):
        np.testing.assert_array_equal(back.values(name), whole.values(name))
    np.testing.assert_array_equal(back.status, whole.status)
    assert list(back.outputs) == ["x", "v"] and back.attributes["description"] == "a pendulum"
    assert back.attributes["versions"]["jax"] == jax.__version__ and back.attributes["rtol"] == 1e-9
    data = back.to_dataset()
    assert (
        data["x"].attrs["units"] == "m" and data["x"].dims == ("run",) and data.attrs["seed"] == 7
    )


def test_an_interrupted_campaign_keeps_its_finished_chunks(whole, tmp_path):
    def stop(done, total):
        if done >= CALL:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        disperse(SWINGS, RUNS, seed=7, chunk=CALL, store=tmp_path / "s.zarr", progress=stop)
    kept = open_store(tmp_path / "s.zarr")
    assert kept.runs == CALL and kept.attributes["planned_runs"] == RUNS
    for name in UNITS:
        np.testing.assert_array_equal(kept.values(name), whole.values(name)[:CALL])
