"""Tables of aerodynamic coefficients: interpolation, forces, files, and what is refused."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads
from scipy.interpolate import PchipInterpolator
from test_vehicles import NOSE, ROCKETS, vehicle

from jaxspace import Scene, load, simulate, simulate_batch
from jaxspace.bodies import BodyState, ExponentialAtmosphere, RigidBody
from jaxspace.core import InputError
from jaxspace.core.hermite import cubic, monotone_slopes
from jaxspace.rotations import Quaternion, from_euler_angles
from jaxspace.simulation import Status
from jaxspace.vehicles import Aerodynamics, TabulatedAerodynamics
from jaxspace.vehicles.aerodynamic_table import AerodynamicTable, read_aerodynamics
from jaxspace.vehicles.coefficient import MachTable
from jaxspace.vehicles.local_air import LocalAir

DEG = np.pi / 180.0
BODY = RigidBody(16.0, [8.0, 8.0, 0.04])
# As isothermal air, whose speed of sound is the same everywhere.
AIR = LocalAir(ExponentialAtmosphere(1.2, 0.0, 7000.0))
SOUND = float(np.sqrt(1.4 * 9.80665 * 7000.0))
REFERENCE = {"area": 0.0127, "length": 0.127, "station": 1.16}

RASAERO = """Mach,Alpha,CD,CD Power-Off,CD Power-On,CA Power-Off,CA Power-On,CL,CN,CN Potential,\
CN Viscous,CNalpha (0 to 4 deg) (per rad),CP,CP (0 to 4 deg),Reynolds Number
0.5,0,0.34,0.34,0.30,0.34,0.30,0,0,0,0,12.0,60.0,80.0,2.0e7
0.5,2,0.34,0.36,0.32,0.35,0.31,0.42,0.43,0.4,0.03,12.0,80.5,80.0,2.0e7
0.5,4,0.34,0.41,0.37,0.36,0.32,0.88,0.90,0.8,0.10,12.0,81.0,80.0,2.0e7
1.0,0,0.50,0.50,0.45,0.50,0.45,0,0,0,0,13.0,60.0,82.0,4.0e7
1.0,2,0.50,0.52,0.47,0.51,0.46,0.46,0.47,0.4,0.07,13.0,82.5,82.0,4.0e7
1.0,4,0.50,0.57,0.52,0.53,0.48,0.95,0.98,0.8,0.18,13.0,83.0,82.0,4.0e7
2.0,0,0.40,0.40,0.37,0.40,0.37,0,0,0,0,11.0,60.0,78.0,8.0e7
2.0,2,0.40,0.42,0.39,0.41,0.38,0.38,0.39,0.3,0.09,11.0,78.5,78.0,8.0e7
2.0,4,0.40,0.47,0.44,0.42,0.39,0.80,0.82,0.7,0.12,11.0,79.0,78.0,8.0e7
"""


@pytest.fixture(scope="module")
def rasaero(tmp_path_factory):
    path = tmp_path_factory.mktemp("tables") / "rasaero.csv"
    path.write_text(RASAERO)
    return path


def state(w, omega=(0.0, 0.0, 0.0), attitude=None):
    """A body with the velocity `w`, m/s, in its own axes."""
    attitude = Quaternion.identity() if attitude is None else attitude
    return BodyState(jnp.zeros(3), attitude.rotate(jnp.asarray(w)), attitude, jnp.asarray(omega))


def flow(mach, angle, roll=0.0):
    """The velocity in body axes at a Mach number, an angle of attack and a roll."""
    across = np.sin(angle) * np.array([np.cos(roll), -np.sin(roll)])
    return mach * SOUND * np.array([*across, np.cos(angle)])


def test_the_cubic_is_that_of_scipy_with_its_slope():
    """SciPy's PCHIP: the same slopes of Fritsch and Butland, to rounding, also at the nodes."""
    rng = np.random.default_rng(3)
    x = np.sort(rng.uniform(0.0, 5.0, 9))
    y = np.append(np.sort(rng.normal(size=5)), rng.normal(size=4))
    expected = PchipInterpolator(x, y)
    at = np.concatenate([x, rng.uniform(x[0], x[-1], 40)])
    data = jnp.asarray(np.stack([y, monotone_slopes(x, y)], axis=1))
    value, slope = jax.jit(
        jax.vmap(jax.value_and_grad(lambda q: cubic(jnp.asarray(x), data, q)[0]))
    )(jnp.concatenate([at, jnp.array([x[0] - 1.0, x[-1] + 1.0])]))
    np.testing.assert_allclose(value[:-2], expected(at), atol=1e-14)
    np.testing.assert_allclose(slope[:-2], expected.derivative()(at), atol=1e-12)
    assert (value[-2], value[-1]) == (y[0], y[-1]) and np.all(slope[-2:] == 0.0)


