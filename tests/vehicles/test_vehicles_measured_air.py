"""Air as it is: soundings, a wind with its uncertainty, gusts by the spectra of Dryden."""

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads
from scipy.interpolate import CubicHermiteSpline

from jaxspace import Scene, load, simulate
from jaxspace.bodies import BodyState, RigidBody
from jaxspace.bodies.standard_atmosphere import geometric_height, standard_atmosphere
from jaxspace.core import InputError
from jaxspace.core.random_paths import _fresh, longitudinal, transverse
from jaxspace.dispersion import disperse
from jaxspace.vehicles import (
    DrydenGusts,
    LaunchSite,
    MeasuredAtmosphere,
    MeasuredWind,
    Parachute,
    UncertainWind,
)
from jaxspace.vehicles._dryden_gusts import (
    RMS_HEIGHTS,
    dryden_intensities,
    dryden_lengths,
)
from jaxspace.vehicles.ground_gravity import GroundGravity
from jaxspace.vehicles.local_air import LocalAir
from jaxspace.vehicles.sounding import read_sounding

FOOT = 0.3048
WYOMING = """<HTML>
<H2>72293 NKX San Diego Observations at 00Z 01 Jan 2020</H2>
<PRE>
-----------------------------------------------------------------------------
   PRES   HGHT   TEMP   DWPT   RELH   MIXR   DRCT   SKNT   THTA   THTE   THTV
    hPa     m      C      C      %    g/kg    deg   knot     K      K      K
-----------------------------------------------------------------------------
 1000.0    103
  992.0    134   15.2    8.2     63   6.93    270     10  289.0  308.8  290.2
  925.0    740   10.0    5.0     71   5.94      0     20  289.5  306.8  290.5
  900.0    973                                 90     20
  850.0   1460   12.4   -4.6     30   3.21                298.8  308.9  299.4
  700.0   3060    1.0  -19.0     21   1.20    180     30  303.6  307.8  303.8
  500.0   5700  -17.1  -40.1     12   0.25    315     40  311.9  313.0  312.0
</PRE><H3>Station information and sounding indices</H3><PRE>
                         Station identifier: NKX
                             Station number: 72293
</PRE>
"""
CSV = """height (m),pressure (hPa),temperature (C),direction (deg),speed (m/s)
0,1013.25,15.0,0,5
1000,898.75,8.5,90,10
2000,794.95,2.0,180,20
"""


def test_a_list_of_wyoming_as_it_comes(tmp_path):
    """Blank fields below the ground and within, knots, and the page about it; by hand."""
    path = tmp_path / "sounding.txt"
    path.write_text(WYOMING)
    found = read_sounding(path)
    # Geopotential heights become geometric: H r/(r - H) with the standard's radius.
    high = np.array([134.0, 740.0, 1460.0, 3060.0, 5700.0])
    np.testing.assert_allclose(found.heights, high * 6356766.0 / (6356766.0 - high), rtol=1e-12)
    np.testing.assert_allclose(found.pressure[-2:], [70000.0, 50000.0], rtol=1e-13)
    np.testing.assert_allclose(found.temperature[:2], [288.35, 283.15], rtol=1e-13)
    assert found.wind_heights.size == 5
    # From the west, the north, the east, the south, the northwest: 1 knot is 1852/3600 m/s.
    knot = 1852.0 / 3600.0
    diagonal = 40.0 * np.sqrt(0.5)
    east = knot * np.array([10.0, 0.0, -20.0, 0.0, diagonal])
    north = knot * np.array([0.0, -20.0, 0.0, 30.0, -diagonal])
    np.testing.assert_allclose(found.east, east, atol=1e-13)
    np.testing.assert_allclose(found.north, north, atol=1e-13)
    air = found.atmosphere().air_at(jnp.asarray(found.heights[3]))
    density = 70000.0 / (8314.32 / 28.9644 * 274.15)
    np.testing.assert_allclose([air.pressure, air.density], [70000.0, density], rtol=1e-12)
    np.testing.assert_allclose(air.sound_speed, np.sqrt(1.4 * 70000.0 / density), rtol=1e-12)


