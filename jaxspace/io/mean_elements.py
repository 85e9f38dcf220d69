"""Mean elements of catalogues, two-line sets and orbit mean-elements messages, by the library
`sgp4`.

    jaxspace     what is read              where the theory is
    read_tle     two-line element sets     Vallado et al., Revisiting Spacetrack Report 3,
    read_omm     OMM in XML, KVN or CSV    AIAA 2006-6753: SGP4 and SDP4

Such elements are meaningful for this theory only: it computes the states, in the axes TEME (true
equator, mean equinox) of their epoch. Needs the extra `ephemerides`.
"""

__all__ = ["CataloguedOrbit", "read_omm", "read_tle"]

import os
from datetime import datetime, timedelta
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..bodies import BodyState
from ..core import InputError
from ..core.extras import extra
from ..core.files import read_text
from ..core.printing import printed
from ._decay import first_failure, states_by_sgp4
from ._mean_element_message import elements, satellites
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

        **Raises** `InputError` where the theory has no state, and for every time beyond: a decayed
        satellite remains decayed, even if SGP4 computes a state for a later time."""
        times = np.atleast_1d(np.asarray(ts, float))
        if times.ndim != 1 or not np.all(np.isfinite(times)):
            raise InputError(f"ts is {times.tolist()}: it must contain finite numbers, (times,).")
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
    another satellite, has a wrong check sum or a number out of its range; the error names the line
    and the field."""
    with extra("ephemerides"):
        from sgp4.api import Satrec

    # A path has no line break, a set of elements at least one.
    is_text = isinstance(source, str) and "\n" in source
    text = str(source).removeprefix("\ufeff") if is_text else read_text(source)
    called = "the text" if is_text else str(source)
    result = [
        CataloguedOrbit(one.name, one.first[9:17].strip(), Satrec.twoline2rv(one.first, one.second))
        for one in element_lines(text, called)
    ]
    if not result:
        raise InputError(
            f"{called} has no two-line element set: its lines must begin with 1 and 2."
        )
    return result


def read_omm(path: str | os.PathLike[str]) -> list[CataloguedOrbit]:
    """The satellites of an orbit mean-elements message (OMM) of CCSDS, or of a catalogue of them.

    **Arguments**

    - `path`: of a file in XML, in keyword = value notation, or in CSV.

    The epoch is a date or a day of the year, with or without a fraction and a Z. Catalogue numbers
    beyond 339999 are zero in the `record`, which cannot represent them.

    **Raises** `InputError` with the line and the keyword of an entry that is missing, is not a
    number or is out of its range, and for elements of another theory, time system, centre or frame.
    """
    with extra("ephemerides"):
        from sgp4.api import WGS72, Satrec

    result = []
    for number, satellite in enumerate(satellites(str(path), read_text(path)), 1):
        one = elements(str(path), number, satellite)
        record = Satrec()
        record.sgp4init(WGS72, "i", *one.numbers)
        identifier = one.texts["OBJECT_ID"]
        record.classification = one.texts["CLASSIFICATION_TYPE"][:1]
        record.intldesg = identifier[2:].replace("-", "")
        record.ephtype = one.counts["EPHEMERIS_TYPE"]
        record.elnum = one.counts["ELEMENT_SET_NO"]
        record.revnum = one.counts["REV_AT_EPOCH"]
        result.append(CataloguedOrbit(one.texts["OBJECT_NAME"], identifier, record))
    if not result:
        raise InputError(
            f"{path} has no elements: it must contain those of at least one satellite."
        )
    return result