def test_the_points_of_a_rasaero_file_are_its_rows(rasaero):
    """C_A, C_N and CP of a row by the forces; inches behind the tip, the motor on and off."""
    table = read_aerodynamics(rasaero, **REFERENCE)
    assert table.names == ("axial", "axial_burning", "normal", "lever")
    effect = TabulatedAerodynamics(table, AIR, burnout=2.0)
    load = jax.jit(lambda t, y: effect.load(t, y, BODY))
    pressure = 0.5 * 1.2 * SOUND**2 * REFERENCE["area"]
    found = load(1.0, state(flow(1.0, 2.0 * DEG)))
    np.testing.assert_allclose(found.force_N / pressure, [-0.47, 0.0, -0.46], atol=1e-14)
    arm = 1.16 - 82.5 * 0.0254
    np.testing.assert_allclose(found.torque_B / pressure, [0.0, -0.47 * arm, 0.0], atol=1e-14)
    off = load(2.0, state(flow(2.0, 0.0)))
    np.testing.assert_allclose(off.force_N / pressure, [0.0, 0.0, -4.0 * 0.40], atol=1e-14)
    # Across a flow from ahead the slope is CNalpha, and its centre that of small angles.
    turn = jax.jacfwd(lambda w: load(2.0, state(w)).torque_B[1])(jnp.array([0.0, 0.0, SOUND]))
    arm = 1.16 - 82.0 * 0.0254
    np.testing.assert_allclose(turn * SOUND / pressure, [-13.0 * arm, 0.0, 0.0], atol=1e-12)
    assert bool(table.outside(jnp.asarray(0.9), jnp.asarray(4.1 * DEG)))
    assert not bool(table.outside(jnp.asarray(0.0), jnp.asarray(0.0)))


def test_beyond_the_last_angle_the_force_follows_the_flow_and_never_pushes(rasaero):
    """C_N sin(a)/sin(4 deg) and C_A cos(a)/cos(4 deg), to a flow from behind; power is lost."""
    effect = TabulatedAerodynamics(read_aerodynamics(rasaero, **REFERENCE), AIR)
    angles = jnp.asarray(np.array([30.0, 90.0, 150.0, 180.0]) * DEG)
    c = effect.table.at(jnp.asarray(0.5), angles)
    np.testing.assert_allclose(c["normal"], 0.90 / np.sin(4.0 * DEG), rtol=1e-13)
    np.testing.assert_allclose(c["axial"], 0.36 * np.cos(angles) / np.cos(4.0 * DEG), rtol=1e-12)
    power = np.sin(angles) ** 2 * c["normal"] + np.cos(angles) * c["axial"]
    assert np.all(np.asarray(power) > 0.0)


