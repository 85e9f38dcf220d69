"""Motors from files: what is read against numbers by hand, and what is refused."""

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspace
from jaxspace import BodyState, Scene, simulate
from jaxspace.bodies import RigidBody
from jaxspace.core import InputError
from jaxspace.dispersion import disperse
from jaxspace.io import SceneError, listing, schema, stored_scene
from jaxspace.orbits import PointGravity
from jaxspace.rockets import (
    Gimbal,
    GimballedThrust,
    Motor,
    SteeredThrust,
    Thrust,
    ThrustProfile,
    read_motor,
)
from jaxspace.rockets.steering import AlongVelocity
from jaxspace.rotations import Quaternion

ENG = """; a comment
A8 18 70 3-5 0.00312 0.0162 Someone
0.1 2.0
0.3 9.0 ; the peak
0.4 3.0
0.7 0.0
B6 18 70 0 0.006 0.02 Someone
0.1 5.0
0.5 0.0
"""


def test_motors_from_files(tmp_path):
    path = tmp_path / "a8.eng"
    path.write_text(ENG)
    motor = read_motor(path)
    impulse = 0.1 + 1.1 + 0.6 + 0.45
    np.testing.assert_allclose(motor.total_impulse, impulse, rtol=1e-14)
    assert motor.name == "A8"
    np.testing.assert_allclose([motor.diameter, motor.length], [0.018, 0.07], rtol=1e-14)
    assert (motor.propellant_mass, motor.loaded_mass) == (0.00312, 0.0162)
    thrust = motor.thrust(ignition=1.0)
    np.testing.assert_allclose(thrust.mean_thrust * thrust.burn_time, impulse, rtol=1e-14)
    np.testing.assert_allclose(thrust.exhaust_velocity, impulse / 0.00312, rtol=1e-14)
    np.testing.assert_allclose(thrust.thrust(jnp.array(1.2), jnp.array(1.0)), 5.5, rtol=1e-12)

    curve = tmp_path / "curve.csv"
    curve.write_text("time,thrust\n0.0,0.0\n1.0,10.0\n3.0,0.0\n")
    table = read_motor(curve)
    np.testing.assert_allclose(table.thrust(0.01).exhaust_velocity, 1500.0, rtol=1e-14)
    with pytest.raises(InputError, match="does not contain the propellant mass"):
        table.thrust()
    curve.write_text("nothing")
    with pytest.raises(InputError, match="has 0 points of a thrust curve"):
        read_motor(curve)
    curve.write_text("0 1\n2 3\n1 3\n")
    with pytest.raises(InputError, match="descending or repeated times"):
        read_motor(curve)


RSE = """<?xml version="1.0" encoding="ISO-8859-1"?>
<engine-database>
 <engine-list>
  <!-- two engines -->
  <engine FDiv="10" FFix="1" Type="single-use" avgThrust="3.214" code="A8" dia="18." len="70."
   mfg="Someone" initWt="16.2" propWt="3.12" burn-time="0.7" delays="3,5">
   <comments>5 &lt; 6</comments>
   <data>
    <eng-data cg="35." f="2." m="3.12" t="0.1"/>
    <eng-data cg="35." f="9." m="2." t="0.3"/>
    <eng-data cg="35." f="3." m="1." t="0.4"/>
    <eng-data cg="35." f="0." m="0." t="0.7"/>
   </data>
  </engine>
  <engine code="B6" dia="no"><data/></engine>
 </engine-list>
</engine-database>
"""


