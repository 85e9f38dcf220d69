"""Orbits from and to other programs: the test case of SGP4, messages that come back as they
were."""

import re
from pathlib import Path

import numpy as np
import pytest

from jaxspace.core import InputError
from jaxspace.io._two_line import check_sum
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
    path.write_text("one,two\n1,2\n")
    with pytest.raises(InputError, match="is not a mean-elements message: it must begin with <"):
        read_omm(path)


# The first example of the standard, in keyword = value notation: its epoch is a day of the year.
KVN = """CCSDS_OMM_VERS = 3.0
CREATION_DATE = 2007-065T16:00:00
ORIGINATOR = NOAA
COMMENT as figure 4-1
OBJECT_NAME = GOES 9
OBJECT_ID = 1995-025A
CENTER_NAME = EARTH
REF_FRAME = TEME
TIME_SYSTEM = UTC
MEAN_ELEMENT_THEORY = SGP/SGP4
EPOCH = 2007-064T10:34:41.4264
MEAN_MOTION = 1.00273272 [rev/day]
ECCENTRICITY = 0.0005013
INCLINATION = 3.0539 [deg]
RA_OF_ASC_NODE = 81.7939 [deg]
ARG_OF_PERICENTER = 249.2363
MEAN_ANOMALY = 150.1602
GM = 398600.8
EPHEMERIS_TYPE = 0
CLASSIFICATION_TYPE = U
NORAD_CAT_ID = 23581
ELEMENT_SET_NO = 0925
REV_AT_EPOCH = 4316
BSTAR = 0.0001
MEAN_MOTION_DOT = -0.00000113
MEAN_MOTION_DDOT = 0.0
"""


def other_notations(message):
    """The same message in XML and in CSV."""
    lines = [line.split(" [")[0] for line in message.splitlines() if " = " in line][3:]
    pairs = [line.split(" = ") for line in lines]
    # The names of the groups are for people; what counts is the segment.
    body = "".join(f"<{key}>{value}</{key}>\n" for key, value in pairs)
    segment = (
        f"<segment><metadata></metadata><data><meanElements>{body}</meanElements></data></segment>"
    )
    xml = f'<?xml version="1.0"?>\n<ndm><omm id="CCSDS_OMM_VERS"><body>{segment}</body></omm></ndm>'
    return xml, "\n".join(",".join(row) for row in zip(*pairs, strict=True)) + "\n"


def test_the_example_of_the_standard_in_every_notation(tmp_path):
    """The state at the epoch is that of the reader of the library, by its epoch in microseconds."""
    omm = pytest.importorskip("sgp4.omm")
    api = pytest.importorskip("sgp4.api")
    keys = {
        k.strip(): v.split(" [")[0].strip()
        for k, v in (x.split("=") for x in KVN.splitlines() if "=" in x)
    }
    record = api.Satrec()
    omm.initialize(record, keys | {"EPOCH": "2007-03-05T10:34:41.426400"})
    error, r, v = record.sgp4(record.jdsatepoch, record.jdsatepochF)
    assert error == 0
    path = tmp_path / "message.omm"
    for text in (KVN, *other_notations(KVN), KVN.replace("\n", "\r\n"), "\ufeff" + KVN):
        path.write_text(text, encoding="utf-8", newline="")
        (satellite,) = read_omm(path)
        assert satellite.name == "GOES 9" and satellite.epoch == "2007-03-05T10:34:41.426400"
        for name in ("satnum", "elnum", "revnum", "ephtype", "classification", "intldesg"):
            assert getattr(satellite.record, name) == getattr(record, name)
        np.testing.assert_allclose(satellite.state().position, 1e3 * np.array(r), rtol=1e-14)
        np.testing.assert_allclose(satellite.state().velocity, 1e3 * np.array(v), rtol=1e-13)


