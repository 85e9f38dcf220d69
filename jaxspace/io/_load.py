"""Loading of a scene file, from its path or from the record of a campaign: all checks that need no
integration."""

import errno
import os
import select
import stat
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from ..core import InputError
from ..statistics import Dispersion
from ._accuracy import tolerance_errors
from ._build import system_errors
from ._catalog import Catalog, catalog
from ._checks import check_parsed
from ._control import control_errors, scatter_errors
from ._errors import SceneError, unknown
from ._final_error import final_error_errors
from ._flight import flight_errors
from ._form import form, format_error, kind_of
from ._inputs import read_inputs
from ._kinds import Reading, Value, Values
from ._modules import check_stored, missing_module, read_modules
from ._named_files import NamedFiles
from ._optimize_table import dispersed_and_free, read_task
from ._output_entries import parts_of_state, read_outputs
from ._output_spec import OutputSpec
from ._parsed import Parsed
from ._scene_file import SceneFile
from .by_numpy import by_numpy

LONGEST = 4_000_000
"""How many characters a scene file may have: those of a hundred thousand lines."""
DEEPEST = 64
"""How deeply tables and lists of a file may be nested; no entry needs ten levels."""
PATIENCE = 10.0
"""Seconds in which the first of a text must come through a pipe."""
LONGEST_NUMBER = 1023
"""Bits of a whole number that any float can hold."""


