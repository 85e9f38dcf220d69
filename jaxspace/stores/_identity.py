"""The identity of a campaign: whether a store belongs to it, and the message about a difference."""

import hashlib
import json
from collections.abc import Mapping

from ..core.record import Record
from .columns import Column

IDENTITY = {
    "planned_runs": "the number of runs",
    "seed": "the seed",
    "chunk": "the runs in a chunk",
    "rtol": "the relative tolerance",
    "atol": "the absolute tolerance",
    "method": "the method",
    "rolled_stages": "the compact form of its steps",
    "description": "the scene",
    "files": "the files that the scene names",
    "modules": "the modules with user-defined physics",
    "inputs": "the inputs",
    "samples": "the number of stored states per phase",
    "times": "the times of the stored states",
    "until": "the rule that ends it",
    "digest": "the results of the first runs",
}
"""Names of the properties, in the order in which differences are reported."""


def mark_of(attributes: Record) -> str:
    """The mark of the campaign with these attributes of a store, which the entry of each of its
    chunks bears. The number of runs is not part of it: an extended campaign keeps its chunks."""
    identity = [attributes.get(name) for name in IDENTITY if name != "planned_runs"]
    return hashlib.sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest()


def difference(
    there: Record, arrays: Mapping[str, Column], attributes: Record, columns: Mapping[str, Column]
) -> str:
    """A message about the difference between the attributes and arrays of a store and those of a
    campaign; empty if there is none."""
    changed = [name for name in IDENTITY if there.get(name) != attributes.get(name)]
    # Compared last, because different settings are the cause of different numbers.
    names = sorted(set(columns) ^ set(arrays))
    others = sorted(name for name in arrays if arrays[name] != columns.get(name))
    if not changed and names:
        return f"only one of the two has {names[0]!r}."
    if not changed:
        return f"its array {others[0]!r} differs." if others else ""
    # With equal settings, the cause of different numbers is outside of the campaign.
    if changed[0] == "digest":
        return _cause(there, attributes)
    if changed[0] == "files":
        return _file("file", there.get("files") or {}, attributes.get("files") or {})
    if changed[0] == "modules":
        return _file("module", _texts(there.get("modules")), _texts(attributes.get("modules")))
    was, now = _differing(str(there.get(changed[0])), str(attributes.get(changed[0])))
    return f"{IDENTITY[changed[0]]}: {was} in the store, {now} here."


def _texts(modules: Mapping[str, Record] | None) -> dict[str, str]:
    """The texts of modules by name, from their entry in a record."""
    return {name: module["text"] for name, module in (modules or {}).items()}


def _file(kind: str, there: Mapping[str, str], here: Mapping[str, str]) -> str:
    """The first file of the scene, or module, that differs."""
    name = next(x for x in (*there, *here) if there.get(x) != here.get(x))
    for own, other, where in ((there, here, "store"), (here, there, "campaign")):
        if name not in other and name in own:
            return f"only the {where} has the {kind} {name} of the scene."
    was, now = _differing(there[name], here[name])
    return f"the {kind} {name} of the scene: {was} in the store, {now} here."


def _cause(there: Record, here: Record) -> str:
    """The likely cause of different results with the same settings."""
    # Versions first, which are the more likely cause.
    for kind in ("versions", "machine"):
        old = there.get(kind) or {}
        new = here.get(kind) or {}
        changed = [key for key in new if old.get(key) != new[key]]
        if changed:
            causes = ", ".join(f"{key} {old.get(key)} has become {new[key]}" for key in changed)
            return f"the first runs have different results, and {causes}."
    return (
        "the first runs have different results, so its functions must have changed, or its inputs "
        "beyond the recorded digits."
    )


def _differing(old: str, new: str) -> tuple[str, str]:
    """The first pair of lines in which two texts differ."""
    # One more empty line, so that a text differs from one that continues it.
    lines = zip((old + "\n").split("\n"), (new + "\n").split("\n"), strict=False)
    pairs = [(a.strip(), b.strip()) for a, b in lines if a != b]
    return pairs[0] if pairs else (old, new)