@pytest.mark.parametrize(
    "text, epoch",
    [
        ("2007-03-05T10:34:41", "2007-03-05T10:34:41"),
        ("2007-03-05T10:34:41Z", "2007-03-05T10:34:41"),
        ("2007-064T10:34:41Z", "2007-03-05T10:34:41"),
        ("2007-064T10:34:41.5Z", "2007-03-05T10:34:41.500000"),
        ("2007-03-05T10:34:41.426400000000", "2007-03-05T10:34:41.426400"),
        ("2008-366T23:59:59.25", "2008-12-31T23:59:59.250000"),
    ],
)
def test_epochs_of_the_standard(tmp_path, text, epoch):
    pytest.importorskip("sgp4")
    path = tmp_path / "message.omm"
    path.write_text(KVN.replace("2007-064T10:34:41.4264", text))
    assert read_omm(path)[0].epoch == epoch
    path = tmp_path / "path.oem"
    path.write_text(ANNEX.replace("1996-12-28T21:29:07.267 -", "1996-12-28T21:29:07Z -"))
    assert read_oem(path)[0].times[1] == 1795.267


@pytest.mark.parametrize(
    "key, value, allowed",
    [
        ("EPOCH", "2007-366T00:00:00", "a time such as"),
        ("EPOCH", "2007-02-29T00:00:00", "a time such as"),
        ("EPOCH", "2007-000T00:00:00", "a time such as"),
        ("EPOCH", "2016-12-31T23:59:60", "a time such as .*, other than a leap second"),
        ("EPOCH", "2007-03-05 10:34:41", "a time such as"),
        ("MEAN_MOTION", "-3", "above 0 and at most 18"),
        ("MEAN_MOTION", "0", "above 0 and at most 18"),
        ("MEAN_MOTION", "1e400", "above 0 and at most 18"),
        ("ECCENTRICITY", "nan", "at least 0 and below 1"),
        ("ECCENTRICITY", "1", "at least 0 and below 1"),
        ("ECCENTRICITY", "0,0005", "at least 0 and below 1"),
        ("INCLINATION", "180.1", "from 0 to 180 degrees"),
        ("RA_OF_ASC_NODE", "361", "from -360 to 360 degrees"),
        ("MEAN_ANOMALY", "725", "from -360 to 360 degrees"),
        ("BSTAR", "inf", "from -1e9 to 1e9"),
        ("MEAN_MOTION_DOT", "1_0", "from -1e9 to 1e9"),
        ("REV_AT_EPOCH", "-1", "a whole number"),
        ("NORAD_CAT_ID", "5.5", "a whole number"),
        ("EPHEMERIS_TYPE", "4", "at most 3, because higher types belong to another theory"),
        ("MEAN_ELEMENT_THEORY", "DSST", "SGP4 or SGP"),
        ("TIME_SYSTEM", "TAI", "UTC"),
        ("REF_FRAME", "GCRF", "TEME"),
        ("CENTER_NAME", "MARS", "EARTH"),
    ],
)
def test_entries_of_messages_that_are_refused(tmp_path, key, value, allowed):
    """Each with its line and keyword, in every notation."""
    pytest.importorskip("sgp4")
    lines = [f"{key} = {value}" if x.startswith(f"{key} =") else x for x in KVN.splitlines()]
    wrong = "\n".join(lines) + "\n"
    path = tmp_path / "message.omm"
    for text in (wrong, *other_notations(wrong)[: 2 if "," not in value else 1]):
        path.write_text(text)
        sentence = f"message.omm, line ([0-9]+): {key} is .*: it must be {allowed}"
        with pytest.raises(InputError, match=sentence) as error:
            read_omm(path)
        (number,) = re.findall("line ([0-9]+):", str(error.value))
        at = text.splitlines()[int(number) - 1]
        # Of CSV the row, below its heading.
        assert value in at and (key in at or number == "2")


