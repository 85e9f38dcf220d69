"""The names that a scene file may use: collected from the public names of the packages of physics.

Nothing is registered. A final class or a declared function is known to files as soon as the root of
its package or one of its public modules gives its name, or when it is given to `load` by `also`."""

import functools
import inspect
import os
import typing
from collections.abc import Iterable, Mapping
from typing import NamedTuple, Protocol, TypeAlias, runtime_checkable

import diffrax
from jaxtyping import Array

from ... import (
    attitude,
    bodies,
    control,
    dispersion,
    gyros,
    mechanics,
    orbits,
    rockets,
    rotations,
    scene,
    solvers,
    vehicles,
)
from ...bodies import AbstractBody, AbstractCondition, AbstractEffect, AbstractJump, BodyState
from ...control import AbstractController
from ...core import AbstractParameters, AbstractSystem, InputError, Scalar, State
from ...core.declarations import EventCondition, Initial, Output
from ...core.modules import public_names
from ...core.quantities import quantities
from ...sampling import AbstractDistribution
from .._kinds.kind import Entry, Maker
from .._kinds.tables import Object
from .declared import entry_of, foreign_fields, function_way, members, object_kind, snake_case
from .modules import defined_in, read_modules

PACKAGES = (
    *(rotations, bodies, orbits, attitude, gyros, rockets, vehicles),
    *(mechanics, scene, control, dispersion),
)


Group: TypeAlias = dict[str, object]


@runtime_checkable
class EventFunction(Protocol):
    """A function that `event` has declared."""

    event: EventCondition
    __name__: str

    def __call__(self, t: Scalar, y: State) -> Scalar: ...


@runtime_checkable
class OutputFunction(Protocol):
    """A function declared with `output`; its arguments name the quantities that it receives."""

    output: Output
    __name__: str

    def __call__(self, **arguments: object) -> Array: ...


@runtime_checkable
class InitialFunction(Protocol):
    """A function declared with `initial`; it receives its declared arguments, and parts."""

    initial: Initial
    __name__: str

    def __call__(self, **arguments: object) -> State | tuple[State, ...]: ...


class Catalog(NamedTuple):
    """Everything that a scene file may name: classes and functions by their key, and how a file
    gives them (`kinds`, by class); and why it may not name the others (`refused`, by key)."""

    systems: Mapping[str, type[AbstractSystem]]
    effects: Mapping[str, type[AbstractEffect]]
    bodies: Mapping[str, type[AbstractBody]]
    jumps: Mapping[str, type[AbstractJump]]
    conditions: Mapping[str, type[AbstractCondition]]
    distributions: Mapping[str, type[AbstractDistribution]]
    controllers: Mapping[str, type[AbstractController]]
    events: Mapping[str, EventFunction]
    outputs: Mapping[str, OutputFunction]
    initials: Mapping[str, InitialFunction]
    methods: Mapping[str, type[diffrax.AbstractSolver]]
    kinds: Mapping[type, Object]
    refused: Mapping[str, str]

    @property
    def named(self) -> tuple[object, ...]:
        """Everything that a file may name, for comparison with another catalog."""
        things = self._replace(kinds={}, refused={})
        return tuple(item for table in things for item in table.items())

    def known_times(self, effect: str) -> list[str]:
        """The names of the times at which a phase with this effect can end."""
        cls = self.effects[effect]
        return [n for n in dir(cls) if getattr(getattr(cls, n), "known_time", False)]

    def effect_outputs(self, effect: str) -> dict[str, OutputFunction]:
        """The methods of an effect that are declared as outputs, by name."""
        return output_methods(self.effects[effect])

    @property
    def all_known_times(self) -> list[str]:
        """The names of all such times."""
        return list(dict.fromkeys(n for effect in self.effects for n in self.known_times(effect)))

    def numbered(self, names: Iterable[str]) -> "Catalog":
        """The catalog with those of these `names` that are an effect with a number, such as
        `steered_thrust_2`: two effects of one class in one file."""
        more = {}
        for name in names:
            base, _, number = name.rpartition("_")
            if number.isdigit() and base in self.effects and name not in self.effects:
                more[name] = self.effects[base]
        return self._replace(effects={**self.effects, **more}) if more else self

    def shared(self, table: str) -> dict[str, Entry]:
        """The entries of a table such as "planet" from which declarations obtain values."""
        result: dict[str, Entry] = {}
        declared = [
            (entry.shared, entry)
            for kind in self.kinds.values()
            for way in kind.ways
            for entry in way.entries.values()
            if entry.shared
        ]
        declared += [
            (entry.shared, entry)
            for function in self.initials.values()
            for entry in function_way(function, function.initial.arguments).entries.values()
            if entry.shared
        ]
        for path, entry in declared:
            package, _, key = path.partition(".")
            if package == table and "." not in key:
                # Optional in the shared table: whether it is needed depends on the effects that
                # are there.
                result.setdefault(key, entry._replace(default=None, shared=""))
        return result


def output_methods(cls: type) -> dict[str, OutputFunction]:
    """The methods of a class that are declared as outputs, by name."""
    every = members(cls).items()
    return {name: m for name, m in every if isinstance(m, OutputFunction)}


def catalog(also: Iterable[object] = (), modules: Iterable[str | os.PathLike[str]] = ()) -> Catalog:
    """The names that a scene file may use: those of the packages of the library, and those that
    `also` and the `modules` give.

    **Arguments**

    - `also`: further final classes (systems, effects, jumps, conditions, distributions, and parts
      of them such as steering laws) and declared functions (outputs, events, makers of initial
      states).
    - `modules`: paths of Python files, which are run; all that they define may be named, as if
      `also` held it.

    **Raises** `InputError` for something in `also` that no file can name, a name that is already
    there, and a module that does not run or defines nothing to name."""
    ran = tuple((m.path.name, tuple(defined_in(m))) for m in read_modules(modules))
    return _catalog(tuple(also), ran)


