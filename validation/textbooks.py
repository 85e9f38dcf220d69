"""Worked examples and tables of textbooks, standards and reports."""

from ._from_tests import OfTest
from ._from_tests import rows as rows_of_tests
from ._row import JUDGED, Row

ABOUT = """## Textbooks, tables and test sets

The reference values are printed in the cited publications, or result from computations of the same
examples with more digits. The tests of this project make the same comparisons.
"""
VALLADO = "Vallado, *Fundamentals of Astrodynamics*"
CURTIS = "Curtis, *Orbital Mechanics*"
DER = "Der, *The Superior Lambert Algorithm*"
PRINTED = "one unit of the last printed digit"
TRUTH = JUDGED + "1e-12 of the length of the vector; the reference has 25 digits"
PUBLISHED = "orbits/test_orbits_kepler.py::test_published_states"
LAMBERT = "orbits/test_orbits_lambert.py::test_published"
FROM_PRINTED = "the inputs are printed with the same number of digits"
ATMOSPHERE = "U.S. Standard Atmosphere, 1976, table I"
DENSE = "bodies/test_bodies_atmosphere.py::test_the_printed_table_up_to_the_mesopause"
THIN = "bodies/test_bodies_atmosphere.py::test_the_printed_table_to_a_thousand_kilometres"
SGP4 = "io/test_io_ephemerides.py::test_a_two_line_set_is_that_of_the_verification"

WANTED = (
    *(
        OfTest(f"{PUBLISHED}[{case}]", what, source, quantity, TRUTH, index)
        for case, what, source in (
            ("KEP-VALLADO-2-4", "Kepler's problem, an ellipse", f"{VALLADO}, example 2-4"),
            ("KEP-CURTIS-3-5", "Kepler's problem, a hyperbola", f"{CURTIS}, example 3.5"),
        )
        for index, quantity in enumerate(("position, km", "velocity, km/s"))
    ),
    *(
        OfTest(
            f"orbits/test_orbits_kepler.py::test_anomalies_of_nasa_tr_r_158[{case}]",
            "True anomaly from the eccentric anomaly",
            "NASA TR R-158",
            f"true anomaly at e = {case.partition('-')[0]}, deg",
            PRINTED,
            allowed=5e-6,
        )
        for case in ("0.05-10.52321-11.05994", "0.61-161.87359-171.02189")
    ),
    OfTest(
        "orbits/test_orbits_elements.py::test_state_of_elements",
        "State of classical elements",
        f"{VALLADO}, example 2-6",
        "position, km",
        FROM_PRINTED,
    ),
    OfTest(
        "orbits/test_orbits_elements.py::test_state_of_elements",
        "State of classical elements",
        f"{VALLADO}, example 2-6",
        "velocity, km/s",
        FROM_PRINTED,
        1,
    ),
    *(
        OfTest(
            f"{LAMBERT}[{case}]",
            f"Lambert's problem, {what}",
            source,
            "velocity, km/s",
            "the relative error of the final position that follows from the printed velocity, "
            f"{missed}",
            allowed=allowed,
        )
        for case, what, source, missed, allowed in (
            ("LAM-VALLADO-7-5", "an ellipse", f"{VALLADO}, example 7-5", "2e-7", 1e-6),
            ("LAM-CURTIS-5-2", "an ellipse in space", f"{CURTIS}, example 5.2", "8e-6", 5e-5),
            ("LAM-DER-II-0P", "a Molniya orbit", DER, "3e-9", 1e-8),
            ("LAM-DER-II-1PH", "a Molniya orbit, one more revolution", DER, "2e-8", 2e-8),
        )
    ),
    *(
        OfTest(
            "orbits/test_orbits_gravity.py::test_drift_over_48_hours",
            "Orbit about an oblate earth over two days, integrated",
            f"{CURTIS}, example 12.2",
            quantity,
            "one percent: three digits are printed",
            index,
        )
        for index, quantity in enumerate(("node's rate, deg/h", "periapsis' rate, deg/h"))
    ),
    OfTest(
        "orbits/test_orbits_perturbations.py::test_special_inclinations",
        "Sun-synchronous orbit at 800 km",
        f"{VALLADO}, 11.4",
        "inclination, deg",
        PRINTED,
    ),
    OfTest(
        "orbits/test_orbits_drag.py::test_the_density_of_the_table",
        "Exponential density, 400 to 450 km",
        f"{VALLADO}, table 8-4",
        "density at 450 km, kg/m^3",
        "the scale height is printed with five digits",
    ),
    *(
        OfTest(DENSE, "Standard air to 80 km", ATMOSPHERE, quantity, PRINTED, index)
        for index, quantity in enumerate(
            ("temperature, K", "pressure, Pa", "density, kg/m^3", "speed of sound, m/s")
        )
    ),
    *(
        OfTest(THIN, "Standard air, 86 to 1000 km", ATMOSPHERE, quantity, PRINTED, index)
        for index, quantity in enumerate(("temperature, K", "pressure, Pa", "density, kg/m^3"))
    ),
    OfTest(
        SGP4,
        "Two-line elements after 0 and 360 minutes, by the package sgp4",
        "Vallado et al., AIAA 2006-6753, case 00005",
        "position, km, and velocity, km/s",
        PRINTED,
    ),
    *(
        OfTest(
            "scene/test_scene_files_of_orbits.py::test_explorer_7_precesses_and_decays",
            "Explorer 7 over a month, integrated with drag",
            "Brouwer, AJ 64 (1959), mean rates to the second order",
            quantity,
            f"{JUDGED}{share}, the uncertainty of the mean of the osculating elements",
            index,
        )
        for index, quantity, share in (
            (0, "node's rate, rad/s", "0.3 %"),
            (1, "periapsis' rate, rad/s", "2 %"),
        )
    ),
    *(
        OfTest(
            f"simulation/test_simulation.py::test_detest_orbits[{e}-integrated]",
            "Kepler orbits D1 to D5 of DETEST, integrated",
            "Hull, Enright, Fellen, Sedgwick, SIAM J. Numer. Anal. 9 (1972)",
            f"state at t = 20, e = {e}",
            JUDGED + "1e-10 at a tolerance of 1e-13",
        )
        for e in (0.1, 0.3, 0.5, 0.7, 0.9)
    ),
    *(
        OfTest(
            "simulation/test_simulation.py::test_arenstorf_orbit_returns",
            "Arenstorf orbit",
            "Hairer, Norsett, Wanner, *Solving Ordinary Differential Equations I*, II.0",
            quantity,
            JUDGED + "1e-7 at a tolerance of 1e-13: errors grow by a factor of a million along the "
            "orbit",
            index,
        )
        for index, quantity in enumerate(("position after a period", "velocity after a period"))
    ),
    *(
        OfTest(
            "simulation/test_simulation.py::test_pleiades",
            "Pleiades, seven bodies",
            "Test Set for IVP Solvers, University of Bari",
            quantity,
            JUDGED + "1e-8 at a tolerance of 1e-12",
            index,
        )
        for index, quantity in enumerate(("positions at t = 3", "velocities at t = 3"))
    ),
)


def rows() -> list[Row]:
    """One row of each comparison."""
    return rows_of_tests(WANTED)
