"""Objects from the values of a file, by the makers that reading has chosen: for one run, or for
many at once."""

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from ...bodies import AbstractEffect
from ...core import Scalar
from .._kinds.kind import Kind, Maker, Value, Values
from .._kinds.tables import Object, OneOrMore
from .._kinds.values import Known, ListOf, Measure, Number

# The types of numbers that are arguments of programs.
NUMBERS = (Measure, Known)


class Runs(NamedTuple):
    """Number of runs that are built at once: `count`, or `None` for one without an axis of runs.

    A number of the file is a scalar, or (runs,) where it is dispersed. Parameters that all runs
    share stay scalars; a state has every run."""

    count: int | None = None

    def vector(self, components: Iterable[ArrayLike]) -> Float[Array, "components *#runs"]:
        """A parameter of several components: (3,), or for runs (3, 1) or (3, runs)."""
        parts = [jnp.asarray(c) for c in components]
        # (3, 1) for shared vectors, which are not copied for every run.
        shape = jnp.broadcast_shapes(() if self.count is None else (1,), *(p.shape for p in parts))
        return jnp.stack([jnp.broadcast_to(p, shape) for p in parts])

    def scalar(self, number: ArrayLike) -> Scalar:
        """A number of the state: () or (runs,)."""
        return jnp.broadcast_to(jnp.asarray(number), () if self.count is None else (self.count,))

    def full(self, components: Iterable[ArrayLike]) -> Float[Array, "components *#runs"]:
        """A vector of the state: (3,) or (3, runs)."""
        return jnp.stack([self.scalar(c) for c in components])


class Building(NamedTuple):
    """Construction of objects from the values of a file.

    - `values`: of the whole file, with arrays in place of numbers.
    - `makers`: by path, the maker of an object.
    - `runs`: the number of runs that are built at once.
    - `full`: whether a state is built, of every run."""

    values: Values
    makers: Mapping[str, Maker]
    runs: Runs
    full: bool = False

    def make(self, path: str, **more: object) -> Any:
        """The object at the path; `more` are arguments that are not in the file."""
        maker = self.makers[path]
        values = at(self.values, path)
        if maker.bare:
            values = {next(iter(maker.entries)): values}
        arguments = dict(more)
        for key, entry in maker.entries.items():
            value = values.get(key)
            source = path if maker.bare else f"{path}.{key}"
            # The table of the object comes first, so that one effect may differ from the planet.
            if value is None and entry.shared:
                value = at(self.values, entry.shared)
                source = entry.shared
            # Omitted, and not passed as `None`, so that the default of the class applies.
            if value is not None and key in maker.arguments:
                arguments[maker.arguments[key]] = self._value(entry.kind, value, source)
        return maker.make(**arguments)

    def effects(self, names: Iterable[str]) -> dict[str, AbstractEffect]:
        """The effects of these names. Effects that refer to another one are created last."""
        made: dict[str, AbstractEffect] = {}
        makers = {name: self.makers[f"effects.{name}"] for name in names}
        # Those without references first; one level is enough, because no reference has references.
        for name in sorted(makers, key=lambda name: bool(makers[name].references)):
            made[name] = self.make(f"effects.{name}", **referred(makers[name], made))
        # In the order of the file, which is that of the sums and of `explain`.
        return {name: made[name] for name in makers}

    def _value(self, kind: Kind, value: Value, path: str) -> Value:
        if isinstance(kind, OneOrMore) and isinstance(value, list):
            return tuple(self.make(f"{path}.{k}") for k in range(len(value)))
        if isinstance(kind, Object | OneOrMore):
            return self.make(path)
        if isinstance(kind, ListOf):
            return self._array(kind, value)
        if isinstance(kind, Number) and not kind.quantity.fixed:
            return self.runs.scalar(value) if self.full else value
        return value

    def _array(self, kind: ListOf, value: list[Value]) -> Value:
        inner = kind.kind
        if isinstance(inner, ListOf):
            return jnp.stack([self._array(inner, row) for row in value])
        if isinstance(inner, Number) and inner.quantity.fixed:
            return value
        return self.runs.full(value) if self.full else self.runs.vector(value)


def referred(maker: Maker, effects: Mapping[str, AbstractEffect]) -> dict[str, object]:
    """The attributes of these effects that an object refers to, by its field."""
    return {
        field: next(getattr(e, attribute) for e in effects.values() if hasattr(e, attribute))
        for field, attribute in maker.references.items()
    }


def at(values: Value, path: str) -> Value:
    """The value at the path of a tree of dicts and lists; `None` without one."""
    for step in path.split("."):
        if isinstance(values, Mapping):
            values = values.get(step)
        elif isinstance(values, list) and step.isdigit() and int(step) < len(values):
            values = values[int(step)]
        else:
            return None
    return values


def replaced(values: Value, samples: Mapping[str, ArrayLike], path: str = "") -> Value:
    """The tree with arrays as numbers: those of `samples` at their paths, and the file's values
    elsewhere."""
    if path in samples:
        return samples[path]
    if isinstance(values, NUMBERS):
        return jnp.asarray(float(values))
    if isinstance(values, Mapping):
        return {k: replaced(v, samples, f"{path}.{k}" if path else k) for k, v in values.items()}
    if isinstance(values, list):
        return [replaced(v, samples, f"{path}.{k}") for k, v in enumerate(values)]
    return values