# Kept from call to call, because every file that is loaded asks for it.
@functools.lru_cache(maxsize=32)
def _catalog(
    also: tuple[object, ...], modules: tuple[tuple[str, tuple[object, ...]], ...]
) -> Catalog:
    named: dict[str, Group] = {name: {} for name in (*BASES, *FUNCTIONS, "methods")}
    refused: dict[str, str] = {}
    kinds: dict[type, Object] = {}
    # Public names alone, because private ones may change. All packages first, because a kind finds
    # its classes among those that are imported.
    for thing in [thing for package in PACKAGES for thing in public_names(package).values()]:
        _add(named, kinds, refused, thing)
    for name, thing in vars(solvers).items():
        if (
            # By its methods: helpers and abstract classes of the package have no step and order.
            getattr(thing, "__final__", False)
            and hasattr(thing, "step")
            and hasattr(thing, "order")
        ):
            named["methods"][name] = thing
    for thing in also:
        # Rejected, because an ignored object would later be an unknown name in a file.
        before = sum(map(len, named.values()))
        _add(named, kinds, refused, thing, new="also")
        if sum(map(len, named.values())) == before and not _is_part(thing):
            raise InputError(
                f"also contains {thing!r}: it must contain declared functions, or final classes of "
                "systems, effects, jumps, conditions, distributions or parts such as steering "
                "laws, whose fields are quantities."
            )
    for module, things in modules:
        before = sum(map(len, (*named.values(), refused)))
        for thing in things:
            _add(named, kinds, refused, thing, new=module)
        if sum(map(len, (*named.values(), refused))) == before and not any(map(_is_part, things)):
            raise InputError(
                f"{module} defines nothing that a scene file can use: it must contain declared "
                "functions, or final classes, such as effects, whose fields are quantities."
            )
    return Catalog(**named, kinds=kinds, refused=refused)  # pyright: ignore[reportArgumentType]


BASES = {
    "systems": AbstractSystem,
    "effects": AbstractEffect,
    "bodies": AbstractBody,
    "jumps": AbstractJump,
    "conditions": AbstractCondition,
    "distributions": AbstractDistribution,
    "controllers": AbstractController,
}
FUNCTIONS = {"events": "event", "outputs": "output", "initials": "initial"}


def _add(
    named: dict[str, Group],
    kinds: dict[type, Object],
    refused: dict[str, str],
    thing: object,
    new: str = "",
) -> None:
    """Add a class or a function to its group, if it has one.

    `new`: its source, if it is not of the library."""
    for group, base in BASES.items():
        # `issubclass` of an abstract class asks all of its subclasses.
        if not (isinstance(thing, type) and base in thing.__mro__):
            continue
        if getattr(thing, "__final__", False):
            kind = object_kind(thing)
            key = snake_case(thing.__name__)
            if kind is not None:
                _name(named[group], key, thing, new)
                kinds[thing] = kind
            else:
                refused[key] = _refusal(thing)
    for group, mark in FUNCTIONS.items():
        if inspect.isfunction(thing) and hasattr(thing, mark):
            _name(named[group], thing.__name__, thing, new)


def _refusal(cls: type) -> str:
    """Why no file can give an object of a class, after its key."""
    fields = [f"{cls.__name__}.{name}" for name in foreign_fields(cls)]
    one = len(fields) == 1
    return (
        f"cannot be used in a scene file: {' and '.join(fields)} {'is' if one else 'are'} "
        f"available in Python only, {'a function or an object' if one else 'functions or objects'} "
        "without declared numbers."
    )


def _is_part(thing: object) -> bool:
    """Whether it is a final class that is accepted by fields of other objects, such as a steering
    law: the kinds of these fields find it among their subclasses."""
    if not isinstance(thing, type) or not issubclass(thing, AbstractParameters):
        return False
    # It needs a further abstract class, because no field takes parameters in general.
    special = AbstractParameters not in thing.__bases__
    return special and getattr(thing, "__final__", False) and object_kind(thing) is not None


def _name(group: Group, name: str, thing: object, new: str) -> None:
    # The same thing twice is harmless, because packages give on names of one another.
    if new and group.get(name, thing) is not thing:
        raise InputError(f"{new} defines {name}: this name is already in use, choose another one.")
    group[name] = thing


def state_class(system: type[AbstractSystem]) -> type:
    """The class of the states of a system, from the annotation of its vector field.

    `BodyState` where the annotation names no class with quantities."""
    # The annotations are those of the decorated function.
    function = inspect.unwrap(system.vector_field)
    annotated = typing.get_type_hints(function).get("y")
    return annotated if isinstance(annotated, type) and quantities(annotated) else BodyState


def state_way(system: type[AbstractSystem]) -> Maker | None:
    """The entries of a state that is created with the system's method `state`, if it is
    declared."""
    method = getattr(system, "state", None)
    declared = getattr(method, "constructor", None)
    if method is None or declared is None:
        return None
    return function_way(method, declared.arguments)


def part_entries(cls: type) -> dict[str, Entry]:
    """The entries for the parts of a state that are numbers, all optional."""
    return {
        name: entry_of(declared._replace(default=None, optional=True))
        for name, declared in quantities(cls).items()
        if not _is_object(cls, name)
    }


def _is_object(cls: type, name: str) -> bool:
    """Whether a part of a state is an object such as a quaternion, and no array."""
    annotation = cls.__dataclass_fields__[name].type  # type: ignore[attr-defined]
    return not any(hasattr(one, "dim_str") for one in (annotation, *typing.get_args(annotation)))
