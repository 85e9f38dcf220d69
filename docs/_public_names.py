"""What a reference page shows of a package: every name that its `__init__` re-exports as `X as X`,
and those of its public modules, below the words of the page itself; and below each of them the
examples that use it."""

import functools
import sys
from pathlib import Path

import griffe

sys.path.insert(0, str(Path(__file__).resolve().parent))

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
        for path, examples in _uses.examples().items():
            _name_examples(pkg, path, examples)


def _name_examples(
    pkg: griffe.Module, path: str, examples: list[_uses.Example]
) -> None:
    """Write the examples behind the docstring of an object."""
    thing = functools.reduce(getattr, path.split("."), jaxspace)
    # Where it is defined: an alias is not resolved yet.
    place = f"{thing.__module__}.{getattr(thing, '__qualname__', path.split('.')[-1])}"
    try:
        described = pkg[place.split(".", 1)[1]]
    except KeyError:
        return
    if described.docstring:
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