# The levels of WYOMING: pressure, hPa, height, m, temperature, C, direction, deg, speed, knots.
NONE = -9999.0
LEVELS = (
    (1000.0, 103.0, NONE, NONE, NONE),
    (992.0, 134.0, 15.2, 270.0, 10.0),
    (925.0, 740.0, 10.0, 0.0, 20.0),
    (900.0, 973.0, NONE, 90.0, 20.0),
    (850.0, 1460.0, 12.4, NONE, NONE),
    (700.0, 3060.0, 1.0, 180.0, 30.0),
    (500.0, 5700.0, -17.1, 315.0, 40.0),
)
SPC = """%TITLE%
 OUN   140519/1200

   LEVEL       HGHT       TEMP       DWPT       WDIR       WSPD
-------------------------------------------------------------------
%RAW%
{}
%END%
"""


def spc(levels=LEVELS):
    """The levels in the form of SPC, -9999 where one has nothing."""
    rows = [
        ",".join(f"{x:10.2f}" for x in (p, h, t, NONE, direction, speed))
        for p, h, t, direction, speed in levels
    ]
    return SPC.format("\n".join(rows))


def tenths(x):
    return -9999 if x == NONE else round(10.0 * x)


def igra(levels=LEVELS):
    """The levels in the form of IGRA, in Pa and tenths, with the flags A and B that may follow a
    value, and what a field has that was removed."""
    head = f"#USM00072357 2014 05 19 12 1105 {len(levels):4d} ncdc-nws ncdc-nws  351800  -974400"
    rows = [
        f"21 {-9999:5d} {round(100 * p):6d}B{round(h):5d}A{tenths(t):5d}B{-8888:5d} {-9999:5d} "
        f"{round(d):5d} {tenths(u):5d} "
        for p, h, t, d, u in levels
    ]
    return "\n".join([head, *rows]) + "\n"


def test_lists_of_the_services_agree(tmp_path):
    """One sounding as each of them writes it; IGRA has its speeds in m/s, here of as many knots."""
    path = tmp_path / "sounding.txt"
    found = []
    for text in (WYOMING, spc(), igra()):
        path.write_text(text)
        found.append(read_sounding(path))
    for name in ("heights", "pressure", "temperature", "wind_heights"):
        for other in found[1:]:
            # A sum of 273.15 and a quotient by ten are rounded.
            np.testing.assert_allclose(getattr(other, name), getattr(found[0], name), rtol=1e-14)
    for name in ("east", "north"):
        expected = getattr(found[0], name)
        np.testing.assert_allclose(getattr(found[1], name), expected, rtol=1e-14)
        np.testing.assert_allclose(getattr(found[2], name) * 1852 / 3600, expected, rtol=1e-14)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (spc().replace("%END%", ""), "has no line %END%: it must end the levels."),
        (spc().replace("    740.00,", ""), "line 9 has 5 numbers: it must have 6, pressure, "),
        (spc().replace("12.40", "  x  "), "line 11: temp is 'x': it must be a finite number."),
        (spc().replace("40.00", "400.0"), "line 13: speed is 205.778: it must be from 0 to 150"),
        (igra().replace("  124B", "  1x4B"), "line 6: temp is '1x4': it must be a finite number."),
        (igra().replace("  315 ", "  515 "), "line 8: direction is 515: it must be from 0 to 360"),
        (WYOMING.replace("  992.0", "\t992.0"), "line 9 contains tabs: its columns must be 7"),
        (
            igra() + igra(),
            "line 9 begins another sounding, of 2 in total: the file must contain only one. Keep "
            "the lines",
        ),
        (igra(()), "has no level of an atmosphere or a wind"),
    ],
)
def test_wrong_lists_are_refused_with_file_and_line(tmp_path, text, sentence):
    path = tmp_path / "list.txt"
    path.write_text(text)
    with pytest.raises(InputError) as error:
        read_sounding(path)
    assert str(error.value).startswith(str(path)) and sentence in str(error.value)


def test_the_csv_of_wyoming_and_that_of_anybody_agree(tmp_path):
    """One is of geopotential heights, with a balloon that swings."""
    mine, theirs = tmp_path / "mine.csv", tmp_path / "theirs.csv"
    mine.write_text(CSV)
    head = "time,longitude,latitude,pressure_hPa,geopotential height_m,temperature_C,"
    head += "dew point temperature_C,wind direction_degree,wind speed_m/s\n"
    rows = ["898.75,1000,8.5,1,90,10", "900,990,8.6,1,90,10", "794.95,2000,2.0,1,180,20"]
    theirs.write_text(
        head + "".join(f"2024-01-01 12:00:0{k},0,0,{r}\n" for k, r in enumerate(rows))
    )
    a, b = read_sounding(mine), read_sounding(theirs)
    np.testing.assert_allclose(a.heights[1:], b.heights, rtol=4e-4)
    for name in ("pressure", "temperature", "east", "north"):
        np.testing.assert_allclose(getattr(a, name)[1:], getattr(b, name), rtol=1e-13)


