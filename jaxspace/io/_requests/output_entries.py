"""The outputs of a file: names of declared functions, methods of effects and paths, and the places
along the run at which they are taken."""

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from ...core.quantities import Quantity, quantities
from ...dispersion.names import check_names
from ...statistics.requirements import Requirement
from ...vehicles import LaunchSite
from .._catalog.catalog import OutputFunction, output_methods
from .._kinds.errors import hint, missing, shown, unknown, wrong
from .._kinds.kind import Kind, Reading, Schema, Value, Values
from .._mission.building import at
from .._mission.flight import SITE, phases_of_flight
from .._mission.parsed import Parsed
from .._mission.states import parts_of_state, state_of
from ..units import WrittenUnits, in_unit, read_number, split
from .output_spec import FINAL, NOMINAL, SPECIAL, OutputSpec, arguments_of

RUN = "run"
ABOUT_A_CENTRE = ("inclination", "radial_speed")
"""Outputs without a meaning for a flight over flat ground."""
TAKES = ("greatest", "least", "time_of_greatest", "time_of_least")


class OutputList(Kind):
    """A list of names or paths, or tables with the keys `output`, `at`, `take`, `unit`, `name`, and
    for a requirement `at_least`, `at_most`, the share of the runs that may violate it (`allowed`)
    and the `confidence` of its verdict."""

    # Keys whose values may be numbers without a unit.
    NUMBERS = ("at_least", "at_most", "allowed", "confidence")
    KEYS = ("output", "at", "take", "unit", "name", *NUMBERS)

    def read(self, value: object, path: str, reading: Reading) -> Value:
        if not (isinstance(value, list) and value):
            reading.errors.append(wrong(path, value, self.expected()))
            return None
        return [self._one(v, f"{path}.{k}", reading) for k, v in enumerate(value)]

    def _one(self, value: object, path: str, reading: Reading) -> dict[str, object]:
        if isinstance(value, str):
            return {"output": value}
        if not isinstance(value, Mapping):
            reading.errors.append(wrong(path, value, "a name, or a table with the key output"))
            return {}
        for key, text in value.items():
            if key not in self.KEYS:
                reading.errors.append(unknown(f"{path}.{key}", key, self.KEYS))
            elif not isinstance(text, str) and key not in self.NUMBERS:
                reading.errors.append(wrong(f"{path}.{key}", text, "text"))
        if "output" not in value:
            reading.errors.append(missing(f"{path}.output", "the name of an output"))
        return dict(value)

    def expected(self) -> str:
        return 'a list of names of outputs, paths such as "final.omega.2", or tables of them'

    def schema(self) -> Schema:
        text = {"type": "string"}
        limit = {"type": ["string", "number"]}
        kinds = {key: limit if key in self.NUMBERS else text for key in self.KEYS}
        table = {
            "type": "object",
            "properties": kinds,
            "required": ["output"],
            "additionalProperties": False,
        }
        return {"type": "array", "minItems": 1, "items": {"anyOf": [text, table]}}


def read_outputs(file: Parsed, units: WrittenUnits) -> tuple[tuple[OutputSpec, ...], list[str]]:
    """The outputs of [dispersion], or their errors. `units`: those of the file."""
    specs, errors = [], []
    for number, entry in enumerate(file.values["dispersion"]["outputs"]):
        key = f"dispersion.outputs.{number}"
        try:
            spec = read_output(key, entry, file, units)
        except ValueError as error:
            errors.append(str(error))
            continue
        # Two outputs of one name would overwrite each other in the store.
        if spec.name in {other.name for other in specs}:
            errors.append(
                wrong(f"{key}.name", spec.name, "a name that is not used by another output")
            )
        specs.append(spec)
    return tuple(specs), errors


class _What(NamedTuple):
    """The output of an entry: a function of a state, a method of an effect, or a path."""

    at: int
    si: str
    function: OutputFunction | None = None
    path: tuple[str, ...] = ()
    effect: str = ""


