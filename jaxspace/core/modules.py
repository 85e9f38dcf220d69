"""The public modules of a package: how its root imports them, and their content.

The root of a package contains the most commonly used names. The rest is in modules named by their
subject, each with its names in `__all__`; a module is imported when it is first used."""

import difflib
import inspect
import pkgutil
import sys
import types
from collections.abc import Callable
from importlib import import_module


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


class _Root(_Subject):
    """The root of a package, whose modules are such ones as soon as they are imported."""

    def __setattr__(self, name: str, value: object) -> None:
        if type(value) is types.ModuleType and value.__name__ == f"{self.__name__}.{name}":
            value.__class__ = _Subject
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
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    def names() -> list[str]:
        given = {*vars(sys.modules[package]), *_files(package)}
        return sorted(given - {"TYPE_CHECKING"})

    return module, names


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