def test_a_sounding_of_the_standard_is_the_standard():
    """At 50 levels to 30 km: within 3e-3 between them, for the cubic rounds off the corner of the
    temperatures at 11 km by 0.6 K; and a km above, where the standard warms a little."""
    heights = np.linspace(0.0, 30e3, 50)
    known = standard_atmosphere(jnp.asarray(heights))
    air = MeasuredAtmosphere(heights, known.pressure, known.temperature)
    at = jnp.linspace(0.0, 29.9e3, 301)
    found, expected = air.air_at(at), standard_atmosphere(at)
    np.testing.assert_allclose(found.density, expected.density, rtol=3e-3)
    np.testing.assert_allclose(found.pressure, expected.pressure, rtol=2e-4)
    above = air.air_at(jnp.asarray(31e3))
    np.testing.assert_allclose(
        above.density, standard_atmosphere(jnp.asarray(31e3)).density, rtol=0.01
    )
    twice = air.scaled(2.0).air_at(at)
    np.testing.assert_allclose(twice.density, 2.0 * found.density, rtol=1e-14)
    for h in (-50.0, float(heights[7]), 12345.0, 40e3):
        check_grads(lambda h: jnp.log(air.air_at(h).density), (h,), 1, atol=1e-7, rtol=1e-5)


UNEVEN = np.array([0.0, 300.0, 310.0, 2500.0, 3000.0, 5000.0])
SHARES = np.array([1.0, 3.0, 3.0, 7.0, 4.0, -2.0])


def chords(values):
    """SciPy's cubic of Hermite with the slopes of the chords over both neighbours."""
    low, high = np.r_[0, np.arange(5)], np.r_[np.arange(1, 6), 5]
    slopes = (values[high] - values[low]) / (UNEVEN[high] - UNEVEN[low])
    return CubicHermiteSpline(UNEVEN, values, slopes)


@pytest.mark.parametrize("size", [0.0, 1e-300, 2.0])
def test_derivatives_by_values_at_the_nodes_are_those_of_a_linear_interpolation(size):
    """By a strength e of a wind, of its mean, of its deviation, of gusts, and by a lapse of the
    temperature: at zero, next to it and far from it. All but the last are linear in e, so that the
    derivative is the value at e = 1; the last is T = T_0 exp(e s)."""
    at = jnp.array([150.0, 305.0, 310.0, 700.0, 2700.0, 4990.0])
    zero, one = jnp.zeros(6), jnp.ones(6)
    path = np.array(longitudinal(jnp.asarray(np.diff(UNEVEN) / 800.0), jnp.asarray(SHARES)))
    pressure = 1e5 * np.exp(-UNEVEN / 8e3)

    def east(e):
        measured = MeasuredWind(UNEVEN, e * SHARES, zero)
        mean = UncertainWind(UNEVEN, e * SHARES, zero, zero, 800.0, SHARES, zero)
        spread = UncertainWind(UNEVEN, zero, zero, e * one, 800.0, SHARES, zero)
        return [wind.at(at)[0] for wind in (measured, mean, spread)]

    def gusts(e):
        return DrydenGusts(3.0, 9.0 * e, e * jnp.ones(12), top=300.0).at(at)

    def temperature(e):
        air = MeasuredAtmosphere(UNEVEN, pressure, 250.0 * jnp.exp(0.01 * e * SHARES))
        return jnp.log(air.air_at(at).temperature / 250.0) / 0.01

    slopes = jax.jit(jax.jacfwd(lambda e: [*east(e), *gusts(e), temperature(e)]))
    found = slopes(jnp.asarray(size))
    by_shares = chords(SHARES)(at)
    # A few roundings, of the logarithm of the temperature over its hundredth.
    expected = [by_shares, by_shares, chords(path)(at), *gusts(1.0), by_shares]
    np.testing.assert_allclose(np.stack(found), np.stack(expected), rtol=1e-12, atol=1e-12)


