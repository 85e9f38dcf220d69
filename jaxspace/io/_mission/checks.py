"""Checks of a file as a whole, whose entries are right one by one."""

import warnings
from collections.abc import Mapping

from ...bodies import AbstractBody
from ...core import AbstractParameters, InputError
from ...core.file_names import file_name_fault
from ...core.quantities import REQUIRED
from ...scene.reading import Reading, read_effects
from .._kinds.errors import missing, unknown, wrong
from .._kinds.kind import Maker, Value
from .._kinds.values import LONGEST_PART
from .building import at
from .control import control_errors
from .effect_tables import AIR
from .ends import condition_of, end_kind, event_needs, is_event
from .flight import flight_errors
from .lines import Leg, Line, phase_tables
from .parsed import ROTATION, TRANSLATION, Parsed
from .states import needed_parts

CALLS_FOR = {"force": TRANSLATION, "acceleration": TRANSLATION, "torque": ROTATION}


def mission_errors(file: Parsed) -> list[str]:
    """Consistency errors of the dynamics as a whole, one message each."""
    errors = _errors_together(file) + control_errors(file)
    return errors or (flight_errors(file) if file.kind == "flight" else [])


def _errors_together(file: Parsed) -> list[str]:
    """Errors of the tables together, whose entries are right one by one."""
    # Objects can be built only if the entries that they share are there.
    errors = shared_errors(file) or object_errors(file)
    if file.kind == "flight":
        return errors
    if not errors:
        errors = initial_errors(file) if "initial" not in file.makers else []
    times = file.values.get("times")
    # A run backwards is allowed, a run of no length is not.
    if times is not None and times["end"] == times["start"]:
        errors.append(wrong("times.end", times["end"], "a time other than times.start"))
    if file.kind == "system" or errors:
        return errors
    if file.kind == "mission":
        errors += name_errors(file) or branch_errors(file)
    if errors:
        return errors
    for line in file.lines:
        for leg in line.legs:
            # Phase by phase, because an effect may need another one that acts in some phases only.
            errors += effect_errors(line, leg, file)
            if file.kind == "mission":
                errors += phase_errors(line, leg, file)
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
    """Errors for absent entries that declarations obtain from other tables of the file."""
    result = []
    for path, maker in file.makers.items():
        value = at(file.values, path)
        for key, entry in maker.entries.items():
            absent = entry.shared and not maker.bare and value.get(key) is None
            if absent and entry.default is REQUIRED and at(file.values, entry.shared) is None:
                line = missing(entry.shared, entry.kind.expected()).removesuffix(".")
                result.append(f"{line}; {who(path)} requires it.")
    return result


def air_warnings(file: Parsed) -> list[str]:
    """A warning about effects of the file that are in different air."""
    airs: dict[str, Value] = {}
    for path, maker in file.makers.items():
        for key, entry in maker.entries.items():
            if entry.shared == AIR and path.startswith("effects.") and path.count(".") == 1:
                own = at(file.values, path).get(key)
                airs[path] = file.values.get(AIR) if own is None else own
    first = next(iter(airs), "")
    others = [path for path, air in airs.items() if air != airs[first]]
    if not others:
        return []
    return [
        f"{', '.join(others)} and {first} are in different air: give one table [air] for all "
        "effects, or give each of them its air, if they differ intentionally."
    ]


def object_errors(file: Parsed) -> list[str]:
    """Errors of a class or a named constructor although each number is in its range."""
    result = []
    for path, maker in file.makers.items():
        # The range of each number is checked already; the rules of the class are not.
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
    # Every class does so in part: that a direction is not zero, and that it has as many inertias as
    # axes, no number of the file shows alone.
    is_parameters = isinstance(cls, type) and issubclass(cls, AbstractParameters)
    return is_parameters and not maker.references


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
            result.append(f"{key} and initial.{twice[0]} are both given: give one of them.")
        for need in needed_parts(maker):
            if need not in parts:
                result.append(f"initial has no {need}, which {key} requires.")
    for pair in (TRANSLATION, ROTATION):
        if len(parts & pair) == 1:
            one, other = sorted(pair & parts)[0], sorted(pair - parts)[0]
            result.append(f"initial has {one} but not {other}: give both or neither.")
    if not parts:
        result.append(
            f"initial is empty: it must contain some of {', '.join(file.values['initial'])}."
        )
    if file.kind != "system" and not result and parts & ROTATION:
        result += _turning_errors("body", file)
    return result or _orbit_errors(file)


