"""Orbits from and to other programs: the test case of SGP4, messages that come back as they
were."""

from pathlib import Path

import numpy as np
import pytest

from jaxspace.core import InputError
from jaxspace.io.ephemeris import Ephemeris, read_oem, write_oem
from jaxspace.io.mean_elements import read_omm, read_tle

# Vallado et al., AIAA 2006-6753, the first verification case: epoch and states after 0 and 360 min.
TLE = """VANGUARD 1
1 00005U 58002B   00179.78495062  .00000023  00000-0  28098-4 0  4753
2 00005  34.2682 348.7242 1859667 331.7664  19.3264 10.82419157413667
"""
STATES = np.array(
    [
        [7022.46529266, -1400.08296755, 0.03995155, 1.893841015, 6.405893759, 4.534807250],
        [-7154.03120202, -3783.17682504, -3536.19412294, 4.741887409, -4.151817765, -2.093935425],
    ]
)
OMM = """<omm id="CCSDS_OMM_VERS" version="2.0"><body><segment><metadata>
<OBJECT_NAME>VANGUARD 1</OBJECT_NAME><OBJECT_ID>1958-002B</OBJECT_ID>
<CENTER_NAME>EARTH</CENTER_NAME><REF_FRAME>TEME</REF_FRAME><TIME_SYSTEM>UTC</TIME_SYSTEM>
<MEAN_ELEMENT_THEORY>SGP4</MEAN_ELEMENT_THEORY></metadata><data><meanElements>
<EPOCH>2000-06-27T18:50:19.733568</EPOCH><MEAN_MOTION>10.82419157</MEAN_MOTION>
<ECCENTRICITY>.1859667</ECCENTRICITY><INCLINATION>34.2682</INCLINATION>
<RA_OF_ASC_NODE>348.7242</RA_OF_ASC_NODE><ARG_OF_PERICENTER>331.7664</ARG_OF_PERICENTER>
<MEAN_ANOMALY>19.3264</MEAN_ANOMALY></meanElements><tleParameters>
<EPHEMERIS_TYPE>0</EPHEMERIS_TYPE><CLASSIFICATION_TYPE>U</CLASSIFICATION_TYPE>
<NORAD_CAT_ID>5</NORAD_CAT_ID><ELEMENT_SET_NO>475</ELEMENT_SET_NO>
<REV_AT_EPOCH>41366</REV_AT_EPOCH><BSTAR>.28098E-4</BSTAR>
<MEAN_MOTION_DOT>2.3E-7</MEAN_MOTION_DOT><MEAN_MOTION_DDOT>0</MEAN_MOTION_DDOT>
</tleParameters></data></segment></body></omm>
"""


def test_a_two_line_set_is_that_of_the_verification():
    pytest.importorskip("sgp4")
    (satellite,) = read_tle(TLE)
    run = satellite.ephemeris([0.0, 21600.0])
    found = np.concatenate([run.position, run.velocity]).T / 1e3
    # Eight digits after the point are printed, of the velocity nine.
    np.testing.assert_allclose(found, STATES, atol=1.5e-8)
    assert (run.name, run.identifier, run.frame) == ("VANGUARD 1", "58002B", "TEME")
    assert satellite.epoch == "2000-06-27T18:50:19.733568"
    np.testing.assert_allclose(satellite.state().position, 1e3 * STATES[0, :3], atol=2e-5)


def test_a_message_of_mean_elements_is_the_same_orbit(tmp_path):
    """The mean motion of the message has a digit less; the epoch a microsecond."""
    pytest.importorskip("sgp4")
    path = tmp_path / "one.xml"
    path.write_text(OMM)
    (satellite,) = read_omm(path)
    assert satellite.name == "VANGUARD 1" and satellite.epoch == "2000-06-27T18:50:19.733568"
    run = satellite.ephemeris([0.0, 21600.0])
    np.testing.assert_allclose(run.position.T, 1e3 * STATES[:, :3], atol=1.0)
    with pytest.raises(InputError, match="must end with .xml or .csv"):
        read_omm(tmp_path / "one.txt")


def test_faults_of_two_line_sets(tmp_path):
    pytest.importorskip("sgp4")
    path = tmp_path / "sets.tle"
    path.write_text(TLE)
    assert read_tle(path)[0].name == "VANGUARD 1"
    with pytest.raises(InputError, match="line 2 .*its check sum, column 69, is '4' and must be 3"):
        read_tle(TLE.replace("4753", "4754"))
    with pytest.raises(InputError, match="line 2 .*a second line must follow"):
        read_tle("\n".join(TLE.splitlines()[:2]) + "\n")
    with pytest.raises(InputError, match="no two-line"):
        read_tle("nothing\n")
    decayed = TLE.replace("1859667", "9859667").replace("413667", "413665")
    with pytest.raises(InputError, match="SGP4 has no state of VANGUARD 1"):
        read_tle(decayed)[0].ephemeris(np.arange(0.0, 8e3, 100.0))


