"""One state of a body, its covariance and manoeuvres, and the CCSDS Orbit Parameter Message that
carries them.

Source: CCSDS 502.0-B-3, Orbit Data Messages, 3 (OPM) and 7 (KVN); CCSDS 505.0-B-3, XML
Specification. Keplerian elements and entries that a user defines are not read.
"""

__all__ = ["Manoeuvre", "OrbitState", "read_opm", "write_opm"]

import os
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..bodies import BodyState
from ..core import InputError
from ..core.checks import check_finite
from ..core.files import read_text
from ..core.printing import printed
from ..sampling import MultivariateNormal
from ._covariance import distribution_of
from ._epochs import ALLOWED, instant
from ._messages import (
    STATE,
    TRIANGLE,
    Entry,
    covariance_of,
    entries_of_keywords,
    entries_of_xml,
    shifted,
    text_of,
    triangle_of,
)

_META = {
    "OBJECT_NAME": "name",
    "OBJECT_ID": "identifier",
    "CENTER_NAME": "centre",
    "REF_FRAME": "frame",
    "TIME_SYSTEM": "time_system",
}
# Zero or positive, in SI.
_BODY = {
    "MASS": "mass",
    "SOLAR_RAD_AREA": "solar_area",
    "SOLAR_RAD_COEFF": "solar_coefficient",
    "DRAG_AREA": "drag_area",
    "DRAG_COEFF": "drag_coefficient",
}
_CHANGES = ("MAN_DV_1", "MAN_DV_2", "MAN_DV_3")
_MANOEUVRE = ("MAN_EPOCH_IGNITION", "MAN_DURATION", "MAN_DELTA_MASS", "MAN_REF_FRAME", *_CHANGES)


@printed(duration="s", mass_change="kg", velocity_change="m/s")
class Manoeuvre(NamedTuple):
    """A manoeuvre: the `epoch` of its ignition, its `duration`, s, zero for an impulse, the change
    of mass, kg, zero or negative, and the change of velocity, m/s, (3,), in the axes of the
    `frame`."""

    epoch: str
    duration: float
    mass_change: float
    velocity_change: Float[np.ndarray, "3"]
    frame: str = "EME2000"


@printed(position="m", velocity="m/s", mass="kg", solar_area="m^2", drag_area="m^2")
class OrbitState(NamedTuple):
    """The state of a body at its `epoch`, text of ISO 8601 in the `time_system`, in NumPy.

    - `position`, m, and `velocity`, m/s: (3,), relative to the `centre` in the axes of the `frame`.
    - `covariance`: of position and velocity, m and s, (6, 6), in the axes of the
      `covariance_frame`; that of the state if empty.
    - `mass`, kg; `solar_area` and `drag_area`, m^2, with their coefficients: `None` if not known.
    - `manoeuvres`: in the order of the message."""

    epoch: str
    position: Float[np.ndarray, "3"]
    velocity: Float[np.ndarray, "3"]
    name: str = ""
    identifier: str = ""
    centre: str = "EARTH"
    frame: str = "EME2000"
    time_system: str = "UTC"
    covariance: Float[np.ndarray, "6 6"] | None = None
    covariance_frame: str = ""
    mass: float | None = None
    solar_area: float | None = None
    solar_coefficient: float | None = None
    drag_area: float | None = None
    drag_coefficient: float | None = None
    manoeuvres: tuple[Manoeuvre, ...] = ()

    def state(self) -> BodyState:
        """Position, velocity and mass, to begin a run with."""
        return BodyState(self.position, self.velocity, mass=self.mass)

    def distribution(self) -> MultivariateNormal:
        """The distribution of position and velocity, m and m/s, (6,), in the axes of the state.

        **Raises** `InputError` without a covariance, for one in axes that do not follow from the
        state, and for one that is not positive semidefinite."""
        if self.covariance is None:
            raise InputError("OrbitState.covariance is None: it must be a matrix, (6, 6).")
        axes = self.covariance_frame or self.frame
        return distribution_of(self.position, self.velocity, self.covariance, axes, self.frame)


def read_opm(path: str | os.PathLike[str]) -> OrbitState:
    """The state of a CCSDS Orbit Parameter Message, in keyword = value notation or in XML.

    **Arguments**

    - `path`: of the file.

    **Raises** `InputError` with the line of an entry that violates the standard: a time or a number
    that is not one, an entry that is missing or repeated, or another message."""
    text = read_text(path)
    begun = text.lstrip()
    if begun.startswith("<"):
        entries = entries_of_xml(path, text)
        kinds = {e.key[1:] for e in entries if e.key.startswith("<")}
        if "opm" not in kinds:
            raise InputError(f"{path} is not an orbit parameter message: it must have <opm>.")
        entries = [e for e in entries if e.key[0] not in "</"]
    elif begun.startswith("CCSDS_OPM_VERS"):
        entries = entries_of_keywords(path, text)
    else:
        raise InputError(
            f"{path} is not an orbit parameter message: it must begin with CCSDS_OPM_VERS or <."
        )
    return _Reader(path, entries).state()