def _orbit_errors(file: Parsed) -> list[str]:
    """Errors of a maker of initial states although each number is in its range."""
    result = []
    for path, maker in file.makers.items():
        # One that requires parts created by another is checked with them, when the state is built.
        if not path.startswith("initial.") or needed_parts(maker):
            continue
        try:
            # Allowed but doubtful values are reported when the state is built.
            with warnings.catch_warnings(action="ignore"):
                file.building().make(path)
        except InputError as error:
            field, gap, rest = str(error).partition(" ")
            known = field.rpartition(".")[2] in maker.entries
            name = f"{path}.{field.rpartition('.')[2]}" if known else f"{path}: {field}"
            result.append(f"{name}{gap}{rest}")
    return result


def _turning_errors(path: str, file: Parsed) -> list[str]:
    """The error for a body without inertia, at this path, in a state with an attitude."""
    if file.building().make(path).has_inertia():
        return []
    return [f"{_no_inertia(path, file)}; initial.attitude makes the body rotate."]


def _no_inertia(path: str, file: Parsed) -> str:
    entry = file.makers[path].entries.get("inertia")
    what = "a list of 3 entries" if entry is None else entry.kind.expected()
    return missing(f"{path}.inertia", what).removesuffix(".")


def _no_mass(path: str, file: Parsed) -> str:
    entries = file.makers[path].entries
    key = "mass" if "mass" in entries else "propellant_mass"
    return missing(f"{path}.{key}", entries[key].kind.expected()).removesuffix(".")


def effect_errors(line: Line, leg: Leg, file: Parsed) -> list[str]:
    """Errors for requirements of the effects of a phase that the file does not satisfy."""
    result, whole = [], []
    active = leg.phase["effects"]
    for name in active:
        others = {n: c for n, c in file.catalog.effects.items() if n != name}
        needs = f"the effect {name} requires another effect"
        errors = reference_errors(file.makers[f"effects.{name}"], needs, others, active)
        result += errors
        # Without its references an effect cannot be made, and the parts that it reads stay unknown.
        whole += [] if errors else [name]
    building = file.building()
    effects = building.effects(whole)
    body = building.make(leg.body)
    try:
        readings = read_effects(effects.values(), body).effects
    except InputError as error:
        return [*result, str(error)]
    parts = file.parts(line)
    for name, reading in zip(effects, readings, strict=True):
        result += _unmet(name, reading, leg.body, parts, file)
    return result


def _unmet(name: str, reading: Reading, path: str, parts: set[str], file: Parsed) -> list[str]:
    """Errors for quantities that an effect reads or changes and that neither the body at the path
    nor the `parts` of the state have."""
    result = []
    body: AbstractBody = file.building().make(path)
    turns = bool(ROTATION & reading.needs) or "torque" in reading.adds
    if turns and not body.has_inertia():
        result.append(f"{_no_inertia(path, file)}; the effect {name} rotates the body.")
    # Gravity alone needs no mass, so that the mass is required only where it enters.
    massless = body.constant_mass() is None and body.loaded_mass() is None
    if ("force" in reading.adds or "mass" in reading.needs) and massless:
        result.append(f"{_no_mass(path, file)}; the effect {name} requires the mass of the body.")
    # Parts that an effect adds have to be integrated, even if the effect does not read them.
    needed = reading.needs & (TRANSLATION | ROTATION)
    for added in reading.adds & set(CALLS_FOR):
        needed |= CALLS_FOR[added]
    absent = sorted(needed - parts)
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
                f"{needs} with a {attribute.replace('_', ' ')} that acts together with it: one of "
                f"{', '.join(offers)}."
            )
    return result


def _absent_part(part: str, whose: str) -> str:
    return f"initial has no {part}, which {whose} requires."


def name_errors(file: Parsed) -> list[str]:
    """Errors for phases of one name, by which outputs and branches refer to them."""
    result = []
    seen: set[tuple[str, str]] = set()
    for path, phase in phase_tables(file.values).items():
        name = (path.rpartition(".")[0], phase["name"])
        if name in seen:
            what = "a name not used by an earlier phase"
            result.append(wrong(f"{path}.name", phase["name"], what))
        seen.add(name)
    return result


