"""Modules of users' physics: Python files whose classes and declared functions scene files may
name.

A module is run only if a caller names it. The key `modules` of a scene file names those that it
needs, and a store those with which it was computed; neither runs one."""

import os
from collections.abc import Iterable, Mapping
from pathlib import Path

from ...core import InputError
from ...core.files import read_text
from ...core.record import Record
from ...core.user_code import run_module, text_hash
from .._kinds.named_files import NamedFile


def read_modules(paths: Iterable[str | os.PathLike[str]]) -> tuple[NamedFile, ...]:
    """The modules at these paths. Raises `InputError` for one that cannot be read."""
    result: dict[str, NamedFile] = {}
    for path in paths:
        try:
            module = NamedFile(Path(os.fspath(path)), read_text(path))
        except OSError as error:
            raise InputError(f"{path} cannot be read: {error.strerror}.") from None
        # A store has them by name, so that the names must differ.
        if result.setdefault(module.path.name, module) != module:
            raise InputError(f"{path} has the name of another module: rename it.")
    return tuple(result.values())


def defined_in(module: NamedFile) -> list[object]:
    """The classes and functions that a module defines, without those that it imports; runs it."""
    ran = run_module(module.path.name, module.text)
    return [
        thing
        for name, thing in vars(ran).items()
        # Imported objects belong to other modules: two modules that import the same class would
        # define it twice.
        if not name.startswith("_") and getattr(thing, "__module__", None) == ran.__name__
    ]


def missing_module(data: Mapping[str, object], given: Iterable[NamedFile]) -> str:
    """The message for the first module that a file requires and that was not given; empty if there
    is none.

    `given`: the modules that the caller allows to run."""
    names = [module.path.name for module in given]
    needed = data.get("modules")
    # A value other than a list of texts is reported when it is read.
    for k, name in enumerate(needed if isinstance(needed, list) else []):
        if isinstance(name, str) and Path(name).name not in names:
            return (
                f'modules.{k} is "{name}", which is code: it must be allowed explicitly by '
                f'--with {name} (in Python modules=["{name}"]), because a scene file alone never '
                "runs code."
            )
    return ""


def check_stored(record: Record, given: Iterable[NamedFile]) -> None:
    """Raise `InputError` unless the modules are those of the record of a store."""
    here = {module.path.name: text_hash(module.text) for module in given}
    there = {name: module["sha256"] for name, module in record.get("modules", {}).items()}
    for name in (*there, *here):
        if there.get(name) == here.get(name):
            continue
        was, now = (
            f"SHA-256 {hashes[name][:16]}..." if name in hashes else "not given"
            for hashes in (there, here)
        )
        raise InputError(
            f"The module {name} is {now}: it must be the one of the store, {was} (--with {name}; "
            f"the store has its text)."
            if name in there
            else f"The module {name} is not in the store: omit it."
        )