def read_output(key: str, entry: Values, file: Parsed, units: WrittenUnits) -> OutputSpec:
    """The output of an entry. Raises `ValueError` with the complete message."""
    name = entry["output"]
    take = entry.get("take", "")
    if take and take not in TAKES:
        raise ValueError(wrong(f"{key}.take", take, _one_of()))
    what = _what(key, entry, file, take)
    phases = _phases_of_extreme(f"{key} = {name}", what, file) if take else ()
    shared = () if what.function is None else tuple(what.function.output.shared.items())
    si = "s" if take.startswith("time") else what.si
    # By default in the unit in which the author wrote it, quantities of this kind, or its limits.
    limits = (_unit_of_limit(entry.get(k)) for k in ("at_least", "at_most"))
    written = next(filter(None, limits), si) if si else si
    unit = entry.get("unit") or units.of(name, si, written)
    try:
        factor = in_unit(si, unit)
    except ValueError as error:
        raise ValueError(wrong(f"{key}.unit", unit, str(error))) from None
    plain = name.removeprefix(f"{RUN}.") if what.path else name.removeprefix(f"{what.effect}.")
    # There is one site, so that its outputs need no name before theirs.
    default = f"{take}_{plain}" if take else plain if what.effect == SITE else name
    shown_name = entry.get("name", default)
    check_names(f"{key}.name" if "name" in entry else key, [shown_name])
    low, high = (_limit(f"{key}.{k}", entry.get(k), si, factor) for k in ("at_least", "at_most"))
    shares = ("allowed", "confidence")
    allowed, confidence = (read_share(f"{key}.{k}", entry.get(k)) for k in shares)
    given = [k for k in shares if entry.get(k) is not None]
    if given and low is None and high is None:
        raise ValueError(f"{key}.{given[0]} belongs to a requirement: give at_least or at_most.")
    required = Requirement(low, high, allowed, 0.95 if confidence is None else confidence)
    if low is not None and high is not None and low > high:
        raise ValueError(
            f"{key}.at_least is {shown(entry['at_least'])} and {key}.at_most is "
            f"{shown(entry['at_most'])}: the lower limit must not exceed the upper one."
        )
    return OutputSpec(
        *(shown_name, what.at, unit, factor, what.function, what.path, shared, required),
        *(what.effect, take, phases),
    )


def _what(key: str, entry: Values, file: Parsed, take: str) -> _What:
    name = entry["output"]
    catalog = file.catalog.outputs
    places = _places(file, take)
    # A path is tried before a name, because no declared function has a dot in its name. The longest
    # place first: that of a branch has one, too.
    for place in sorted(places, key=len, reverse=True):
        if name.startswith(f"{place}."):
            path = tuple(name.removeprefix(f"{place}.").split("."))
            unit = _unit_of_path(f"{key} = {name}", path, places[place], file)
            return _What(places[place], unit, None, path)
    head, dot, rest = name.partition(".")
    if dot and head == FINAL:
        raise ValueError(f"{key} = {name}: an extreme must be taken along {RUN} or along a phase.")
    if dot and head == RUN:
        raise ValueError(f"{key} = {name}: along the whole run, take is required, {_one_of()}.")
    methods = _methods_of(head, file)
    if name not in catalog and rest not in methods:
        expected = f"one of {', '.join(catalog)}, or a path such as final.position.0"
        near = [*catalog, *_methods(file), *_paths_like(name, places)]
        raise ValueError(wrong(key, name, expected) + hint(name, near))
    where = entry.get("at", RUN if take else FINAL)
    if where not in places:
        raise ValueError(unknown(f"{key}.at", where, places, "phase"))
    function = methods[rest] if rest in methods else catalog[name]
    for error in _lacking(name, function, file, places[where]):
        raise ValueError(error)
    if take and NOMINAL in arguments_of(function):
        raise ValueError(f"{key}: {name} compares with the nominal run and has no extreme.")
    return _What(places[where], function.output.unit, function, (), head if rest in methods else "")


def _paths_like(name: str, places: Iterable[str]) -> list[str]:
    """The path `name` with each of the places in front of its part of the state."""
    steps = name.split(".")
    return [".".join([place, *steps[place.count(".") + 1 :]]) for place in places]


def _one_of() -> str:
    return f"one of {', '.join(TAKES)}"


def _methods(file: Parsed) -> list[str]:
    """The outputs that the effects of the file have."""
    return [f"{e}.{m}" for e in (*file.active_effects(), SITE) for m in _methods_of(e, file)]


def _methods_of(name: str, file: Parsed) -> Mapping[str, OutputFunction]:
    """The outputs of an effect of the file, or of its site."""
    if name == SITE and file.kind == "flight":
        return output_methods(LaunchSite)
    return file.catalog.effect_outputs(name) if name in file.active_effects() else {}


def _phases_of_extreme(what: str, found: _What, file: Parsed) -> tuple[int, ...]:
    """The numbers of the phases along which an extreme is sought: those in which the effect acts,
    if it is of one. Raises `ValueError` where there are none."""
    active = [phase["effects"] for phase in _phases(file)]
    every = [found.at]
    if found.at < 0:
        # Along the branch alone, or along the mission without its branches.
        own = file.kind == "mission"
        legs = [leg.number for leg in file.line_at(found.at).legs] if own else range(len(active))
        every = legs or [0]
    phases = [k for k in every if not active or not found.effect or found.effect in active[k]]
    if not phases:
        raise ValueError(f"{what}: {found.effect} does not act in this phase.")
    return tuple(phases)


def _unit_of_limit(value: object) -> str:
    """The unit in which a limit is written; empty without one."""
    try:
        return split(value, "")[1] if isinstance(value, str) else ""
    # Reported where the limit is read.
    except ValueError:
        return ""