# Each that decays within 42 days among the verification cases of SGP4: the side of the epoch, and
# the first minute for which SGP4 alone reports an error, by calls at every second.
DECAYS = {
    "11801": (1, 63338.0), "16925": (1, 54377.9), "22312": (1, 489.2), "23333": (1, 20078.9),
    "28350": (1, 1472.2), "28872": (1, 51.6), "29141": (-1, 670.2), "28623": (-1, 54551.4),
}  # fmt: skip


@pytest.mark.parametrize("number", DECAYS)
def test_a_satellite_that_decayed_has_no_state_at_any_later_time(number):
    """Before it the states are those of SGP4; beyond, every one is refused, also where SGP4 by
    itself returns to 6,478 km or to 2e13 m, alone, among others and in another order."""
    sgp4 = pytest.importorskip("sgp4")
    lines = (Path(sgp4.__file__).parent / "SGP4-VER.TLE").read_text().splitlines()
    k = next(k for k, line in enumerate(lines) if line[2:7] == number)
    (satellite,) = read_tle("\n".join(line[:69] for line in lines[k : k + 2]) + "\n")
    side, end = DECAYS[number]
    before = side * 60.0 * np.linspace(0.0, end - 0.4, 7)
    run = satellite.ephemeris(before)
    status, r, _ = satellite.record.sgp4_tsince(before[-1] / 60.0)
    assert status == 0
    np.testing.assert_allclose(run.position[:, -1], 1e3 * np.array(r), rtol=1e-6)
    later = side * 60.0 * np.append(end + 0.4, end * np.array([1.01, 1.1, 1.5, 3.0]))
    for t in later:
        with pytest.raises(InputError, match=f"no state of .* {'after' if side > 0 else 'before'}"):
            satellite.state(t)
    with pytest.raises(InputError, match="no state"):
        satellite.ephemeris(np.append(later[-1], before))
    # Away from the decay, on the other side of the epoch, there are states.
    assert np.isfinite(satellite.state(-side * 60.0).position).all()


def test_times_of_an_ephemeris():
    pytest.importorskip("sgp4")
    (satellite,) = read_tle(TLE)
    # Far away: no decay, and no search without an end.
    assert np.isfinite(satellite.state(-1e8).position).all()
    for wrong in ([np.nan], [0.0, np.inf], np.zeros((2, 2))):
        with pytest.raises(InputError, match="ts is .*finite numbers"):
            satellite.ephemeris(wrong)


NAME, FIRST, SECOND = TLE.splitlines()
OF_ANOTHER = "2 00006  34.2682 348.7242 1859667 331.7664  19.3264 10.82419157413668"


@pytest.mark.parametrize(
    "lines, sentence",
    [
        # Its mean motion would be 10.82, and the last one of 15.72125391 was read as 15.7212.
        ([FIRST, SECOND[:57]], "line 2 is .*: it has 57 columns and must have at least 68"),
        ([FIRST, OF_ANOTHER], "line 2 is .*00006.*: it must be of the satellite of '1 00005U"),
        ([FIRST[:60], SECOND, FIRST, SECOND], "line 1 is .*: it has 60 columns"),
        ([NAME, FIRST, NAME, SECOND], "line 3 is 'VANGUARD 1': it must be the second line of '1"),
        ([NAME, "l" + FIRST[1:], SECOND], "line 3 is .*: a first line, .* must precede it"),
        ([FIRST, SECOND[:68] + "O"], "line 2 is .*: its check sum, column 69, is 'O' and must be"),
        (
            [FIRST, SECOND.replace("34.2", "3A.2")],
            "line 2 .*: its inclination, columns 9 to 16, is",
        ),
        ([FIRST, SECOND.replace("18596", "18S96")], "line 2 .*: its eccentricity, .* is '18S9667'"),
        ([FIRST, SECOND.replace(".8241", ".82A1")], "line 2 .*: its mean motion, .*'10.82A19157'"),
        ([FIRST, SECOND.replace("4136", "4I36")], "line 2 .*: its revolution at the epoch, .*4I36"),
        ([FIRST.replace("28098", "2B098"), SECOND], "line 1 .*: its drag term, columns 54 to 61"),
        ([FIRST.replace("00179.7", "OO179.7"), SECOND], "line 1 .*: its year of the epoch"),
        ([FIRST.replace("00005U", "0I005U"), SECOND], "line 1 .*: its number in the catalogue"),
        # A column is lost, and with it the check sum: all that follow are one to the left.
        ([FIRST, SECOND.replace(" 348", "348")], "line 2 .*: column 17 must be blank"),
    ],
)
def test_lines_of_two_line_sets_that_are_refused(lines, sentence):
    pytest.importorskip("sgp4")
    with pytest.raises(InputError, match="the text, " + sentence):
        read_tle("\n".join(lines) + "\n")


