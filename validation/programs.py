"""Numbers that operational programs publish in the tests of their repositories."""

import jax.numpy as jnp
import numpy as np

from jaxspace import Accuracy, BodyState, Scene, simulate
from jaxspace.attitude import TorqueFreeBody
from jaxspace.orbits import Oblateness, PointGravity
from jaxspace.orbits.clohessy_wiltshire import clohessy_wiltshire_flow
from jaxspace.orbits.ground_track import ground_point
from jaxspace.orbits.kepler import kepler_flow
from jaxspace.orbits.lambert import lambert
from jaxspace.orbits.time_of_flight import period
from jaxspace.rotations import Quaternion
from jaxspace.solvers import DOP853

from ._from_tests import OfTest
from ._from_tests import rows as rows_of_tests
from ._row import JUDGED, Row, compared

ABOUT = """## Operational programs

The reference values are from the repositories of other programs, at the stated commits; only values
were copied, no code. Values of GMAT (NASA, Apache License 2.0) and MONTE (JPL) are quoted in the
tests of nyx-space; those of Basilisk (ISC licence), Tudat (BSD licence) and Orekit (Apache License
2.0) are from their own tests. JEOD is under the NASA Open Source Agreement 1.3; its runs 2 and 10A
are also exo-atmospheric check-cases of NASA/TM-2015-218675. The other JEOD runs require tesseral
harmonics, an ephemeris of the Moon and the Sun, the atmosphere model of the Marshall Space Flight
Center, or trajectories that were not copied.
"""
NYX = "nyx-space/nyx f31c037, `nyx-core/tests/"
GMAT = f"GMAT, in {NYX}propagation/propagators.rs`"
MONTE = f"MONTE, in {NYX}mission_design/orbitaldyn.rs`"
BASILISK = "AVSLab/basilisk 1812a1a, `test_spacecraft.py`"
HILLS = "tudat-team/tudatpy 3c7d26f, `unitTestClohessyWiltshirePropagator.cpp`"
GOODING = "tudat-team/tudatpy a60911d, `unitTestLambertTargeterGooding.cpp`"
HARMONICS = "tudat-team/tudatpy, term C20 of EGM2008"
KEPLERIAN = "CS-SI/Orekit 04c7587, `KeplerianPropagatorTest.java`"
ELLIPSOID = "CS-SI/Orekit, `OneAxisEllipsoidTest.java`"
JEOD = "nasa/jeod 6550cf4, `verif/SIM_dyncomp`"
FREE = "attitude/test_attitude_torque_free.py::test_space_station"
TIDAL = "attitude/test_attitude_gravity_gradient.py::test_a_cylinder_librates_over_eight_hours"
OF_JEOD = (
    JUDGED + "1e-3 m, 1e-9 of the quaternion and 1e-12 rad/s, for the error of the integrator of "
    "the source"
)

WANTED = (
    OfTest(
        "orbits/test_orbits_perturbations.py::test_the_first_zonal_is_the_oblateness",
        "Acceleration by the second zonal harmonic",
        HARMONICS,
        "acceleration, m/s^2",
        JUDGED + "a relative difference of 2e-14",
        1,
    ),
    *(
        OfTest(test, what, f"{JEOD}, run {run}", quantity, OF_JEOD, index)
        for test, what, run, quantities in (
            (
                FREE,
                "Space station without torque, eight hours",
                "2",
                ("rates, rad/s", "quaternion"),
            ),
            (
                TIDAL,
                "Cylinder librating by gravity gradient, eight hours",
                "10A",
                ("quaternion", "position, m", "rates, rad/s"),
            ),
        )
        for index, quantity in enumerate(quantities)
    ),
)