def test_between_levels_the_wind_leaves_those_that_stay_by_a_quarter_of_the_next_change():
    """Of two levels 10 m apart beside one of 2 km, where the slope of a parabola through three
    levels would leave them by half of the whole change."""
    for heights in ([0.0, 10.0, 2010.0, 2020.0], [0.0, 2000.0, 2010.0, 4010.0]):
        wind = MeasuredWind(heights, [0.0, 1.0, 1.0, 0.0], np.zeros(4))
        east, _ = wind.at(jnp.linspace(0.0, heights[-1], 4041))
        assert -1e-12 <= east.min() and east.max() <= 1.25


def test_wrong_soundings_are_refused_with_file_and_line(tmp_path):
    path = tmp_path / "s.csv"

    def refusal(text):
        path.write_text(text)
        with pytest.raises(InputError) as error:
            read_sounding(path)
        assert "\n" not in str(error.value)
        return str(error.value)

    def changed(old, new):
        return refusal(CSV.replace(old, new))

    assert f"{path}, line 3: speed is 200: it must be from 0 to 150 m/s." in changed(
        "90,10", "90,200"
    )
    assert "line 4: direction is 400: it must be from 0 to 360" in changed("180,20", "400,20")
    assert "line 3 has 6 fields: it must have 5, as many" in changed("8.5", "8,5")
    assert "line 3: pressure is 8.9875e+06: it must be above 0 and at most 120 kPa" in changed(
        "898.75", "89875"
    )
    assert "line 3: pressure is inf: it must be above 0" in changed("898.75", "1e308")
    for number in ("inf", "1e999", "1_0"):
        bad = changed("8.5", number)
        assert f"line 3: temperature is {number!r}: it must be a finite number." in bad
    assert "line 3: pressure is 'x': it must be a finite number." in changed("898.75", "x")
    assert "line 3: height is 0 after 0: it must be above" in changed("\n1000", "\n0")
    assert "line 4: pressure is 90000 Pa after 89875: it must decrease" in changed("794.95", "900")
    # A rounding to whole hPa hides no 100 hPa.
    assert "line 4: pressure is 89875 Pa after 89875: it must decrease" in changed(
        "794.95", "898.75"
    )
    assert "the unit of speed is 'furlong'" in changed("(m/s)", "(furlong)")
    assert "no heading with a height" in refusal("a,b\n1,2\n")
    assert "no level of an atmosphere or a wind" in refusal("height (m),speed (m/s)\n1,2\n")
    with pytest.raises(InputError, match="it is not a regular file"):
        read_sounding("/dev/null")
    path.write_text("height (m),direction (deg),speed (knot)\n0,0,5\n900,0,8\n")
    with pytest.raises(InputError, match="0 levels with a pressure"):
        read_sounding(path).atmosphere()
    with pytest.raises(InputError, match=r"MeasuredWind\.heights .* ascending"):
        MeasuredWind([0.0, 0.0], [1.0, 1.0], [1.0, 1.0])


def test_a_gap_is_an_error_for_what_needs_its_levels_alone(tmp_path):
    path = tmp_path / "gap.csv"
    heights = range(0, 8001, 2000)
    rows = [f"{h},{1013.25 * np.exp(-h / 8e3):.2f},{15 - 0.006 * h:.1f}" for h in heights]
    wind = [",90,5", ",nan,NA", ",,", ",90,-9999", ",90,9"]
    path.write_text(CSV.splitlines()[0] + "\n" + "\n".join(map(str.__add__, rows, wind)))
    sounding = read_sounding(path)
    assert sounding.heights.size == 5 and sounding.wind_heights.size == 2
    np.testing.assert_allclose(sounding.atmosphere().temperature[4], 240.15)
    assert MeasuredAtmosphere.of_sounding(path).heights.size == 5
    sentence = f"{path}, line 6: height is 8000 after 0: it must be at most 6000 m above"
    for use in (sounding.wind, lambda: MeasuredWind.of_sounding(path)):
        with pytest.raises(InputError, match=re.escape(sentence)):
            use()
    path.write_text(CSV.replace("\n2000", "\n9000"))
    for use in (read_sounding(path).wind, read_sounding(path).atmosphere):
        with pytest.raises(InputError, match="line 4: height is 9000 after 1000: it must be at"):
            use()


