"""Loading of a scene file, from its path or from the record of a campaign: all checks that need no
integration."""

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..core import InputError
from ..statistics import Dispersion
from ._catalog.catalog import catalog
from ._catalog.modules import check_stored, missing_module, read_modules
from ._form import form, format_error, kind_of
from ._kinds.errors import SceneError
from ._kinds.kind import Reading
from ._kinds.named_files import NamedFiles
from ._mission.build import system_errors
from ._mission.checks import mission_errors
from ._mission.effect_tables import named_effects, with_empty_tables
from ._mission.parsed import Parsed
from ._requests.accuracy import accuracy_errors
from ._requests.dispersion import Requested, read_dispersion
from ._requests.optimize_table import Task, dispersed_and_free, read_task
from ._scene_file import SceneFile
from ._text import read_toml
from .by_numpy import by_numpy


# A number used by a check need not be finite, and is then rejected.
@np.errstate(all="ignore")
@by_numpy()
def load(
    path: str | os.PathLike[str],
    also: Iterable[object] = (),
    *,
    modules: Iterable[str | os.PathLike[str]] = (),
    text: str | None = None,
    files: Mapping[str, str] | None = None,
) -> SceneFile:
    """The scene file at `path`.

    **Arguments**

    - `path`: of a file in TOML. Files that it names are relative to it.
    - `also`: classes and declared functions that the file may name besides those of the library:
      final systems, effects, jumps, conditions and distributions whose fields are quantities;
      outputs, events and makers of initial states.
    - `modules`: paths of Python files, which are run; the file may use the names that they define.
      The key `modules` of a file names those that it needs, and does not run them.
    - `text`: of the file, if it is not to be read.
    - `files`: texts of all files that it names, of which none is read then.

    **Returns** the checked file, which builds its system on request.

    **Raises** `SceneError`, with one line for each error, before anything is compiled."""
    data, text = read_toml(path, text)
    # This error alone, because any other about a later format would be a guess.
    if format_error(data):
        raise SceneError(path, format_error(data))
    user_modules = read_modules(modules)
    if missing_module(data, user_modules):
        raise SceneError(path, missing_module(data, user_modules))
    named = NamedFiles(Path(path).parent, files, closed=files is not None)
    known = catalog(also, user_modules).numbered(named_effects(data))
    table, errors = form(data, known)
    # If the form is unknown nothing can be read, and any further error would be a guess.
    if errors:
        raise SceneError(path, errors)
    reading = Reading(named)
    values = table.read(with_empty_tables(data, known), "", reading)
    if reading.errors:
        raise SceneError(path, map(named.discreet, reading.errors))
    source = (text, tuple(named.texts.items()), known.named)
    file = Parsed(kind_of(data), values, reading.makers, known, source)
    requests, errors = _read_requests(file, reading, "accuracy" in data)
    if requests is None:
        raise SceneError(path, map(named.discreet, errors))
    return SceneFile(
        path=Path(path),
        text=text,
        parsed=file,
        inputs=requests.campaign.inputs,
        outputs=requests.campaign.outputs,
        sweep=requests.campaign.sweep,
        units=reading.units,
        task=requests.task,
        files=named,
        modules=user_modules,
    )


class _Requests(NamedTuple):
    """The requests of a file for its runs, as a `FileContent`."""

    campaign: Requested
    task: Task | None


def _read_requests(
    file: Parsed, reading: Reading, with_accuracy: bool
) -> tuple[_Requests | None, list[str]]:
    """The requests of a file, or `None` with its errors; `with_accuracy`: whether it gives the
    tolerance itself."""
    # One after the other, because each takes for granted that what it reads is right.
    errors = mission_errors(file) or accuracy_errors(file, with_accuracy)
    # Traces the vector field, which needs a state without faults.
    if file.kind == "system" and not errors:
        errors = system_errors(file)
    if errors:
        return None, errors
    found, errors = read_dispersion(file, reading)
    if errors or file.values["optimize"] is None:
        return None if errors else _Requests(found, None), errors
    task, errors = read_task(file, reading.units)
    if task is not None and not errors:
        errors = dispersed_and_free(task, found.inputs)
    return None if errors else _Requests(found, task), errors


def stored_scene(
    dispersion: Dispersion, modules: Iterable[str | os.PathLike[str]] = ()
) -> SceneFile:
    """The scene file whose text a dispersion carries in its record.

    **Arguments**

    - `dispersion`: that of a scene file, such as one from `open_store`.
    - `modules`: as in `load`; those with which it was computed.

    **Raises** `InputError` for a campaign defined in Python and for different modules, and
    `SceneError` for a text that this version can no longer read."""
    text = str(dispersion.attributes.get("description", ""))
    if "[dispersion" not in text:
        raise InputError("the record contains no scene file: the campaign was defined in Python.")
    user_modules = read_modules(modules)
    check_stored(dispersion.attributes, user_modules)
    path = str(dispersion.attributes.get("scene_file", "scene.toml"))
    # No file is read for it: a store has the texts of all that its scene names.
    files = dispersion.attributes.get("files", {})
    return load(path, modules=user_modules, text=text, files=files)
