"""The tables of the effects of a file, by their names; a second effect of one kind has its name
with a number.

    [effects.third_body]        the moon
    [effects.third_body_2]      the sun
"""

from collections.abc import Mapping
from dataclasses import dataclass

from ._kinds import Reading, Schema, Value
from ._table_kinds import Table
from ._value_kinds import OneName


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
        return f"{path}.{key} is not a key that is known: a second {base} is [{path}.{base}_2]."

    def schema(self) -> Schema:
        # Without the entries, which would double the schema.
        return {**super().schema(), "patternProperties": {_numbered(self.entries): {}}}


@dataclass(frozen=True, eq=False)
class EffectName(OneName):
    """The name of an effect of a file."""

    def schema(self) -> Schema:
        pattern = {"type": "string", "pattern": _numbered(self.names)}
        return {"anyOf": [super().schema(), pattern]}


def _numbered(names: Mapping[str, object] | tuple[str, ...]) -> str:
    """The pattern of these names with a number."""
    return f"^({'|'.join(names)})_[0-9]+$"