def test_levels_whose_pressures_a_rounding_makes_equal_are_read(tmp_path):
    """The standard, rounded to whole hPa at levels that are close, as a balloon reports each second
    and SPC merges two lists: read at every level, within a rounding of the standard."""
    path = tmp_path / "spc.txt"
    heights = np.concatenate([np.arange(0.0, 25e3, 250.0), 100.0 + np.arange(10.0)])
    heights = np.sort(np.concatenate([heights, [502.0, 12003.0, 20020.0, 20050.0]]))
    geometric = geometric_height(jnp.asarray(heights))
    known = standard_atmosphere(geometric)
    rows = zip(heights, np.asarray(known.pressure), np.asarray(known.temperature), strict=True)
    lines = [f"{p / 100:.0f}.00, {h}, {t - 273.15:.2f}, -9999.00, 270, 10" for h, p, t in rows]
    path.write_text("%RAW%\n" + "\n".join(lines) + "\n%END%\n")
    sounding = read_sounding(path)
    assert sounding.heights.size == heights.size
    assert np.sum(np.diff(sounding.pressure) == 0.0) >= 9
    found = sounding.atmosphere().air_at(geometric)
    # Half a rounding at a level, and a quarter of the change next to it between levels.
    np.testing.assert_allclose(found.pressure, known.pressure, atol=50.0 + 1e-6)
    # Half of the temperature's last digit, too.
    np.testing.assert_allclose(found.temperature, known.temperature, atol=0.005 + 1e-9)
    between = jnp.asarray(0.5 * (geometric[1:] + geometric[:-1]))
    found = sounding.atmosphere().air_at(between)
    np.testing.assert_allclose(found.pressure, standard_atmosphere(between).pressure, atol=100.0)
    # A scene file is built within a trace.
    traced = jax.eval_shape(lambda: MeasuredAtmosphere.of_sounding(path).temperature)
    assert traced.shape == heights.shape


@pytest.mark.parametrize(
    "text",
    [
        "# " + CSV,
        "# Heights of a flight; metres\n\n# note\n" + CSV.replace(",", ";").replace(".", ","),
        CSV.replace(",", "\t").replace("\n", "\r\n"),
        CSV.replace("(", "[").replace(")", "]"),
        CSV.replace(" (", "_").replace(")", "").replace("direction", "wind_direction"),
        CSV + "3000,nan,1.0,NaN,10\n4000,,,,\n5000\n",
        "%" + CSV.replace("1000", "% off\n1000"),
    ],
    ids=["comment", "semicolons", "tabulators", "brackets", "strokes", "missing", "percent"],
)
def test_forms_of_a_sounding(tmp_path, text):
    path, plain = tmp_path / "form.csv", tmp_path / "plain.csv"
    path.write_text(text)
    plain.write_text(CSV)
    np.testing.assert_array_equal(read_sounding(path)[:6], read_sounding(plain)[:6])


def test_the_errors_of_a_wind_have_their_covariance():
    """The recursion is the Cholesky factor of exp(-|h - h'|/l): its matrix times its transpose."""
    heights = np.array([0.0, 100.0, 150.0, 900.0, 4000.0])
    deviation = np.array([1.0, 2.0, 2.0, 3.0, 5.0])
    zero = jnp.zeros(5)

    def winds(z):
        wind = UncertainWind(heights, heights * 0.0 + 7.0, zero, deviation, 500.0, z, zero)
        return wind.at(jnp.asarray(heights))[0]

    factor = jax.jit(jax.jacfwd(winds))(zero)
    expected = np.exp(-np.abs(heights[:, None] - heights) / 500.0) * np.outer(deviation, deviation)
    np.testing.assert_allclose(factor @ factor.T, expected, rtol=1e-12)
    np.testing.assert_allclose(winds(zero), 7.0, rtol=1e-15)


def test_a_seed_makes_one_wind_and_many_make_its_spread():
    given = ([0.0, 1000.0], [5.0, 5.0], [0.0, 0.0], [2.0, 3.0], 800.0)
    many = UncertainWind.of_seed(*given, jnp.arange(4000.0))
    east, north = many.at(jnp.asarray(1000.0))
    one = UncertainWind.of_seed(*given, 17.0).at(jnp.asarray(1000.0))
    np.testing.assert_allclose([east[17], north[17]], one, rtol=1e-14)
    # The standard error of 4000 runs is 0.05 of the mean, and 0.011 of the deviation.
    assert abs(east.mean() - 5.0) < 0.2 and abs(east.std() / 3.0 - 1.0) < 0.05
    assert abs(np.corrcoef(east, north)[0, 1]) < 0.06


