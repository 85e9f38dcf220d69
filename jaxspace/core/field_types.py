"""The kinds of values accepted by the fields of a module, according to their annotations.

Without a check a text in the place of a number, or a number in the place of an atmosphere, is found
where it is first computed with, by an error of JAX that names no field. Shapes and ranges are
checked elsewhere, and anything not specified by an annotation passes.
"""

import dataclasses
import functools
import inspect
import numbers
import types
import typing
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from .checks import InputError

# The entry of a field's metadata with its declaration as a quantity.
QUANTITY = "quantity"
# Longest text of a wrong value in a message.
SHOWN = 60
# Classes that a sentence lists for an abstract one.
LISTED = 6


class Kind(NamedTuple):
    """The values accepted by a field: `accepts` returns whether it accepts a value; `words`
    complete the message "it must be ..."."""

    accepts: Callable[[object], bool]
    words: str


def is_number(x: object) -> bool:
    """Whether `x` is a number or an array of numbers, known or traced, or the shape of one."""
    if isinstance(x, jax.Array | np.ndarray | np.generic | jax.ShapeDtypeStruct):
        return jnp.issubdtype(x.dtype, np.number) or x.dtype == bool
    return isinstance(x, numbers.Number)


def is_real(x: object) -> bool:
    """Whether `x` is a number or an array of numbers that are not complex."""
    if not is_number(x):
        return False
    dtype = getattr(x, "dtype", None)
    if dtype is None:
        return isinstance(x, numbers.Real)
    return not jnp.issubdtype(dtype, np.complexfloating)


def is_whole(x: object) -> bool:
    """Whether `x` is a whole number, or an array of whole numbers."""
    dtype = getattr(x, "dtype", None)
    if dtype is None:
        return isinstance(x, numbers.Integral) and not isinstance(x, bool)
    return jnp.issubdtype(dtype, np.integer)


def check_types(module: object, *names: str) -> None:
    """Raise `InputError` for a field of a module with a value of another kind than it declares.

    **Arguments**

    - `module`: an instance of a dataclass.
    - `names`: the fields to check, where a constructor computes the others from them; all without
      a name."""
    cls = type(module)
    for name, default, kind in _kinds(cls):
        if names and name not in names:
            continue
        value = getattr(module, name)
        # A default is the author's.
        if value is not default and not kind.accepts(value):
            raise InputError(f"{cls.__name__}.{name} is {shown(value)}: it must be {kind.words}.")


# Cached for each class, because every construction asks for it.
@functools.cache
def _kinds(cls: type) -> Sequence[tuple[str, object, Kind]]:
    """For each field with a checked annotation: its name, its default and its kind."""
    result = []
    for field in dataclasses.fields(cls):
        kind = kind_of(field.type, getattr(field.metadata.get(QUANTITY), "unit", ""))
        if kind is not None:
            result.append((field.name, field.default, kind))
    return tuple(result)


def kind_of(annotation: object, unit: str = "") -> Kind | None:
    """The kind that an annotation declares; `None` for an annotation that is not checked."""
    parts = typing.get_args(annotation)
    if isinstance(annotation, types.UnionType) or typing.get_origin(annotation) is typing.Union:
        return _union([kind_of(part, unit) for part in parts])
    if annotation is None or annotation is types.NoneType:
        return Kind(lambda x: x is None, "None")
    if hasattr(annotation, "dim_str") or annotation in (jax.Array, np.ndarray, float):
        return _number(annotation, unit)
    origin = typing.get_origin(annotation)
    if origin is tuple and parts[1:] == (Ellipsis,):
        return _tuple(kind_of(parts[0], unit))
    if origin is not None and isinstance(origin, type) and callable in (origin, annotation):
        return None
    return _class(annotation if origin is None else origin)


def _number(annotation: object, unit: str) -> Kind | None:
    """The kind of an annotation of numbers; keys of random numbers are not checked."""
    dtypes = " ".join(getattr(annotation, "dtypes", None) or ("float",))
    if "complex" in dtypes:
        return Kind(is_number, "a number")
    if not any(word in dtypes for word in ("float", "int", "bool")):
        return None
    # In user-defined classes, `float` often means an array of floats.
    alone = not getattr(annotation, "dim_str", "").replace("*#runs", "").strip()
    words = "a number" if alone else "an array of numbers"
    return Kind(is_real, f"{words} in {unit}" if unit else words)


def _class(cls: object) -> Kind | None:
    """The kind of the instances of a class; `None` for anything but such a class."""
    if cls is bool:
        return Kind(lambda x: isinstance(x, bool | np.bool_ | jax.Array), "True or False")
    if cls is int:
        return Kind(is_whole, "a whole number")
    if cls is str:
        return Kind(lambda x: isinstance(x, str), "a text")
    if getattr(cls, "__name__", "") == "Callable":
        return Kind(callable, "a function")
    if not isinstance(cls, type) or cls in (object, Any) or isinstance(cls, type(PyTree)):
        return None
    return Kind(lambda x: isinstance(x, cls), _article(cls))


def _tuple(kind: Kind | None) -> Kind | None:
    """The kind of a tuple of any length."""
    if kind is None:
        return Kind(lambda x: isinstance(x, tuple), "a tuple")
    return Kind(
        lambda x: isinstance(x, tuple) and all(kind.accepts(one) for one in x),
        f"a tuple, each of them {kind.words}",
    )


def _article(cls: type) -> str:
    """The instances of a class in words, of an abstract one with the classes that it has."""
    name = cls.__name__
    if not inspect.isabstract(cls):
        return f"{'an' if name[0] in 'AEIOUaeiou' else 'a'} {name}"
    names = [c.__name__ for c in _below(cls) if not c.__name__.startswith(("_", "Abstract"))]
    listed = f" ({', '.join(names[:LISTED])}{', ...' if len(names) > LISTED else ''})"
    return f"an {name}{listed if names else ''}"


def _below(cls: type) -> list[type]:
    """The classes that derive from a class, each once."""
    found = [cls, *(c for sub in cls.__subclasses__() for c in _below(sub))]
    return list(dict.fromkeys(found))


def _union(kinds: Sequence[Kind | None]) -> Kind | None:
    """The values accepted by one of several kinds; `None` where one of them is not checked."""
    known = [kind for kind in kinds if kind is not None]
    if len(known) < len(kinds):
        return None
    words = " or ".join(dict.fromkeys(kind.words for kind in known))
    return Kind(lambda x: any(kind.accepts(x) for kind in known), words)


def check_kind(name: str, value: object, annotation: object) -> None:
    """Raise `InputError` for a value of another kind than an annotation declares.

    - `name`: of the argument."""
    kind = kind_of(annotation)
    if kind is not None and not kind.accepts(value):
        raise InputError(f"{name} is {shown(value)}: it must be {kind.words}.")


def shown(value: object) -> str:
    """A wrong value in the form of messages: the value if it is short, or its type."""
    if isinstance(value, jax.Array | np.ndarray):
        return f"an array of the shape {value.shape} and the type {value.dtype}"
    plain = isinstance(value, str | bytes | numbers.Number | list | tuple | types.NoneType)
    text = " ".join(repr(value).split()) if plain else ""
    return text if plain and len(text) <= SHOWN else f"of type {type(value).__name__}"
