"""Mean elements of catalogues, two-line sets and orbit mean-elements messages, by the library
`sgp4`.

    jaxspace     what is read              where the theory is
    read_tle     two-line element sets     Vallado et al., Revisiting Spacetrack Report 3,
    read_omm     OMM in XML or CSV         AIAA 2006-6753: SGP4 and SDP4

Such elements have a meaning for this theory alone: it gives the states, in the axes TEME (true
equator, mean equinox) of their epoch. Needs the extra `ephemerides`.
"""

__all__ = ["CataloguedOrbit", "read_omm", "read_tle"]

import io
import os
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..bodies import BodyState
from ..core import InputError
from ..core.extras import extra
from ..core.files import read_text
from ..core.printing import printed
from ._decay import first_failure, states_by_sgp4
from ._two_line import element_lines
from .ephemeris import Ephemeris


@printed()
class CataloguedOrbit(NamedTuple):
    """A satellite of a catalogue: its `name`, its `identifier` (international designator) and the
    `record` of the library `sgp4`."""

    name: str
    identifier: str
    record: Any

    @property
    def epoch(self) -> str:
        """The epoch of the elements, UTC, text of ISO 8601."""
        # The count of Julian days begins at noon; this one is the midnight of 2000-01-01.
        whole = self.record.jdsatepoch - 2451544.5
        day = datetime(2000, 1, 1) + timedelta(days=float(np.floor(whole)))
        fraction = whole - np.floor(whole) + self.record.jdsatepochF
        return (day + timedelta(seconds=round(float(fraction) * 86400.0, 6))).isoformat()

    def ephemeris(self, ts: ArrayLike) -> Ephemeris:
        """The states at times by SGP4.

        **Arguments**

        - `ts`: s after the epoch of the elements, (times,); negative ones are before it.

        **Raises** `InputError` where the theory has no state, and for every time beyond: a
        satellite that decayed stays so, whatever SGP4 computes of a later time alone."""
        times = np.atleast_1d(np.asarray(ts, float))
        if times.ndim != 1 or not np.all(np.isfinite(times)):
            raise InputError(f"ts is {times.tolist()}: it must be finite numbers, (times,).")
        self._check_reached(times)
        _, r, v = states_by_sgp4(self.record, times)
        # The library works in km.
        return Ephemeris(
            self.epoch, times, 1e3 * r.T, 1e3 * v.T, self.name, self.identifier, frame="TEME"
        )

    def state(self, t: float = 0.0) -> BodyState:
        """Position and velocity `t`, s, after the epoch, to begin a run with. Raises `InputError`
        as `ephemeris` does."""
        return self.ephemeris([t]).state()

    def _check_reached(self, times: NDArray[np.float64]) -> None:
        """Raise `InputError` for the first of the `times`, s, that SGP4 does not reach from the
        epoch on, forwards or backwards."""
        # Imported where it is used, because the library is an extra.
        with extra("ephemerides"):
            from sgp4.api import SGP4_ERRORS

        for side, word in ((1.0, "after"), (-1.0, "before")):
            asked = times[times >= 0.0] if side > 0.0 else times[times < 0.0]
            if not asked.size:
                continue
            failure = first_failure(self.record, side * float(np.max(np.abs(asked))))
            if failure is None:
                continue
            end, code = failure
            beyond = asked[side * asked >= side * end]
            if beyond.size:
                raise InputError(
                    f"SGP4 has no state of {self.name or self.identifier} {abs(beyond[0]):g} s "
                    f"{word} its epoch: from {abs(end):.6g} s {word} it on, {SGP4_ERRORS[code]}."
                )


def read_tle(source: str | os.PathLike[str]) -> list[CataloguedOrbit]:
    """The satellites of two-line element sets.

    **Arguments**

    - `source`: the text itself, or the path of a file; a line before a set is its name.

    **Raises** `InputError` for a set that is not complete, or a line that is cut, shifted, of
    another satellite or has a wrong check sum; the sentence names the line."""
    with extra("ephemerides"):
        from sgp4.api import Satrec

    # A path has no line break, a set of elements at least one.
    is_text = isinstance(source, str) and "\n" in source
    text = str(source) if is_text else read_text(source)
    called = "the text" if is_text else str(source)
    result = [
        CataloguedOrbit(one.name, one.first[9:17].strip(), Satrec.twoline2rv(one.first, one.second))
        for one in element_lines(text, called)
    ]
    if not result:
        raise InputError("no two-line element set was found: its lines must begin with 1 and 2.")
    return result


def read_omm(path: str | os.PathLike[str]) -> list[CataloguedOrbit]:
    """The satellites of an orbit mean-elements message of CCSDS, or of a catalogue of them.

    **Arguments**

    - `path`: of a file in XML or CSV, by its ending.

    **Raises** `InputError` for another ending, a message without elements, or an entry that is
    missing or is no number."""
    with extra("ephemerides"):
        from sgp4 import omm
        from sgp4.api import Satrec

    kind = Path(path).suffix.lower()
    if kind not in (".xml", ".csv"):
        raise InputError(f"{path} ends with {kind!r}: it must end with .xml or .csv.")
    parse = omm.parse_xml if kind == ".xml" else omm.parse_csv
    try:
        rows: list[dict[str, str]] = list(parse(io.StringIO(read_text(path))))
    except (ElementTree.ParseError, AttributeError, TypeError) as error:
        raise InputError(f"{path} is no message of mean elements: {error}.") from error
    result = []
    for k, row in enumerate(rows, 1):
        record = Satrec()
        try:
            omm.initialize(record, row)
        except KeyError as error:
            raise InputError(f"{path}, satellite {k}, has no {error.args[0]}.") from error
        except (ValueError, TypeError) as error:
            raise InputError(f"{path}, satellite {k}, has a wrong entry: {error}.") from error
        result.append(CataloguedOrbit(row.get("OBJECT_NAME", ""), row["OBJECT_ID"], record))
    if not result:
        raise InputError(f"{path} holds no elements.")
    return result
