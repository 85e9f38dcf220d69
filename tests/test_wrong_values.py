"""Values of another kind, sign or size than a field declares: a sentence at construction."""

import dataclasses
import inspect
import pickle
import re

import cloudpickle
import jax.numpy as jnp
import numpy as np
import pytest
from systems import Integrated
from unchecked import unchecked
from wrong_values import NODES, NOT_MADE, arguments_of, parameter_classes

from jaxspace import Event, Mission, Phase, orbits
from jaxspace.attitude import ReactionWheels, TorqueFreeBody
from jaxspace.control import ClosedLoop
from jaxspace.core import AbstractParameters, InputError, Table
from jaxspace.core.quantities import quantities
from jaxspace.orbits import Drag, PointGravity, TwoBody, transfers
from jaxspace.orbits.transfers import hohmann_transfer
from jaxspace.rockets import Separation
from jaxspace.vehicles import FinSet, MeasuredWind, Rail

WRONG = {"text": "1 km", "complex": 1.0 + 2.0j, "thing": object(), "texts": ["a", "b"]}
WRONG |= {"complex array": np.array([1.0j, 2.0]), "ragged": [[1.0], [1.0, 2.0]], "none": None}
# Fields of any kind: what the user's functions are given.
ANY_KIND = {"Hamiltonian.parameters", "Uncertain.noise"}


def wrong_numbers(declared):
    """Numbers that a declaration refuses, each with what is wrong with it."""
    yield "not a number", np.nan
    yield "infinite", np.inf
    if declared.low > -np.inf:
        yield "too low", declared.low - 1.0
    if declared.high < np.inf:
        yield "too high", declared.high + 1.0
    if declared.strict and declared.low > -np.inf:
        yield "at its limit", declared.low
    if declared.whole:
        yield "a part", declared.low + 0.5


def wrong_values(cls, name):
    """Values that a field must not take, by what is wrong with them."""
    field, declared = cls.__dataclass_fields__[name], quantities(cls).get(name)
    for what, value in WRONG.items():
        text = what == "text" and "str" in str(field.type)
        none = value is None and ("None" in str(field.type) or field.default is None)
        if not text and not none:
            yield what, value
    if declared is not None and field.type is not bool:
        like = np.ones([NODES if n is None else n for n in declared.shape])
        yield from ((what, number * like) for what, number in wrong_numbers(declared))
        if declared.direction:
            yield "no direction", np.zeros(np.shape(arguments_of(cls).get(name, np.zeros(3))))


def complaint(cls, right, name, value):
    """How the class takes a wrong value, unless it refuses it in a sentence with its field."""
    try:
        cls(**{**right, name: value})
    except InputError as error:
        return "" if re.match(r"[\w. ]*\S", str(error)) else str(error)
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return "nothing"


# Of Equinox, about an array in the place of a text, which is then refused.
@pytest.mark.filterwarnings("ignore:A JAX array is being set as static")
def test_no_class_takes_a_value_of_another_kind_or_size():
    """Every public class of declared numbers, field by field."""
    silent, tried = [], 0
    with unchecked():
        for cls in parameter_classes():
            if cls.__name__ in NOT_MADE:
                continue
            right = arguments_of(cls)
            cls(**right)
            taken = set(inspect.signature(cls).parameters) & set(cls.__dataclass_fields__)
            for name in sorted(taken):
                if f"{cls.__name__}.{name}" in ANY_KIND:
                    continue
                for what, value in wrong_values(cls, name):
                    tried += 1
                    found = complaint(cls, right, name, value)
                    if found:
                        silent.append(f"{cls.__name__}.{name}, {what}: {found}")
    assert not silent, "\n".join(silent)
    # The law is asked of everything that can be made, and not of nothing.
    assert tried > 5000


COAST = Phase(Integrated(TwoBody(1.0)), 1.0)
FREE = TorqueFreeBody([3.0, 2.0, 1.0])