def test_two_line_sets_of_the_verification_are_read(tmp_path):
    """All that the library ships, but three whose authors changed them without their check sum;
    indented and without names, too."""
    sgp4 = pytest.importorskip("sgp4")
    lines = (Path(sgp4.__file__).parent / "SGP4-VER.TLE").read_text().splitlines()
    sets = [line for line in lines if line[:2] in ("1 ", "2 ") and line[2:5] != "333"]
    found = read_tle("\n".join("  " + line for line in sets))
    assert len(found) == len(sets) // 2 == 30
    motions = [float(second[52:63]) for second in sets[1::2]]
    read = [orbit.record.no_kozai * 720.0 / np.pi for orbit in found]
    np.testing.assert_allclose(read, motions, rtol=1e-14)


@pytest.mark.parametrize(
    "old, new, sentence",
    [
        ("<BSTAR>.28098E-4</BSTAR>", "", "satellite 1, has no BSTAR"),
        ("348.7242", "34B.7242", "satellite 1, has a wrong entry: .*34B.7242"),
        ("</omm>", "", "is no message of mean elements"),
    ],
)
def test_messages_of_mean_elements_that_are_refused(tmp_path, old, new, sentence):
    pytest.importorskip("sgp4")
    path = tmp_path / "one.xml"
    path.write_text(OMM.replace(old, new))
    with pytest.raises(InputError, match=sentence):
        read_omm(path)


def test_an_ephemeris_message_comes_back(tmp_path):
    """Bit for bit, and times to a nanosecond, across a midnight and in two segments."""
    times = np.array([0.0, 60.0, 120.5, 86400.25])
    r, v = np.random.default_rng(2).normal(size=(2, 3, 4)) * [[[7e6]], [[7e3]]]
    one = Ephemeris("2026-02-28T23:59:30.125", times, r, v, "ONE", "2026-001A")
    other = Ephemeris("2026-03-01T00:00:00.0", times[:2], r[:, :2], v[:, :2], frame="ICRF")
    path = tmp_path / "orbits.oem"
    write_oem(path, [one, other], created="2026-01-01T00:00:00")
    first, second = read_oem(path)
    np.testing.assert_allclose(first.times, times, atol=2e-9)
    np.testing.assert_allclose(first.position, r, rtol=4e-16)
    np.testing.assert_allclose(first.velocity, v, rtol=4e-16)
    assert (first.name, first.identifier, first.epoch) == ("ONE", "2026-001A", one.epoch + "000000")
    assert second.frame == "ICRF" and second.name == "UNKNOWN" and second.times.shape == (2,)
    np.testing.assert_allclose(first.path()(60.0), r[:, 1], rtol=1e-12)
    np.testing.assert_array_equal(first.state(2).velocity, first.velocity[:, 2])


# Annex G of the standard, shortened: comments, accelerations, a covariance, a day of the year.
ANNEX = """CCSDS_OEM_VERS = 2.0
COMMENT from Mars
CREATION_DATE = 1996-11-04T17:22:31
ORIGINATOR = NASA/JPL
META_START
OBJECT_NAME = MARS GLOBAL SURVEYOR
OBJECT_ID = 1996-062A
CENTER_NAME = MARS BARYCENTER
REF_FRAME = EME2000
TIME_SYSTEM = UTC
START_TIME = 1996-12-28T21:29:07.267
STOP_TIME = 1996-12-30T01:28:02.267
INTERPOLATION = HERMITE
META_STOP
COMMENT two states
1996-12-28T21:29:07.267 -2432.166 -063.042 1742.754 7.33702 -3.495867 -1.041945
1996-363T21:59:02.267 -2445.234 -878.141 1873.073 1.86043 -3.421256 -0.996366 0.1 0.2 0.3
COVARIANCE_START
EPOCH = 1996-12-28T22:28:02.267
3.3313494e-04
COVARIANCE_STOP
"""


def test_the_message_of_the_standard(tmp_path):
    path = tmp_path / "mars.oem"
    path.write_text(ANNEX)
    (found,) = read_oem(path)
    assert found.centre == "MARS BARYCENTER" and found.epoch == "1996-12-28T21:29:07.267"
    np.testing.assert_allclose(found.times, [0.0, 1795.0], atol=1e-9)
    np.testing.assert_allclose(found.position[:, 1], [-2445234.0, -878141.0, 1873073.0])
    for old, new, sentence in (
        ("CCSDS_OEM_VERS", "CCSDS_OPM_VERS", "must begin with CCSDS_OEM_VERS"),
        ("REF_FRAME = EME2000\n", "", "lacks REF_FRAME"),
        (" -1.041945", "", "line 16.*6 columns"),
        ("1996-363T21:59", "1996-360T21:59", "do not ascend"),
        ("1996-363T21", "soon", "is no time"),
        ("7.33702", "fast", "is no number"),
    ):
        path.write_text(ANNEX.replace(old, new))
        with pytest.raises(InputError, match=sentence):
            read_oem(path)
