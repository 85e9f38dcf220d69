"""Quantities: the unit, range and meaning of a field, declared once where the class declares it.

From a declaration follow the check at construction, the keys, units and errors of scene files, the
tables of the manual, the units of data sets and the labels of plots. No other file repeats it.
"""

__all__ = ["REQUIRED", "Quantity", "quantities"]

import dataclasses
import functools
import math
import typing
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array

from .checks import InputError, check, is_concrete, shown
from .field_types import QUANTITY, check_types
from .printing import Unit, printed_form
from .structure import HashedModule
from .types import as_float, as_optional_float

# The marker of dataclasses, so that fields take a default as it is declared.
REQUIRED = dataclasses.MISSING


class Quantity(NamedTuple):
    """Declaration of a field, or of an argument of a named constructor.

    - `unit`: SI unit, such as "kg m^2"; empty for a dimensionless number.
    - `doc`: meaning, as a phrase that follows the name of the field.
    - `low`, `high`: the range of allowed values; a limit belongs to it unless it is `strict`.
    - `optional`: whether the field may be absent (`None`).
    - `fixed`: whether it determines the shape of a computation, so that it cannot be dispersed.
    - `shared`: where a scene file looks for a value that the table of the class does not give, such
      as "planet.mu".
    - `key`: the key in a scene file where it is not the name of the field.
    - `shape`: without the axis of runs; `None` means any length.
    - `batched`: whether batch axes may follow.
    - `least`: minimum number of entries of a list of any length in a scene file.
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
    batched: bool = True

    def fits(self, shape: tuple[int, ...]) -> bool:
        """Whether an array of this shape has the declared axes, followed by batch axes only."""
        count = len(self.shape)
        lengths = zip(self.shape, shape[:count], strict=False)
        same = all(declared is None or declared == length for declared, length in lengths)
        return same and (len(shape) >= count if self.batched else len(shape) == count)

    def form(self) -> str:
        """The shape as text, completing the message "it must have the shape ..."."""
        axes = ["n" if length is None else str(length) for length in self.shape]
        axes += ["*runs"] if self.batched else []
        return f"({axes[0]},)" if len(axes) == 1 else f"({', '.join(axes)})"

    def allowed(self) -> str:
        """The range as text, completing the message "it must be ..."."""
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
        text = f"{' and '.join(limits)}, and finite"
        return f"{text}; angles are in rad (jnp.deg2rad)" if self.unit == "rad" else text

    def contains(self, value: ArrayLike) -> Array | np.ndarray | np.bool_:
        """Whether each number of `value` is finite and within the range; for a traced value, as an
        array."""
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
        """Raise `InputError` where a number of the concrete `value` of the field `name` is not
        allowed, or where it has no direction but requires one; traced values pass."""
        if not is_concrete(value):
            return
        x = np.asarray(value)
        check(self.contains(x), name, x, self.allowed())
        if self.direction and x.ndim:
            check(np.any(x != 0.0, axis=0), name, x, "of non-zero length")


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
    """A field of a module for numbers of one quantity:
    `mass: NumberField = quantity("kg", ...)`.

    The annotation gives the shape; the value is converted to a floating-point array.

    **Arguments**

    - `unit`, `doc`, and by name the other arguments of `argument` except the shape.
    - `converter`: converts the value to that of the field, instead of a floating-point array.
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
        field.name: field.metadata[QUANTITY]._replace(
            shape=annotated_shape(field.type), batched=takes_runs(field.type)
        )
        for field in fields
        if QUANTITY in field.metadata
    }


def annotated_shape(annotation: object) -> tuple[int | None, ...]:
    """The shape that an annotation such as `Float[Array, "3 *#runs"]` gives, without runs.

    A named axis of any length is `None`; `()` where the annotation is not that of an array."""
    return tuple(int(axis) if axis.isdigit() else None for axis in _axes_of(annotation))


def _axes_of(annotation: object) -> Sequence[str]:
    """The axes that the annotation of an array names, without runs."""
    # Of an optional field, the array is one of the alternatives.
    for one in (annotation, *typing.get_args(annotation)):
        dims = getattr(one, "dim_str", None)
        if dims is not None:
            return [axis for axis in dims.split() if not axis.startswith(("*", "."))]
    return []


def takes_runs(annotation: object) -> bool:
    """Whether an annotation lets axes of runs follow those that it names; `True` where it is not
    that of an array."""
    for one in (annotation, *typing.get_args(annotation)):
        dims = getattr(one, "dim_str", None)
        if dims is not None:
            return any(axis.startswith(("*", ".")) for axis in dims.split())
    return True


