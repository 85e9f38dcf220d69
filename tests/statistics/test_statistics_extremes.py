"""Extremes along a run: between the states of a phase, over phases, in campaigns and files."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq
from test_campaigns import Swinging

import jaxspace
from jaxspace import statistics
from jaxspace.bodies import BodyState, ExponentialAtmosphere
from jaxspace.core import InputError
from jaxspace.dispersion import Campaign, Normal, disperse, moments
from jaxspace.io import SceneError, load
from jaxspace.orbits import Drag
from jaxspace.simulation import Mission, Phase

# One program each, in place of one for every operation.
greatest, least = jax.jit(statistics.extremes.greatest), jax.jit(statistics.extremes.least)


def curve(t):
    return jnp.sin(t) + 0.3 * jnp.cos(3.0 * t)


def peak():
    """Where the slope of the curve vanishes on its way down, by bisection."""
    t = brentq(lambda t: np.cos(t) - 0.9 * np.sin(3.0 * t), 1.7, 2.4, xtol=1e-14)
    return t, float(np.sin(t) + 0.3 * np.cos(3.0 * t))


def test_greatest_between_states_is_of_order_four():
    """max |q''''| h^4/384 with |q''''| <= 1 + 0.3 81 = 25.3."""
    time, value = peak()
    errors = []
    for n in (33, 65, 129):
        t = jnp.linspace(0.0, 4.0, n)
        found = greatest(t, curve(t))
        h = 4.0 / (n - 1)
        assert abs(float(found.value) - value) < 25.3 * h**4 / 384.0
        # The place follows from the slope, which is of order three.
        assert abs(float(found.time) - time) < 20.0 * h**3
        errors.append(abs(float(found.value) - value))
    assert errors[2] < errors[0] / 100.0


def test_extremes_at_an_end_and_of_what_is_constant():
    t = jnp.linspace(1.0, 3.0, 9)
    rising = greatest(t, t**3)
    assert float(rising.value) == 27.0 and float(rising.time) == 3.0
    assert float(least(t, t**3).time) == 1.0
    flat = greatest(t, jnp.full(9, 2.5))
    assert float(flat.value) == 2.5 and float(flat.time) == 1.0
    assert float(jax.grad(lambda a: greatest(t, a * jnp.ones(9)).value)(2.5)) == 1.0


def test_extremes_of_runs_over_phases():
    """Each run has its own times; a parabola is the cubic itself, to rounding."""
    ends = jnp.array([2.0, 3.0])
    early = jnp.linspace(0.0, 1.0, 7)[:, None] * ends
    late = ends + jnp.linspace(0.0, 1.0, 9)[:, None] * ends

    def parabola(t):
        return 5.0 - (t - jnp.array([1.3, 4.1])) ** 2

    found = greatest([early, late], [parabola(early), parabola(late)])
    np.testing.assert_allclose(found.value, 5.0, rtol=1e-14)
    np.testing.assert_allclose(found.time, [1.3, 4.1], rtol=1e-13)
    low = least([early, late], [parabola(early), parabola(late)])
    np.testing.assert_allclose(low.value, [5.0 - 2.7**2, 5.0 - 4.1**2], rtol=1e-14)
    np.testing.assert_allclose(low.time, [4.0, 0.0])


def test_gradient_of_an_extreme():
    """d max/d a of a sin(w t) + b t is the partial derivative at the place; the place moves as
    -(d slope/d b)/q''."""
    t = jnp.linspace(0.0, 2.5, 65)

    def found(p):
        return greatest(t, p[0] * jnp.sin(p[1] * t) + p[2] * t)

    p = jnp.array([2.0, 1.1, 0.2])
    place = float(np.arccos(-0.2 / 2.2) / 1.1)
    exact = [
        np.sin(1.1 * place),
        2.0 * place * np.cos(1.1 * place),
        place,
    ]
    # The slopes of the cubic are those of the formula to h^3, h = 0.04.
    np.testing.assert_allclose(jax.grad(lambda p: found(p).value)(p), exact, rtol=1e-4)
    np.testing.assert_allclose(jax.jacfwd(lambda p: found(p).value)(p), exact, rtol=1e-4)
    moved = jax.grad(lambda p: found(p).time)(p)[2]
    assert float(moved) == pytest.approx(1.0 / (2.0 * 1.21 * np.sin(1.1 * place)), rel=1e-3)


def test_single_precision_stays():
    t = jnp.linspace(0.0, 4.0, 65, dtype=jnp.float32)
    found = greatest(t, curve(t))
    assert found.value.dtype == found.time.dtype == jnp.float32
    assert abs(float(found.value) - peak()[1]) < 1e-5


