"""Optimal flights whose optimum is published."""

from ._from_tests import OfTest
from ._from_tests import rows as rows_of_tests
from ._row import JUDGED, Row

ABOUT = """## Optimal flight

The optima are computed by gradient-based optimisation from rough initial values, without knowledge
of their structure. The programs are in `examples/known_optima`.
"""
KNOWN = "optimization/test_optimization_known.py::test_"

WANTED = (
    OfTest(
        f"{KNOWN}the_ascent_of_a_delta_iii",
        "Ascent of a Delta III, 37 unknowns in four phases",
        "Benson, MIT 2005; Rao et al., GPOPS, ACM TOMS 37 (2010)",
        "mass in orbit, kg",
        JUDGED + "1e-6 of the mass",
    ),
    OfTest(
        f"{KNOWN}the_ascent_of_a_delta_iii",
        "Ascent of a Delta III, 37 unknowns in four phases",
        "Benson, MIT 2005; Rao et al., GPOPS, ACM TOMS 37 (2010)",
        "final time, s",
        JUDGED + "2 ms, the change of the time that corresponds to 1e-6 of the mass",
        1,
    ),
    OfTest(
        f"{KNOWN}goddards_rocket",
        "Goddard's rocket with drag",
        "Bryson and Ho, *Applied Optimal Control*; Dolan, More, Munson, COPS 3.0",
        "maximum height, radii",
        "one unit of the last printed digit",
    ),
    OfTest(
        f"{KNOWN}linear_tangent_steering",
        "Linear-tangent steering",
        "Betts, *Practical Methods for Optimal Control*",
        "minimum time",
        "half a unit of the last printed digit",
    ),
    OfTest(
        f"{KNOWN}a_three_stage_launch_with_a_coast",
        "Launch of three stages with a coast",
        "Pontryagin's conditions, solved by SciPy",
        "mass in orbit, kg",
        JUDGED + "1e-5 of the mass, because the steering consists of polynomials",
        1,
    ),
)


def rows() -> list[Row]:
    """One row of each optimum."""
    return rows_of_tests(WANTED)