def branch_errors(file: Parsed) -> list[str]:
    """Errors of the branches, which make further checks meaningless."""
    result = []
    for key in file.values["branch"]:
        # Its name is a part of the names of files, as those of its phases are.
        if fault := file_name_fault(key, LONGEST_PART):
            result.append(wrong("branch", key, f"a name that is {fault}"))
    known = {line.key: line for line in file.lines}
    for key, branch in file.values["branch"].items():
        if key in known:
            continue
        # Not those of its own, after which it cannot start.
        names = [leg.name for leg in file.legs]
        where = f'branch.{key}.after = "{branch["after"]}"'
        result.append(unknown(where, branch["after"], names, "phase"))
    if result:
        return result
    for line in file.lines[1:]:
        leg = file.legs[line.after]
        whole = file.line_at(line.after)
        names = {other.phase["name"] for other in whole.legs}
        taken = {name.partition(".")[0] for name in names} | {"final", "run"}
        if line.key in taken:
            what = f"a name other than {', '.join(sorted(taken))}"
            result.append(wrong("branch", line.key, what))
        if leg == whole.legs[-1]:
            what = (
                "a phase that is followed by another one, which continues with the remaining body"
            )
            result.append(wrong(f"{line.path}.after", leg.name, what))
        for path in ("body", f"{line.path}.body"):
            if file.building().make(path).loaded_mass() is None:
                result.append(f"{_no_mass(path, file)}; {line.path} separates with a part of it.")
    return result or [error for leg in file.legs for error in _mass_errors(leg, file)]


def _mass_errors(leg: Leg, file: Parsed) -> list[str]:
    """The error for branches that leave at the end of a phase with more mass than there is."""
    building = file.building()
    paths = [line.path for line in file.leaving(leg)]
    given = sum(float(building.make(f"{path}.body").loaded_mass()) for path in paths)
    # Unknown where only the state contains the remaining mass of a stage.
    whole = building.make(leg.body).loaded_mass()
    if whole is None or given < whole:
        return []
    what = f"{given:g} kg leave as {' and '.join(paths)}"
    return [f"{what}: they must be less than the {float(whole):g} kg of {leg.body}."]


def phase_errors(line: Line, leg: Leg, file: Parsed) -> list[str]:
    """Errors of a phase as a whole."""
    key, phase = leg.path, leg.phase
    result = []
    parts = file.parts(line)
    until = phase["until"]
    # A branch without inertia is a point, and has no attitude.
    if phase["body"] is not None and parts & ROTATION:
        result += _turning_errors(leg.body, file)
    if (phase["duration"] is None) == (until is None):
        ends = end_kind(file.catalog).expected()
        result.append(f"{key} must have either duration (a time) or until ({ends}).")
    elif is_event(until, file.catalog):
        if phase["within"] is None:
            what = (
                "the longest time to wait for the event, a number in s or text with a unit of time"
            )
            result.append(missing(f"{key}.within", what))
        name = condition_of(until) or until
        # The mass is never given in `initial`: it is that of the body.
        for part in sorted(event_needs(until, file.catalog) - parts - {"mass"}):
            result.append(_absent_part(part, f"the event {name}"))
        maker = file.makers.get(f"{key}.until.{name}")
        if maker is not None:
            needs = f"the event {name} requires an effect"
            effects = file.catalog.effects
            result += reference_errors(maker, needs, effects, phase["effects"])
    elif until is not None:
        named = [name for name in phase["effects"] if until in file.catalog.known_times(name)]
        if not named:
            what = "a different end, because no effect of this phase defines that time"
            result.append(wrong(f"{key}.until", until, what))
        elif any(is_event(x.phase["until"], file.catalog) for x in file.before(line, leg)):
            effect = file.building().make(f"effects.{named[0]}")
            # A time that counts from the start of the phase is known whenever it starts.
            if effect.started_at(0.0) is effect:
                what = "a duration, because the time is unknown after a phase that ends at an event"
                hint = (
                    f" Give effects.{named[0]} a delay, which counts from the start of the phase."
                )
                result.append(wrong(f"{key}.until", until, what) + hint)
    jumps = [name for name, table in phase["jump"].items() if table is not None]
    if len(jumps) > 1:
        result.append(f"{key}.jump has {' and '.join(jumps)}: it must have only one of them.")
    for name in jumps:
        needs = file.catalog.jumps[name].needs - {"mass"}
        result += [_absent_part(part, f"the jump {name}") for part in sorted(needs - parts)]
    return result