def test_a_table_of_a_linear_law_is_barrowmans():
    """A constant slope and centre, as a nose has; damping and roll by the parts of both."""
    mach = np.array([0.0, 0.5, 1.0])
    slope = float(NOSE.slope(0.0)) / 0.0127
    columns = {"mach": mach, "axial": np.array([0.4, 0.5, 0.6])}
    columns |= {"normal_slope": np.full(3, slope), "centre": np.full(3, 0.4)}
    table = AerodynamicTable.of_columns(columns, area=0.0127, length=0.127, station=1.16)
    nose = dataclasses.replace(NOSE, centre_behind=jnp.asarray(0.4))
    y = state([20.0, -15.0, 0.9 * SOUND], [0.3, -0.2, 0.7], from_euler_angles(jnp.ones(3)))
    expected = Aerodynamics(0.0127, MachTable([0.0, 1.0], [0.4, 0.6]), nose, air=AIR)
    found = TabulatedAerodynamics(table, AIR, nose=nose)
    a, b = found.load(0.0, y, BODY), expected.load(0.0, y, BODY)
    # Without an axis of angles C_A goes with the cosine, as F_z goes with w_z.
    np.testing.assert_allclose(a.force_N, b.force_N, rtol=1e-12)
    np.testing.assert_allclose(a.torque_B, b.torque_B, rtol=1e-12, atol=1e-9)


def columns_of(law, mach, angle, roll):
    """A full grid of the coefficients that a `law` gives."""
    grid = np.meshgrid(mach, angle, roll, indexing="ij")
    m, a, r = (x.ravel() for x in grid)
    return {"mach": m, "angle": a, "roll": r, **law(m, a, r)}


def winged(m, a, r):
    """Of -K (w_x, w_y) with K = diag(3, 5) (1 + M): a flat body, by the plane of the flow."""
    c, s = np.cos(r), -np.sin(r)
    k = (1.0 + m) * np.sin(a)
    return {
        "axial": 0.4 + 0.1 * m + 0.2 * np.sin(a) ** 2,
        "normal": k * (3.0 * c * c + 5.0 * s * s),
        "centre": 2.0 + 0.0 * m,
        "side": -k * (3.0 * c * s - 5.0 * s * c),
        "yaw": 0.0 * m,
        "roll_moment": 0.01 * np.sin(a) * np.sin(2.0 * r),
        "pitch_damping": -60.0 + 0.0 * m,
        "roll_damping": -3.0 - m,
    }


MACHS, ANGLES = np.array([0.0, 0.5, 1.0, 1.5]), np.radians([0.0, 5.0, 15.0, 40.0])
ROLLS = np.radians(np.arange(0.0, 181.0, 22.5))
WINGED = AerodynamicTable.of_columns(columns_of(winged, MACHS, ANGLES, ROLLS), **REFERENCE)
WING = TabulatedAerodynamics(WINGED, AIR)
SLOPES = jax.jit(jax.jacfwd(lambda w: WING.load(0.0, state(w, [0.1, 0.2, 0.3]), BODY).force_N))


def test_roll_and_side_force_are_those_of_the_body():
    """At the nodes of all axes -K w exactly, in body axes, for every sense of the flow."""
    for roll in (0.0, 22.5, 90.0, 135.0, 202.5, 337.5):
        w = flow(1.0, 15.0 * DEG, roll * DEG)
        found = WING.load(0.0, state(w, [0.0, 0.0, 2.0]), BODY)
        push = 0.5 * 1.2 * SOUND * REFERENCE["area"]
        np.testing.assert_allclose(found.force_N[:2], -push * 2.0 * w[:2] * [3, 5], atol=1e-9)
        twist = 0.127 * SOUND * 0.01 * np.sin(15.0 * DEG) * np.sin(2.0 * roll * DEG)
        damping = -4.0 * 0.5 * 0.127**2 * 2.0
        np.testing.assert_allclose(found.torque_B[2], push * (twist + damping), atol=1e-9)


