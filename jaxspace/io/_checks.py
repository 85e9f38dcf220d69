"""Checks of a file as a whole, whose entries are right one by one."""

import dataclasses
import functools
from collections.abc import Hashable, Mapping

from ..bodies import AbstractBody
from ..core import AbstractParameters, InputError
from ..core.quantities import REQUIRED
from ..scene.reading import Reading, read_effects
from ._catalog import Catalog
from ._ends import condition_of, end_kind, event_needs, is_event
from ._errors import missing, wrong
from ._kinds import Maker, Values
from ._objects import Building, Runs, at

ROTATION = frozenset({"attitude", "omega"})
TRANSLATION = frozenset({"position", "velocity"})
CALLS_FOR = {"force": TRANSLATION, "acceleration": TRANSLATION, "torque": ROTATION}


@dataclasses.dataclass(frozen=True)
class Parsed:
    """A file whose entries are right one by one: its kind, values, and makers of objects."""

    # One of `_form.KINDS`.
    kind: str
    values: Values = dataclasses.field(compare=False)
    makers: dict[str, Maker] = dataclasses.field(compare=False)
    catalog: Catalog = dataclasses.field(compare=False)
    # What all other fields follow from. Compared in their place, because campaigns hold a file as a
    # static field: loaded again, the same file finds the programs compiled before.
    source: Hashable

    @property
    def is_mission(self) -> bool:
        """Whether it runs in phases."""
        return self.kind in ("mission", "flight")

    def building(self) -> Building:
        """For one run, of the numbers that the file gives."""
        return Building(self.values, self.makers, Runs())

    def phases(self) -> list[Values]:
        """The phases; a scene is a single one."""
        if self.kind == "mission":
            return self.values["phase"]
        return [{"name": "scene", "effects": list(self.active_effects())}]

    def active_effects(self) -> tuple[str, ...]:
        """The effects that have a table."""
        tables = self.values.get("effects", {})
        return tuple(name for name, table in tables.items() if table is not None)

    @functools.cached_property
    def loses_mass(self) -> bool:
        """Whether an effect changes the mass, which is then a part of the state."""
        if self.kind in ("system", "flight"):
            return self.kind == "flight"
        building = self.building()
        effects = building.effects(self.active_effects()).values()
        result = read_effects(effects, building.make("body")).effects
        return any("mass_rate" in reading.adds for reading in result)

    def parts(self) -> set[str]:
        """The parts of the state that the file gives."""
        # After its rail a rocket becomes a point under its parachutes, without an attitude.
        if self.kind == "flight":
            return set(TRANSLATION)
        initial = self.values["initial"]
        given = {key for key, value in initial.items() if value is not None}
        result = {key for key in given if f"initial.{key}" not in self.makers}
        for key in given - result:
            result |= set(self.makers[f"initial.{key}"].make.initial.gives)
        return result


def check_parsed(file: Parsed) -> list[str]:
    """Errors of the file as a whole, one sentence each."""
    # Objects can be built only if the entries that they share are there.
    errors = shared_errors(file) or object_errors(file)
    if file.kind == "flight":
        return errors
    if not errors:
        errors = initial_errors(file) if "initial" not in file.makers else []
    times = file.values.get("times")
    # A run backwards is allowed, a run of no length is not.
    if times is not None and times["end"] == times["start"]:
        errors.append(wrong("times.end", times["end"], "another time than times.start"))
    if file.kind == "system" or errors:
        return errors
    for number, phase in enumerate(file.phases()):
        # Phase by phase, because an effect may need another one that acts in some phases only.
        errors += effect_errors(phase["effects"], file)
        if file.kind == "mission":
            errors += phase_errors(number, phase, file)
    # Without repetitions, because an effect of several phases has the same error in each.
    return list(dict.fromkeys(errors))


def who(path: str) -> str:
    """The entry at a path, in words."""
    package, _, name = path.partition(".")
    if package == "effects":
        return f"the effect {name}"
    if ".jump." in path:
        return f"the jump {path.rpartition('.')[2]}"
    return path