def test_a_file_of_rocksim_is_that_of_rasp(tmp_path):
    """The same motor in both forms; of the second engine nothing is read."""
    (tmp_path / "a8.eng").write_text(ENG)
    (tmp_path / "a8.rse").write_text(RSE)
    rasp, rocksim = (read_motor(tmp_path / name) for name in ("a8.eng", "a8.rse"))
    assert rocksim.name == "A8"
    np.testing.assert_array_equal(rocksim.times, rasp.times)
    np.testing.assert_array_equal(rocksim.thrusts, rasp.thrusts)
    np.testing.assert_allclose(rocksim[2:6], rasp[2:6], rtol=1e-14)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('f="9."', 'f="nine"', "line 10: f of <eng-data> is 'nine': it must be a finite number."),
        ('propWt="3.12" ', "", "line 5: propWt of <engine> is missing: it must be"),
        (
            "</data>",
            "</dato>",
            "line 13 is not valid XML (mismatched tag): it must be a RockSim file.",
        ),
        ("engine", "motor", "has no element <engine>: it must be a RockSim file."),
        (
            't="0.4"',
            't="0.2"',
            "has descending or repeated times: 0.2 s in line 11 comes after 0.3 s",
        ),
        (
            'propWt="3.12"',
            'propWt="0.00312"',
            "line 5: loaded mass is 0.0162: it must be at most 100 times",
        ),
        (
            "<engine-database>",
            '<!DOCTYPE x [<!ENTITY a "aaaa">]>\n<engine-database>',
            "line 2 declares the entity 'a', which is not allowed in a RockSim file.",
        ),
    ],
)
def test_files_of_rocksim_that_are_refused(tmp_path, old, new, sentence):
    path = tmp_path / "wrong.rse"
    path.write_text(RSE.replace(old, new))
    with pytest.raises(InputError, match=re.escape(sentence)):
        read_motor(path)


# By hand: 10 N at 1.5 s, and none at 0 and 3 s: 15 N s.
COLUMNS = {
    "decimal commas": "time;thrust\n0,0;0,0\n1,5;10,0\n3,0;0,0\n",
    "semicolons": "0;0\n1.5;10\n3;0\n",
    "tabulators": "Zeit\tSchub\n0,0\t0,0\n1,5\t10\n3,0\t0\n",
    "quotes": '"Time (s)","Thrust (N)"\n"0","0"\n"1,5","10,0"\n"3","0"\n',
    "blanks": "0 0\n 1.5  10\n3 0\n",
    "comments": "\ufeff0,0\n# 1,99\n; 2,99\n1.5,10,99\n\n3,0\n",
}


@pytest.mark.parametrize("kind", COLUMNS)
def test_columns_of_a_motor(tmp_path, kind):
    path = tmp_path / "curve.csv"
    path.write_text(COLUMNS[kind], encoding="utf-8")
    motor = read_motor(path)
    np.testing.assert_array_equal(motor.times, [0.0, 1.5, 3.0])
    np.testing.assert_array_equal(motor.thrusts, [0.0, 10.0, 0.0])
    assert motor.total_impulse == 15.0


CURVE = [(0.0, 0.0), (0.1, 1000.0), (1.0, 900.0), (1.2, 0.0)]
POUND = 4.4482216152605


def table(heads, row, separator=","):
    """A file of the curve: the lines `heads`, and for each point the numbers that `row` makes."""
    rows = [separator.join(f"{x:.12g}" for x in row(k, *p)) for k, p in enumerate(CURVE)]
    return "\n".join([*heads, *rows, ""])


HEADED = {
    "pandas": table([",time,thrust"], lambda k, t, f: (k, t, f)),
    "openMotor": table(
        ["Time(s),Kn,Pressure(Pa),Thrust(N),Mass Flow(G1;kg/s),Mass Flux(G1;kg/(m^2*s))"],
        lambda k, t, f: (t, 200 + k, 5e6, f, 0.4, 300),
    ),
    "OpenRocket": table(
        ["# Simulation 1 (Up to date)", "# Time (s),Altitude (m),Drag force (N),Thrust (N)"],
        lambda k, t, f: (t, 10 * k, 3.0, f),
    ),
    "milliseconds": table(["time (ms),thrust (N)"], lambda k, t, f: (1e3 * t, f)),
    "pounds": table(["Time,Thrust (lbf)"], lambda k, t, f: (t, f / POUND)),
    "units after names": table(["t_ms;F_kN"], lambda k, t, f: (1e3 * t, 1e-3 * f), ";"),
    "units of other words": table(["Zeit [ms]\tSchub [N]"], lambda k, t, f: (1e3 * t, f), "\t"),
    "units alone": table(["Time,Thrust", "(ms),(N)"], lambda k, t, f: (1e3 * t, f)),
    "only units": table(["N,s"], lambda k, t, f: (f, t)),
    "another order": table(["motor thrust / N\ttime / s"], lambda k, t, f: (f, t), "\t"),
    "blanks": table(["Time (s) Kn Thrust (kN)"], lambda k, t, f: (t, k, 1e-3 * f), " "),
    "comments": table(["# one,two,three", "time,kn,thrust"], lambda k, t, f: (t, k, f)),
}


