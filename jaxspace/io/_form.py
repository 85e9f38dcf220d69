"""The form of a scene file: the tables of each of its four kinds.

    kind       tables
    system     [system], [planet], [initial], [times]               a system by its name
    scene      [planet], [body], [effects.*], [initial], [times]    a body and what acts on it
    mission    [planet], [body], [effects.*], [initial], [[phase]]  phases, each with its effects,
               [branch.*]                                           and parts that leave after one
    flight     [vehicle], [site], [waiting]                         a rocket from rail to ground

Every kind may have [dispersion], [sweep], [optimize], `format`, `title` and how to integrate:
`accuracy` or `final_error`, `method`, `max_step`, `max_steps`. The entries of each table are
defined in the module of this table, in `_mission` or `_requests`.
"""

from collections.abc import Mapping

import jaxspace

from ..bodies import BodyState
from ..core import argument
from ._catalog.catalog import Catalog, state_class
from ._kinds.errors import missing, unknown, wrong
from ._kinds.kind import Entry
from ._kinds.tables import Table
from ._kinds.values import ListOf, Number, OneName, Text, Whole
from ._mission.flight import flight_entries
from ._mission.tables import mission_entries, scene_entries, system_entries
from ._requests.accuracy import accuracy_entries
from ._requests.dispersion import dispersion_table
from ._requests.optimize_table import optimize_table
from ._requests.output_entries import OutputList
from ._requests.sweep import sweep_table

KINDS = ("system", "scene", "mission", "flight")
FORMAT = 1
"""The format of scene files that this version reads. It rises when a file that was right would mean
something else or be rejected; an additional key does not change it."""
TOLERANCE = Number(argument("", positive=True, fixed=True, doc="relative tolerance"))


def kind_of(data: Mapping[str, object]) -> str:
    """The kind of a file, from the tables that it has."""
    # No key gives the kind, because the tables of the file determine it.
    named = {"system": "system", "vehicle": "flight", "phase": "mission"}
    return next((kind for key, kind in named.items() if key in data), "scene")


def format_error(data: Mapping[str, object]) -> str:
    """The error for a file of a later format, with a remedy; empty for any other file."""
    written = data.get("format")
    # Another type is reported by reading it.
    if not isinstance(written, int) or written <= FORMAT:
        return ""
    return (
        f"format is {written}: jaxspace {jaxspace.__version__} reads formats up to {FORMAT}: use a "
        "later version (pip install --upgrade jaxspace)."
    )


def form(data: Mapping[str, object], catalog: Catalog) -> tuple[Table, list[str]]:
    """The form of a file of the kind of `data`; or, for a system of unknown name, the error."""
    kind = kind_of(data)
    if kind != "system":
        return form_of(kind, catalog), []
    system = data["system"]
    names = tuple(catalog.systems)
    if not isinstance(system, Mapping):
        return Table({}), [wrong("system", system, "a table")]
    if "name" not in system:
        return Table({}), [missing("system.name", OneName(names).expected())]
    name = system["name"]
    if not isinstance(name, str):
        return Table({}), [wrong("system.name", name, OneName(names).expected())]
    if name in catalog.refused:
        return Table({}), [f'system.name = "{name}" {catalog.refused[name]}']
    if name not in names:
        return Table({}), [unknown(f'system.name = "{name}"', name, names, "system")]
    return form_of(kind, catalog, name), []


def form_of(kind: str, catalog: Catalog, system: str = "") -> Table:
    """The form of a file of a kind, with the name of its `system` where it has one."""
    state = BodyState if kind != "system" else state_class(catalog.systems[system])
    common, campaign = _common_entries(catalog, state), _campaign_entries()
    if kind == "flight":
        return Table({**common, **flight_entries(), **campaign})
    common["planet"] = Entry(Table(catalog.shared("planet")), None, doc="what attracts")
    if kind == "system":
        return Table({**common, **system_entries(catalog, system), **campaign})
    if kind == "mission":
        return Table({**common, **mission_entries(catalog), **campaign})
    refused = {"branch": "leaves at the end of a phase: at least one [[phase]] is required."}
    return Table({**common, **scene_entries(catalog), **campaign}, refused)


def _common_entries(catalog: Catalog, state: type) -> dict[str, Entry]:
    """The entries common to all files, for states of this class."""
    return {
        "format": Entry(Whole(1, FORMAT), FORMAT, doc="version of the scene-file format"),
        "modules": Entry(
            ListOf(Text()),
            (),
            doc="Python files that it requires; each runs only if allowed by --with",
        ),
        "title": Entry(
            Text(), "", doc="used in tables and figures; by default the name of the file"
        ),
        **accuracy_entries(catalog, state),
    }


def _campaign_entries() -> dict[str, Entry]:
    """The tables of a campaign and of a search."""
    search = optimize_table(OutputList(), TOLERANCE)
    return {
        "dispersion": Entry(dispersion_table(), None, doc="dispersed inputs and recorded outputs"),
        "sweep": Entry(sweep_table(), None, doc="numbers of the file at explicit values"),
        "optimize": Entry(search, None, doc="objective, constraints and design variables"),
    }