def spectrum_of(correlation, w):
    """(2/pi) int R(s) cos(w s) ds by trapezoids, whose error is that of the kink at s = 0."""
    s = np.linspace(0.0, 60.0, 600_001)
    return 2.0 / np.pi * np.trapezoid(correlation(s) * np.cos(w * s), s)


def along(s):
    return np.exp(-s)


def across(s):
    return (1.0 - 0.5 * s) * np.exp(-s)


def test_nodes_that_are_close_together():
    """The difference of two neighbours has the variance 2 (1 - R), about 3 s: to a distance of
    1e-12 correlation lengths, and at one place."""
    for s in (1e-3, 1e-6, 1e-8, 1e-12, 0.0):
        steps = np.array([0.3, s])
        factor = jax.jacfwd(lambda z, steps=steps: transverse(steps, z))(jnp.zeros((3, 2)))
        change = (factor[2] - factor[1]).ravel()
        # 1 - (1 - s/2) exp(-s), without the difference.
        expected = 2.0 * (0.5 * s * np.exp(-s) - np.expm1(-s))
        np.testing.assert_allclose(change @ change, expected, rtol=1e-6)
    # The part of a step that is independent of the other: s^3/12 of w_2.
    np.testing.assert_allclose(_fresh(np.array([1e-7]))[0, 1, 1] ** 2, 1e-21 / 12.0, rtol=1e-6)


def test_the_filters_are_exact_at_uneven_nodes_and_have_the_spectra_of_the_standard():
    """The covariance of the sequences at their nodes is R of the distance; the transform of R is
    the spectrum of MIL-F-8785C, whose integral is the variance."""
    steps = np.array([0.05, 0.4, 1e-3, 2.0, 0.1])
    at = np.append(0.0, np.cumsum(steps))
    apart = np.abs(at[:, None] - at)
    factor = jax.jit(jax.jacfwd(lambda z: longitudinal(jnp.asarray(steps), z)))(jnp.zeros(6))
    np.testing.assert_allclose(factor @ factor.T, along(apart), atol=1e-12)
    factor = jax.jit(jax.jacfwd(lambda z: transverse(steps, z)))(jnp.zeros((6, 2))).reshape(6, 12)
    np.testing.assert_allclose(factor @ factor.T, across(apart), atol=1e-12)
    for w in (0.0, 0.3, 1.0, 4.0):
        u, v = 2.0 / np.pi / (1.0 + w * w), (1.0 + 3.0 * w * w) / np.pi / (1.0 + w * w) ** 2
        np.testing.assert_allclose(spectrum_of(along, w), u, rtol=1e-6)
        np.testing.assert_allclose(spectrum_of(across, w), v, rtol=1e-6)


@pytest.fixture(scope="module")
def gusts_of_many_seeds():
    return DrydenGusts.of_severity("moderate", jnp.arange(3000.0), top=2500.0)


def test_scales_and_intensities_of_the_standard():
    """MIL-F-8785C, 3.7.3: by hand at 100 ft, at 1000 ft and aloft, and half way at 1500 ft."""
    h = FOOT * np.array([100.0, 1000.0, 1500.0, 3750.0])
    horizontal, vertical = dryden_lengths(h)
    low = 100.0 / (0.177 + 0.0823) ** 1.2
    np.testing.assert_allclose(horizontal / FOOT, [low, 1000.0, 1375.0, 1750.0], rtol=1e-12)
    np.testing.assert_allclose(vertical / FOOT, [100.0, 1000.0, 1375.0, 1750.0], rtol=1e-12)
    rms = jnp.asarray(FOOT * np.array([8.6, 9.6, 10.6, 10.1, 8, 6.6, 5, 4.2, 2.7, 0, 0, 0]))
    u, w = dryden_intensities(h, 15.0, rms)
    aloft = FOOT * (9.6 + 1.0 * 250.0 / 2000.0)
    np.testing.assert_allclose(w, [1.5, 1.5, 0.5 * (1.5 + aloft), FOOT * 10.6], rtol=1e-12)
    expected = [1.5 / 0.2593**0.4, 1.5, 0.5 * (1.5 + aloft), FOOT * 10.6]
    np.testing.assert_allclose(u, expected, rtol=1e-12)
    assert RMS_HEIGHTS[-1] == FOOT * 80e3