@pytest.mark.parametrize("kind", HEADED)
def test_columns_are_found_by_their_headings(tmp_path, kind):
    """995 N s by hand: 50 + 855 + 90."""
    path = tmp_path / "curve.csv"
    path.write_text(HEADED[kind], encoding="utf-8")
    motor = read_motor(path)
    # Twelve digits are written.
    np.testing.assert_allclose(np.stack([motor.times, motor.thrusts]).T, CURVE, rtol=1e-11)
    np.testing.assert_allclose(motor.total_impulse, 995.0, rtol=1e-11)


@pytest.mark.parametrize(
    "text, sentence",
    [
        ("a,b,c\n0,0,0\n1,1,0\n", "line 1 is 'a,b,c': it must be headings of which one is 'time'"),
        ("time,pressure\n0,0\n1,1\n", "line 1 is 'time,pressure': it must be headings of which"),
        ("Zeit [ms],Druck [Pa]\n0,0\n1,1\n", "'Druck [Pa]': its unit must be N, or one of n"),
        ("time (fortnights),thrust\n0,0\n1,1\n", "'time (fortnights)': its unit must be s, or"),
        # R writes a column of row names without a heading.
        ("time,thrust\n1,0,0\n2,1,5\n", "line 1 is 'time,thrust': it must be 3 headings, one for"),
        (",time,thrust\n0,0,0\n1,2\n", "line 3 is '1,2': it must be a time, s, and a thrust, N"),
        ("time,thrust\n0,0\nnan,5\n1,0\n", "line 3 is 'nan,5': it must be a time, s, and"),
        (
            "0,0\n1,5\n\n0.5,3\n2,0\n",
            "descending or repeated times: 0.5 s in line 4 comes after 1 s",
        ),
        ("0,0\n1,5\n1,6\n0.9,1\n2,0\n", "0.9 s in line 4 comes after 1 s in line 3"),
        # 0.2 s and 5.5 N, or 0 s and 2 N.
        (
            "0,0\n0,2,5,5\n1,4,0\n",
            "line 2 is '0,2,5,5': it must be two columns, or columns with head",
        ),
        ("1,5\n1,6\n", "has 1 points of a thrust curve: it must have at least two."),
        ("0,0\n1e999,5\n2,0\n", "line 2 is '1e999,5': it must be a time, s, and a thrust, N"),
        ("0,0\n1_0,5\n20,0\n", "line 2 is '1_0,5': it must be a time, s, and a thrust, N"),
    ],
)
def test_headings_and_times_that_are_refused(tmp_path, text, sentence):
    path = tmp_path / "curve.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=re.escape(f"{path}") + ".*" + re.escape(sentence)):
        read_motor(path)


def test_points_that_stand_twice_are_taken_once(tmp_path):
    """And a jump at either end, where one of its sides has no impulse."""
    path = tmp_path / "curve.csv"
    path.write_text("0,0\n0,9\n1,8\n1,8\n2,4\n2,0\n")
    motor = read_motor(path)
    np.testing.assert_array_equal(motor.times, [0.0, 1.0, 2.0])
    np.testing.assert_array_equal(motor.thrusts, [9.0, 8.0, 4.0])