# A number that a check computes with need not be finite, and is then refused.
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
    - `files`: texts of files that it names, which then are not read either.

    **Returns** the checked file, which builds its system on request.

    **Raises** `SceneError`, with one line for each error, before anything is compiled."""
    data, text = _parsed(path, text)
    # This error alone, because any other about a later format would be a guess.
    if format_error(data):
        raise SceneError(path, format_error(data))
    user_modules = read_modules(modules)
    if missing_module(data, user_modules):
        raise SceneError(path, missing_module(data, user_modules))
    named = NamedFiles(Path(path).parent, files)
    known = catalog(also, user_modules).numbered(_named_effects(data))
    table, errors = form(data, known)
    # If the form is unknown nothing can be read, and any further error would be a guess.
    if errors:
        raise SceneError(path, errors)
    reading = Reading(named)
    values = table.read(_with_empty_tables(data, known), "", reading)
    if reading.errors:
        raise SceneError(path, map(named.discreet, reading.errors))
    source = (text, tuple(named.texts.items()), known.named)
    file = Parsed(kind_of(data), values, reading.makers, known, source)
    errors = check_parsed(file) + control_errors(file)
    if file.kind == "flight" and not errors:
        errors = flight_errors(file)
    if not errors:
        errors = final_error_errors(file, parts_of_state(file), "accuracy" in data)
        errors += tolerance_errors(file)
    inputs = {}
    outputs = ()
    # Traces the vector field, which needs a state without faults.
    if file.kind == "system" and not errors:
        errors = system_errors(file)
    if not errors and values["dispersion"] is not None:
        outputs, errors = read_outputs(file, reading.units)
        inputs, more = read_inputs(file, named)
        more = more + _rule_errors(values["dispersion"]["until"], outputs, errors)
        # Both at once: outputs and inputs do not depend on each other.
        errors = errors + more + scatter_errors(file, inputs)
    task = None
    if not errors and values["optimize"] is not None:
        task, errors = read_task(file, reading.units)
        if task is not None and not errors:
            errors = dispersed_and_free(task, inputs)
    if errors:
        raise SceneError(path, map(named.discreet, errors))
    return SceneFile(
        Path(path), text, file, inputs, outputs, reading.units, task, named, user_modules
    )


def _rule_errors(until: Values | None, outputs: tuple[OutputSpec, ...], errors: list) -> list[str]:
    """Errors of the rule that ends a campaign; none if the outputs have errors."""
    names = [spec.name for spec in outputs]
    if until is None or errors or until["output"] in names:
        return []
    key = f'dispersion.until.output = "{until["output"]}"'
    return [unknown(key, until["output"], names, "output of this file")]


def _parsed(path: str | os.PathLike[str], text: str | None) -> tuple[Values, str]:
    try:
        # No more than needed to see that it is too long, because it may be endless.
        if text is None:
            text = _text_of(path)
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not text in UTF-8"
        raise SceneError(path, f"cannot be read: {reason}.") from error
    if len(text) > LONGEST:
        raise SceneError(
            path,
            f"is longer than {LONGEST:,} characters: a scene file must be shorter, and long tables "
            f"stand in files that it names.",
        )
    # The byte order mark that some editors write.
    text = text.removeprefix("\ufeff")
    try:
        data = tomllib.loads(text)
        _check_nested(data)
    except tomllib.TOMLDecodeError as error:
        # Sentences begin with the path of the file, and go on in small letters.
        raise SceneError(path, f"is not TOML: {str(error)[0].lower()}{str(error)[1:]}.") from error
    except RecursionError:
        raise SceneError(
            path, f"is nested too deeply: at most {DEEPEST} levels are read."
        ) from None
    # Python itself refuses to read longer ones.
    except ValueError:
        raise SceneError(
            path, "has a whole number of more than 307 digits: it must have fewer."
        ) from None
    return data, text


def _text_of(path: str | os.PathLike[str]) -> str:
    """The text of a file, up to what shows that it is too long. Raises `OSError` also for a pipe
    into which nobody writes, at which it would wait for ever."""
    # Windows has neither such pipes nor the flag.
    handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
    with open(handle, encoding="utf-8") as file:
        if stat.S_ISFIFO(os.fstat(handle).st_mode):
            if not select.select([handle], [], [], PATIENCE)[0]:
                raise OSError(errno.EPIPE, "it is a pipe into which nobody writes")
            os.set_blocking(handle, True)
        return file.read(LONGEST + 1)


def _check_nested(data: Values) -> None:
    """Raises `RecursionError` for tables and lists that are nested too deeply, and `ValueError` for
    a whole number beyond the range of a float."""
    level: list[Value] = [data]
    # Level by level, so that no depth can exceed that of Python's own calls.
    for _ in range(DEEPEST):
        if any(isinstance(x, int) and x.bit_length() > LONGEST_NUMBER for x in level):
            raise ValueError
        level = [
            x
            for inner in level
            if isinstance(inner, dict | list)
            for x in (inner.values() if isinstance(inner, dict) else inner)
        ]
    if level:
        raise RecursionError


def _with_empty_tables(data: Values, known: Catalog) -> Values:
    """The data in which an effect that a phase names has a table, if only an empty one."""
    effects = data.get("effects", {})
    # A wrong type is reported by reading it, with the path.
    if not isinstance(effects, Mapping):
        return data
    empty = {e: {} for e in _named_effects(data) if e in known.effects}
    return {**data, "effects": {**empty, **effects}} if empty else data


def _named_effects(data: Values) -> list[str]:
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


def stored_scene(
    dispersion: Dispersion, modules: Iterable[str | os.PathLike[str]] = ()
) -> SceneFile:
    """The scene file whose text a dispersion carries in its record.

    **Arguments**

    - `dispersion`: that of a scene file, such as one from `open_store`.
    - `modules`: as in `load`; those with which it was computed.

    **Raises** `InputError` for a campaign that was made in Python and for other modules, and
    `SceneError` for a text that this version no longer understands."""
    text = str(dispersion.attributes.get("description", ""))
    if "[dispersion" not in text:
        raise InputError("the record holds no scene file: the campaign was made in Python.")
    user_modules = read_modules(modules)
    check_stored(dispersion.attributes, user_modules)
    path = str(dispersion.attributes.get("scene_file", "scene.toml"))
    return load(path, modules=user_modules, text=text, files=dispersion.attributes.get("files"))
