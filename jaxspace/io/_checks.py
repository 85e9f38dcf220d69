"""What has to fit together in a file whose every entry is right by itself."""

from typing import Any

from ._errors import hint, missing, unknown, wrong
from ._form import BODY
from ._registry import Registry
from ._tables import Key, allowed
from ._values import at

ROTATION = {"attitude", "omega"}
TRANSLATION = {"position", "velocity"}


def said(table: Any, path: str) -> str:
    """What the entry at the path of a table must be."""
    kind: Any = table
    for step in path.split("."):
        kind = kind[step].kind if isinstance(kind[step], Key) else kind[step]
    return allowed(kind)


def scene_complaints(values: dict[str, Any], registry: Registry) -> list[str]:
    """What does not fit in a scene or a mission."""
    found = body_complaints(values["body"]) + registry.initial.check(values)
    mission = "phase" in values
    phases = values["phase"] if mission else [{"name": "scene", "effects": list(acting(values))}]
    if not mission and values["times"]["end"] == values["times"]["start"]:
        found.append(wrong("times.end", values["times"]["end"], "another time than times.start"))
    parts = registry.initial.parts(values)
    for number, phase in enumerate(phases):
        for name in phase["effects"]:
            found += effect_complaints(name, values, parts, registry)
        if mission:
            found += _phase_complaints(number, phase, phases, values, parts, registry)
    return list(dict.fromkeys(found))


def acting(values: dict[str, Any]) -> tuple[str, ...]:
    """The effects that have a table."""
    return tuple(name for name, table in values["effects"].items() if table is not None)


def body_complaints(body: dict[str, Any]) -> list[str]:
    """What does not fit in the table of the body."""
    found = []
    burning = [k for k in ("dry_mass", "propellant_mass", "gyration_radii") if body[k] is not None]
    if body["mass"] is not None and burning:
        found.append(
            f"body.mass and body.{burning[0]} are both there: give the mass, or the dry mass with its propellant."
        )
    elif burning:
        needed = ("dry_mass", "propellant_mass", "inertia", "gyration_radii")
        found += [missing(f"body.{k}", allowed(BODY[k].kind)) for k in needed if body[k] is None]
    if body["inertia"] is not None:
        moments = sorted(body["inertia"])
        if moments[2] > (1.0 + 1e-6) * (moments[0] + moments[1]):
            found.append(
                wrong(
                    "body.inertia",
                    body["inertia"],
                    "such that no moment exceeds the sum of the other two",
                )
            )
    return found


def effect_complaints(
    name: str, values: dict[str, Any], parts: set[str], registry: Registry
) -> list[str]:
    """What an effect needs and the file does not have."""
    entry, body = registry.effects[name], values["body"]
    tables = {"planet": registry.planet, "body": BODY}
    found = []
    for path in entry.uses:
        if at(values, path) is None:
            room, _, key = path.partition(".")
            what = said(tables[room], key) if room in tables else "a table"
            found.append(missing(path, what).removesuffix(".") + f"; the effect {name} needs it.")
    turns = bool(ROTATION & entry.cls.needs) or "torque" in entry.cls.adds
    if turns and body["inertia"] is None:
        found.append(
            missing("body.inertia", said(BODY, "inertia")).removesuffix(".")
            + f"; the effect {name} turns the body."
        )
    if "force" in entry.cls.adds and body["mass"] is None and body["dry_mass"] is None:
        found.append(
            missing("body.mass", said(BODY, "mass")).removesuffix(".")
            + f"; the effect {name} adds a force."
        )
    wanted = (entry.cls.needs & (TRANSLATION | ROTATION)) | (ROTATION if turns else set())
    wanted |= TRANSLATION if {"force", "acceleration"} & entry.cls.adds else set()
    return found + [_lacking(part, f"the effect {name}") for part in sorted(wanted - parts)]


def _lacking(part: str, who: str) -> str:
    return f"initial has no {part}: {who} needs it."


def _phase_complaints(
    number: int,
    phase: dict[str, Any],
    phases: list[Any],
    values: dict[str, Any],
    parts: set[str],
    registry: Registry,
) -> list[str]:
    key, found = f"phase.{number}", []
    if [p["name"] for p in phases].index(phase["name"]) < number:
        found.append(
            wrong(f"{key}.name", phase["name"], "another name than that of an earlier phase")
        )
    if (phase["duration"] is None) == (phase["until"] is None):
        found.append(
            f"{key} must have either duration, a time, or until, one of burnout, {', '.join(registry.events)}."
        )
    if phase["until"] == "burnout" and "thrust" not in phase["effects"]:
        found.append(
            wrong(
                f"{key}.until",
                "burnout",
                "another end: the effect thrust does not act in this phase",
            )
        )
    if phase["until"] == "burnout" and any(p["until"] in registry.events for p in phases[:number]):
        found.append(
            wrong(
                f"{key}.until",
                "burnout",
                "a duration: after a phase that ends at an event the time is not known",
            )
        )
    if phase["until"] in registry.events and phase["within"] is None:
        found.append(
            missing(
                f"{key}.within",
                "the longest time to wait for the event, in s or text with a unit of time",
            )
        )
    jumps = [name for name, table in phase["jump"].items() if table is not None]
    if len(jumps) > 1:
        found.append(f"{key}.jump has {' and '.join(jumps)}: it must have one of them.")
    for name in jumps:
        for use in registry.jumps[name].uses:
            if use in ROTATION | TRANSLATION and use not in parts:
                found.append(_lacking(use, f"the jump {name}"))
            elif "." in use and at(values, use) is None:
                found.append(
                    missing(use, said({"body": BODY}, use)).removesuffix(".")
                    + f"; the jump {name} needs it."
                )
    return found


def output_complaints(values: dict[str, Any], registry: Registry) -> list[str]:
    """What the outputs of a dispersion need and the file does not have."""
    parts, found = registry.initial.parts(values), []
    for name in values["dispersion"]["outputs"]:
        for use in registry.outputs[name].uses:
            if "." in use and at(values, use) is None:
                found.append(f"{use} is missing: the output {name} needs it.")
            elif "." not in use and use not in parts:
                found.append(_lacking(use, f"the output {name}"))
    return found


def unknown_path(path: str, paths: list[str]) -> str:
    """The sentence for an input of the dispersion that is no number of the file."""
    table = path.rpartition(".")[0]
    near = [p for p in paths if p.rpartition(".")[0] == table] or sorted(
        {p.partition(".")[0] + ".*" for p in paths}
    )
    sentence = unknown(f"dispersion.inputs.{path}", path, near, "number of this file")
    return sentence.partition(" Did you mean")[0] + hint(path, paths)
