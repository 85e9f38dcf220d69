"""Declarations that go with a function: named constructors, outputs, events, initial states.

A decorator declares the arguments or the result once. Scene files, their schema, the command
line and the manual read it there, so that a new function needs no entry anywhere else.
"""

__all__ = ["EventCondition", "Initial", "Output", "references"]

import dataclasses
import functools
import inspect
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, TypeAlias, TypeVar, cast

import equinox as eqx
import jax

from .checks import InputError
from .field_types import is_number, kind_of, shown
from .quantities import REQUIRED, Quantity, check_shape

_REFERENCE = "reference"

# A decorator returns its argument type, so that type checkers preserve the signature.
Function = TypeVar("Function", bound=Callable[..., object])


class Choice(NamedTuple):
    """An argument that is one of several `names`."""

    names: tuple[str, ...]
    doc: str
    default: object = REQUIRED


class FileName(NamedTuple):
    """An argument that is the name of a file; in a scene file it is relative to that one.

    A scene file passes a path with a custom `read_text`, like that of `pathlib.Path`: the file may
    be gone, and its text in a store."""

    doc: str
    default: object = REQUIRED


# Allowed arguments of a declared function.
Argument: TypeAlias = Quantity | Choice | FileName


class Constructor(NamedTuple):
    """Declaration of a named constructor: its `arguments`, and the fields that it `sets` itself."""

    arguments: Mapping[str, Argument]
    sets: frozenset[str]


class Output(NamedTuple):
    """Declaration of an output: its `unit`, and the `shared` entries of a scene file by
    argument."""

    unit: str
    shared: Mapping[str, str]


class EventCondition(NamedTuple):
    """Declaration of an event: the `unit` and the `direction` of its condition, and the parts of
    the state that it `needs`."""

    unit: str
    direction: int
    needs: frozenset[str]


class Initial(NamedTuple):
    """Declaration of a maker of initial states: its `key` in a scene file, the parts of the state
    that it `gives`, and its `arguments`."""

    key: str
    gives: tuple[str, ...]
    arguments: Mapping[str, Argument]


def _checked(function: Function, arguments: Mapping[str, Argument]) -> Function:
    """The function, with the known values of its declared arguments checked at every call."""
    signature = inspect.signature(function)
    # Without the function around a class that is defined within one.
    owner = function.__qualname__.rpartition("<locals>.")[2].partition(".")[0]

    @functools.wraps(function)
    def checked(*given: object, **named: object) -> object:
        # Only values that the caller gives are checked: defaults are the author's.
        bound = signature.bind(*given, **named).arguments
        for name, value in bound.items():
            _check_kind(f"{owner}.{name}", value, signature.parameters[name], arguments.get(name))
        for name, declared in arguments.items():
            value = bound.get(name)
            # `None` means an absent optional argument.
            if isinstance(declared, Quantity) and value is not None:
                check_shape(f"{owner}.{name}", value, declared)
                declared.check(f"{owner}.{name}", value)
            if isinstance(declared, Choice) and name in bound and value not in declared.names:
                raise InputError(
                    f"{owner}.{name} is {value!r}: it must be one of {', '.join(declared.names)}."
                )
        return function(*given, **named)

    return cast(Function, checked)


def _check_kind(
    name: str, value: object, parameter: inspect.Parameter, declared: Argument | None
) -> None:
    """Raise `InputError` for a text in the place of numbers, and for an object of another class
    than that of a parameter without numbers."""
    if value is parameter.default or parameter.annotation is parameter.empty:
        return
    if isinstance(declared, Quantity):
        if any(isinstance(x, str) for x in jax.tree.leaves(value)):
            unit = f" in {declared.unit}" if declared.unit else ""
            kind = "an array of numbers" if declared.shape else "a number"
            raise InputError(f"{name} is {shown(value)}: it must be {kind}{unit}.")
    elif not isinstance(declared, Choice) and parameter.kind is not parameter.VAR_KEYWORD:
        kind = kind_of(parameter.annotation)
        # Numbers and lists are converted by the function.
        several = isinstance(value, list | tuple)
        numbers = kind is not None and "number" in kind.words and (several or is_number(value))
        listed = kind is not None and several and kind.accepts(())
        if kind is not None and not (kind.accepts(value) or numbers or listed):
            raise InputError(f"{name} is {shown(value)}: it must be {kind.words}.")