def test_what_a_message_may_leave_out(tmp_path):
    """The values of a two-line set; numbers beyond its range are read, and left out."""
    pytest.importorskip("sgp4")
    path = tmp_path / "message.omm"
    optional = ("EPHEMERIS_TYPE", "CLASSIFICATION_TYPE", "REV_AT", "ELEMENT_SET", "MEAN_MOTION_D")
    kept = [line for line in KVN.splitlines() if not line.startswith(optional)]
    path.write_text("\n".join(kept).replace("23581", "799500123"))
    (satellite,) = read_omm(path)
    assert satellite.record.satnum == 0 and satellite.record.classification == "U"
    path.write_text(KVN.replace("BSTAR = 0.0001", "BSTAR ="))
    with pytest.raises(InputError, match="message.omm, line 24: satellite 1 has no BSTAR"):
        read_omm(path)
    path.write_text(KVN + "BSTAR = 0.0002\n")
    with pytest.raises(InputError, match="line 27 repeats BSTAR: it must occur once"):
        read_omm(path)
    path.write_text("EPOCH,MEAN_MOTION\n2007-064T10:34:41,1,2\n")
    with pytest.raises(InputError, match="line 2 has 3 fields: it must have 2"):
        read_omm(path)
    path.write_text('<!DOCTYPE x [<!ENTITY a "aaaa">]>\n<omm/>')
    with pytest.raises(InputError, match="line 1 declares the entity 'a', which is not allowed"):
        read_omm(path)
    path.write_text("<omm/>")
    with pytest.raises(InputError, match="has no elements"):
        read_omm(path)


def test_faults_of_two_line_sets(tmp_path):
    pytest.importorskip("sgp4")
    path = tmp_path / "sets.tle"
    path.write_text(TLE)
    assert read_tle(path)[0].name == "VANGUARD 1"
    with pytest.raises(InputError, match="line 2 .*its check sum, column 69, is '4' and must be 3"):
        read_tle(TLE.replace("4753", "4754"))
    with pytest.raises(InputError, match="line 2 .*a second line must follow"):
        read_tle("\n".join(TLE.splitlines()[:2]) + "\n")
    with pytest.raises(InputError, match="the text has no two-line"):
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
        ([FIRST, OF_ANOTHER], "line 2 is .*00006.*: it must belong to the satellite of '1 00005U"),
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
        (
            [FIRST.replace("00179", "00999"), SECOND],
            "line .*its day of the epoch, .* 21 to 32, is 999.78",
        ),
        (
            [FIRST.replace("00179", "00000"), SECOND],
            "line .*its day .*: it must be from 1 to the end of",
        ),
        ([FIRST.replace("00179", "01366"), SECOND], "line .*must be from 1 to the end of day 365"),
        (
            [FIRST.replace(" 0  4", " 4  4"), SECOND],
            "line 1 .*: its type of .* is 4: it must be from 0 to 3",
        ),
        (
            [FIRST, SECOND.replace(" 34.2", "251.6")],
            "line .*inclination, .* 251.6682: .* from 0 to 180",
        ),
        (
            [FIRST, SECOND.replace(" 34.2", " -4.2")],
            "line .*inclination, .* -4.2682: .* from 0 to 180",
        ),
        (
            [FIRST, SECOND.replace("348.7", "360.1")],
            "line .*ascending node, .* 360.1242: .* from 0 to",
        ),
        (
            [FIRST, SECOND.replace("331.7", "431.7")],
            "line .*perigee, .* 431.7664: it must be from 0 to",
        ),
        ([FIRST, SECOND.replace(" 19.3", "725.3")], "line 2 .* mean anomaly, .* 725.3264: it must"),
        (
            [FIRST, SECOND.replace("10.82", " 0.00").replace("419157", "000000")],
            "line .*is 0.00000000: ",
        ),
        (
            [FIRST, SECOND.replace("10.82", "-3.82")],
            "line .*mean motion, .*: it must be above 0 and at",
        ),
        (
            [FIRST, SECOND.replace("10.82", "18.82")],
            "line .*above 0 and at most 18 revolutions per day",
        ),
        # A column is lost, and with it the check sum: all that follow are one to the left.
        ([FIRST, SECOND.replace(" 348", "348")], "line 2 .*: column 17 must be blank"),
    ],
)
def test_lines_of_two_line_sets_that_are_refused(lines, sentence):
    pytest.importorskip("sgp4")
    with pytest.raises(InputError, match="the text, " + sentence):
        read_tle("\n".join(lines) + "\n")