def test_slopes_are_continuous_right_and_finite():
    """Across a node of each axis the slope is the same from both sides; between them it is that of
    differences; straight ahead, at Mach 1 and at the seam of the roll it is finite."""
    nodes = [(1.0, 15.0, 22.5), (1.0, 10.0, 60.0), (0.8, 5.0, 30.0), (0.7, 12.0, 180.0)]
    for mach, angle, roll in (*nodes, (0.7, 12.0, 0.0)):
        sides = [
            SLOPES(jnp.asarray(flow(mach + e, (angle + e) * DEG, (roll + e) * DEG)))
            for e in (-1e-9, 1e-9)
        ]
        # The second derivatives, about 1e2, times the distance of both points.
        np.testing.assert_allclose(*sides, rtol=1e-6, atol=1e-6)
    ahead = SLOPES(jnp.array([0.0, 0.0, SOUND]))
    assert np.all(np.isfinite(ahead))
    # The mean over the roll of both directions across, K = 4 (1 + M).
    push = 0.5 * 1.2 * SOUND * REFERENCE["area"]
    np.testing.assert_allclose(np.diag(ahead)[:2], -8.0 * push, rtol=1e-12)
    assert np.all(np.isfinite(SLOPES(jnp.zeros(3))))
    check_grads(
        lambda w: WING.load(0.0, state(w), BODY).force_N,
        (jnp.asarray(flow(0.7, 12.0 * DEG, 40.0 * DEG)),),
        order=1,
        atol=1e-4,
        rtol=1e-6,
    )


def test_single_precision_stays_and_a_batch_is_its_runs():
    """As a batch hands it on: with an axis of runs of length one behind what all share."""
    single = jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), WINGED)
    c = single.at(*(jnp.float32(x) for x in (1.0, 0.1, np.pi)))
    assert all(x.dtype == jnp.float32 for x in c.values())
    effect = dataclasses.replace(WING, table=single)
    small = jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), (effect, state(flow(1.0, 0.1))))
    load = small[0].load(jnp.float32(0.0), small[1], BODY)
    assert load.force_N.dtype == load.torque_B.dtype == jnp.float32
    expected = WING.load(0.0, state(flow(1.0, 0.1)), BODY).force_N
    np.testing.assert_allclose(load.force_N, expected, rtol=1e-5, atol=1e-2)
    point = [jnp.array([0.3, 1.0, 9.0]), jnp.array([0.0, 0.3, 1.0]), jnp.array([-7.0, 0.5, 3.0])]
    shared = jax.tree.map(lambda x: x[..., None], WINGED)
    own = jax.tree.map(lambda x: jnp.stack([x, x, x], -1), WINGED)
    many = [table.at(*point) for table in (WINGED, shared, own)]
    for name in WINGED.names:
        runs = [WINGED.at(*(x[k] for x in point))[name] for k in range(3)]
        for found in many:
            np.testing.assert_allclose(found[name], runs, rtol=1e-13)


def test_a_reynolds_number_is_an_axis_where_it_is_free():
    re = np.array([1e5, 1e6, 1e7])
    m, r = (x.ravel() for x in np.meshgrid([0.0, 1.0], re, indexing="ij"))
    columns = {"mach": m, "reynolds": r, "axial": 0.1 + 0.05 * np.log10(r)}
    table = AerodynamicTable.of_columns(columns, **REFERENCE)
    # Linear in the logarithm, which the cubic reproduces.
    c = table.at(0.4, 0.0, reynolds=jnp.array([0.0, 3e5, 1e9]))["axial"]
    np.testing.assert_allclose(c, 0.1 + 0.05 * np.log10([1e5, 3e5, 1e7]), rtol=1e-12)
    assert bool(table.outside(0.4, 0.0, jnp.asarray(2e7)))
    load = TabulatedAerodynamics(table, AIR).load(0.0, state([0.0, 0.0, 50.0]), BODY)
    t = 9.80665 * 7000.0 * 28.9644 / 8314.32
    reynolds = 1.2 * 50.0 * 0.127 / (1.458e-6 * t**1.5 / (t + 110.4))
    expected = 0.5 * 1.2 * 2500.0 * 0.0127 * (0.1 + 0.05 * np.log10(reynolds))
    np.testing.assert_allclose(load.force_N[2], -expected, rtol=1e-12)


DATCOM = """'SIZES',  'NVARS', 7, 'NALPHA', 3, 'NMACH', 2
'CASE','MACH','ALPHA','CN','CM','CA','CMQ','CMAD','CLLP'
1,0.5,-4,-0.8,1.6,0.31,-50,-10,-2
1,0.5,0,0,0,0.30,-50,-10,-2
1,0.5,4,0.8,-1.6,0.31,-50,-10,-2
1,0.9,-4,-0.9,1.9,0.41,-60,-12,-2
1,0.9,0,0,0,0.40,-60,-12,-2
1,0.9,4,0.9,-1.9,0.41,-60,-12,-2
"""