def constructor(
    *, sets: tuple[str, ...] = (), **arguments: Argument
) -> Callable[[Function], Function]:
    """Declare the arguments of a named constructor, or of a method `state` that makes a state.

    The decorator is placed below `classmethod` or `staticmethod`. At every call the known values
    are checked; scene files offer the constructor as one more way to give the class.

    **Arguments**

    - `sets`: the fields that the constructor computes; it accepts the others by name if it has
      `**fields`.
    - `arguments`: by name, each an `argument(...)`, a `Choice` or a `FileName`.

    **Raises** `InputError`, from the constructor, for a value out of its range."""

    def declare(function: Function) -> Function:
        checked = _checked(function, arguments)
        # On the function and not in a registry: whoever has the class has its declaration.
        checked.constructor = Constructor(arguments, frozenset(sets))  # type: ignore[attr-defined]
        return checked

    return declare


def initial(
    key: str, *, gives: tuple[str, ...], **arguments: Argument
) -> Callable[[Function], Function]:
    """Declare a function that creates parts of an initial state, for the table `[initial.key]`.

    **Arguments**

    - `key`: name of the table; functions with the same key are several ways to fill it.
    - `gives`: the parts of the state that the function returns, in order.
    - `arguments`: as in `constructor`. An argument that is not declared is a part of the state,
      created by another function.
    """

    def declare(function: Function) -> Function:
        checked = _checked(function, arguments)
        checked.initial = Initial(key, gives, arguments)  # type: ignore[attr-defined]
        return checked

    return declare


def output(unit: str, **shared: str) -> Callable[[Function], Function]:
    """Declare that a function of a state can be an output of a dispersion.

    Its arguments are taken by their names: the parts of a state (`position`, `omega`, ...), the
    whole state `y`, the time `t`, the `body`, the `initial` state that was intended, the state in
    which the phase `began`, the state `nominal` of the nominal run at the same place.

    **Arguments**

    - `unit`: that of the result, in SI.
    - `shared`: for other arguments the entry of a scene file: `mu="planet.mu"`.
    """

    def declare(function: Function) -> Function:
        function.output = Output(unit, shared)  # type: ignore[attr-defined]
        return function

    return declare


def event(unit: str, *, direction: int, needs: tuple[str, ...]) -> Callable[[Function], Function]:
    """Declare that a condition (t, y) can end a phase where it passes through zero.

    **Arguments**

    - `unit`: that of the condition, in SI.
    - `direction`: 1 for a rise, -1 for a fall, 0 for both.
    - `needs`: the parts of the state that it reads.
    """

    def declare(function: Function) -> Function:
        condition = EventCondition(unit, direction, frozenset(needs))
        function.event = condition  # type: ignore[attr-defined]
        return function

    return declare


def known_time(method: Function) -> Function:
    """Declare that a method of an effect returns a time, s, at which a phase can end.

    The time follows from the parameters only, so that no event search is required."""
    method.known_time = True  # type: ignore[attr-defined]
    return method


def reference(attribute: str, *, doc: str) -> Any:
    """A field that a scene file fills with an attribute of another effect, such as a mass rate.

    **Arguments**

    - `attribute`: name of the attribute.
    - `doc`: meaning, as a phrase that follows the name of the field."""
    return eqx.field(metadata={_REFERENCE: attribute, "doc": doc})


def references(cls: type) -> dict[str, str]:
    """The fields that are references, with the attribute that each of them needs."""
    fields = dataclasses.fields(cls) if dataclasses.is_dataclass(cls) else ()
    return {f.name: f.metadata[_REFERENCE] for f in fields if _REFERENCE in f.metadata}