def shared_errors(file: Parsed) -> list[str]:
    """Errors for absent entries that declarations take from other tables of the file."""
    result = []
    for path, maker in file.makers.items():
        value = at(file.values, path)
        for key, entry in maker.entries.items():
            absent = entry.shared and not maker.bare and value.get(key) is None
            if absent and entry.default is REQUIRED and at(file.values, entry.shared) is None:
                line = missing(entry.shared, entry.kind.expected()).removesuffix(".")
                result.append(f"{line}; {who(path)} needs it.")
    return result


def object_errors(file: Parsed) -> list[str]:
    """What a class or a named constructor does not accept although each number is in its range."""
    result = []
    for path, maker in file.makers.items():
        # Ranges are checked already; only classes with a rule of their own can still refuse.
        if not _checks_itself(maker) or path.startswith(("initial", "method")):
            continue
        try:
            file.building().make(path)
        except InputError as error:
            sentence = str(error)
            owner, dot, rest = sentence.partition(".")
            # With the path in the file, because its author does not know the class.
            if owner == maker.name.partition(".")[0] and dot:
                rest = rest[rest.index(" ") :] if maker.bare else "." + rest
                sentence = path + rest
            else:
                sentence = f"{path}: {sentence}"
            # An outer object repeats the error of an inner one.
            if not any(f.startswith(f"{path}.") for f in result):
                result.append(sentence)
    return result


def _checks_itself(maker: Maker) -> bool:
    # A named constructor is bound to its class.
    cls = getattr(maker.make, "__self__", maker.make)
    is_parameters = isinstance(cls, type) and issubclass(cls, AbstractParameters)
    return (
        is_parameters
        and ("__check_init__" in vars(cls) or "." in maker.name)
        and not maker.references
    )


def initial_errors(file: Parsed) -> list[str]:
    """Errors of the parts of the initial state together."""
    result = []
    parts = file.parts()
    for key, maker in file.makers.items():
        if not key.startswith("initial."):
            continue
        twice = [
            part
            for part in maker.make.initial.gives  # type: ignore[attr-defined]
            if file.values["initial"].get(part) is not None and f"initial.{part}" != key
        ]
        if twice:
            result.append(f"{key} and initial.{twice[0]} are both there: give one of them.")
        for need in needed_parts(maker):
            if need not in parts:
                result.append(f"initial has no {need}: {key} needs it.")
    for pair in (TRANSLATION, ROTATION):
        if len(parts & pair) == 1:
            one, other = sorted(pair & parts)[0], sorted(pair - parts)[0]
            result.append(f"initial has {one} and no {other}: it must have both, or neither.")
    if not parts:
        result.append(
            f"initial is empty: it must have some of {', '.join(file.values['initial'])}."
        )
    if file.kind != "system" and not result and parts & ROTATION and not _body(file).has_inertia():
        result.append(f"{_no_inertia(file)}; initial.attitude makes the body turn.")
    return result


def needed_parts(maker: Maker) -> list[str]:
    """The parts of the state that a maker of other parts needs: its undeclared arguments."""
    import inspect

    declared = set(maker.arguments.values())
    return [
        name
        for name, p in inspect.signature(maker.make).parameters.items()
        if name not in declared and p.kind is not inspect.Parameter.VAR_KEYWORD
    ]


def _body(file: Parsed) -> AbstractBody:
    return file.building().make("body")


def _no_inertia(file: Parsed) -> str:
    entry = file.makers["body"].entries.get("inertia")
    what = "a list of 3 entries" if entry is None else entry.kind.expected()
    return missing("body.inertia", what).removesuffix(".")


def effect_errors(active: list[str], file: Parsed) -> list[str]:
    """Errors for what effects that act together need and the file does not have."""
    result, whole = [], []
    for name in active:
        others = {n: c for n, c in file.catalog.effects.items() if n != name}
        needs = f"the effect {name} needs another effect"
        errors = reference_errors(file.makers[f"effects.{name}"], needs, others, active)
        result += errors
        # Without its references an effect cannot be made, and the parts that it reads stay unknown.
        whole += [] if errors else [name]
    building = file.building()
    effects = building.effects(whole)
    body = building.make("body")
    try:
        readings = read_effects(effects.values(), body).effects
    except InputError as error:
        return [*result, str(error)]
    for name, reading in zip(effects, readings, strict=True):
        result += _unmet(name, reading, body, file)
    return result


