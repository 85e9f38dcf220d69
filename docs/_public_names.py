"""What a reference page shows of a package: every name that its `__init__` re-exports as `X as X`,
and those of its public modules, below the words of the page itself; of each class how it is
constructed; and below each name the examples that use it."""

import functools
import sys
from pathlib import Path

import griffe

sys.path.insert(0, str(Path(__file__).resolve().parent))

import _constructions  # noqa: E402
import _uses  # noqa: E402

import jaxspace  # noqa: E402

MOST = 8
"""Examples that are named below an object."""


class PublicNames(griffe.Extension):
    """Reads the re-exports of each package, so that no list of names has to be kept beside them."""

    def on_package(self, *, pkg: griffe.Module, **kwargs) -> None:
        del kwargs
        for package in pkg.modules.values():
            # The docstring of a package is for those who change it; that of a module is on the
            # pages of the physics.
            package.docstring = None
            for module in package.modules.values():
                if module.exports is not None:
                    module.docstring = None
            if package.is_init_module and package.exports is None:
                package.exports = [
                    name
                    for name, origin in package.imports.items()
                    if origin.rsplit(".", 1)[-1] == name
                    and origin.startswith(pkg.name)
                    and name not in package.modules
                ]
        for cls in _constructions.classes():
            if cls not in _constructions.results():
                _show_construction(pkg, cls)
        for path, examples in _uses.examples().items():
            _name_examples(pkg, path, examples)


def _described(
    pkg: griffe.Module, thing: object, name: str
) -> griffe.Object | None:
    """The entry of an object where it is defined: an alias is not resolved yet."""
    place = f"{thing.__module__}.{getattr(thing, '__qualname__', name)}"
    try:
        return pkg[place.split(".", 1)[1]]
    except KeyError:
        return None


def _show_construction(pkg: griffe.Module, cls: type) -> None:
    """Give a class the signature of its constructor, the table of its arguments and its example."""
    entry = _described(pkg, cls, cls.__name__)
    if entry is None or not entry.docstring:
        return
    entry.docstring.value = _constructions.describe(
        cls, entry.docstring.value
    )
    if "__init__" not in entry.members:
        # The one that a dataclass or a module of equinox writes when it is imported.
        entry.set_member("__init__", _constructor(entry, cls))


def _constructor(entry: griffe.Class, cls: type) -> griffe.Function:
    made = [
        griffe.Parameter("self", kind=griffe.ParameterKind.positional_only)
    ]
    for parameter in _constructions.parameters(cls):
        member = entry.members.get(parameter.name)
        made.append(
            griffe.Parameter(
                parameter.name,
                annotation=getattr(member, "annotation", None),
                kind=griffe.ParameterKind[parameter.kind.name.lower()],
                default=_constructions.default(cls, parameter) or None,
            )
        )
    return griffe.Function("__init__", parameters=griffe.Parameters(*made))


def _name_examples(
    pkg: griffe.Module, path: str, examples: list[_uses.Example]
) -> None:
    """Write the examples behind the docstring of an object."""
    thing = functools.reduce(getattr, path.split("."), jaxspace)
    described = _described(pkg, thing, path.split(".")[-1])
    if described is not None and described.docstring:
        # Each page of the reference stands two folders below the root.
        links = [
            f"[{title}]({_up(address)})" for title, address in examples[:MOST]
        ]
        more = len(examples) - len(links)
        rest = f", and {more} more" if more else ""
        described.docstring.value += (
            f"\n\n*Examples:* {', '.join(links)}{rest}"
        )


def _up(address: str) -> str:
    return address if address.startswith("https:") else f"../../{address}"