OPENROCKET = """# Simulation 1 (Up to date)
# 7 data points written for 7 variables of Mach Buster.
# Time (s),Altitude (m),Vertical velocity (m/s),Mach number (\u200b),Thrust (N),\
Axial drag coefficient (\u200b),Drag coefficient (\u200b)
# Event LAUNCH occurred at t=0 seconds
0,0,1,0.0,100,NaN,NaN
0.01,0,1,0.0,100,0.08,0.50
1,50,100,0.3,100,0.41,0.40
2,200,200,0.6,100,0.46,0.45
# Event BURNOUT occurred at t=2 seconds
3,400,150,0.45,0,0.55,0.52
8,900,1,0.0,0,-0.20,0.60
# Event APOGEE occurred at t=8 seconds
9,890,-10,0.02,0,0.9,0.9
"""


def test_files_of_datcom_and_openrocket(tmp_path):
    path = tmp_path / "for042.csv"
    path.write_text(DATCOM)
    table = read_aerodynamics(path, area=0.0127, length=0.127, station=0.1)
    c = table.at(0.5, 4.0 * DEG)
    expected = {"axial": 0.31, "normal": 0.8, "pitch": -1.6, "pitch_damping": -60.0}
    expected["roll_damping"] = -2.0
    for name, value in expected.items():
        over = np.sin(4.0 * DEG) if name in ("normal", "pitch") else 1.0
        np.testing.assert_allclose(c[name], value / over, rtol=1e-13)
    path = tmp_path / "flight.csv"
    path.write_text(OPENROCKET, encoding="utf-8")
    table = read_aerodynamics(path, area=0.0127, length=0.127, station=0.0)
    c = table.at(jnp.array([0.0, 0.3, 0.6]), 0.0)
    np.testing.assert_allclose(c["axial_burning"], [0.50, 0.40, 0.45], rtol=1e-13)
    # Linear between the Mach numbers of the coast, constant beyond its greatest one.
    np.testing.assert_allclose(c["axial"], [0.60, 0.60 - 0.08 / 1.5, 0.52], rtol=1e-13)
    # That of an angle of attack which the file may not have: negative from behind.
    path.write_text(OPENROCKET.replace(",Drag coefficient", ",Base drag coefficient"))
    with pytest.raises(InputError, match="must have Mach number, Drag coefficient, Thrust"):
        read_aerodynamics(path, area=0.0127, length=0.127, station=0.0)


def test_the_row_that_rasaero_leaves_out_is_extrapolated_along_the_mach_number(tmp_path):
    """Of a table that is a sum of a function of the Mach number and one of the angle the missing
    row is exact; any other row is missed."""
    path = tmp_path / "rasaero.csv"
    head = "Mach,Alpha,CA Power-Off,CA Power-On,CN,CP\n"
    machs = [0.01, 0.02, 1.3, 24.99, 25.0]
    rows = [
        f"{m:.2f},{a},{0.3 + 0.1 * m + 0.01 * a},{0.2 + 0.1 * m + 0.01 * a},{0.2 * a},60"
        for a in (0, 2, 4)
        for m in machs
    ]
    path.write_text(head + "\n".join(rows[:-1]))
    table = read_aerodynamics(path, **REFERENCE)
    assert table.mach.shape == (5,) and table.angle.shape == (3,)
    c = table.at(jnp.array([25.0, 25.0, 24.99]), jnp.array([2.0, 4.0, 4.0]) * DEG)
    np.testing.assert_allclose(c["axial"], [2.82, 2.84, 2.839], rtol=1e-13)
    np.testing.assert_allclose(c["axial_burning"], [2.72, 2.74, 2.739], rtol=1e-13)
    normal = np.array([0.4, 0.8, 0.8]) / np.sin(np.array([2.0, 4.0, 4.0]) * DEG)
    np.testing.assert_allclose(c["normal"], normal, rtol=1e-12)
    for lost in (rows[:-2], [*rows[:4], *rows[5:]], [*rows[:7], *rows[8:-1]]):
        path.write_text(head + "\n".join(lost))
        with pytest.raises(InputError, match="has 0 rows for mach"):
            read_aerodynamics(path, **REFERENCE)
    # A table of another program that ends too soon has lost something.
    path.write_text(head.replace(" Power-Off", "").replace(" Power-On", "2") + "\n".join(rows[:-1]))
    with pytest.raises(InputError, match="has 0 rows for mach 25, angle"):
        read_aerodynamics(path, **REFERENCE)