# km, km/s: a polar orbit, and where GMAT and MONTE have it a day later.
POLAR = jnp.array([[-2436.45, -2436.45, 6891.037], [5.088611, -5.088611, 0.0]])
DAY = 86400.0
GMAT_MU = 398600.4415
GMAT_ENDS = np.array(
    [
        [-5971.194191670392, 3945.506653218658, 2864.63661842225],
        [0.049096957637897856, -4.185093318481106, 5.8489408677453],
    ]
)
# The next best of GMAT's four methods there, at the same tolerance of 1e-12.
GMAT_OTHER = np.array(
    [
        [-5971.194191670676, 3945.506653225158, 2864.6366184134445],
        [0.04909695762999346, -4.185093318475795, 5.848940867748944],
    ]
)
# Normalised C20, and the radius of the field JGM-3.
MONTE_MU, MONTE_J2, MONTE_RADIUS = 398600.4328969392, 0.000484169325971 * np.sqrt(5.0), 6378.1363
MONTE_ENDS = np.array(
    [
        [-5751.472565170783, 4721.183256208691, 2046.020865167045],
        [-0.7976895830677169, -3.656498994998706, 6.139616747276084],
    ]
)
# GMAT's end of the same orbit with the zonal of JGM-3, in the same test.
GMAT_OBLATE = np.array(
    [
        [-5751.473991327555, 4721.214035135832, 2045.947768608806],
        [-0.7977402618596746, -3.656451983636495, 6.139637921620765],
    ]
)

# m, m/s: Basilisk's hub, ten seconds later; sigma are its modified Rodrigues parameters.
HUB_R = jnp.array([-4020338.690396649, 7490566.741852513, 5248299.211589362])
HUB_V = jnp.array([-5199.77710904224, -3436.681645356935, 1041.576797498721])
HUB_END = [-4072255.7737936215, 7456050.4649078, 5258610.029627514]
HUB_INERTIA, HUB_OMEGA = [500.0, 200.0, 300.0], jnp.array([0.5, -0.4, 0.7])
HUB_SIGMA = [3.73034285e-01, -2.39564413e-03, 2.08570797e-01]


def two_body() -> list[Row]:
    """GMAT's low orbit over a day, by the closed form and by steps; Basilisk's over ten seconds."""
    exact = np.stack(kepler_flow(*POLAR, DAY, GMAT_MU))
    scene = Scene([PointGravity(GMAT_MU)])
    accuracy = Accuracy(1e-13, method=DOP853())
    run = simulate(scene, BodyState(*POLAR), jnp.array([0.0, DAY]), accuracy=accuracy)
    stepped = np.stack([run.final.position, run.final.velocity])
    allowed = np.linalg.norm(GMAT_ENDS - GMAT_OTHER, axis=1)
    why = "the difference between two methods of GMAT at the same tolerance"
    hub, _ = kepler_flow(HUB_R, HUB_V, 10.0, 3.986004415e14)
    return [
        *(
            compared(
                found[k],
                GMAT_ENDS[k],
                allowed[k],
                what=f"Low orbit over a day, {how}",
                source=GMAT,
                quantity=quantity,
                why=why,
            )
            for how, found in (("closed form", exact), ("integrated", stepped))
            for k, quantity in enumerate(("position, km", "velocity, km/s"))
        ),
        compared(
            hub,
            HUB_END,
            1e-10 * np.linalg.norm(HUB_END),
            what="Orbit over ten seconds",
            source=BASILISK,
            quantity="position, m",
            why="1e-10, the tolerance in the test of the source",
        ),
    ]


def oblate() -> list[Row]:
    """The low orbit with the second zonal harmonic, beside MONTE, which GMAT is away from."""
    scene = Scene(
        [PointGravity(MONTE_MU), Oblateness(MONTE_MU, float(MONTE_J2), MONTE_RADIUS)],
    )
    accuracy = Accuracy(1e-13, method=DOP853())
    run = simulate(scene, BodyState(*POLAR), jnp.array([0.0, DAY]), accuracy=accuracy)
    found = np.stack([run.final.position, run.final.velocity])
    allowed = np.linalg.norm(MONTE_ENDS - GMAT_OBLATE, axis=1)
    return [
        compared(
            found[k],
            MONTE_ENDS[k],
            allowed[k],
            what="Low orbit over a day with the second zonal harmonic",
            source=MONTE,
            quantity=quantity,
            why="the difference between GMAT and MONTE, which include polar motion and use other "
            "constants",
        )
        for k, quantity in enumerate(("position, km", "velocity, km/s"))
    ]