def test_gusts_of_many_seeds_have_variances_and_spectra_of_the_standard(gusts_of_many_seeds):
    """3000 fields: at heights of both models, at the nodes; the variance errs by 2.6 percent
    (sqrt(2/3000)), the spectrum of 3 frequencies by the same over the root of 2."""
    many = gusts_of_many_seeds
    heights, data = np.asarray(many.heights), np.asarray(many.data)
    for height in (15.0, 200.0, 450.0, 1500.0):
        k = int(np.argmin(np.abs(heights - height)))
        u, w = dryden_intensities(heights[k : k + 1], many.wind_20_feet, many.rms_aloft)
        found = np.std(data[k, :3], axis=-1)
        np.testing.assert_allclose(found, [u[0], u[0], w[0]], rtol=0.07)
    # Where scale and intensity change least: above 2000 ft on even nodes.
    part = (heights > 650.0) & (heights < 2400.0)
    x = data[part, :3]
    spacing = np.diff(heights[part]).mean()
    sigma = np.asarray(dryden_intensities(heights[part], 0.0, many.rms_aloft)[0])
    x = x / sigma[:, None, None]
    n, scale = x.shape[0], 1750.0 * FOOT
    # The expected periodogram, from R, so that neither leakage nor aliasing is an error.
    lags = np.arange(-n + 1, n)
    for number, correlation in enumerate((across, across, along)):
        power = np.mean(np.abs(np.fft.rfft(x[:, number], axis=0)) ** 2, axis=-1) / n
        triangle = (1.0 - np.abs(lags) / n) * correlation(np.abs(lags) * spacing / scale)
        for j in (1, 3, 8):
            expected = np.sum(triangle * np.cos(2.0 * np.pi * j * lags / n))
            np.testing.assert_allclose(power[j], expected, rtol=0.1)


def test_a_field_of_gusts_is_one_smooth_function_of_the_height(gusts_of_many_seeds):
    """Of a seed, whatever flies with it: each run of a batch is its own seed, the slope is
    continuous, and between the nodes little of the variance is lost."""
    many = gusts_of_many_seeds
    one = DrydenGusts.of_severity("moderate", 5.0, top=2500.0)
    np.testing.assert_allclose(one.data, many.data[..., 5], atol=1e-13)
    slope = jax.jit(jax.vmap(jax.jacfwd(lambda h: jnp.stack(one.at(h)))))
    at = one.heights[1:-1]
    np.testing.assert_allclose(slope(at * (1 - 1e-12)), slope(at * (1 + 1e-12)), atol=1e-6)
    high = np.asarray(many.heights)[-40:]
    between = jnp.asarray(0.5 * (high[1:] + high[:-1]))[:, None]
    lost = 1.0 - np.var(np.stack(many.at(between))) / np.var(np.asarray(many.data)[-40:, :3])
    assert 0.0 < lost < 0.06
    single = jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), one)
    assert all(x.dtype == jnp.float32 for x in single.at(jnp.float32(700.0)))
    with pytest.raises(InputError, match="severity is 'wild': it must be one of light"):
        DrydenGusts.of_severity("wild", 1.0)


def test_wind_and_gusts_meet_over_flat_ground_and_over_a_planet():
    gusts = DrydenGusts.of_severity("light", 3.0, top=2000.0)
    wind = MeasuredWind([0.0, 4000.0], [10.0, 10.0], [2.0, 2.0])
    flat = LocalAir(elevation=500.0, wind=wind, gusts=gusts)
    east, north, rising = gusts.at(jnp.asarray(700.0))
    moving = flat.velocity(jnp.array([0.0, 0.0, 700.0]))
    np.testing.assert_allclose(moving, [10.0 + east, 2.0 + north, rising], rtol=1e-13)
    round_ = LocalAir(radius=6.4e6, elevation=500.0, wind=wind, gusts=gusts)
    moving = round_.velocity(jnp.array([6.4e6 + 700.0, 0.0, 0.0]))
    # Outwards, east and north at a point of the equator; the height loses digits to the radius.
    np.testing.assert_allclose(moving, [rising, 10.0 + east, 2.0 + north], rtol=1e-7)
    site = LaunchSite(5.0, 1.5, wind=wind, gusts=gusts)
    assert site.air.gusts is gusts


