"""An unknown name of a module or of an object: the error suggests the nearest one."""

import copy
import dataclasses
import enum
import importlib
import inspect
import pickle
import subprocess
import sys

import jax.numpy as jnp
import numpy as np
import pytest

import jaxspace
from jaxspace import BodyState, Scene, constants, optimization, orbits
from jaxspace.core.modules import public_names
from jaxspace.core.printing import printed
from jaxspace.core.structure import HashedModule
from jaxspace.dispersion import StopRule
from jaxspace.orbits import PointGravity, transfers

PACKAGES = sorted(set(jaxspace.__all__) - set(jaxspace._MODULE_OF) - {"constants"})
PACKAGES += ["control", "mechanics", "minimisation", "robust", "sampling", "stores", "vehicles"]
# Python's own kinds of objects.
PLAIN = (BaseException, enum.Enum)
Y = BodyState(jnp.ones(3), jnp.zeros(3))


@pytest.mark.parametrize(
    ("thing", "name", "sentence"),
    [
        (jaxspace, "simulat", "has no attribute 'simulat'. Did you mean simulate?"),
        (jaxspace, "PointGravity", "'PointGravity': it is jaxspace.orbits.PointGravity."),
        (orbits, "lambrt", "Did you mean lambert?"),
        (orbits, "hohman", "Did you mean jaxspace.orbits.transfers.hohmann_transfer?"),
        (
            optimization,
            "staging_with_losses",
            ": it is jaxspace.optimization.flown_staging.staging_with_losses.",
        ),
        (transfers, "hohman", "Did you mean hohmann_transfer?"),
        (constants, "EARTH_MU", "Did you mean MU_EARTH?"),
        (Y, "positon", "'BodyState' object has no attribute 'positon'. Did you mean position?"),
        (Scene([PointGravity(1.0)]), "efects", "Did you mean effects?"),
        (
            orbits.interception.Interception(*Y.position, 0.0, 0.0),
            "arival",
            "Did you mean arrival?",
        ),
        # Nothing is near.
        (Y, "xyz", "'BodyState' object has no attribute 'xyz'"),
    ],
)
def test_an_unknown_name_gets_the_nearest_one(thing, name, sentence):
    with pytest.raises(AttributeError) as caught:
        getattr(thing, name)
    assert str(caught.value).endswith(sentence)
    # Sent from a worker to the process that reports it.
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)


def test_every_public_object_suggests_names():
    """Modules, and the instances of the classes of results, states and parameters."""
    without, tried = [], 0
    for package in PACKAGES:
        root = importlib.import_module(f"jaxspace.{package}")
        for name, thing in public_names(root).items():
            if inspect.isclass(thing) and not issubclass(thing, PLAIN) and package != "core":
                tried += 1
                without += [] if hasattr(thing, "__getattr__") else [f"{package}.{name}"]
        for name, module in vars(root).items():
            if inspect.ismodule(module) and getattr(module, "__all__", ()):
                tried += 1
                first = module.__all__[0]
                with pytest.raises(AttributeError) as caught:
                    getattr(module, f"{first}x")
                without += [] if "Did you mean" in str(caught.value) else [f"{package}.{name}"]
    assert not without
    assert tried > 300


def test_questions_of_libraries_get_a_plain_answer():
    for thing in (Y, orbits, transfers, jaxspace, constants):
        for name in ("__array__", "__jax_array__", "_repr_html_", "_x"):
            with pytest.raises(AttributeError) as caught:
                getattr(thing, name)
            assert "mean" not in str(caught.value)
    assert not hasattr(Y, "shape") and np.asarray(Y, dtype=object).shape == ()
    assert copy.deepcopy(Y).mass is None
    cloudpickle = pytest.importorskip("cloudpickle")
    assert cloudpickle.loads(cloudpickle.dumps(Y)).velocity.tolist() == [0.0, 0.0, 0.0]


@printed(number="m")
class Faulty(HashedModule):
    number: float

    @property
    def broken(self):
        return self.number.nothing


def test_an_error_within_a_property_stays_its_own():
    """And is not reported as a missing property."""
    with pytest.raises(AttributeError, match="'float' object has no attribute 'nothing'"):
        Faulty(1.0).broken  # noqa: B018


def test_a_traceback_suggests_a_name_once():
    code = "import jaxspace.orbits as o\no.hohman"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    last = done.stderr.splitlines()[-1]
    assert last == (
        "AttributeError: module 'jaxspace.orbits' has no attribute 'hohman'. Did you mean "
        "jaxspace.orbits.transfers.hohmann_transfer?"
    )


def test_help_shows_the_arguments_of_a_dataclass():
    assert list(inspect.signature(StopRule).parameters) == [
        field.name for field in dataclasses.fields(StopRule)
    ]