@pytest.mark.parametrize(
    "times, values, words",
    [
        (np.zeros(2), np.zeros(2), "requires at least 5 states"),
        (np.zeros(6), np.zeros(7), "must be compatible with"),
    ],
)
def test_what_does_not_fit_is_refused(times, values, words):
    with pytest.raises(InputError, match=words):
        greatest(times, values)


def test_dynamic_pressure_of_drag_in_air_that_turns():
    """rho |v - Omega Z x r|^2/2 at the equator, a scale height above the reference."""
    air = ExponentialAtmosphere(density=1.2, reference_height=0.0, scale_height=8e3)
    drag = Drag(100.0, air, radius=6.4e6, air_rate=7e-5)
    r = 6.4e6 + 8e3
    y = BodyState(jnp.array([r, 0.0, 0.0]), jnp.array([30.0, 900.0, 40.0]))
    exact = 0.5 * 1.2 * np.exp(-1.0) * (30.0**2 + (900.0 - 7e-5 * r) ** 2 + 40.0**2)
    # The height is a difference of 6.4e6 m: 1e-9 m of 8e3 m.
    assert float(drag.dynamic_pressure(y)) == pytest.approx(exact, rel=1e-12)


# ----------------------------------------------------------------------------------- in a campaign


def build(samples):
    y0 = {"x": 0.0 * samples["w"], "v": samples["v0"]}
    return Mission([Phase(Swinging(samples["w"]), 3.0, name="swing")]), y0


def outputs(result, samples):
    (phase,) = result.phases
    top = greatest(phase.ts, phase.states["x"])
    return {"top": top.value, "when": top.time}


CAMPAIGN = Campaign(
    build, {"w": Normal(1.0, 0.05), "v0": Normal(2.0, 0.1)}, outputs, {"when": "s"}, num_saved=33
)


def test_a_campaign_keeps_extremes(tmp_path):
    """x = v0 sin(w t)/w is greatest at pi/(2 w). h = 3/32 leaves w^4 h^4/384 = 2e-7, and of the
    place some h^3/100."""
    kept = disperse(CAMPAIGN, 300, store=tmp_path / "s.zarr", samples=5, seed=4)
    w, v0 = kept.inputs["w"], kept.inputs["v0"]
    np.testing.assert_allclose(kept.outputs["top"], v0 / w, rtol=1e-6)
    np.testing.assert_allclose(kept.outputs["when"], 0.5 * np.pi / w, atol=1e-4)
    # The states kept beside are five of those along which it was sought.
    import xarray

    with xarray.open_zarr(tmp_path / "s.zarr") as data:
        t = data["swing.time"].values
        np.testing.assert_allclose(t, np.broadcast_to(np.linspace(0.0, 3.0, 5), t.shape))
        x = v0[:, None] * np.sin(w[:, None] * t) / w[:, None]
        np.testing.assert_allclose(data["swing.x"], x, atol=1e-7)


def test_a_replay_has_its_extremes_and_as_many_states_as_asked_for():
    run = CAMPAIGN.replay(7, seed=4, num_saved=10)
    assert run.outputs["top"] == pytest.approx(run.inputs["v0"] / run.inputs["w"], rel=1e-6)
    assert run.trajectory["swing"].states["x"].shape == (10,)


def test_linear_covariance_of_an_extreme():
    """d top = d v0/w - v0 d w/w^2."""
    found = moments(CAMPAIGN)
    exact = np.hypot(0.1, 2.0 * 0.05)
    assert found.std("top") == pytest.approx(exact, rel=1e-4)


# ---------------------------------------------------------------------------------- in scene files

FILE = """
accuracy = 1e-10
[planet]
mu = "398600.4418 km^3/s^2"
radius = "6378.137 km"
[initial.orbit]
periapsis_altitude = "300 km"
eccentricity = 0.1
true_anomaly = "-60 deg"
[effects.drag]
ballistic_coefficient = 1e15
atmosphere = { density = 1.225, reference_height = 0.0, scale_height = "60 km" }
[[phase]]
name = "down"
effects = ["point_gravity", "drag"]
duration = "480 s"
[[phase]]
name = "past"
effects = ["point_gravity"]
duration = "1320 s"
[dispersion]
runs = 100
outputs = [
  { output = "altitude", take = "least", unit = "km" },
  { output = "altitude", take = "time_of_least", name = "passage" },
  { output = "drag.dynamic_pressure", take = "greatest" },
  { output = "run.position.1", take = "greatest", unit = "km" },
  { output = "altitude", at = "past", take = "greatest", unit = "km" },
  "drag.dynamic_pressure",
]
[dispersion.inputs]
"initial.orbit.periapsis_altitude" = { deviation = "5 km" }
"""
NAMES = (
    *("least_altitude", "passage", "greatest_dynamic_pressure", "greatest_position.1"),
    *("greatest_altitude", "drag.dynamic_pressure"),
)


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("extremes") / "dip.toml"
    path.write_text(FILE)
    return load(path)