class _Reader:
    """The entries of a message by their keyword, and those of its manoeuvres."""

    def __init__(self, path: str | os.PathLike[str], entries: list[Entry]):
        self.path = path
        self.entries: dict[str, Entry] = {}
        self.manoeuvres: list[dict[str, Entry]] = []
        for entry in entries:
            own = self.entries
            if entry.key in _MANOEUVRE:
                if entry.key == _MANOEUVRE[0]:
                    self.manoeuvres.append({})
                if not self.manoeuvres:
                    raise InputError(f"{self.where(entry)} must follow {_MANOEUVRE[0]}.")
                own = self.manoeuvres[-1]
            if entry.key in own:
                raise InputError(f"{self.where(entry)} is repeated: it must occur once.")
            own[entry.key] = entry

    def where(self, entry: Entry) -> str:
        return f"{self.path}, line {entry.line}: {entry.key}"

    def needed(self, key: str, own: dict[str, Entry] | None = None) -> Entry:
        """The entry of a keyword, which must have a value."""
        entry = (self.entries if own is None else own).get(key)
        if entry is None or not entry.text:
            where = self.path if entry is None else f"{self.path}, line {entry.line}"
            raise InputError(f"{where} has no {key}: an orbit parameter message must have it.")
        return entry

    def number(self, entry: Entry, power: int = 0) -> float:
        return shifted(self.where(entry), entry.text, power)

    def vector(self, keys: tuple[str, ...], own: dict[str, Entry] | None = None) -> np.ndarray:
        """Components in m or m/s of entries in km or km/s."""
        return np.array([self.number(self.needed(key, own), 3) for key in keys])

    def epoch(self, entry: Entry) -> str:
        if instant(entry.text) is None:
            raise InputError(f"{self.where(entry)} is {entry.text[:40]!r}: it must be {ALLOWED}.")
        return entry.text.rstrip("Z")

    def state(self) -> OrbitState:
        meta = {field: self.needed(key).text for key, field in _META.items()}
        body = {}
        for key, field in _BODY.items():
            if key in self.entries:
                body[field] = self.number(self.entries[key])
                if body[field] < 0.0:
                    entry = self.entries[key]
                    raise InputError(
                        f"{self.where(entry)} is {entry.text[:40]!r}: it must be zero or positive."
                    )
        covariance = None
        if any(key in self.entries for key in TRIANGLE):
            covariance = covariance_of([self.number(self.needed(key), 6) for key in TRIANGLE])
        axes = self.entries.get("COV_REF_FRAME")
        return OrbitState(
            self.epoch(self.needed("EPOCH")),
            self.vector(STATE[:3]),
            self.vector(STATE[3:]),
            **meta,
            covariance=covariance,
            covariance_frame="" if axes is None else axes.text,
            **body,
            manoeuvres=tuple(self.manoeuvre(own) for own in self.manoeuvres),
        )

    def manoeuvre(self, own: dict[str, Entry]) -> Manoeuvre:
        duration, change = (self.needed(key, own) for key in _MANOEUVRE[1:3])
        if self.number(duration) < 0.0:
            where = f"{self.where(duration)} is {duration.text[:40]!r}"
            raise InputError(f"{where}: it must be zero or positive.")
        return Manoeuvre(
            self.epoch(self.needed(_MANOEUVRE[0], own)),
            self.number(duration),
            self.number(change),
            self.vector(_CHANGES, own),
            self.needed("MAN_REF_FRAME", own).text,
        )


def write_opm(
    path: str | os.PathLike[str],
    state: OrbitState,
    originator: str = "JAXSPACE",
    created: str | None = None,
) -> None:
    """Write a state as a CCSDS Orbit Parameter Message, version 2.0, in keyword = value notation.

    **Arguments**

    - `path`: of the file.
    - `state`: with its covariance and manoeuvres.
    - `originator`: who sends the message.
    - `created`: its date, text of ISO 8601; now by default.

    `read_opm` reads the same numbers, to the last digit.

    **Raises** `InputError` for an epoch that is not a time, and for numbers that are not finite."""
    made = created or datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S")
    lines = ["CCSDS_OPM_VERS = 2.0", f"CREATION_DATE = {made}", f"ORIGINATOR = {originator}"]
    lines += [f"{key} = {getattr(state, field) or 'UNKNOWN'}" for key, field in _META.items()]
    lines += [f"EPOCH = {_checked_epoch('OrbitState.epoch', state.epoch)}"]
    for name in ("position", "velocity"):
        check_finite(f"OrbitState.{name}", np.asarray(getattr(state, name)))
    vectors = zip(STATE, [*state.position, *state.velocity], strict=True)
    lines += [f"{key} = {text_of(x, 3)}" for key, x in vectors]
    for key, field in _BODY.items():
        value = getattr(state, field)
        if value is not None:
            check_finite(f"OrbitState.{field}", np.asarray(value))
            lines.append(f"{key} = {float(value)!r}")
    if state.covariance is not None:
        check_finite("OrbitState.covariance", np.asarray(state.covariance))
        lines.append(f"COV_REF_FRAME = {state.covariance_frame or state.frame}")
        texts = [x for row in triangle_of(state.covariance) for x in row]
        lines += [f"{key} = {x}" for key, x in zip(TRIANGLE, texts, strict=True)]
    for one in state.manoeuvres:
        numbers = [one.duration, one.mass_change, *one.velocity_change]
        check_finite("Manoeuvre", np.asarray(numbers))
        values = [
            _checked_epoch("Manoeuvre.epoch", one.epoch),
            repr(float(one.duration)),
            repr(float(one.mass_change)),
            one.frame,
            *(text_of(x, 3) for x in one.velocity_change),
        ]
        lines += [f"{key} = {value}" for key, value in zip(_MANOEUVRE, values, strict=True)]
    Path(path).write_text("\n".join(lines) + "\n", encoding="utf-8")


def _checked_epoch(name: str, text: str) -> str:
    if instant(text) is None:
        raise InputError(f"{name} is {text[:40]!r}: it must be {ALLOWED}.")
    return text
