"""Every public formula with an argument of another kind or size: a sentence with its name."""

import importlib
import inspect
import pickle
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace.core import InputError, Scalar, Vector
from jaxspace.core.formula import _numbers_of, formula
from jaxspace.core.modules import public_names
from jaxspace.orbits.transfers import hohmann_transfer

# The packages of physics. Those of `core` are the parts of formulas, and take what they are given.
PACKAGES = (
    *("rotations", "bodies", "orbits", "attitude", "rockets", "gyros", "mechanics", "vehicles"),
    "optimization",
)
WRONG = {"text": "1 km", "complex": 1.0 + 2.0j, "thing": object(), "bytes": b"1", "set": {1.0}}
WRONG |= {"complex array": np.array([1.0j, 2.0, 3.0]), "texts": np.array(["a", "b", "c"])}
# Those whose arguments are not refused by their own names, each with the reason.
EXCEPTIONS = {
    "work_along": "its second argument is a list of functions, which names no kind",
}


def formulas():
    """The public functions with arguments of real numbers, and these arguments."""
    found = {}
    for package in PACKAGES:
        for thing in public_names(importlib.import_module(f"jaxspace.{package}")).values():
            own = inspect.isfunction(thing) and thing.__module__.startswith(f"jaxspace.{package}")
            if own and thing.__name__ not in EXCEPTIONS:
                numbers = _numbers_of(thing)
                if numbers:
                    found[thing] = numbers
    return found


def wrong_values(number):
    yield from WRONG.items()
    if not number.optional:
        yield "none", None
    if any(number.shape):
        yield "count", np.ones([3 if n is None else n + 1 for n in number.shape])


def test_every_formula_refuses_what_is_no_real_number():
    every = formulas()
    wrong, tried = [], 0
    for function, numbers in every.items():
        required = [
            name
            for name, argument in inspect.signature(function).parameters.items()
            if argument.default is argument.empty
        ]
        for number in numbers:
            # The check comes before anything is computed, so that the others may be anything.
            others = {name: 0.5 for name in required if name != number.name}
            for what, value in wrong_values(number):
                tried += 1
                try:
                    function(**{number.name: value}, **others)
                except InputError as error:
                    if re.match(rf"{number.name} (is|has) .*: it must be a", str(error)):
                        continue
                    wrong.append(f"{function.__name__}.{number.name}, {what}: {error}")
                except Exception as error:
                    wrong.append(f"{function.__name__}.{number.name}, {what}: {type(error)}")
                else:
                    wrong.append(f"{function.__name__}.{number.name}, {what}: nothing")
    assert not wrong, "\n".join(wrong)
    assert len(every) > 200 and tried > 4000


@formula
def stretched(x: Vector, factor: Scalar, power: Scalar | None = None) -> Vector:
    """A vector times a factor."""
    return x * factor if power is None else x * factor**power


def test_what_a_formula_takes():
    """Plain numbers, lists, arrays of any axes of runs, traced ones, absent optional ones."""
    assert stretched(np.ones(3), 2).tolist() == [2.0, 2.0, 2.0]
    assert stretched(jnp.ones((3, 5)), jnp.arange(5.0), np.float64(2.0)).shape == (3, 5)
    assert jax.eval_shape(stretched, jax.ShapeDtypeStruct((3, 7, 2), float), 1.0).shape == (3, 7, 2)
    assert jax.make_jaxpr(lambda x: stretched(x, 2.0))(jnp.ones(3)).eqns
    with pytest.raises(InputError, match=r"^x has the shape \(2,\): it must be an array of numb"):
        jax.eval_shape(stretched, jax.ShapeDtypeStruct((2,), float), 1.0)
    with pytest.raises(InputError, match="^factor is of type .*, complex128: it must be a number"):
        jax.eval_shape(stretched, np.ones(3), jax.ShapeDtypeStruct((), complex))


def test_a_formula_stays_the_function_that_it_is():
    """Its signature, its documentation, and its place, by which it is sent to other processes."""
    assert list(inspect.signature(hohmann_transfer).parameters)[:2] == ["start", "end"]
    assert hohmann_transfer.__doc__ and pickle.loads(pickle.dumps(hohmann_transfer)) is (
        hohmann_transfer
    )
