"""A coefficient of the aerodynamic forces by the Mach number, from a table.

Linear between the points and constant outside; one point is a constant coefficient."""

__all__ = ["MachTable"]

from collections.abc import Sequence
from typing import final

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import AbstractParameters, InputError, Scalar, quantity
from ..core.field_types import is_real, shown
from ..core.tables import polygon
from ..core.types import as_float
from .local_air import check_nodes


@final
class MachTable(AbstractParameters):
    """A coefficient by the Mach number: `MachTable([0.0, 0.9, 1.1], [0.4, 0.5, 0.7])(mach)`.

    Raises `InputError` for Mach numbers that do not ascend, or another number of values."""

    mach: Float[Array, "nodes *#runs"] = quantity("", non_negative=True, doc="ascending")
    values: Float[Array, "nodes *#runs"] = quantity("", doc="the coefficient there")

    def __check_init__(self):
        super().__check_init__()
        check_nodes("MachTable.mach", self.mach, values=self.values)

    def __call__(self, mach: Scalar) -> Scalar:
        """The coefficient at the Mach number, (*runs,)."""
        return polygon(mach, self.mach, self.values)


def as_coefficient(x: object) -> MachTable:
    """A table as it is; a pair of Mach numbers and values as a table; a number as a constant."""
    if isinstance(x, MachTable):
        return x
    if isinstance(x, Sequence) and len(x) == 2:
        return MachTable(as_float(x[0]), as_float(x[1]))
    value = as_float(x)
    if not is_real(value):
        raise InputError(
            f"coefficient is {shown(x)}: it must be a number, a MachTable, or Mach numbers with "
            "one value for each."
        )
    # A table of one point is constant.
    return MachTable(jnp.zeros((1,), value.dtype), value[None])


def as_optional_coefficient(x: object) -> MachTable | None:
    """Convert a coefficient by `as_coefficient`; `None`, for no coefficient, remains `None`."""
    return None if x is None else as_coefficient(x)


# Shared by the effects whose coefficient changes there.
BURNOUT = "time from which the coasting coefficient applies"


def coefficient_at(
    t: Scalar, mach: Scalar, burning: MachTable, coasting: MachTable | None, burnout: Scalar | None
) -> Scalar:
    """The coefficient at a Mach number and the time `t`, s: that of `coasting` from `burnout`, s,
    on, where there is one."""
    value = burning(mach)
    if coasting is None or burnout is None:
        return value
    # At the burnout itself it is that of coasting, as in the segment that begins there.
    return jnp.where(t < burnout, value, coasting(mach))
