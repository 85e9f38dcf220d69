"""Results, states and parameters print their numbers with names and units."""

import dataclasses
import importlib
import inspect
import re
import types
import typing
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from test_layers import PACKAGES
from unchecked import unchecked
from wrong_values import NODES, NOT_MADE, arguments_of, parameter_classes

from jaxspace import Accuracy
from jaxspace.bodies import BodyState, MassProperties
from jaxspace.core import AbstractParameters
from jaxspace.core.modules import public_names
from jaxspace.core.printing import printed, units_of
from jaxspace.core.quantities import quantities
from jaxspace.dispersion import Dispersion
from jaxspace.optimization import Minimum
from jaxspace.rotations import Quaternion

MOST_LINES = 40
# Those that hold what a computation is made of, and no numbers that it gave.
NO_RESULTS = {
    "Advance": "a step of a method, for those who write one",
    **dict.fromkeys(("Choice", "FileName", "EventCondition", "Initial", "Output"), "declarations"),
    **dict.fromkeys(("Quantity", "SolverTraits", "Catalog", "SceneFile"), "descriptions"),
    **dict.fromkeys(("ByPurpose", "Campaign", "Evaluator", "LatinHypercube"), "what is to be run"),
    **dict.fromkeys(("Sobol", "StopRule", "FreeDesign"), "what is to be run"),
    **dict.fromkeys(("Phase", "Mission", "ClosedLoop", "Event", "Case"), "what is to be run"),
    **dict.fromkeys(("CVaR", "Constraint", "Mean", "MeanPlus"), "what is to be computed"),
    **dict.fromkeys(("Quantile", "Violation", "Worst"), "what is to be computed"),
    **dict.fromkeys(("AdaptiveRegularised", "ExponentialRosenbrock", "FixedSteps"), "methods"),
    **dict.fromkeys(("MuntheKaas", "Regularised", "RKN1210", "Splitting", "Stormer"), "methods"),
    **dict.fromkeys(("DOP853", "Tsit5"), "methods"),
}
# Those that print in their own way, as tests of their packages show.
OWN = {
    "AccuracyCost",
    "CampaignComparison",
    "LogComparison",
    "SweepTable",
    "WeightedDispersion",
    "Setting",
    "Dispersion",
    "EffectBudget",
    "Fit",
    "Law",
    "LawReport",
    "LoopRun",
}
OWN |= {
    "DesignOptimum",
    "Estimate",
    "AssessedDesign",
    "DesignAssessment",
    "AssessedLimit",
    "MissionTrajectory",
    "Trajectory",
    "Verification",
}
# Units in a docstring: behind a comma or a colon, before a comma, a full stop and such.
UNIT = re.compile(r"(?:[,:]) (kg|N|K|Pa|J|m|s|rad)((?:[ /][a-z]+)?(?:\^\d)?)(?=[,;:.)]|$)", re.M)

# Units in docstrings that are not those of a field.
NOT_OF_A_FIELD = {
    "Filtered": "m",  # the number of coordinates of a reading
    "InsertionOptimum": "s/m",  # of a price that is per time or per speed, by the criterion
    "Modes": "m",  # the number of inputs
    "Motor": "N s",  # of a property
    "Polhode": "N",  # a symbol
}


def result_classes():
    """The public modules, named tuples and data classes that hold results."""
    found: dict[Any, str] = {}
    for package in PACKAGES:
        if package != "cli":
            for name, thing in public_names(importlib.import_module(f"jaxspace.{package}")).items():
                if not isinstance(thing, type) or issubclass(thing, AbstractParameters):
                    continue
                if issubclass(thing, eqx.Module | tuple) or dataclasses.is_dataclass(thing):
                    found[thing] = name
    return [c for c, name in found.items() if not inspect.isabstract(c) and name not in NO_RESULTS]


def fields_of(cls):
    """The annotations of the fields of a class, by name."""
    if dataclasses.is_dataclass(cls):
        return {field.name: field.type for field in dataclasses.fields(cls)}
    hints = [inspect.get_annotations(base) for base in reversed(cls.__mro__)]
    return {name: {k: v for h in hints for k, v in h.items()}[name] for name in cls._fields}


def value_of(annotation, wide):
    """A value that an annotation allows: arrays of two runs if `wide`."""
    dims = getattr(annotation, "dim_str", None)
    if dims is not None:
        axes = [a.strip("#") for a in dims.split() if not a.startswith(("*", "."))]
        shape = [int(a) if a.isdigit() else NODES for a in axes]
        return 0.25 + np.arange(np.prod(shape + [2] * wide)).reshape(shape + [2] * wide)
    if typing.get_args(annotation) and isinstance(annotation, types.UnionType):
        return value_of(typing.get_args(annotation)[0], wide)
    if annotation in (float, int, bool, str):
        return {float: 0.25, int: 2, bool: True, str: "name"}[annotation]
    if isinstance(annotation, type) and annotation in CLASSES:
        return filled(annotation, wide)
    if typing.get_origin(annotation) is dict:
        return {"a": np.full([3] + [2] * wide, 0.25)}
    return np.full([3] + [2] * wide, 0.25)