class UserClass(AbstractParameters):
    """A user's class, with annotations as users write them."""

    rate: float
    table: jnp.ndarray
    name: str = "own"


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (
            lambda: PointGravity("398600 km^3/s^2"),
            r"PointGravity.mu is '398600 km\^3/s\^2': it must be a number in m\^3/s\^2.",
        ),
        (
            lambda: Drag(50.0, 1.2, 6.4e6),
            r"Drag.atmosphere is 1.2: it must be an AbstractAtmosphere \(ExponentialAtmosphere",
        ),
        (
            lambda: ReactionWheels(np.zeros((3, 2)), [1.0, 1.0], [0.0, 0.0]),
            "ReactionWheels.axes is .*: it must be of non-zero length",
        ),
        (
            lambda: ReactionWheels(np.eye(3), [1.0, 1.0], [0.0, 0.0, 0.0]),
            "ReactionWheels.inertia has 2 wheels, and axes has 3: it must have the same number",
        ),
        (
            lambda: FinSet(2.5, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1),
            "FinSet.count is 2.5: it must be a whole number from 2 to 8",
        ),
        (lambda: Rail([0.0, 0.0, 0.0], 5.0), "Rail.direction is .*non-zero length"),
        (lambda: Separation("x"), "Separation.dropped is 'x': it must be a number in kg"),
        (lambda: Phase(COAST.system, 1.0, name=5), "Phase.name is 5: it must be a text"),
        (lambda: Phase("x", 1.0), "Phase.system is 'x': it must be an AbstractSystem"),
        (lambda: Mission([COAST], name=5), "Mission.name is 5: it must be a text"),
        (lambda: Event(lambda t, y: t, direction="up"), "Event.direction is 'up'"),
        (lambda: Event(3.0), "Event.condition is 3.0: it must be a function"),
        (
            lambda: ClosedLoop(FREE, lambda y: y, period=1.0, hold=1),
            "ClosedLoop.hold is 1: it must be a text",
        ),
        (lambda: Table(["a", "b"], [1.0, 2.0]), r"Table.times is \['a', 'b'\]: it must be an arr"),
        (
            lambda: MeasuredWind([0.0, 1.0], "east", [0.0, 1.0]),
            "MeasuredWind.east is 'east': it must be an array of numbers in m/s",
        ),
        (lambda: TorqueFreeBody("heavy"), "inertia is 'heavy': it must be three principal"),
        (lambda: UserClass("fast", [1.0]), "UserClass.rate is 'fast': it must be a number"),
    ],
)
def test_wrong_values_get_a_sentence(call, sentence):
    with unchecked(), pytest.raises(InputError, match=sentence):
        call()


@pytest.mark.parametrize("wrong", [-7e6, 0.0, np.nan, "7000 km", 1.0j, None])
@pytest.mark.parametrize("place", range(3))
def test_a_transfer_between_no_circles_is_refused(wrong, place):
    """By the name of its argument; under `jit` and for runs side by side it is NaN in their row."""
    right = [7e6, 4.2e7, 4e14]
    name = ("start", "end", "mu")[place]
    with (
        unchecked(),
        pytest.raises(
            InputError, match=rf"^{name} is .*: it must be .*(above zero|positive|a number)"
        ),
    ):
        hohmann_transfer(*right[:place], wrong, *right[place + 1 :])


def test_a_module_that_is_called_says_what_to_write():
    """A function of this name stood there, or might."""
    with pytest.raises(TypeError, match=r"jaxspace\.orbits\.transfers is a module: call one .*\("):
        transfers(7e6, 4.2e7, 4e14)
    with pytest.raises(TypeError, match=r"jaxspace\.orbits is a module: call one of its"):
        orbits()
    # Functions that use it can be sent to other processes.
    assert pickle.loads(cloudpickle.dumps(transfers)) is transfers


def test_users_classes_take_what_their_annotations_mean():
    """Arrays of runs for a `float`, plain numbers for an array, whatever is traced."""
    own = UserClass(np.array([1.0, 2.0]), 3)
    assert dataclasses.replace(own, rate=jnp.ones(4), name="other").name == "other"
    assert UserClass(1, np.float32(2.0)).rate == 1
