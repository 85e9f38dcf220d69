"""From a file to a scene that may be built: every check that needs no computation, done at once."""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ._checks import output_complaints, scene_complaints
from ._errors import SceneError
from ._form import form, kind_of
from ._inputs import distributions
from ._registry import Registry
from ._scene_file import SceneFile
from ._tables import checked


def load(path: str | Path, registry: Registry) -> SceneFile:
    """The scene file at `path`, whose names are those of the `registry`.

    Raises `SceneError`, one line for each thing that is wrong; nothing is compiled before."""
    data, text = _parsed(path)
    table, complaints = form(data, registry)
    if not complaints:
        values, complaints = checked(table, _with_empty_tables(data, registry))
    if complaints:
        raise SceneError(path, complaints)
    kind, inputs = kind_of(data), {}
    if kind == "system":
        complaints = registry.systems[values["system"]["name"]].check(values)
    else:
        complaints = scene_complaints(values, registry)
    if not complaints and values.get("dispersion") is not None:
        inputs, complaints = distributions(values)
        complaints = output_complaints(values, registry) + complaints
    if complaints:
        raise SceneError(path, complaints)
    return SceneFile(Path(path), text, kind, values, inputs, registry)


def _parsed(path: str | Path) -> tuple[dict[str, Any], str]:
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not text in UTF-8"
        raise SceneError(path, f"cannot be read: {reason}.") from error
    try:
        return tomllib.loads(text), text
    except tomllib.TOMLDecodeError as error:
        raise SceneError(path, f"is not TOML: {str(error)[0].lower()}{str(error)[1:]}.") from error


def _with_empty_tables(data: dict[str, Any], registry: Registry) -> dict[str, Any]:
    """The data in which an effect that a phase names has a table, if only an empty one."""
    effects, phases = data.get("effects", {}), data.get("phase", [])
    if not isinstance(effects, Mapping) or not isinstance(phases, list):
        return data
    named = [
        e
        for p in phases
        if isinstance(p, Mapping) and isinstance(p.get("effects"), list)
        for e in p["effects"]
    ]
    empty = {e: {} for e in named if isinstance(e, str) and e in registry.effects}
    return {**data, "effects": {**empty, **effects}} if empty else data