def filled(cls, wide):
    """An instance whose fields are full of numbers, made without its constructor."""
    values = {name: value_of(kind, wide) for name, kind in fields_of(cls).items()}
    # Codes of an enumeration: that of a success.
    codes = {k for k, unit in units_of(cls).items() if isinstance(unit, type)}
    values |= {name: np.zeros([2] * wide, int) for name in codes}
    if issubclass(cls, tuple):
        return cls(**values)
    made = object.__new__(cls)
    for name, value in values.items():
        object.__setattr__(made, name, value)
    return made


CLASSES = result_classes()


def is_table(text):
    lines = text.splitlines()
    return len(lines) <= MOST_LINES and all(len(line) <= 102 for line in lines)


@pytest.mark.parametrize("wide", [False, True])
def test_every_result_prints_its_numbers(wide):
    """Those of one run and of a batch, with the name of each field."""
    wrong = []
    for cls in CLASSES:
        if cls.__name__ in OWN:
            continue
        text = repr(filled(cls, wide))
        missing = [name for name in fields_of(cls) if not re.search(rf"\b{name}\b", text)]
        if re.search(r"[fi](32|64)\[", text) or not is_table(text) or missing:
            wrong.append(f"{cls.__name__}, without {missing}: {text[:300]}")
        if "0.25" not in text and "from" not in text:
            wrong.append(f"{cls.__name__} prints no number: {text}")
    assert len(CLASSES) > 80 and not wrong, "\n".join(wrong)


def test_every_unit_that_a_result_names_is_printed():
    """The units in the docstring of a class are those of its fields."""
    wrong = []
    for cls in CLASSES:
        named = {"".join(pair) for pair in UNIT.findall(cls.__doc__ or "")}
        named.discard(NOT_OF_A_FIELD.get(cls.__name__))
        absent = named - {str(unit) for unit in units_of(cls).values()}
        unknown = set(getattr(cls, "_printed_units", ())) - set(fields_of(cls))
        if (absent or unknown) and cls.__name__ not in OWN:
            wrong.append(f"{cls.__name__}: {absent} {unknown}")
        if cls.__name__ in OWN:
            assert cls.__repr__ is not object.__repr__
    assert not wrong, "\n".join(wrong)


# Of Equinox, about an array in the place of a text.
@pytest.mark.filterwarnings("ignore:A JAX array is being set as static")
def test_every_class_of_parameters_prints_its_numbers():
    wrong = []
    with unchecked():
        for cls in parameter_classes():
            if cls.__name__ not in NOT_MADE:
                made = cls(**arguments_of(cls))
                text = repr(made)
                present = [n for n in quantities(cls) if getattr(made, n) is not None]
                missing = [name for name in present if not re.search(rf"\b{name}\b", text)]
                units = {quantities(cls)[name].unit for name in present}
                missing += [unit for unit in units if unit not in text]
                if missing or "f64[" in text or not is_table(text):
                    wrong.append(f"{cls.__name__}, {missing}: {text[:300]}")
    assert not wrong, "\n".join(wrong)


def test_numbers_lists_and_codes():
    """One line where it fits; a table of nested fields; shapes of what is traced and of many."""
    assert repr(Accuracy(rtol=1e-9)).startswith("Accuracy(rtol=1e-09, method=auto, max_steps=")
    part = MassProperties(jnp.array(2.0), jnp.array([1.0, -0.0, 0.5]), jnp.eye(3))
    assert repr(part) == (
        "MassProperties(mass=2 kg, centre=[1, 0, 0.5] m, tensor=float64[3, 3] from 0 to 1 kg m^2)"
    )
    state = BodyState(
        jnp.array([7e6, 0.0, 0.0]),
        jnp.zeros(3),
        Quaternion.identity(),
        jnp.zeros(3),
        jnp.array(9.0),
    )
    lines = repr(state).splitlines()
    assert lines[0] == "BodyState" and lines[1].split() == "position m [7e+06, 0, 0]".split()
    assert lines[3].split() == "attitude [1, 0, 0, 0]".split()
    shown = []
    jax.jit(lambda x: shown.append(repr(x)))(part)
    assert shown[0].startswith("MassProperties(mass=float64[] kg, centre=float64[3] m")
    assert "float64[3, 3]" in repr(jax.eval_shape(lambda: part))


def test_a_long_result_is_cut():
    @printed(numbers="m")
    @dataclasses.dataclass
    class Long:
        numbers: list

    text = repr(Long([np.full(3, 1.5 * k) for k in range(60)]))
    assert is_table(text) and text.splitlines()[1].split() == "numbers.0 m [0, 0, 0]".split()
    assert text.endswith("and 24 more")


def test_the_reason_of_an_end_is_printed_by_its_name():
    assert re.search(r"reason +CONVERGED\n", repr(filled(Minimum, wide=False)))


def test_a_dispersion_prints_its_table():
    runs = np.arange(1.0, 5.0)
    held = {"mass": runs}, {"range": 10.0 * runs, "time": runs * np.nan}
    result = Dispersion(*held, np.zeros(4, int), np.ones(4), {"range": "km", "mass": "kg"}, 1)
    lines = repr(result).splitlines()
    assert lines[0] == "Dispersion of 4 runs, 4 of them successful"
    assert lines[3].split() == ["range", "km", "25.0", "12.9", "10.0", "40.0"]
    many = Dispersion(
        {}, dict.fromkeys(map(str, range(99)), runs), *dataclasses.astuple(result)[2:]
    )
    assert is_table(repr(many)) and repr(many).endswith("and 69 more")
