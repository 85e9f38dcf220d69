"""Quantities: the unit, range and meaning of a field, declared once where the class declares it.

From a declaration follow the check at construction, the keys, units and errors of scene files, the
tables of the manual, the units of data sets and the labels of plots. No other file repeats it.
"""

__all__ = ["REQUIRED", "Quantity", "quantities"]

import dataclasses
import functools
import math
import typing
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array

from .checks import check, is_concrete
from .field_types import QUANTITY, check_types
from .types import as_float, as_optional_float

# The marker of dataclasses, so that fields take a default as it is declared.
REQUIRED = dataclasses.MISSING


class Quantity(NamedTuple):
    """Declaration of a field, or of an argument of a named constructor.

    - `unit`: dimensions of SI, such as "kg m^2"; empty for a pure number.
    - `doc`: meaning, as a phrase that follows the name of the field.
    - `low`, `high`: the range of allowed values; a limit belongs to it unless it is `strict`.
    - `optional`: whether `None` says that the field is absent.
    - `fixed`: sets the shape of a computation, so that it cannot be dispersed.
    - `shared`: where a scene file looks for a value that the table of the class does not give, such
      as "planet.mu".
    - `key`: the key in a scene file where it is not the name of the field.
    - `shape`: without the axis of runs; `None` stands for any length.
    - `least`: how many numbers a list of any length has in a scene file at least.
    - `whole`: whether it counts something.
    - `direction`: whether the components on its first axis have a direction, so that not all of
      them are zero.
    - `default`: the value where none is given, or `REQUIRED`."""

    unit: str
    doc: str
    low: float = -math.inf
    high: float = math.inf
    strict: bool = False
    optional: bool = False
    fixed: bool = False
    shared: str = ""
    key: str = ""
    shape: tuple[int | None, ...] = ()
    default: object = REQUIRED
    least: int = 2
    whole: bool = False
    direction: bool = False

    def allowed(self) -> str:
        """The range in words, as the end of the sentence "it must be ..."."""
        if self.whole:
            return f"a whole number from {self.low:g} to {self.high:g}"
        if self.strict and self.low == 0.0 and self.high == math.inf:
            return "positive and finite"
        if self.low == 0.0 and self.high == math.inf:
            return "zero or positive, and finite"
        if self.low == -math.inf and self.high == math.inf:
            return "finite"
        above = "above" if self.strict else "at least"
        below = "below" if self.strict else "at most"
        limits = [f"{above} {self.low:g}"] if self.low > -math.inf else []
        limits += [f"{below} {self.high:g}"] if self.high < math.inf else []
        return f"{' and '.join(limits)}, and finite"

    def contains(self, value: ArrayLike) -> Array | np.ndarray | np.bool_:
        """Whether each number of `value` is finite and within the range; of a traced value, an
        array that says so."""
        # Known values are checked by NumPy, because a check must not start a device.
        xp = np if is_concrete(value) else jnp
        x = xp.asarray(value)
        within = (
            (x > self.low) & (x < self.high) if self.strict else (x >= self.low) & (x <= self.high)
        )
        if self.whole:
            within = within & (x == xp.round(x))
        return xp.isfinite(x) & within

    def check(self, name: str, value: object) -> None:
        """Raise `InputError` where a number of the known `value` of the field `name` is not
        allowed, or where it has no direction and needs one; what is not known passes."""
        if not is_concrete(value):
            return
        x = np.asarray(value)
        check(self.contains(x), name, x, self.allowed())
        if self.direction and x.ndim:
            check(np.any(x != 0.0, axis=0), name, x, "of another length than zero")


def argument(
    unit: str,
    *,
    doc: str,
    positive: bool = False,
    non_negative: bool = False,
    low: float = -math.inf,
    high: float = math.inf,
    strict: bool = False,
    optional: bool = False,
    fixed: bool = False,
    shared: str = "",
    key: str = "",
    shape: tuple[int | None, ...] = (),
    default: object = REQUIRED,
    least: int = 2,
    whole: bool = False,
    direction: bool = False,
) -> Quantity:
    """The declaration of an argument of a named constructor; see `constructor`.

    **Arguments**

    - `positive`, `non_negative`: the two common ranges, in place of `low` and `strict`.
    - `default`: an optional argument has the default `None`.
    - the others: see `Quantity`.
    """
    if positive:
        low, strict = 0.0, True
    if non_negative:
        low = 0.0
    if optional and default is REQUIRED:
        default = None
    limits = (low, high, strict, optional, fixed)
    return Quantity(
        *(unit, doc, *limits, shared, key, tuple(shape), default, least, whole, direction)
    )


def quantity(
    unit: str,
    *,
    doc: str,
    converter: Callable[..., object] | None = None,
    **declared: Any,
) -> Any:
    """A field of a module that holds numbers of one quantity:
    `mass: NumberField = quantity("kg", ...)`.

    The annotation gives the shape; the value is converted to a floating-point array.

    **Arguments**

    - `unit`, `doc`, and by name what else `argument` takes, but the shape.
    - `converter`: what turns the value into that of the field, in place of a floating-point array.
    """
    made = argument(unit, doc=doc, **declared)
    if converter is None:
        converter = as_optional_float if made.optional else as_float
    return eqx.field(converter=converter, default=made.default, metadata={QUANTITY: made})


# Cached for each class, because every construction asks for it.
@functools.cache
def quantities(cls: type) -> Mapping[str, Quantity]:
    """The quantities that a class declares, by the name of their field, in order.

    Their shapes are those of the annotations."""
    fields = dataclasses.fields(cls) if dataclasses.is_dataclass(cls) else ()
    return {
        field.name: field.metadata[QUANTITY]._replace(shape=annotated_shape(field.type))
        for field in fields
        if QUANTITY in field.metadata
    }


def annotated_shape(annotation: object) -> tuple[int | None, ...]:
    """The shape that an annotation such as `Float[Array, "3 *#runs"]` gives, without runs.

    A named axis of any length is `None`; `()` where the annotation is not that of an array."""
    # Of an optional field, the array is one of the alternatives.
    for one in (annotation, *typing.get_args(annotation)):
        dims = getattr(one, "dim_str", None)
        if dims is not None:
            axes = [axis for axis in dims.split() if not axis.startswith(("*", "."))]
            return tuple(int(axis) if axis.isdigit() else None for axis in axes)
    return ()


def check_declared(module: object, *names: str) -> None:
    """Raise `InputError` for a field with a value of another kind or out of the range that it
    declares.

    **Arguments**

    - `module`: whose class declares its numbers.
    - `names`: the fields to check, where a constructor computes the others from them; all without
      a name."""
    check_types(module, *names)
    for name, declared in quantities(type(module)).items():
        if not names or name in names:
            declared.check(f"{type(module).__name__}.{name}", getattr(module, name))


class AbstractParameters(eqx.Module):
    """A module whose numbers are declared by `quantity`, and checked when it is constructed.

    Raises `InputError` for a value of another kind than its field declares, such as a text, and for
    one outside its range; the sentence names class, field, value and what is allowed. Traced
    numbers pass."""

    def __check_init__(self):
        check_declared(self)