def check_shape(name: str, value: object, declared: Quantity) -> None:
    """Raise `InputError` unless an array has the axes that its declaration names, the first ones,
    so that no run is taken for a component.

    **Arguments**

    - `name`: of the value, in the message.
    - `value`: numbers, a list of them, or an array, which may be traced; other objects pass.
    - `declared`: its declaration."""
    shape = _shape_of(value)
    if shape is None or declared.fits(shape):
        return
    said = f"is {shown(value)}" if is_concrete(value) else f"has the shape {shape}"
    raise InputError(f"{name} {said}: it must have the shape {declared.form()}.")


def _shape_of(value: object) -> tuple[int, ...] | None:
    """The shape of numbers in an array or in nested lists; `None` of anything else."""
    if isinstance(value, bool | int | float):
        return ()
    if isinstance(value, jax.Array | np.ndarray | np.generic):
        return tuple(value.shape)
    if not isinstance(value, list | tuple):
        return None
    entries = [_shape_of(entry) for entry in value]
    known = [entry for entry in entries if entry is not None]
    if len(known) < len(entries):
        return None
    # Entries may have different axes of runs, of which the longest are those of the array.
    return (len(value), *max(known, key=len, default=()))


def check_kinds(module: object, *names: str) -> None:
    """Raise `InputError` for a field with a value of another kind or without the axes that it
    declares; arguments as of `check_declared`."""
    check_types(module, *names)
    for name, declared in quantities(type(module)).items():
        value = getattr(module, name) if not names or name in names else None
        # A placeholder of a tree transformation has no shape.
        if isinstance(value, jax.Array | np.ndarray):
            check_shape(f"{type(module).__name__}.{name}", value, declared)


def check_declared(module: object, *names: str) -> None:
    """Raise `InputError` for a field with a value of another kind, without the axes or out of the
    range that it declares.

    **Arguments**

    - `module`: whose class declares its numbers.
    - `names`: the fields to check, where a constructor computes the others from them; all without
      a name."""
    check_kinds(module, *names)
    for name, declared in quantities(type(module)).items():
        if not names or name in names:
            declared.check(f"{type(module).__name__}.{name}", getattr(module, name))
    _check_counts(module, *names)


def _check_counts(module: object, *names: str) -> None:
    """Raise `InputError` where two fields have different numbers along an axis of one name."""
    first: dict[str, tuple[str, int]] = {}
    for name, axes in _named_axes(type(module)).items():
        value = getattr(module, name) if not names or name in names else None
        if not isinstance(value, jax.Array | np.ndarray):
            continue
        for axis, length in zip(axes, value.shape, strict=False):
            other, known = first.setdefault(axis, (name, length))
            if axis and length != known:
                raise InputError(
                    f"{type(module).__name__}.{name} has {length} {axis}, and {other} has {known}: "
                    f"it must have the same number as {other}."
                )


@functools.cache
def _named_axes(cls: type) -> Mapping[str, Sequence[str]]:
    """The names of the axes of each declared field, without those of runs; empty for a number."""
    result = {}
    for field in dataclasses.fields(cls):
        declared = field.metadata.get(QUANTITY)
        axes = [] if declared is None else _axes_of(field.type)
        if any(axis and not axis.isdigit() for axis in axes):
            result[field.name] = ["" if axis.isdigit() else axis for axis in axes]
    return result


class AbstractParameters(HashedModule):
    """A module whose numbers are declared by `quantity`, and checked when it is constructed.

    Raises `InputError` for a value of another kind than its field declares, such as a text, for one
    without the declared axes, and for one outside its range; the message names class, field, value
    and the allowed values. Of traced numbers only the axes are checked."""

    # Without field names: those of the declarations.
    _printed_units: ClassVar[Mapping[str, Unit]] = {}

    def __init_subclass__(cls, **kwargs: object) -> None:
        super().__init_subclass__(**kwargs)
        own = cls.__dict__.get("__check_init__")
        if own is None:
            return

        # The check of a subclass comes before the one below, and may read axes that are not there.
        @functools.wraps(own)
        def check_init(self: AbstractParameters) -> None:
            check_kinds(self)
            own(self)

        cls.__check_init__ = check_init

    def __check_init__(self):
        check_declared(self)

    def __repr__(self) -> str:
        return printed_form(self)