@pytest.mark.parametrize("kind", ["eng", "rse", "csv"])
def test_a_time_that_stands_twice_is_a_jump_of_the_thrust(tmp_path, kind):
    """10 N up to 1 s, then 4 N down to 2 N at 3 s: 16 N s by hand, and the thrust on both sides.
    Of three points at one time the middle one says nothing."""
    points = [(0.0, 10.0), (1.0, 10.0), (1.0, 99.0), (1.0, 4.0), (3.0, 2.0)]
    data = "".join(f'<eng-data t="{t}" f="{f}"/>' for t, f in points)
    engine = '<engine code="X" dia="24." len="70." initWt="50." propWt="20.">'
    rows = "\n".join(f"{t} {f}" for t, f in points)
    xml = f"<d>{engine}<data>{data}</data></engine></d>"
    path = tmp_path / f"jump.{kind}"
    path.write_text({"eng": HEAD + rows, "csv": rows, "rse": xml}[kind])
    motor = read_motor(path)
    np.testing.assert_array_equal(motor.times, [0.0, 1.0, 1.0, 3.0])
    np.testing.assert_array_equal(motor.thrusts, [10.0, 10.0, 4.0, 2.0])
    assert (motor.total_impulse, motor.burn_time) == (16.0, 3.0)
    thrust = motor.thrust(0.02)
    at, mass = jnp.array([0.5, 1.0, 1.0 + 3.1e-6, 2.0]), jnp.array(1.0)
    # The mean is that of the jump, the levels that of a ramp over a millionth of the burn.
    np.testing.assert_allclose(thrust.thrust(at, mass), [10.0, 10.0, 4.0, 3.0], rtol=3e-6)
    np.testing.assert_allclose(thrust.mean_thrust * thrust.burn_time, 16.0, rtol=1e-14)
    profile = thrust.profile
    assert np.all(np.diff(np.float32(profile.fraction)) > 0.0)
    # Next to another point the ramp is shorter.
    close = ThrustProfile.of_table([0.0, 1.0, 1.0, 1.0 + 1e-9, 3.0], [1.0, 1.0, 2.0, 2.0, 2.0])
    assert np.all(np.diff(close.fraction) > 0.0)
    for times in ([0.0, 0.0, 1.0], [0.0, 1.0, 1.0], [0.0, 1.0, 1.0, 1.0, 2.0]):
        with pytest.raises(InputError, match=r"ThrustProfile\.times .* ascending; a repeated time"):
            ThrustProfile.of_table(times, np.ones(len(times)))


def test_a_run_through_a_jump_of_the_thrust_is_exact(tmp_path):
    """v(3 s) in closed form: the speed of the exhaust times the logarithm of the mass ratio, and
    x(3 s) by the law of either part: 10 N for 1 s, 4 N for 2 s."""
    path = tmp_path / "jump.csv"
    path.write_text("0,10\n1,10\n1,4\n3,4\n")
    motor = read_motor(path).thrust(0.02)
    u = 18.0 / 0.02
    y0 = BodyState(jnp.zeros(3), jnp.zeros(3), Quaternion.identity(), jnp.zeros(3), jnp.array(0.1))
    end = simulate(Scene((motor,), RigidBody(0.1, [1e-3] * 3)), y0, jnp.array([0.0, 3.0])).final
    np.testing.assert_allclose(end.mass, 0.08, rtol=1e-12)
    np.testing.assert_allclose(end.velocity[2], u * np.log(0.1 / 0.08), rtol=2e-6)

    def climb(m, v, flow, t):
        """By a flow from the mass m and the speed v on."""
        left = m - flow * t
        return v * t + u * (t - left / flow * np.log(m / left))

    after = 0.1 - 10.0 / u
    expected = climb(0.1, 0.0, 10.0 / u, 1.0) + climb(after, u * np.log(0.1 / after), 4.0 / u, 2.0)
    # The ramp ends 3e-6 s late, by half of 6 N of 0.09 kg.
    np.testing.assert_allclose(end.position[2], expected, rtol=2e-6)


def test_columns_begin_at_their_first_point(tmp_path):
    """At 8 s by the clock of the test stand, without a ramp from zero: 10,800 N s by hand."""
    path = tmp_path / "curve.csv"
    path.write_text("8,800\n20,800\n23,0\n")
    motor = read_motor(path)
    assert (motor.total_impulse, motor.burn_time) == (10800.0, 15.0)
    thrust, mass = motor.thrust(4.0), jnp.array(1.0)
    np.testing.assert_allclose(thrust.thrust(jnp.array(0.5), mass), 800.0, rtol=1e-14)


HEAD = "24E 24 70 3-5 0.02 0.05 Maker\n"