@pytest.mark.parametrize(
    "content",
    [
        b"Mach,CA\r\n0,0.4\r\n\r\n1,0.5\r\n",
        b"# Mach,CA\n# a note\n0, 0.4\n1, 0.5\n",
        b"Mach Buster, drag\n\nMach;CA;\n0;0,4;\n1;0,5;\n",
        b"\xef\xbb\xbfMach\tCA\n0\t0,4\n1\t.5e0\n",
        "Mach,CA,Länge (°)\n0,0.4,1\n1,0.5,1\n".encode("latin-1"),
        "Mach;CA\n0;0.4\n1;0.5\n".encode("utf-16"),
    ],
    ids=["windows", "comment", "semicolons", "tabulators", "latin-1", "utf-16"],
)
def test_forms_of_a_table(tmp_path, content):
    path = tmp_path / "table.csv"
    path.write_bytes(content)
    c = read_aerodynamics(path, **REFERENCE).at(jnp.array([0.0, 1.0]), 0.0)
    np.testing.assert_allclose(c["axial"], [0.4, 0.5], rtol=1e-13)


def test_a_table_of_all_angles_reaches_a_flow_from_behind():
    """C_N = 2 sin(a), whose quotient is constant, and C_A = cos(a)/2, even about both ends: the
    cubic over 15 degrees errs by h^4/384 of the fourth derivative and by its slopes."""
    angles = np.radians(np.arange(0.0, 181.0, 15.0))
    m, a = (x.ravel() for x in np.meshgrid([0.0, 1.0], angles, indexing="ij"))
    columns = {"mach": m, "angle": a, "axial": 0.5 * np.cos(a), "normal": 2.0 * np.sin(a)}
    table = AerodynamicTable.of_columns(columns | {"centre": 1.0 + 0.0 * m}, **REFERENCE)
    at = jnp.array([0.0, 0.3, 1.6, 3.0, np.pi])
    c = table.at(0.5, at)
    np.testing.assert_allclose(c["normal"], 2.0, rtol=1e-12)
    np.testing.assert_allclose(c["axial"], 0.5 * np.cos(at), atol=3e-3)
    ends = jax.vmap(jax.grad(lambda x: table.at(0.5, x)["axial"]))(at[jnp.array([0, 4])])
    np.testing.assert_allclose(ends, 0.0, atol=1e-14)
    assert not np.any(np.asarray(table.outside(0.5, at)))


def test_drag_and_lift_and_a_base_make_the_forces_along_the_axes(tmp_path):
    """C_A = C_D cos - C_L sin, C_N = C_D sin + C_L cos; a jet takes the base from C_A."""
    path = tmp_path / "drag.csv"
    path.write_text("""Mach,Alpha,CD Power-Off,CD Power-On,CL,CP (m)
0,0,0.4,0.3,0,1.0
0,10,0.6,0.5,1.5,1.0
1,0,0.5,0.4,0,1.0
1,10,0.7,0.6,1.6,1.0
""")
    c = read_aerodynamics(path, **REFERENCE).at(0.0, 10.0 * DEG)
    cos, sin = np.cos(10.0 * DEG), np.sin(10.0 * DEG)
    np.testing.assert_allclose(c["axial"], 0.6 * cos - 1.5 * sin, rtol=1e-12)
    np.testing.assert_allclose(c["axial_burning"], 0.5 * cos - 1.5 * sin, rtol=1e-12)
    np.testing.assert_allclose(c["normal"] * sin, 0.6 * sin + 1.5 * cos, rtol=1e-12)
    np.testing.assert_allclose(c["lever"], -c["normal"] * 1.0, rtol=1e-12)
    path.write_text("Mach;CA;CA Base\n0;0,4;0,1\n1;0,5;0,15\n")
    c = read_aerodynamics(path, **REFERENCE).at(1.0, 0.0)
    np.testing.assert_allclose([c["axial"], c["axial_burning"]], [0.5, 0.35], rtol=1e-13)