def _limit(key: str, value: object, si: str, factor: float) -> float | None:
    """A limit of an output in its unit. Raises `ValueError` with the complete message."""
    if value is None:
        return None
    try:
        return factor * read_number(value, Quantity(si, "limit"))[0]
    except ValueError as error:
        raise ValueError(wrong(key, value, str(error))) from None


def read_share(key: str, value: object) -> float | None:
    """A share between 0 and 1. Raises `ValueError` with the complete message."""
    if value is None:
        return None
    share = _limit(key, value, "", 1.0)
    if share is None or not 0.0 < share < 1.0:
        raise ValueError(wrong(key, value, 'between 0 and 1, both excluded, such as "1 %"'))
    return share


def unit_of(spec: OutputSpec, file: Parsed) -> str:
    """The unit of an output in SI."""
    if spec.take.startswith("time"):
        return "s"
    if spec.function is not None:
        return spec.function.output.unit
    return _unit_of_path(spec.name, spec.path, spec.at, file)


def _places(file: Parsed, take: str = "") -> dict[str, int]:
    """The places at which an output can be taken: the end, or the end of a phase before its jump;
    an extreme along the whole run, or along a phase. Names of a branch have its name before
    theirs."""
    whole = RUN if take else FINAL
    ends = {whole: -1}
    if file.kind == "mission":
        ends = {line.place(whole): -1 - k for k, line in enumerate(file.lines)}
    return {**ends, **{phase["name"]: k for k, phase in enumerate(_phases(file))}}


def _phases(file: Parsed) -> list[Values]:
    """The phases of a file, with the effects that can have outputs in each."""
    if file.kind == "flight":
        return [{"name": name, "effects": []} for name in phases_of_flight(file)]
    if file.kind != "mission":
        return []
    return [{"name": leg.name, "effects": leg.phase["effects"]} for leg in file.legs]


def _unit_of_path(key: str, path: tuple[str, ...], place: int, file: Parsed) -> str:
    declared = quantities(state_of(file))
    parts = parts_of_state(file, place)
    if path[0] not in parts:
        raise ValueError(unknown(key, path[0], sorted(parts), "part of the state"))
    quantity = declared[path[0]]
    # The declaration of an attitude specifies an object, but not its number of components.
    shape = quantity.shape or ((4,) if path[0] == "attitude" else ())
    indices = path[1:]
    good = len(indices) == len(shape) and all(
        i.isdigit() and (n is None or int(i) < n) for i, n in zip(indices, shape, strict=True)
    )
    if not good:
        counts = " and ".join(f"0 to {n - 1}" for n in shape if n is not None)
        what = f"followed by {counts}" if shape else "without a trailing number"
        raise ValueError(f"{key}: {path[0]} must be {what}.")
    return quantity.unit


def _lacking(name: str, function: OutputFunction, file: Parsed, place: int = -1) -> list[str]:
    """Errors for requirements of an output that the file does not satisfy at its location."""
    parts = parts_of_state(file, place)
    shared = function.output.shared
    result = []
    for argument in arguments_of(function):
        if argument in shared:
            if at(file.values, shared[argument]) is None:
                result.append(f"{shared[argument]} is missing: the output {name} requires it.")
        elif argument == "initial" and file.kind == "flight":
            result.append(f"A flight has no [initial], which the output {name} requires.")
        elif argument in ("body", "scene") and file.kind == "system":
            result.append(f"A system has no {argument}, which the output {name} requires.")
        elif argument not in SPECIAL and argument != "mass" and argument not in parts:
            result.append(f"initial has no {argument}, which the output {name} requires.")
    return result


def applicable_outputs(file: Parsed, units: WrittenUnits) -> tuple[OutputSpec, ...]:
    """All outputs at the end of the run whose arguments the file has."""
    result = []
    for name, function in file.catalog.outputs.items():
        # A comparison of the nominal run with itself is zero.
        compares = {NOMINAL, "initial"} & set(arguments_of(function))
        # Over flat ground the origin is not a centre.
        compares |= {name} & set(ABOUT_A_CENTRE) if file.kind == "flight" else set()
        # The sensed acceleration is of interest along a run, and requires a trace of all loads.
        compares |= {"scene"} & set(arguments_of(function))
        if not compares and not _lacking(name, function, file):
            si = function.output.unit
            unit = units.of(name, si)
            shared = tuple(function.output.shared.items())
            result.append(OutputSpec(name, -1, unit, in_unit(si, unit), function, (), shared))
    for name, function in _methods_of(SITE, file).items():
        si = function.output.unit
        unit = units.of(name, si)
        spec = OutputSpec(name, -1, unit, in_unit(si, unit), function, (), ())
        result.append(spec._replace(effect=SITE))
    return tuple(result)