def falling(gusts):
    """A load under a parachute from 400 m on."""
    air = LocalAir(wind=MeasuredWind([0.0, 4000.0], [5.0, 9.0], [0.0, 0.0]), gusts=gusts)
    scene = Scene([GroundGravity(9.8), Parachute(4.0, air=air)], RigidBody(20.0))
    return scene, BodyState(jnp.array([0.0, 0.0, 400.0]), jnp.array([0.0, 0.0, -9.0]))


def test_gusts_keep_the_accuracy_of_an_adaptive_run():
    """At ten times the tolerance the end moves by a hundred times less than the gusts move it."""
    gusts = DrydenGusts.of_severity("severe", 8.0, top=1000.0)
    # Of the same nodes, so that all three runs are one program.
    calm = DrydenGusts(8.0, 0.0, np.zeros(12), top=1000.0)
    ends = []
    for field, accuracy in ((gusts, 1e-6), (gusts, 1e-9), (calm, 1e-9)):
        scene, y0 = falling(field)
        ends.append(simulate(scene, y0, jnp.array([0.0, 30.0]), accuracy=accuracy).final.position)
    moved = np.linalg.norm(ends[2] - ends[1])
    assert moved > 5.0
    assert np.linalg.norm(ends[0] - ends[1]) < 1e-4 * moved


SCENE = """
accuracy = 1e-6
[body]
mass = "20 kg"
[effects.ground_gravity]
gravity = 9.8
[effects.parachute]
drag_area = "4 m^2"
[effects.parachute.air]
atmosphere = { sounding = "sounding.csv" }
wind = { sounding = "sounding.csv" }
gusts = { severity = "moderate", seed = 1.0, top = "500 m" }
[initial]
position = [0.0, 0.0, 300.0]
velocity = [0.0, 0.0, -9.0]
[times]
end = "5 s"
[dispersion]
runs = 16
outputs = ["final.position.0"]
[dispersion.inputs]
"effects.parachute.air.gusts.seed" = { distribution = "uniform", low = 0.0, high = 1e6 }
"""


@pytest.fixture
def scene_file(tmp_path):
    (tmp_path / "sounding.csv").write_text(CSV)
    (tmp_path / "scene.toml").write_text(SCENE)
    return load(tmp_path / "scene.toml")


def test_a_file_names_sounding_and_gusts_and_a_campaign_draws_the_seed(scene_file):
    air = scene_file.system.effects[1].air
    np.testing.assert_allclose(air.wind.at(1000.0), [-10.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(air.atmosphere.air_at(2000.0).pressure, 79495.0, rtol=1e-12)
    seeds = jnp.array([3.0, 4.0])
    mission, _ = scene_file.campaign().build({"effects.parachute.air.gusts.seed": seeds})
    found = mission.phases[0].system.effects[1].air.gusts
    expected = DrydenGusts.of_severity("moderate", seeds, top=500.0)
    np.testing.assert_allclose(found.data, expected.data, atol=1e-12)


def test_a_campaign_of_a_file_draws_the_errors_of_a_wind(tmp_path):
    wind = """wind = { heights = [0.0, 3000.0], east = [5.0, 7.0], north = [0.0, 0.0],\
 deviation = [1.0, 2.0], correlation_length = "800 m", seed = 1.0 }"""
    text = SCENE.replace('wind = { sounding = "sounding.csv" }', wind).replace(
        "air.gusts.seed", "air.wind.seed"
    )
    (tmp_path / "sounding.csv").write_text(CSV)
    (tmp_path / "scene.toml").write_text(text)
    seeds = jnp.array([3.0, 4.0])
    campaign = load(tmp_path / "scene.toml").campaign()
    mission, _ = campaign.build({"effects.parachute.air.wind.seed": seeds})
    found = mission.phases[0].system.effects[1].air.wind
    given = ([0.0, 3000.0], [5.0, 7.0], [0.0, 0.0], [1.0, 2.0], 800.0)
    expected = UncertainWind.of_seed(*given, seeds)
    np.testing.assert_allclose(found.data, expected.data, atol=1e-12)


@pytest.mark.sweep
def test_a_campaign_of_gusts_drifts_apart(scene_file):
    result = disperse(scene_file.campaign(), scene_file.runs, seed=1)
    drift = np.asarray(result.outputs["final.position.0"])
    assert np.all(np.isfinite(drift)) and drift.std() > 0.1
