"""What every public class of declared numbers is made of, by its declarations, for the law that it
takes nothing else."""

import dataclasses
import functools
import importlib
import inspect
import types
import typing

import numpy as np
from test_layers import PACKAGES

from jaxspace.core import AbstractParameters
from jaxspace.core.modules import public_names
from jaxspace.core.quantities import quantities
from jaxspace.vehicles import FinSet

# Length of an axis that has a name.
NODES = 3
EQUINOCTIAL = ("semi_major_axis", "h", "k", "p", "q", "mean_longitude")
# Arguments of classes whose numbers belong together.
GIVEN = {
    "EquinoctialElements": dict(zip(EQUINOCTIAL, (1.0, 0.0, 0.1, 0.0, 0.0, 0.0), strict=True)),
    "InertiaTensor": {"tensor": np.diag([3.0, 2.0, 2.0])},
    "MovableFins": {"fins": FinSet(3, 0.1, 0.1, 0.1, 0.0, 0.1, 0.0), "azimuths": [0.0, 2.0, 4.0]},
    "ThrustProfile": {"fraction": [0.0, 1.0], "level": [1.0, 1.0]},
    "Triangular": {"low": 0.0, "mode": 0.5, "high": 1.0},
    "TruncatedNormal": {"mean": 0.5, "deviation": 1.0, "low": 0.0, "high": 1.0},
    "Uniform": {"low": 0.0, "high": 1.0},
}
# Those that are made of other things than their declared fields.
NOT_MADE = {
    "AerodynamicTable": "names of columns",
    "Insertion": "a function of thrust",
    "Lagrangian": "names of coordinates",
    "RigidBody": "its arguments have other names than its fields",
    "Scene": "a list of effects",
    "SteeredFlight": "a function of thrust",
    "TabulatedAerodynamics": "an AerodynamicTable",
    "TabulatedPath": "its arguments are no fields",
    "Together": "a list of controllers",
    "Vehicle": "one of two tables",
}


@functools.cache
def parameter_classes() -> list[type]:
    """The public classes whose numbers are declared."""
    found = {}
    for package in PACKAGES:
        if package != "cli":
            for thing in public_names(importlib.import_module(f"jaxspace.{package}")).values():
                if isinstance(thing, type) and issubclass(thing, AbstractParameters):
                    found[thing] = not inspect.isabstract(thing)
    return [cls for cls, final in found.items() if final]


def arguments_of(cls: type) -> dict[str, object]:
    """Values for the arguments of a class that have no default."""
    if cls.__name__ in GIVEN:
        return GIVEN[cls.__name__]
    fields = {field.name: field for field in dataclasses.fields(cls)}
    return {
        name: _value(fields[name].type, quantities(cls).get(name))
        for name, taken in inspect.signature(cls).parameters.items()
        if taken.default is inspect.Parameter.empty
    }


def made(cls: type) -> object:
    """An instance of the class, or of the first public one below an abstract class."""
    if inspect.isabstract(cls):
        cls = next(
            c for c in parameter_classes() if issubclass(c, cls) and c.__name__ not in NOT_MADE
        )
    return cls(**arguments_of(cls))


def _value(annotation, quantity):
    """A value that an annotation and a declaration allow."""
    if getattr(annotation, "dim_str", None) is not None:
        return _number(annotation, quantity)
    if isinstance(annotation, types.UnionType):
        return _value(typing.get_args(annotation)[0], quantity)
    if isinstance(annotation, type) and issubclass(annotation, AbstractParameters):
        return made(annotation)
    if annotation in (float, int, bool, str):
        return {float: 1.0, int: 2, bool: True, str: "name"}[annotation]
    assert "Callable" in str(annotation), annotation
    return lambda *given: given[0]


def _number(annotation, quantity):
    axes = [a for a in annotation.dim_str.split() if not a.startswith(("*", "."))]
    shape = tuple(int(a) if a.isdigit() else NODES for a in axes)
    low, high = (-np.inf, np.inf) if quantity is None else (quantity.low, quantity.high)
    start = low if np.isfinite(low) else 0.0
    width = min(1.0, high - start)
    # Ascending and within the range; a number in the middle of it.
    count = int(np.prod(shape))
    numbers = start + width * (np.arange(count) + 1.0) / (count + 1.0)
    if quantity is not None and quantity.whole:
        return start
    return numbers.reshape(shape) if shape else float(numbers[0])
