"""Times of messages of CCSDS: a calendar date or a day of the year, and a time of day.

    2026-03-01T12:00:00.5Z        2026-060T12:00:00.5Z

The fraction, of any length, and the Z are optional. A leap second, 23:59:60, is not read, because
seconds are counted without them.

Source: CCSDS 502.0-B-3, Orbit Data Messages, 7.5.10; CCSDS 301.0-B-4, Time Code Formats, 3.5.
"""

import re
from datetime import datetime, timedelta
from typing import NamedTuple

PATTERN = re.compile(
    r"(?P<year>[0-9]{4})-(?:(?P<month>[0-9]{2})-(?P<date>[0-9]{2})|(?P<day>[0-9]{3}))"
    r"T(?P<hour>[0-9]{2}):(?P<minute>[0-9]{2}):(?P<second>[0-9]{2})(?P<fraction>\.[0-9]+)?Z?"
)
ALLOWED = "a time such as 2026-03-01T12:00:00.5 or 2026-060T12:00:00Z, other than a leap second"


class Instant(NamedTuple):
    """Date and time to the `second`, and the `fraction` of it."""

    second: datetime
    fraction: float

    def since(self, start: "Instant | datetime") -> float:
        """Seconds from the `start`, of which none is a leap second."""
        if isinstance(start, datetime):
            start = Instant(start, 0.0)
        # The whole seconds first, so that the fractions are accurate.
        return (self.second - start.second).total_seconds() + (self.fraction - start.fraction)


def instant(text: str) -> Instant | None:
    """The time of a text; `None` for any other text."""
    match = PATTERN.fullmatch(text)
    if match is None:
        return None
    try:
        if match["day"] is None:
            day = datetime(int(match["year"]), int(match["month"]), int(match["date"]))
        else:
            day = datetime(int(match["year"]), 1, 1) + timedelta(days=int(match["day"]) - 1)
        second = day.replace(
            hour=int(match["hour"]), minute=int(match["minute"]), second=int(match["second"])
        )
    except (ValueError, OverflowError):
        return None
    # A day of the year may be none, such as 000 or 366.
    if second.year != int(match["year"]):
        return None
    return Instant(second, float(match["fraction"] or 0.0))