def _unmet(name: str, reading: Reading, body: AbstractBody, file: Parsed) -> list[str]:
    """Errors for parts that an effect reads or changes, and the file does not have."""
    result = []
    turns = bool(ROTATION & reading.needs) or "torque" in reading.adds
    if turns and not body.has_inertia():
        result.append(f"{_no_inertia(file)}; the effect {name} turns the body.")
    # Gravity alone needs no mass, so that the mass is required only where it enters.
    massless = body.constant_mass() is None and body.loaded_mass() is None
    if ("force" in reading.adds or "mass" in reading.needs) and massless:
        entries = file.makers["body"].entries
        key = "mass" if "mass" in entries else "propellant_mass"
        line = missing(f"body.{key}", entries[key].kind.expected()).removesuffix(".")
        result.append(f"{line}; the effect {name} needs the mass of the body.")
    # What an effect adds has to be integrated, even where the effect does not read it.
    needed = reading.needs & (TRANSLATION | ROTATION)
    for added in reading.adds & set(CALLS_FOR):
        needed |= CALLS_FOR[added]
    absent = sorted(needed - file.parts())
    return result + [_absent_part(part, f"the effect {name}") for part in absent]


def reference_errors(
    maker: Maker, needs: str, effects: Mapping[str, type], active: list[str]
) -> list[str]:
    """Errors for references of an object that none of the effects acting with it offers."""
    result = []
    for attribute in maker.references.values():
        offers = [name for name, cls in effects.items() if hasattr(cls, attribute)]
        if not set(offers) & set(active):
            result.append(
                f"{needs} with a {attribute.replace('_', ' ')} that acts beside it: one of "
                f"{', '.join(offers)}."
            )
    return result


def _absent_part(part: str, whose: str) -> str:
    return f"initial has no {part}: {whose} needs it."


def phase_errors(number: int, phase: Values, file: Parsed) -> list[str]:
    """Errors of a phase as a whole."""
    key = f"phase.{number}"
    result = []
    phases = file.values["phase"]
    parts = file.parts()
    until = phase["until"]
    # Outputs refer to phases by name, so that the names must differ.
    if [p["name"] for p in phases].index(phase["name"]) < number:
        result.append(
            wrong(f"{key}.name", phase["name"], "another name than that of an earlier phase")
        )
    if (phase["duration"] is None) == (until is None):
        ends = end_kind(file.catalog).expected()
        result.append(f"{key} must have either duration, a time, or until, {ends}.")
    elif is_event(until, file.catalog):
        if phase["within"] is None:
            what = "the longest time to wait for the event, in s or text with a unit of time"
            result.append(missing(f"{key}.within", what))
        name = condition_of(until) or until
        # The mass is never given in `initial`: it is that of the body.
        for part in sorted(event_needs(until, file.catalog) - parts - {"mass"}):
            result.append(_absent_part(part, f"the event {name}"))
        maker = file.makers.get(f"{key}.until.{name}")
        if maker is not None:
            needs = f"the event {name} needs an effect"
            effects = file.catalog.effects
            result += reference_errors(maker, needs, effects, phase["effects"])
    elif until is not None:
        if not any(until in file.catalog.known_times(name) for name in phase["effects"]):
            what = "another end: no effect of this phase has that time"
            result.append(wrong(f"{key}.until", until, what))
        if any(is_event(p["until"], file.catalog) for p in phases[:number]):
            what = "a duration: after a phase that ends at an event the time is not known"
            result.append(wrong(f"{key}.until", until, what))
    jumps = [name for name, table in phase["jump"].items() if table is not None]
    if len(jumps) > 1:
        result.append(f"{key}.jump has {' and '.join(jumps)}: it must have one of them.")
    for name in jumps:
        needs = file.catalog.jumps[name].needs - {"mass"}
        result += [_absent_part(part, f"the jump {name}") for part in sorted(needs - parts)]
    return result
