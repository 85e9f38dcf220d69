"""Checks of data read from a store: its head and the entries of its manifest are untrusted JSON
until they have passed.

A value that the library reads from the attributes of a store has its check here. All other
attributes, as the notes of a user, are passed on as they are.
"""

from collections.abc import Callable
from typing import NamedTuple, TypeAlias, TypeGuard

import numpy as np

from ..core.file_names import file_name_fault
from ..core.record import Record
from ..statistics.purpose import Purpose
from ..statistics.requirements import requirement_of
from ..statistics.spread import StopRule

# Beyond, a whole number is none of this library, and may exceed the range of a float.
GREATEST = 2**63 - 1
# Kinds of NumPy's dtypes whose arrays contain plain numbers.
NUMBERS = "biuf"
# Variables that every store has, each with one whole number for each run.
ALWAYS = ("run", "status", "evaluations")


Check: TypeAlias = Callable[[object], bool]


def is_whole(x: object, least: int = 0) -> bool:
    """Whether this is a whole number from `least` on."""
    return type(x) is int and least <= x <= GREATEST


def is_number(x: object) -> TypeGuard[float]:
    """Whether this is a number that a float can represent; it may be infinite or NaN."""
    return type(x) is float or type(x) is int and abs(x) <= GREATEST


def is_duration(x: object) -> bool:
    """Whether this is a finite number from zero on."""
    return is_number(x) and 0.0 <= x <= GREATEST


def is_text(x: object) -> bool:
    """Whether this is text."""
    return isinstance(x, str)


def _each(check: Check) -> Check:
    """The check of a list of such values."""
    return lambda x: isinstance(x, list) and all(map(check, x))


def _named(check: Check) -> Check:
    """The check of such values by name."""
    return lambda x: isinstance(x, dict) and all(map(check, x.values()))


def _is_requirement(x: object) -> bool:
    if not isinstance(x, list) or not all(y is None or is_number(y) for y in x):
        return False
    requirement_of(x).check("requirement")
    return True


def _is_rule(x: object) -> bool:
    return isinstance(x, dict) and bool(StopRule(**x))


def _is_purpose(x: object) -> bool:
    return isinstance(x, dict) and all(map(is_number, x.values())) and bool(Purpose(**x))


def _is_sweep(x: object) -> bool:
    return isinstance(x, dict) and is_whole(x["rows"], 1) and _each(is_text)(x["inputs"])


REQUIRED: dict[str, Check] = {
    "seed": is_whole,
    "planned_runs": lambda x: is_whole(x, 1),
    "chunk": lambda x: is_whole(x, 1),
    "preparation_seconds": is_duration,
}
OPTIONAL: dict[str, Check] = {
    "enough_runs": lambda x: is_whole(x, 1),
    "samples": is_whole,
    "times": _each(is_number),
    "until": _is_rule,
    "rtol": is_number,
    "storing_seconds": is_duration,
    "requirements": _named(_is_requirement),
    "sweep": _is_sweep,
    "by_purpose": _is_purpose,
    "numerical_errors": _named(is_number),
    "nominal": _named(is_number),
    "machine": lambda x: isinstance(x, dict) and is_whole(x.get("cores", 0)),
    "versions": _named(is_text),
    "files": _named(is_text),
    "modules": _named(lambda x: isinstance(x, dict) and {"text", "sha256"} <= set(x)),
    "title": is_text,
    "scene_file": is_text,
}


def attributes_fault(attributes: object) -> str:
    """The fault of the attributes of a store, as the end of a message; empty if there is none."""
    if not isinstance(attributes, dict):
        return "has attributes that are not a JSON object"
    for name, check in {**REQUIRED, **OPTIONAL}.items():
        if name not in attributes:
            if name in REQUIRED:
                return f"has no {name}"
            continue
        try:
            good = check(attributes[name])
        # The classes of the library reject invalid arguments.
        except (ValueError, TypeError, KeyError):
            good = False
        if not good:
            return f"has a {name} that no campaign writes"
    if attributes.get("enough_runs", 1) > attributes["planned_runs"]:
        return "has more enough_runs than planned_runs"
    return ""


def array_fault(name: str, head: object, attributes: Record) -> str:
    """The fault of an array of a store with these attributes, as the end of a message."""
    if fault := file_name_fault(name):
        return f"has an array named {name!r}, which must be {fault}"
    try:
        if isinstance(head, dict) and _is_array(
            name, head, attributes.get("enough_runs") or attributes["planned_runs"]
        ):
            return ""
    except (ValueError, TypeError, LookupError, AttributeError):
        pass
    return f"has an array {name!r} that no campaign writes"


def _is_array(name: str, head: Record, runs: int) -> bool:
    # NumPy interprets anything but text in its own way, and `None` as a float.
    kind = np.dtype(head["data_type"]).kind if is_text(head["data_type"]) else "O"
    shape, dims, own = head["shape"], head["dimension_names"], head["attributes"]
    sizes = _each(is_whole)(shape) and _each(is_text)(dims) and len(shape) == len(dims)
    if not sizes or shape[0] != runs or kind not in NUMBERS or not isinstance(own, dict):
        return False
    if name in ALWAYS:
        return len(shape) == 1 and kind in "iu"
    if own.get("kind") in ("input", "output"):
        return len(shape) == 1 and is_whole(own["place"]) and is_text(own["units"])
    return own.get("kind") == "trajectory"


class Entry(NamedTuple):
    """The entry of a finished chunk in the manifest: its runs, the size and the checksum of each of
    its files, the mark of its campaign, its computing time, s, and its host."""

    first: int
    runs: int
    campaign: str
    files: dict[str, tuple[int, str]]
    seconds: float
    cpu_seconds: float
    host: int | None


def entry_of(found: object) -> Entry | None:
    """The entry in this JSON; `None` for anything else."""
    if not isinstance(found, dict):
        return None
    try:
        values = {name: found[name] for name in Entry._fields if name != "host"}
        entry = Entry(**values, host=found.get("host"))
        pairs = all(is_whole(size) and is_text(digest) for size, digest in entry.files.values())
    except (ValueError, TypeError, LookupError, AttributeError):
        return None
    whole = is_whole(entry.first) and is_whole(entry.runs, 1) and is_text(entry.campaign)
    times = is_duration(entry.seconds) and is_duration(entry.cpu_seconds)
    known = entry.host is None or is_whole(entry.host)
    return entry if pairs and whole and times and known else None
