"""The groups of comparisons, in the order of the page."""

from . import case_17, flights, measured, nesc, optima, peers, programs, rockets, textbooks
from ._row import Row

GROUPS = {
    "textbooks": textbooks,
    "nesc": nesc,
    "case_17": case_17,
    "programs": programs,
    "peers": peers,
    "rockets": rockets,
    "flights": flights,
    "optima": optima,
    "measured": measured,
}
ABOUT = {name: group.ABOUT for name, group in GROUPS.items()}


def rows_of(name: str) -> list[Row]:
    """Compute the rows of a group."""
    return GROUPS[name].rows()