def test_curve_goes_on_after_a_pause(tmp_path):
    """Two pulses, 0.2 and 0.3 N s over the pause and 0.9 N s after it, by hand."""
    path = tmp_path / "dual.ENG"
    pulses = "0.1 2\n0.3 0 ; the pause\n# of 0.3 s\n0.6 0\n0.9 3\n1.2 0\n"
    # The name of the next motor is a number: the number of its fields makes it a head.
    path.write_text("; two pulses\n" + HEAD + pulses + "1000 24 70 0 0.02 0.05 Maker\n0.1 99\n")
    motor = read_motor(path)
    np.testing.assert_array_equal(motor.times, [0.0, 0.1, 0.3, 0.6, 0.9, 1.2])
    np.testing.assert_array_equal(motor.thrusts, [0.0, 2.0, 0.0, 0.0, 3.0, 0.0])
    np.testing.assert_allclose(motor.total_impulse, 0.1 + 0.2 + 0.0 + 0.45 + 0.45, rtol=1e-14)
    thrust = motor.thrust()
    mass = jnp.array(1.0)
    found = [float(thrust.thrust(jnp.array(t), mass)) for t in (0.2, 0.45, 0.75)]
    np.testing.assert_allclose(found, [1.0, 0.0, 1.5], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(
    "text, sentence",
    [
        ("A8 18 70 0 0 0.02 X\n1 2\n2 0\n", "line 1: propellant mass is 0: it must be above zero"),
        ("A8 18 70 0 -1 0.02 X\n1 2\n2 0\n", "propellant mass is -1: it must be above zero"),
        ("A8 -18 70 0 1 2 X\n1 2\n2 0\n", "diameter is -18: it must be zero or positive, in mm"),
        ("A8 18 -70 0 1 2 X\n1 2\n2 0\n", "length is -70: it must be zero or positive, in mm"),
        ("A8 18 70 0 1 -2 X\n1 2\n2 0\n", "loaded mass is -2: it must be zero or positive, in kg"),
        ("A 18 70 0 1.9 1.3 X\n1 2\n2 0\n", "mass is 1.9: it must be at most the loaded mass, 1.3"),
        ("A 18 70 0 1.9 3100 X\n1 2\n2 0\n", "loaded mass is 3100: it must be at most 100 times"),
        (
            "A 18 70 0 1900 3100 X\n1 2000\n2 0\n",
            "mass is 1900: it must be below 200, in kg, so th",
        ),
        (
            HEAD + "1 2\n1 3\n.5 0\n",
            "descending or repeated times: 0.5 s in line 4 comes after 1 s",
        ),
        (HEAD + "1 2\n2 -3\n3 0\n", "line 3: thrust is -3: it must be zero or positive, in N"),
        (HEAD + "1 0\n2 0\n", "thrust is 0: it must be above zero somewhere, in N"),
        (HEAD + "-1 2\n2 0\n", "time is -1: it must be zero or positive, in s"),
        (HEAD + "1 2\n2 inf\n", "line 3 is '2 inf': it must be a time, s, and a thrust, N"),
        (HEAD + "1 2\n2 3 4\n", "line 3 is '2 3 4': it must be a time, s, and a thrust, N"),
        (HEAD + "1 2\n0,5 3\n", "line 3 is '0,5 3': it must be a time, s, and a thrust, N"),
        (HEAD + "1 2\nend\n", "line 3 is 'end': it must be a time, s, and a thrust, N"),
        ("0.1 2\n1 0\n", "line 1 is '0.1 2': it must be a header: name, diameter"),
        ("A 8b 18 70 0 1 2 X\n1 2\n2 0\n", "line 1 has the header 'A 8b 18 70 0 1 2 X': it is"),
    ],
)
def test_motors_that_are_refused(tmp_path, text, sentence):
    path = tmp_path / "a8.eng"
    path.write_text(text)
    with pytest.raises(InputError, match=re.escape(f"{path}") + ".*" + re.escape(sentence)):
        read_motor(path)


def test_columns_that_are_refused(tmp_path):
    path = tmp_path / "curve.csv"
    for line in ("1,5 10,0", "1", "1;", "1.5,10 ; the peak"):
        path.write_text(f"0 0\n{line}\n3 0\n")
        with pytest.raises(InputError, match="line 2 is '1.*': it must be a time, s, and a thrust"):
            read_motor(path)


def test_motors_without_mass_or_impulse():
    curve = np.array([0.0, 1.0]), np.array([2.0, 2.0])
    with pytest.raises(InputError, match="Motor.propellant_mass is 0: it must be positive"):
        Motor(*curve, 0.0).thrust()
    with pytest.raises(InputError, match="Motor.propellant_mass is -1: it must be positive"):
        Motor(*curve).thrust(-1.0)
    with pytest.raises(InputError, match="Motor.total_impulse is 0: it must be positive"):
        Motor(curve[0], 0.0 * curve[1], 1.0).thrust()


# ---------------------------------------------------------------- scene files

FLIGHT = """
[planet]
mu = 3.986004418e14

[body]
mass = "0.1 kg"

[effects.point_gravity]

[effects.steered_thrust]
motor_file = "motors/a8.eng"
ignition = "0.1 s"
steering = {}

[initial]
position = [6.4e6, 0.0, 0.0]
velocity = [30.0, 1.0, 0.0]

[times]
end = "2 s"
samples = 9

[dispersion]
runs = 4
outputs = ["final.velocity.0"]

[dispersion.inputs]
"effects.steered_thrust.ignition" = { deviation = "20 ms" }
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "motors").mkdir()
    (tmp_path / "motors" / "a8.eng").write_text(ENG)
    (tmp_path / "flight.toml").write_text(FLIGHT)
    return tmp_path


def assert_same(found, expected):
    """Rates of two scenes to rounding."""
    np.testing.assert_allclose(found.position, expected.position, rtol=1e-15)
    np.testing.assert_allclose(found.velocity, expected.velocity, rtol=1e-13)
    np.testing.assert_allclose(found.mass, expected.mass, rtol=1e-15)


def test_scene_file_names_the_file_of_its_motor(folder, monkeypatch):
    """The same start and, along the flight, the same rates as of an effect that was made in Python,
    from any folder."""
    monkeypatch.chdir(folder / "motors")
    file = jaxspace.load("../flight.toml")
    monkeypatch.chdir(folder)
    motor = read_motor(folder / "motors" / "a8.eng")
    thrust = SteeredThrust.of_thrust(motor.thrust(ignition=0.1), AlongVelocity())
    y0 = BodyState(jnp.array([6.4e6, 0.0, 0.0]), jnp.array([30.0, 1.0, 0.0]), mass=jnp.array(0.1))
    scene = Scene([PointGravity(3.986004418e14), thrust])
    run = file.simulate()
    jax.tree.map(np.testing.assert_array_equal, file.y0, y0)
    rates = jax.jit(lambda t, y: (file.system.vector_field(t, y), scene.vector_field(t, y)))
    assert_same(*rates(run.ts, run.states))
    burnt = 0.1 - run.states.mass[-1]
    np.testing.assert_allclose(burnt, 0.00312, rtol=1e-9)


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """A store of four flights, and what is in it."""
    folder = tmp_path_factory.mktemp("flown")
    (folder / "motors").mkdir()
    (folder / "motors" / "a8.eng").write_text(ENG)
    path, store = folder / "flight.toml", folder / "runs.zarr"
    path.write_text(FLIGHT)
    file = jaxspace.load(path)
    how = {"accuracy": file.accuracy, "store": store, "notes": {"scene_file": str(path)}}
    return store, disperse(file.campaign(), 4, **how)


def test_other_fields_of_a_motor_of_a_file_scatter(flown, folder):
    """Each run is the flight of a file with its ignition."""
    _, result = flown
    drawn = np.asarray(result.inputs["effects.steered_thrust.ignition"])
    for ignition, speed in zip(drawn, result.outputs["final.velocity.0"], strict=True):
        text = FLIGHT.replace('"0.1 s"', f'"{float(ignition)!r} s"')
        (folder / "one.toml").write_text(text)
        run = jaxspace.load(folder / "one.toml").simulate()
        np.testing.assert_allclose(speed, run.final.velocity[0], rtol=1e-9)


def test_each_motor_takes_a_file(folder):
    path = folder / "motors" / "a8.eng"
    motor = read_motor(path)
    plain = Thrust.of_file(
        path, station=-1.0, offset=(0.1, 0.2), misalignment=jnp.array([0.1, 0.0])
    )
    np.testing.assert_array_equal(plain.point, [0.1, 0.2, -1.0])
    gimbal = Gimbal(AlongVelocity(), 0.8, 0.6)
    for made in (plain, GimballedThrust.of_file(gimbal, path, -1.0, burnout_mass=0.01)):
        expected = motor.thrust()
        for name in ("mean_thrust", "exhaust_velocity", "burn_time"):
            assert getattr(made, name) == getattr(expected, name), name
        np.testing.assert_array_equal(made.profile.level, expected.profile.level)
    mass = Thrust.of_file(path, 0.002).exhaust_velocity
    np.testing.assert_allclose(mass, motor.total_impulse / 0.002, rtol=1e-15)


def test_files_of_motors_that_are_refused(folder):
    path, motor = folder / "flight.toml", folder / "motors" / "a8.eng"
    path.write_text(FLIGHT.replace("a8.eng", "b8.eng"))
    with pytest.raises(SceneError) as error:
        jaxspace.load(path)
    absent = folder / "motors" / "b8.eng"
    sentence = f"effects.steered_thrust.motor_file: {absent} cannot be read: No such file"
    assert str(error.value).startswith(f"{path}: {sentence}") and "\n" not in str(error.value)
    path.write_text(FLIGHT.replace('"motors/a8.eng"', "8"))
    with pytest.raises(SceneError, match="motor_file is 8: it must be the name of a file"):
        jaxspace.load(path)
    path.write_text(FLIGHT)
    motor.write_text(ENG.replace("2.0", "-2.0"))
    with pytest.raises(SceneError, match="effects.steered_thrust: .*a8.eng, line 3: thrust is -2:"):
        jaxspace.load(path)
    (folder / "motors" / "a8.csv").write_text("0,0\n1,2\n2,0\n")
    path.write_text(FLIGHT.replace("a8.eng", "a8.csv"))
    with pytest.raises(
        SceneError, match="does not contain the propellant mass: give propellant_mass"
    ):
        jaxspace.load(path)
    path.write_text(path.read_text().replace('a8.csv"', 'a8.csv"\npropellant_mass = "3 g"'))
    assert jaxspace.load(path).system.effects[-1].exhaust_velocity == 2.0 / 0.003


def test_store_knows_the_motor_of_its_runs(flown, folder):
    """A store keeps the motor, is read from any folder, and takes no runs of another motor."""
    path, motor = folder / "flight.toml", folder / "motors" / "a8.eng"
    (store, kept), file = flown, jaxspace.load(path)
    how = {"accuracy": file.accuracy, "store": store, "resume": True}
    assert kept.attributes["files"] == {"motors/a8.eng": ENG}
    motor.write_text(ENG.replace("9.0", "8.0"))
    with pytest.raises(ValueError, match="of another campaign: the file motors/a8.eng of the sce"):
        campaign = jaxspace.load(path).campaign()
        disperse(campaign, 4, **how)
    motor.unlink()
    again = stored_scene(kept)
    assert again.system.effects[-1].profile == file.system.effects[-1].profile
    assert disperse(again.campaign(), 4, **how).runs == 4


def test_optimum_names_the_motor_from_any_folder(folder):
    path = folder / "flight.toml"
    task = """
[optimize]
maximise = "final.velocity.0"
steps = 4

[optimize.free]
"initial.velocity.1" = { low = -20.0, high = 20.0 }
"""
    path.write_text(FLIGHT.partition("[dispersion]")[0] + task)
    elsewhere = folder / "out" / "best.toml"
    elsewhere.parent.mkdir()
    elsewhere.write_text(jaxspace.load(path).optimize().text())
    assert jaxspace.load(elsewhere).system.effects[-1].burn_time == 0.7


def test_listing_and_schema_name_the_file_of_a_motor():
    line = "motor_file (file): with the thrust curve: RASP (.eng), RockSim (.rse), or columns"
    assert listing().count(line) == 3
    forms = [form["properties"] for form in schema()["anyOf"] if "effects" in form["properties"]]
    for effect in ("thrust", "steered_thrust", "gimballed_thrust"):
        ways = forms[0]["effects"]["properties"][effect]["anyOf"]
        (way,) = (w for w in ways if "motor_file" in w["properties"])
        assert way["properties"]["motor_file"]["type"] == "string"
        assert "motor_file" in way["required"]
