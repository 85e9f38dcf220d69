"""Suggestions of the nearest name where an unknown one is used.

Only the path of the error computes them. Names that start with an underscore get none: libraries
ask for such names to learn what an object can do.
"""

import difflib
import functools
import inspect
from collections.abc import Callable, Iterable, Mapping
from typing import TypeVar

Class = TypeVar("Class", bound=type)


def nearest(name: object, names: Iterable[str], full: Mapping[str, str] | None = None) -> str:
    """A question for the nearest of the `names`, or an empty text where none is near; with its
    `full` name, if given."""
    # Half of the letters in common: `sprung` suggests `spring`, and an unrelated word nothing.
    near = difflib.get_close_matches(str(name), list(names), n=1, cutoff=0.5)
    return f" Did you mean {(full or {}).get(near[0]) or near[0]}?" if near else ""


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
        hint = nearest(self.name, names, names)
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
    """Decorator: the instances of a class suggest the nearest attribute for an unknown one, and the
    constructor of a dataclass the nearest argument."""
    if not hasattr(cls, "__getattr__"):
        cls.__getattr__ = _missing  # type: ignore[attr-defined]
    # By the creation of an object, because dataclasses replace the constructors of subclasses.
    if hasattr(cls, "__dataclass_fields__") and not hasattr(cls.__new__, _CHECKED):
        cls.__new__ = staticmethod(_checked(cls.__new__))  # type: ignore[assignment]
        # `help` would show the arguments of `__new__`, which accepts any. The classes of equinox
        # have a signature of their metaclass.
        if type(cls) is type:
            signature = inspect.signature(cls.__init__)
            rest = list(signature.parameters.values())[1:]
            cls.__signature__ = signature.replace(parameters=rest)  # type: ignore[attr-defined]
    return cls


# The attribute of a `__new__` that checks its arguments.
_CHECKED = "checks_names"


def _checked(make: Callable[..., object]) -> Callable[..., object]:
    def new(cls: type, *args: object, **named: object) -> object:
        del args
        if named:
            known = _arguments(cls)
            for name in named:
                if known and name not in known:
                    hint = nearest(name, known) or f" It has {', '.join(known)}."
                    raise TypeError(f"{cls.__name__} has no argument {name!r}.{hint}")
        return make(cls)

    setattr(new, _CHECKED, True)
    return new


# Cached for each class, because every construction asks for it.
@functools.cache
def _arguments(cls: type) -> Mapping[str, str]:
    """The names of the arguments of a constructor; none where it accepts any."""
    parameters = list(inspect.signature(cls.__init__).parameters.values())[1:]
    kinds = {parameter.kind for parameter in parameters}
    if inspect.Parameter.VAR_KEYWORD in kinds:
        return {}
    return {parameter.name: parameter.name for parameter in parameters}


def _missing(self: object, name: str) -> object:
    cls = type(self)
    if hasattr(cls, name) or name.startswith("_"):
        # A property whose own code raised an `AttributeError` raises it again.
        return object.__getattribute__(self, name)
    raise unknown_attribute(
        f"{cls.__name__!r} object", name, lambda: {each: each for each in dir(self)}
    )