def with_sum(line):
    return line[:68] + check_sum(line)


def test_fields_of_two_line_sets_at_their_limits(tmp_path):
    """Angles of 0 and 360 degrees, the last day of a leap year, both ends of the century, and the
    last number of "alpha-5"; in a file of Windows that begins with a byte order mark."""
    pytest.importorskip("sgp4")
    path = tmp_path / "sets.tle"
    for start, epoch, angles, number in (
        ("00366.99999999", "2000-12-31T23:59:59.999136", "180.0000 360.0000", "Z9999"),
        ("57001.00000000", "1957-01-01T00:00:00", "  0.0000   0.0000", "A0000"),
        ("56366.00000000", "2056-12-31T00:00:00", "  0.0000 360.0000", "00000"),
    ):
        first = FIRST.replace("00179.78495062", start).replace("00005", number)
        second = SECOND.replace(" 34.2682 348.7242", angles).replace("00005", number)
        lines = NAME, with_sum(first), with_sum(second)
        path.write_text("\r\n".join(lines) + "\r\n", encoding="utf-8-sig", newline="")
        for source in (path, "\ufeff" + "\n".join(lines) + "\n"):
            (satellite,) = read_tle(source)
            assert (satellite.name, satellite.epoch) == (NAME, epoch)
            assert satellite.record.satnum_str == number


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
        ("<BSTAR>.28098E-4</BSTAR>", "", "line 1: satellite 1 has no BSTAR"),
        ("348.7242", "34B.7242", "line 7: RA_OF_ASC_NODE is '34B.7242': it must be from"),
        ("</omm>", "", "is not a mean-elements message"),
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
    np.testing.assert_array_equal(first.position, r)
    np.testing.assert_array_equal(first.velocity, v)
    assert (first.name, first.identifier, first.epoch) == ("ONE", "2026-001A", one.epoch + "000000")
    assert second.frame == "ICRF" and second.name == "UNKNOWN" and second.times.shape == (2,)
    np.testing.assert_allclose(first.path()(60.0), r[:, 1], rtol=1e-12)
    np.testing.assert_array_equal(first.state(2).velocity, first.velocity[:, 2])


# Annex G of the standard, with two states: comments, accelerations, a day of the year.
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
EPOCH = 1996-12-28T21:29:07.267
COV_REF_FRAME = EME2000
 3.3313494e-04
 4.6189273e-04  6.7824216e-04
