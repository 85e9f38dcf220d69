"""Flights that were measured, as the examples of this project compute them."""

import runpy
from pathlib import Path

import numpy as np

from ._row import JUDGED, Row, compared

ABOUT = """## Measured flights

Comparisons with published results from measurements. The examples
`10_orbit_from_ranges_and_angles.py` and `12_drag_from_two_line_elements.py` contain the data.
"""
EXAMPLES = Path(__file__).parents[1] / "examples"
VALLADO = "Vallado, *Fundamentals of Astrodynamics*, example 10-4"
DECAYED = (
    "the elements of three weeks determine the drag of those weeks, and the standard atmosphere "
    "is for mean solar activity. In the minimum of 2018 the density of the upper atmosphere "
    "decreased more rapidly with altitude than in the standard, so the drag increased faster "
    "during the decay, and re-entry was earlier. The stated spread is that of the elements "
    "only; a density model that includes the solar flux, which this library does not contain, "
    "would be required."
)


def orbit_of_geos_3() -> list[Row]:
    """The orbit of GEOS-3 from the readings of one radar pass."""
    seen = runpy.run_path(str(EXAMPLES / "10_orbit_from_ranges_and_angles.py"))
    distance, speed = seen["lengths"]
    what = "GEOS-3 from a radar pass of three minutes"
    words = (
        (
            distance / 1e3,
            7216.76,
            0.5,
            "distance, km",
            VALLADO,
            JUDGED + "the gravity fields and the axes differ",
        ),
        (speed, 7432.62, 2.0, "speed, m/s", VALLADO, "the standard deviation of the speed"),
        (
            seen["inclination"],
            115.0,
            0.2,
            "inclination, deg",
            "NASA, GEOS-3",
            "three digits are published, and the pass is short",
        ),
    )
    return [
        compared(ours, theirs, allowed, what=what, source=source, quantity=quantity, why=why)
        for ours, theirs, allowed, quantity, source, why in words
    ]


def end_of_tiangong_1() -> Row:
    """When Tiangong-1 comes down, from its elements seven weeks before."""
    seen = runpy.run_path(str(EXAMPLES / "12_drag_from_two_line_elements.py"))
    return compared(
        seen["end"],
        92.01,
        2.0 * np.asarray(seen["spread"]),
        what="Re-entry of Tiangong-1 from elements seven weeks before",
        source="NORAD 37820: 2 April 2018, 00:16 UTC",
        quantity="day of 2018",
        why="two standard deviations, from the scatter of the elements",
        note=DECAYED,
    )


def rows() -> list[Row]:
    """The rows of both flights."""
    return [*orbit_of_geos_3(), end_of_tiangong_1()]