def test_what_is_no_table_is_refused_in_a_sentence(tmp_path, rasaero):
    path = tmp_path / "table.csv"

    def refusal(text):
        path.write_text(text)
        with pytest.raises(InputError) as error:
            read_aerodynamics(path, **REFERENCE)
        return str(error.value)

    rows = RASAERO.splitlines()
    gap = refusal("\n".join(rows[:5] + rows[6:]))
    assert "has 0 rows for mach 1, angle 0.0349066 rad: it must have one" in gap
    assert "has 2 rows for mach 0.5, angle 0 rad" in refusal("\n".join([*rows, rows[1]]))
    text = "\n".join([*rows[:3], rows[3].replace("0.90", "n/a"), *rows[4:]])
    assert f"{path}, line 4: cn is 'n/a': it must be a finite number." in refusal(text)
    for number in ("nan", "inf", "1e999", "1e300", "1_0", "0x1", "", "٣"):
        bad = refusal(f"Mach,CA\n0,0.4\n\n1,{number}\n")
        assert f"{path}, line 4: ca is {number!r}: it must be a finite number." in bad
    # With a decimal comma all columns behind it are shifted.
    assert "line 2 has 3 fields: it must have 2" in refusal("Mach,CA\n0,0,4\n1,0,5\n")
    assert "no heading with Mach" in refusal("a,b\n1,2\n")
    assert "no rows below its heading" in refusal(rows[0])
    assert "1 Mach numbers: it must have two" in refusal("\n".join(rows[:4]))
    assert "angles of sideslip" in refusal("Mach,Alpha,Beta,CA\n0,0,1,1\n1,0,1,1\n")
    bare = refusal("Mach,Alpha,CA,CN\n0,0,1,0\n1,0,1,0\n0,9,1,1\n1,9,1,1")
    assert "neither its centre nor a moment" in bare
    assert "neither an axial force" in refusal("Mach,CN\n0,0\n1,0\n")
    rolled = refusal("Mach,PHI,CA\n0,0,1\n1,0,1\n0,90,2\n1,90,2\n")
    assert f"{path}: the last roll is 1.5708: it must be a period behind the first" in rolled
    with pytest.raises(FileNotFoundError, match=r"none\.csv"):
        read_aerodynamics(tmp_path / "none.csv", **REFERENCE)


def test_an_end_beyond_the_table_is_marked_and_an_apogee_is_not(rasaero):
    """By the dynamic pressure: 5 kPa at 60 degrees is outside of the model, 20 Pa is not."""
    table = read_aerodynamics(rasaero, **REFERENCE)
    scene = Scene([TabulatedAerodynamics(table, AIR)], BODY)
    fast, slow = (state(v * np.array([np.sin(1.0), 0.0, np.cos(1.0)])) for v in (90.0, 6.0))
    assert bool(scene.outside(0.0, fast)) and not bool(scene.outside(0.0, slow))
    run = simulate(scene, fast, jnp.array([0.0, 1e-3]), accuracy=1e-6, throw=False)
    assert run.status == Status.OUTSIDE_MODEL