def tumbling() -> Row:
    """Basilisk's free body over ten seconds."""
    y0 = BodyState(attitude=Quaternion(jnp.array([1.0, 0.0, 0.0, 0.0])), omega=HUB_OMEGA)
    accuracy = Accuracy(1e-12, method=DOP853())
    run = simulate(TorqueFreeBody(HUB_INERTIA), y0, jnp.array([0.0, 10.0]), accuracy=accuracy)
    w, *vector = np.asarray(run.final.attitude.wxyz)
    # Of the two sets of parameters that of the shorter turn.
    sigma = np.array(vector) / (1.0 + abs(w)) * np.sign(w)
    return compared(
        sigma,
        HUB_SIGMA,
        0.5e-9,
        what="Free body over ten seconds",
        source=BASILISK,
        quantity="modified Rodrigues parameters",
        why="half a unit of the last printed digit",
    )


def relative() -> list[Row]:
    """Vallado's routine for relative motion, in a test of Tudat."""
    start = jnp.array([[45.0, 37.0, 12.0], [0.08, 0.03, 0.01]])
    mean_motion = np.sqrt(3.986004418e14 / 6.778137e6**3)
    found = clohessy_wiltshire_flow(*start, 1800.0, mean_motion)
    ends = (
        [3.806450080201250e2, -5.437424675454679e2, 2.509547637285142],
        [1.541620605755606e-1, -7.294751390499470e-1, -1.662099488431618e-2],
    )
    return [
        compared(
            ours,
            theirs,
            1e-14 * np.linalg.norm(theirs),
            what="Relative motion, half an hour",
            source=HILLS,
            quantity=quantity,
            why="1e-14 of the length of the vector, the tolerance in the test of the source",
        )
        for ours, theirs, quantity in zip(
            found, ends, ("position, m", "velocity, m/s"), strict=True
        )
    ]


def transfers() -> list[Row]:
    """Lambert's problem in two tests of Tudat."""
    unit, au = 6.378136e6, 149597870691.0
    cases = (
        (
            "a hyperbola",
            ([0.02 * au, 0.0, 0.0], [0.0, -0.03 * au, 0.0], 8.64e6),
            ([-745.457, 156.743, 0.0], [104.495, -693.209, 0.0]),
            0.5e-3,
            "half a unit of the last printed digit",
        ),
        (
            "an ellipse",
            ([2.0 * unit, 0.0, 0.0], [2.0 * unit, 2.0 * np.sqrt(3.0) * unit, 0.0], 5.0 * 806.78),
            ([2735.8, 6594.3, 0.0], [-1367.9, 4225.03, 0.0]),
            0.05,
            "half a unit of the last printed digit of the coarsest component",
        ),
    )
    return [
        compared(
            np.stack(lambert(jnp.array(a), jnp.array(b), t, 3.986004418e14)),
            np.array(ends),
            allowed,
            what=f"Lambert's problem, {what}",
            source=GOODING,
            quantity="velocities, m/s",
            why=why,
        )
        for what, (a, b, t), ends, allowed, why in cases
    ]


def geometry() -> list[Row]:
    """Numbers of two tests of Orekit."""
    place = ground_point(
        jnp.array([4637885.347, 121344.608, 4362452.869]), 0.0, 6378137.0, 1.0 / 298.257222101
    )
    theirs = (0.757987116290729, 0.026157811533131, 260.455572965555)
    return [
        compared(
            period(7209668.0, 3.9860047e14),
            6092.3362422560844633,
            1e-12,
            what="Period of an orbit",
            source=KEPLERIAN,
            quantity="period, s",
            why="1e-12 s, the tolerance in the test of the source",
        ),
        *(
            compared(
                ours,
                number,
                allowed,
                what="Geodetic coordinates",
                source=ELLIPSOID,
                quantity=quantity,
                why=why,
            )
            for ours, number, quantity, allowed, why in zip(
                place,
                theirs,
                ("latitude, rad", "longitude, rad", "altitude, m"),
                (0.5e-15, 0.5e-15, 2e-9),
                2 * ["half a unit of the last printed digit"]
                + ["two rounding errors of the distance"],
                strict=True,
            )
        ),
    ]


def rows() -> list[Row]:
    """The rows of the tests, then those that are computed here."""
    return [
        *two_body(),
        *oblate(),
        tumbling(),
        *relative(),
        *transfers(),
        *geometry(),
        *rows_of_tests(WANTED),
    ]
