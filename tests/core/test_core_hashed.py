"""Methods of public classes under `jax.jit`, which hashes the function that it is given."""

import importlib
import inspect
import pkgutil

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspace
from jaxspace import BodyState, Event, Mission, Phase, simulate
from jaxspace.control import SlewTask
from jaxspace.core import Table
from jaxspace.core.modules import public_names
from jaxspace.core.structure import HashedModule
from jaxspace.orbits import TwoBody
from jaxspace.rotations import Quaternion
from tests.systems import SAMPLES


def public_classes():
    packages = [m.name for m in pkgutil.iter_modules(jaxspace.__path__) if m.ispkg]
    for name in packages:
        package = importlib.import_module(f"jaxspace.{name}")
        for thing in public_names(package).values():
            if inspect.isclass(thing) and issubclass(thing, eqx.Module):
                yield thing


def methods_of(cls):
    fields = set(getattr(cls, "__dataclass_fields__", {}))
    for base in cls.__mro__:
        if base.__module__.startswith("jaxspace"):
            for name in vars(base):
                own = name == "__call__" or not name.startswith("_")
                if (
                    own
                    and name not in fields
                    and inspect.isfunction(inspect.unwrap(getattr(cls, name)))
                ):
                    yield name


def test_public_classes_with_methods_have_a_hash():
    """The numbers of a solver are static: it has the hash of its fields."""
    without = {
        cls.__name__
        for cls in public_classes()
        if not issubclass(cls, HashedModule | diffrax.AbstractSolver) and any(methods_of(cls))
    }
    assert not without


@pytest.mark.parametrize("case", SAMPLES, ids=lambda case: case.name)
def test_methods_of_systems_are_traced_under_jit(case):
    t = jnp.zeros(())
    for method in (case.system.vector_field, case.system.invariants):
        jax.eval_shape(jax.jit(method), t, case.state)


def test_results_of_methods_under_jit():
    task = SlewTask()
    key = jax.random.key(0)
    _, episode = task.reset(key, (2,))
    action = jnp.full((task.action_space.shape[0], 2), 0.5)
    step = jax.jit(task.step)
    observation = task.step(key, episode, action)[0]
    np.testing.assert_allclose(step(key, episode, action)[0], observation, rtol=1e-12, atol=1e-15)
    turn = Quaternion(jnp.array([np.cos(0.5), 0.0, 0.0, np.sin(0.5)]))
    east = jnp.array([1.0, 0.0, 0.0])
    # The quaternion of a turn by 1 rad about the third axis.
    exact = [np.cos(1.0), np.sin(1.0), 0.0]
    np.testing.assert_allclose(jax.jit(turn.rotate)(east), exact, atol=1e-15)
    run = simulate(TwoBody(1.0), BodyState(east, jnp.array([0.0, 1.0, 0.0])), jnp.array([0.0, 3.0]))
    np.testing.assert_allclose(jax.jit(run.at)(1.0).position, exact, atol=1e-14)
    table = Table(jnp.array([0.0, 1.0]), jnp.array([0.0, 2.0]))
    assert jax.jit(table)(0.25) == 0.5


def test_modules_of_other_numbers_are_other_functions():
    """Equal hashes are no equal modules: of the same structure, they have one hash."""
    first, second = TwoBody(1.0), TwoBody(2.0)
    assert hash(first) == hash(second) == hash(TwoBody(1.0))
    assert hash(first) != hash(TwoBody(np.ones(2)))
    y = BodyState(jnp.array([1.0, 0.0, 0.0]), jnp.zeros(3))
    for system, mu in ((first, 1.0), (second, 2.0)):
        assert jax.jit(system.vector_field)(0.0, y).velocity[0] == -mu
    assert isinstance(hash(Mission([Phase(first, 1.0)])), int)
    assert isinstance(hash(Event(lambda t, y: t)), int)
