"""The tables of the effects of a file, by their names; a second effect of one kind has its name
with a number.

    [effects.third_body]        the moon
    [effects.third_body_2]      the sun
"""

from collections.abc import Mapping
from dataclasses import dataclass

from .._catalog.catalog import Catalog
from .._kinds.kind import Reading, Schema, Value, Values
from .._kinds.tables import Table
from .._kinds.values import OneName

AIR = "air"
"""The table of the air for all effects in it that have no other one."""


@dataclass(frozen=True, eq=False)
class EffectTables(Table):
    """The effects of a file, each a table."""

    def read(self, value: object, path: str, reading: Reading) -> Value:
        if not isinstance(value, Mapping):
            return super().read(value, path, reading)
        others = {key: self._otherwise(path, key, table) for key, table in value.items()}
        reading.errors += filter(None, others.values())
        return super().read({k: v for k, v in value.items() if not others[k]}, path, reading)

    def _otherwise(self, path: str, key: str, table: object) -> str:
        """The error for a second effect that is given in another way; empty for anything else."""
        if key in self.entries and isinstance(table, list):
            return (
                f"{path}.{key} is a list of tables: it must be one table, and a second {key} is "
                f"[{path}.{key}_2]."
            )
        bases = [name for name in self.entries if key.startswith(f"{name}_")]
        if key in self.entries or key in self.refused or not bases:
            return ""
        base = max(bases, key=len)
        return f"{path}.{key} is not a known key: a second {base} is [{path}.{base}_2]."

    def schema(self) -> Schema:
        # Without the entries, which would double the schema.
        return {**super().schema(), "patternProperties": {_numbered(self.entries): {}}}


@dataclass(frozen=True, eq=False)
class EffectName(OneName):
    """The name of an effect of a file."""

    def schema(self) -> Schema:
        pattern = {"type": "string", "pattern": _numbered(self.names)}
        return {"anyOf": [super().schema(), pattern]}


def with_empty_tables(data: Values, known: Catalog) -> Values:
    """The data in which an effect that a phase names has a table, if only an empty one."""
    effects = data.get("effects", {})
    # A wrong type is reported by reading it, with the path.
    if not isinstance(effects, Mapping):
        return data
    empty = {e: {} for e in named_effects(data) if e in known.effects}
    return {**data, "effects": {**empty, **effects}} if empty else data


def named_effects(data: Values) -> list[str]:
    """The effects that have a table, or that a phase names."""
    effects, branches = data.get("effects", {}), data.get("branch", {})
    owners = [data, *(branches.values() if isinstance(branches, Mapping) else ())]
    lists = [owner.get("phase") for owner in owners if isinstance(owner, Mapping)]
    active = [
        e
        for phases in lists
        for p in (phases if isinstance(phases, list) else [])
        if isinstance(p, Mapping) and isinstance(p.get("effects"), list)
        for e in p["effects"]
    ]
    names = list(effects) if isinstance(effects, Mapping) else []
    return [e for e in (*names, *active) if isinstance(e, str)]


def _numbered(names: Mapping[str, object] | tuple[str, ...]) -> str:
    """The pattern of these names with a number."""
    return f"^({'|'.join(names)})_[0-9]+$"