def _kepler(mean_anomaly):
    """The eccentric anomaly at e = 0.1, by iteration."""
    e = mean_anomaly
    for _ in range(40):
        e = mean_anomaly + 0.1 * np.sin(e)
    return e


def test_a_scene_file_asks_for_extremes(file):
    """Of negligible drag the orbit is Kepler's: the least altitude is that of the periapsis, at its
    passage, and there the dynamic pressure is greatest."""
    campaign = file.campaign(warn=False)
    assert campaign.num_saved == 65
    d = disperse(campaign, 40, seed=2, accuracy=file.accuracy)
    assert tuple(d.outputs) == NAMES and d.units["passage"] == "s"
    assert d.units["greatest_dynamic_pressure"] == "Pa"
    mu, radius = 398600.4418e9, 6378137.0
    periapsis = d.inputs["initial.orbit.periapsis_altitude"]
    r = radius + periapsis
    a = r / 0.9
    eccentric = 2.0 * np.arctan(np.sqrt(0.9 / 1.1) * np.tan(np.deg2rad(30.0)))
    passage = (eccentric - 0.1 * np.sin(eccentric)) * np.sqrt(a**3 / mu)
    # h is 8 min/64 and 22 min/64: (n h)^4/384 of the radius, n = 1.1e-3/s, is some 2 m; the phase
    # of the passage is the second one.
    np.testing.assert_allclose(d.outputs["least_altitude"], periapsis / 1e3, atol=2e-3)
    np.testing.assert_allclose(d.outputs["passage"], passage, atol=0.5)
    in_first = passage < 480.0
    # The drag acts in the first phase alone: greatest at its end, before the periapsis.
    assert not in_first.any()
    q = d.outputs["greatest_dynamic_pressure"]
    speed2 = mu * (1.1 / r)
    assert np.all(q < 0.5 * 1.225 * np.exp(-periapsis / 60e3) * speed2)
    # Behind the periapsis the altitude is greatest at one of the ends of the phase.
    ends = [_kepler(np.sqrt(mu / a**3) * (t - passage)) for t in (480.0, 1800.0)]
    top = np.maximum(*(a * (1.0 - 0.1 * np.cos(e)) - radius for e in ends))
    np.testing.assert_allclose(d.outputs["greatest_altitude"], top / 1e3, atol=1e-4)


def test_the_nominal_run_has_them_too(file):
    own = file.nominal_outputs(file.nominal_mission())
    assert tuple(own) == NAMES
    assert own["least_altitude"][0] == pytest.approx(300.0, abs=2e-3)


def edited(tmp_path, old, new):
    path = tmp_path / "wrong.toml"
    path.write_text(FILE.replace(old, new))
    with pytest.raises(SceneError) as error:
        load(path)
    return str(error.value)


@pytest.mark.parametrize(
    "new, words",
    [
        ('{ output = "altitude", take = "most" }', "one of greatest, least, time_of_greatest"),
        ('"run.position.1"', "along the whole run, take is required"),
        ('{ output = "final.position.1", take = "least" }', "an extreme must be taken along run"),
        ('{ output = "drag.dynamic_presure", take = "greatest" }', "drag.dynamic_pressure"),
        (
            '{ output = "drag.dynamic_pressure", at = "past", take = "least" }',
            "drag does not act in this phase",
        ),
        ('{ output = "radial_error", take = "greatest" }', "compares with the nominal run"),
        ('{ output = "altitude", at = "later", take = "least" }', "past"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, new, words):
    assert words in edited(tmp_path, '"drag.dynamic_pressure",\n]', f"{new}\n]")


def test_a_phase_that_is_asked_for_alone(tmp_path):
    assert "extreme_samples" in edited(tmp_path, "runs = 100", "runs = 100\nextreme_samples = 3")


def test_the_listing_names_outputs_of_effects():
    assert "  drag.dynamic_pressure [Pa]" in jaxspace.io.listing()
