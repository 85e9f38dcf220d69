"""Suggestions of the nearest name where an unknown one is used.

Only the path of the error computes them. Names that start with an underscore get none: libraries
ask for such names to learn what an object can do.
"""

import difflib
from collections.abc import Callable, Iterable, Mapping
from typing import TypeVar

Class = TypeVar("Class", bound=type)


def nearest(name: object, names: Iterable[str]) -> str:
    """A question for the nearest of the `names`, or an empty text where none is near; in place of
    a name the question has its entry where `names` is a mapping."""
    # Half of the letters in common: `sprung` suggests `spring`, and an unrelated word nothing.
    near = difflib.get_close_matches(str(name), list(names), n=1, cutoff=0.5)
    full = names if isinstance(names, Mapping) else {}
    return f" Did you mean {full.get(near[0]) or near[0]}?" if near else ""


class UnknownAttribute(AttributeError):
    """An unknown attribute, with a message that suggests the nearest name.

    The suggestion is computed when the message is read, because most of these errors are answers to
    libraries that ask whether an attribute exists."""

    full_names: Callable[[], Mapping[str, str]]

    def __str__(self) -> str:
        text = super().__str__()
        if self.name is None or self.name.startswith("_"):
            return text
        names = {one: full for one, full in self.full_names().items() if not one.startswith("_")}
        if self.name in names:
            return f"{text}: it is {names[self.name]}."
        hint = nearest(self.name, names)
        return f"{text}.{hint}" if hint else text

    def __reduce__(self) -> tuple[type[AttributeError], tuple[str]]:
        return AttributeError, (str(self),)


# The name that tracebacks show.
UnknownAttribute.__name__ = UnknownAttribute.__qualname__ = "AttributeError"
UnknownAttribute.__module__ = "builtins"


def unknown_attribute(
    owner: str, name: str, full_names: Callable[[], Mapping[str, str]]
) -> AttributeError:
    """The error of an unknown attribute.

    **Arguments**

    - `owner`: the object, in words.
    - `name`: of the attribute.
    - `full_names`: the names that exist, each with what to write for it."""
    # Without the object, for which Python would repeat the suggestion in the traceback.
    error = UnknownAttribute(f"{owner} has no attribute {name!r}", name=name)
    error.full_names = full_names
    return error


def suggests(cls: Class) -> Class:
    """Decorator: the instances of a class suggest the nearest attribute for an unknown one."""
    if not hasattr(cls, "__getattr__"):
        cls.__getattr__ = _missing  # type: ignore[attr-defined]
    return cls


def _missing(self: object, name: str) -> object:
    cls = type(self)
    if hasattr(cls, name) or name.startswith("_"):
        # A property whose own code raised an `AttributeError` raises it again.
        return object.__getattribute__(self, name)
    raise unknown_attribute(
        f"{cls.__name__!r} object", name, lambda: {each: each for each in dir(self)}
    )
