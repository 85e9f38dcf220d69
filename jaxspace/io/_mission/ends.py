"""The end of a phase: the name of a time or of an event, or a table of an event that has
parameters, by its name.

    until = "apoapsis"                          until = { at_altitude = { altitude = "100 km" } }
"""

from collections.abc import Mapping
from dataclasses import dataclass

from .._catalog.catalog import Catalog
from .._kinds.errors import wrong
from .._kinds.kind import Entry, Kind, Reading, Schema, Value
from .._kinds.tables import Table
from .._kinds.values import OneName


@dataclass(frozen=True, eq=False)
class End(Kind):
    """A name out of `names`, or one of the `conditions`: a table, or just the name where it needs
    no entries."""

    names: tuple[str, ...]
    conditions: Mapping[str, Entry]

    def read(self, value: object, path: str, reading: Reading) -> Value:
        if isinstance(value, str) and value in self.conditions:
            value = {value: {}}
        if not isinstance(value, Mapping):
            return self._name().read(value, path, reading)
        table = Table(self.conditions).read(value, path, reading)
        if len(value) != 1:
            reading.errors.append(wrong(path, dict(value), f"one of {', '.join(self.conditions)}"))
        return table

    def _name(self) -> OneName:
        return OneName((*self.names, *self.conditions))

    def expected(self) -> str:
        return self._name().expected()

    def schema(self) -> Schema:
        table = Table(self.conditions).schema()
        one = {**table, "minProperties": 1, "maxProperties": 1}
        return {"anyOf": [self._name().schema(), one]}


def end_kind(catalog: Catalog) -> End:
    """The file entries for the end of a phase."""
    conditions = {name: Entry(catalog.kinds[c], None) for name, c in catalog.conditions.items()}
    return End((*catalog.all_known_times, *catalog.events), conditions)


def condition_of(until: Value) -> str | None:
    """The name of the event with parameters that ends a phase; `None` for another end."""
    if not isinstance(until, Mapping):
        return None
    return next((name for name, table in until.items() if table is not None), None)


def is_event(until: Value, catalog: Catalog) -> bool:
    """Whether an event ends the phase, and no known time."""
    return condition_of(until) is not None or (isinstance(until, str) and until in catalog.events)


def event_needs(until: Value, catalog: Catalog) -> frozenset[str]:
    """The parts of the state that the event at the end of a phase reads."""
    name = condition_of(until)
    return catalog.events[until].event.needs if name is None else catalog.conditions[name].needs