-3.0700078e-04 -4.2212341e-04  3.2319319e-04
-3.3493650e-07 -4.6860842e-07  2.4849495e-07  4.2960228e-10
-2.2118325e-07 -2.8641868e-07  1.7980986e-07  2.6088992e-10  1.7675147e-10
-3.0413460e-07 -4.9894969e-07  3.5403109e-07  1.8692631e-10  1.0088625e-10  6.2244443e-10
COVARIANCE_STOP
"""


def test_the_message_of_the_standard(tmp_path):
    path = tmp_path / "mars.oem"
    path.write_text(ANNEX)
    (found,) = read_oem(path)
    assert found.centre == "MARS BARYCENTER" and found.epoch == "1996-12-28T21:29:07.267"
    np.testing.assert_allclose(found.times, [0.0, 1795.0], atol=1e-9)
    np.testing.assert_allclose(found.position[:, 1], [-2445234.0, -878141.0, 1873073.0])
    ((time, matrix, axes),) = found.covariances
    assert time == 0.0 and axes == "EME2000" and matrix[2, 1] == matrix[1, 2] == -422.12341
    np.testing.assert_allclose(found.distribution().covariance, matrix, rtol=1e-9, atol=1e-9)
    second = "1996-363T21:59:02.267"
    for old, new, sentence in (
        ("CCSDS_OEM_VERS", "CCSDS_OPM_VERS", "must begin with CCSDS_OEM_VERS"),
        ("\nREF_FRAME = EME2000\n", "\n", "line 5 begins a segment without REF_FRAME"),
        (" -1.041945", "", "line 16: .*6 columns"),
        (
            "1996-363T21:59",
            "1996-360T21:59",
            "line 17: the epoch is 1996-360.* after .*07.267: epochs",
        ),
        (second, "1996-12-28T21:29:07.267", "line 17: the epoch is .*: epochs must ascend"),
        ("1996-363T21", "soon", "line 17: the epoch is 'soon.*': it must be a time such as"),
        (second, "1996-363T24:00:00", "line 17: the epoch is '1996-363T24:00:00'"),
        (second, "1996-366T21:59:02.2e3", "line 17: the epoch is"),
        (second, "1997-366T21:59:02", "line 17: the epoch is"),
        (second, "1996-12-31T23:59:60", "line 17: the epoch is .*, other than a leap second"),
        (
            "= 1996-12-30T01:28:02.267",
            "= never",
            "line 12: STOP_TIME is 'never': it must be a time",
        ),
        ("7.33702", "fast", "line 16: X_DOT is 'fast': it must be a finite number"),
        ("-2432.166", "nan", "line 16: X is 'nan': it must be a finite number"),
        ("1742.754", "1e999", "line 16: Z is '1e999': it must be a finite number"),
        ("-878.141", "1e308", "line 17: Y is '1e308': it must be a finite number"),
        ("-0.996366", "-0,996", "line 17: Z_DOT is '-0,996': it must be a finite number"),
        ("0.2 0.3", "inf 0.3", "line 17: Y_DDOT is 'inf': it must be a finite number"),
        ("META_STOP\n", "", "line 15 is '1996-12-28.*: it must be a keyword = value"),
        ("META_START\n", "", "line 15 is '1996-12-28.*': META_START must precede it"),
        ("TIME_SYSTEM = UTC", "REF_FRAME = ICRF", "line 10 repeats REF_FRAME"),
        ("COVARIANCE_STOP\n", "COVARIANCE_STOP\nMETA_START\n", "line 28 begins a segment without"),
        ("EPOCH = 1996-12-28T21:29:07.267\n", "", "line 19 is .*: EPOCH must precede it"),
        ("COV_REF", "REF", "line 20 is .*: it must be EPOCH, COV_REF_FRAME or a row"),
        (" 1.0088625e-10", "", "line 19 begins a covariance of 20 numbers: it must have 21"),
        ("1.0088625e-10", "nan", "line 26: the covariance is 'nan': it must be a finite number"),
        (
            ANNEX[ANNEX.index("1996-12-28T21:29:07.267 -") :],
            "",
            "line 5 begins a segment without states",
        ),
    ):
        assert old in ANNEX
        path.write_text(ANNEX.replace(old, new))
        with pytest.raises(InputError, match=sentence) as error:
            read_oem(path)
        assert str(error.value).startswith(str(path))


def test_an_ephemeris_that_is_not_finite_is_not_written(tmp_path):
    one = Ephemeris("2026-01-01T00:00:00", np.array([0.0, 1.0]), np.zeros((3, 2)), np.zeros((3, 2)))
    for field in ("times", "position", "velocity"):
        wrong = one._replace(**{field: getattr(one, field) + np.nan})
        with pytest.raises(InputError, match=f"Ephemeris.{field} is .*: it must be finite"):
            write_oem(tmp_path / "none.oem", [wrong])
    with pytest.raises(InputError, match="Ephemeris.epoch is 'today': it must be a time such as"):
        write_oem(tmp_path / "none.oem", [one._replace(epoch="today")])
    assert not (tmp_path / "none.oem").exists()