def test_a_vehicle_takes_a_table_in_place_of_its_drag():
    """Of C_A alone: the parts give the rest, and all is as with the drag at a node."""
    with pytest.raises(InputError, match=r"Vehicle\.drag is None"):
        dataclasses.replace(vehicle(ROCKETS["Calisto"]), drag=None)
    plain = vehicle(ROCKETS["Calisto"])
    columns = {"mach": np.array([0.0, 0.5, 1.0]), "axial": np.array([0.5, 0.4, 0.6])}
    columns["axial_burning"] = columns["axial"] - 0.05
    table = AerodynamicTable.of_columns(columns, area=plain.area, length=0.127, station=0.0)
    drag = MachTable(columns["mach"], columns["axial_burning"])
    coasting = MachTable(columns["mach"], columns["axial"])
    plain = dataclasses.replace(plain, drag=drag, coasting_drag=coasting)
    with_table = dataclasses.replace(plain, drag=None, coasting_drag=None, table=table)
    y = dataclasses.replace(state([9.0, -4.0, 0.5 * SOUND]), mass=plain.body.loaded_mass())
    w = np.array([9.0, -4.0, 0.5 * SOUND])
    y = dataclasses.replace(y, velocity=jnp.asarray(w * 0.5 * SOUND / np.linalg.norm(w)))
    for t in (1.0, 5.0):
        a, b = (
            Scene(v.as_body(AIR), v.body).vector_field(jnp.asarray(t), y)
            for v in (with_table, plain)
        )
        np.testing.assert_allclose(a.velocity, b.velocity, rtol=1e-12)
        np.testing.assert_allclose(a.omega, b.omega, rtol=1e-11, atol=1e-12)
    point = with_table.as_point(AIR)[0]
    np.testing.assert_allclose(point.coefficient(0.5), 0.4, rtol=1e-13)


def test_a_scene_file_names_a_table(tmp_path, rasaero):
    (tmp_path / "table.csv").write_text(RASAERO)
    (tmp_path / "scene.toml").write_text("""
[body]
mass = "16 kg"
inertia = [8.0, 8.0, 0.04]
[effects.tabulated_aerodynamics]
table = { file = "table.csv", area = "127 cm^2", length = "127 mm", station = "1.16 m" }
[initial]
position = [0.0, 0.0, 0.0]
velocity = [0.0, 0.0, 200.0]
attitude = { angles = [0.0, 0.0, 0.0] }
omega = [0.0, 0.0, 0.0]
[times]
end = "1 s"
""")
    file = load(tmp_path / "scene.toml")
    (effect,) = file.system.effects
    np.testing.assert_allclose(effect.table.at(1.0, 2.0 * DEG)["axial"], 0.51, rtol=1e-13)


def test_a_batch_with_factors_of_its_own_is_its_runs_and_what_tumbles_marks_itself_alone(rasaero):
    """Of one table for all: in the middle the run that stands alone."""
    table = read_aerodynamics(rasaero, **REFERENCE)
    factors = jnp.array([0.9, 1.0, 1.2])
    y0 = state([5.0, 0.0, 1.05 * SOUND])
    many = jax.tree.map(lambda x: jnp.repeat(x[..., None], 3, axis=-1), y0)
    ts = jnp.array([0.0, 0.2])

    def runs(shifts):
        air = {"axial_factor": factors, "centre_shift": jnp.array(shifts)}
        scene = Scene([TabulatedAerodynamics(table, AIR, **air)], BODY)
        return simulate_batch(scene, many, ts, accuracy=1e-9)

    together = runs([0.0, 0.0, 0.0])
    one = Scene([TabulatedAerodynamics(table, AIR)], BODY)
    alone = simulate(one, y0, ts, accuracy=1e-9).final
    np.testing.assert_allclose(together.final.velocity[:, 1], alone.velocity, rtol=1e-7, atol=1e-6)
    assert np.all(np.diff(together.final.velocity[2]) < -1e-3)
    # The pressure acts three metres ahead: the angle grows by e in a fiftieth of a second.
    beside = runs([0.0, 3.0, 0.0])
    marked = [Status.COMPLETED, Status.OUTSIDE_MODEL, Status.COMPLETED]
    assert beside.status.tolist() == marked
    ends = [run.final.velocity[:, jnp.array([0, 2])] for run in (beside, together)]
    # All runs of a block share their steps, which the tumbling makes shorter.
    np.testing.assert_allclose(*ends, rtol=1e-7, atol=1e-6)
