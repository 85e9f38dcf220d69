"""The public modules of a package: how its root imports them, and their content.

The root of a package contains the most commonly used names. The rest is in modules named by their
subject, each with its names in `__all__`; a module is imported when it is first used. The error of
an unknown name suggests the nearest one, or names the module that contains it."""

import difflib
import inspect
import pkgutil
import re
import sys
import types
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from .suggestions import unknown_attribute


class _Subject(types.ModuleType):
    """A module that raises a helpful error if it is called like a function."""

    def __call__(self, *args: object, **kwargs: object) -> None:
        del args, kwargs
        names = sorted(getattr(self, "__all__", ()))
        functions = [name for name in names if inspect.isfunction(getattr(self, name))]
        last = self.__name__.rpartition(".")[2]
        near = difflib.get_close_matches(last, functions, n=1, cutoff=0.0)
        such = f", such as {self.__name__}.{near[0]}(...)" if near else ""
        raise TypeError(f"{self.__name__} is a module: call one of its functions{such}.")

    def __reduce__(self) -> tuple[object, ...]:
        # By its name, as libraries that send functions to other processes do with plain modules.
        return import_module, (self.__name__,)


class _File(_Subject):
    """A module whose error of an unknown name suggests the nearest one."""

    def __getattr__(self, name: str) -> object:
        names = vars(self).get("__all__", ())
        raise unknown_attribute(f"module {self.__name__!r}", name, lambda: dict.fromkeys(names, ""))


class _Root(_Subject):
    """The root of a package, whose modules are such ones as soon as they are imported."""

    def __setattr__(self, name: str, value: object) -> None:
        if type(value) is types.ModuleType and value.__name__ == f"{self.__name__}.{name}":
            value.__class__ = _File
        super().__setattr__(name, value)


def modules_of(package: str) -> tuple[Callable[[str], types.ModuleType], Callable[[], list[str]]]:
    """`__getattr__` and `__dir__` for the root of a package, which import its public modules when
    they are first used.

    **Arguments**

    - `package`: the `__name__` of the root.

    **Returns** the two functions."""
    root = sys.modules[package]
    root.__class__ = _Root
    # Packages that the root has imported above.
    for name, thing in list(vars(root).items()):
        setattr(root, name, thing)

    def module(name: str) -> types.ModuleType:
        if name in _files(package):
            # The import sets the attribute too: the next use does not come here.
            return import_module(f"{package}.{name}")
        raise unknown_name(package, name)

    def names() -> list[str]:
        given = {*vars(sys.modules[package]), *_files(package)}
        return sorted(given - {"TYPE_CHECKING"})

    return module, names


def unknown_name(package: str, name: str) -> AttributeError:
    """The error of an unknown name of the root of a package: with the module that contains it, or
    the nearest name of the package and its modules."""

    def full_names() -> dict[str, str]:
        root = dir(sys.modules[package])
        return {**_full_names(package), **{each: each for each in root}}

    return unknown_attribute(f"module {package!r}", name, full_names)


# The names of a module, and those that the root of a package imports from its modules.
_ALL = re.compile(r"^__all__ = \[(.*?)\]", re.DOTALL | re.MULTILINE)
_NAME = re.compile(r"\"(\w+)\"")
_IMPORTED = re.compile(r"^from \.\w+ import \w+ as (\w+)$", re.MULTILINE)


def _full_names(package: str) -> dict[str, str]:
    """The public names of the modules within a package, with their full names, by the text of the
    modules: nothing is imported, because a library may only ask whether a name exists."""
    result = {}
    top = Path(sys.modules[package].__path__[0])
    # The roots of packages last, because users import from there.
    for file in sorted(top.rglob("*.py"), key=lambda file: file.name == "__init__.py"):
        parts = file.relative_to(top).with_suffix("").parts
        root = parts[-1] == "__init__"
        parts = parts[:-1] if root else parts
        if not parts or any(part.startswith("_") for part in parts):
            continue
        text = file.read_text(encoding="utf-8")
        listed = _ALL.search(text)
        names = _IMPORTED.findall(text) if root else _NAME.findall(listed[1] if listed else "")
        result |= {name: ".".join((package, *parts, name)) for name in names}
    return result


def public_names(package: types.ModuleType) -> dict[str, object]:
    """The public names of a package, with their objects: the names of its root, then those of its
    modules.

    Names that the root of one package gives on from another are among them.

    **Arguments**

    - `package`: such as `jaxspace.orbits`."""
    result = {name: thing for name, thing in vars(package).items() if _counts(name, thing)}
    for file in _files(package.__name__):
        module = import_module(f"{package.__name__}.{file}")
        # A module without `__all__` is used by other packages of the library, and is not public.
        result |= {name: getattr(module, name) for name in getattr(module, "__all__", ())}
    return result


def _counts(name: str, thing: object) -> bool:
    private = name.startswith("_") or name == "TYPE_CHECKING"
    return not private and not isinstance(thing, types.ModuleType)


def _files(package: str) -> list[str]:
    """The files of a package whose names are public."""
    result = pkgutil.iter_modules(sys.modules[package].__path__)
    return [file.name for file in result if not file.name.startswith("_")]
