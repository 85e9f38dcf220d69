"""Properties that give tuples: called as methods they say what to write, else they are tuples."""

import importlib
import inspect
import pickle

import jax
import jax.numpy as jnp
import pytest
from test_layers import PACKAGES

from jaxspace.core.listed import Listed, no_method
from jaxspace.core.modules import public_names
from jaxspace.gyros import Gyropendulum

# Those that are plain tuples, each with the reason.
EXCEPTIONS = {
    ("Requirement", "record"): "written to the record of a campaign",
    ("Catalog", "named"): "no name of the manual",
}


def tuples_of_properties():
    """The properties of public classes that give tuples, with the functions behind them."""
    for package in PACKAGES:
        if package == "cli":
            continue
        for thing in public_names(importlib.import_module(f"jaxspace.{package}")).values():
            for cls in getattr(thing, "__mro__", ()):
                for name, value in vars(cls).items():
                    function = getattr(value, "fget", None) or getattr(value, "func", None)
                    given = str(getattr(function, "__annotations__", {}).get("return"))
                    own = cls.__module__.startswith("jaxspace") and not name.startswith("_")
                    if own and given.startswith("tuple") and not inspect.isabstract(cls):
                        yield cls.__name__, name, function


def says_so(function):
    """Whether a property has the decorator, or makes a tuple of this class; by its source, because
    the checks of types wrap it."""
    source = inspect.getsource(inspect.unwrap(function))
    return "@no_method" in source or "Listed(" in source


def test_every_tuple_of_a_property_is_one_that_can_be_called_by_mistake():
    found = {(cls, name): function for cls, name, function in tuples_of_properties()}
    plain = {names for names, function in found.items() if not says_so(function)}
    assert plain == set(EXCEPTIONS) and len(found) > 20


def test_arrays_of_a_property():
    """The call says what to write; under transformations the tuple is what others are."""
    gyro = Gyropendulum(1.0, 2.0, 3.0)
    with pytest.raises(TypeError, match="^This is the value of a property: write the property wit"):
        gyro.frequencies()  # type: ignore[operator]
    slow, fast = gyro.frequencies
    assert gyro.frequencies == (slow, fast) and jnp.stack(gyro.frequencies).shape == (2,)
    changed = jax.jit(jax.vmap(lambda a: Gyropendulum(a, 2.0, 3.0).frequencies))(jnp.ones(4))
    assert isinstance(changed, Listed) and changed[0].shape == (4,)
    assert pickle.loads(pickle.dumps(Listed((1, 2)))) == (1, 2)


class Pair:
    """A class with a property of two numbers."""

    @property
    @no_method
    def both(self) -> tuple[float, float]:
        """Two numbers."""
        return 1.0, 2.0


def test_a_property_keeps_its_documentation():
    assert Pair.both.__doc__ == "Two numbers." and Pair().both == (1.0, 2.0)
