"""The groups of comparisons, in the order of the page."""

from . import nesc, optima, rockets, textbooks
from ._row import Row

GROUPS = {"textbooks": textbooks, "nesc": nesc, "optima": optima, "rockets": rockets}
ABOUT = {name: group.ABOUT for name, group in GROUPS.items()}


def rows_of(name: str) -> list[Row]:
    """Compute the rows of a group."""
    return GROUPS[name].rows()
