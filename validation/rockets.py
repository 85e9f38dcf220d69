"""Model rockets from the rail to the ground beside RocketPy."""

from ._from_tests import OfTest
from ._from_tests import rows as rows_of_tests
from ._row import JUDGED, Row

ABOUT = """## Model rockets compared with RocketPy

Three of the example rockets of RocketPy 1.13 are simulated with both libraries, with the same
tables. `python benchmarks/_rocketpy.py` computes the values of RocketPy: as released, and with the
centre of mass on the correct side of the nozzle. In the equations of motion of RocketPy 1.13,
propellant and nozzle are ahead of the centre of dry mass (issue 1186 reports a part of this). In
the rows "corrected", jaxspace is compared with the corrected simulations. In the rows "as
released", the rockets in jaxspace are mirrored in the same way and compared with RocketPy as
released. The data of the rockets are under RocketPy's MIT licence.
"""
SOURCE = "RocketPy 1.13.0"
MODELS = (
    JUDGED + "differences of the models: added mass of the parachutes, Coriolis force of the gas, "
    "sine of the angle of attack instead of the angle"
)
ROCKETS = ("Calisto", "NDRT 2020", "Valetudo")
FLIGHTS = tuple(f"{rocket}, {how}" for how in ("corrected", "as released") for rocket in ROCKETS)
QUANTITIES = (
    "apogee, m",
    "time of the apogee, s",
    "speed at rail exit, m/s",
    "time of the landing, s",
    "drift, m",
)

WANTED = (
    *(
        OfTest(
            "vehicles/test_vehicles.py::test_three_rockets_fly_as_in_rocketpy",
            flight,
            SOURCE,
            quantity,
            MODELS,
            index,
            part,
        )
        for part, flight in enumerate(FLIGHTS)
        for index, quantity in enumerate(QUANTITIES)
    ),
    *(
        OfTest(
            "vehicles/test_vehicles.py::test_slopes_and_centres_of_calisto_are_those_of_rocketpy",
            f"Calisto's {part}",
            SOURCE,
            quantity,
            JUDGED + "1e-13: both programs use Barrowman's formulas",
            2 * k + which,
        )
        for k, part in enumerate(("nose", "fins", "tail"))
        for which, quantity in enumerate(("lift-curve slope times area, m^2", "station, m"))
    ),
)


def rows() -> list[Row]:
    """One row of each comparison."""
    return rows_of_tests(WANTED)
