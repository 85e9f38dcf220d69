"""Lists of numbers in place of arrays, in every public function with an argument for numbers."""

import functools
import importlib
import inspect
import pkgutil
import typing

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from unchecked import unchecked

import jaxspace
from jaxspace import BodyState, Mission, Phase, Scene, simulate, simulate_batch, simulate_mission
from jaxspace.core import AbstractSystem, InputError
from jaxspace.core.modules import public_names
from jaxspace.core.safe import safe_sqrt
from jaxspace.core.vectors import dot, matvec, norm
from jaxspace.orbits import PointGravity
from jaxspace.rotations import Quaternion

# Their arrays are made by an integrator, and not by a user.
INTERNAL = {"bind", "field_of_step", "times_slope", "axis"}
# It returns what it is given.
INTERNAL |= {"end_time"}
NOT_BY_NAME = (inspect.Parameter.VAR_KEYWORD, inspect.Parameter.VAR_POSITIONAL)


def arrays_of(annotation):
    """The shape without runs of an argument for numbers; `None` for another argument."""
    for one in (annotation, *typing.get_args(annotation)):
        dims = getattr(one, "dim_str", None)
        if dims is not None and "float" in " ".join(one.dtypes or ("float",)):
            axes = [axis for axis in dims.split() if not axis.startswith(("*", "#"))]
            return tuple(int(axis) if axis.isdigit() else 3 for axis in axes)
    return None


def public_functions():
    found = {}
    for package in pkgutil.iter_modules(jaxspace.__path__):
        if package.name.startswith("_") or package.name in ("cli", "constants"):
            continue
        for name, thing in public_names(
            importlib.import_module(f"jaxspace.{package.name}")
        ).items():
            plain = inspect.isfunction(thing) or isinstance(thing, jax.custom_jvp)
            if plain and name not in INTERNAL:
                found[thing] = f"{package.name}.{name}"
    return found


def numbers(shape):
    """Ascending numbers, a diagonal matrix: what most functions are defined for."""
    if len(shape) == 2 and shape[0] == shape[1]:
        return np.diag(0.2 + 0.1 * np.arange(shape[0]))
    return 0.2 + 0.1 * np.arange(np.prod(shape, dtype=int)).reshape(shape)


def outcome(function, arguments, traced=True):
    """What a function returns, by its shapes, or the error that it raises."""
    call = functools.partial(called, function)
    try:
        with unchecked():
            made = jax.eval_shape(call, arguments) if traced else call(arguments)
    except Exception as error:  # noqa: BLE001
        return error
    return jax.tree.map(lambda x: (x.shape, x.dtype), jax.tree.leaves(made))


def called(function, arguments):
    result = function(**arguments)
    return [x for x in jax.tree.leaves(result) if isinstance(x, jax.Array)]


def complaint(function, names, others, shapes):
    """How a function takes lists in place of arrays, unless it does so as it takes the arrays, or
    refuses one by the name of its argument."""
    arrays = {**others, **{name: numbers(shapes[name] or (3,)) for name in names}}
    lists = {**arrays, **{name: arrays[name].tolist() for name in names}}
    by_array, by_list = outcome(function, arrays), outcome(function, lists)
    if isinstance(by_list, jax.errors.JAXTypeError):
        # The function reads the numbers.
        by_array, by_list = outcome(function, arrays, traced=False), outcome(function, lists, False)
    if isinstance(by_list, InputError) and str(by_list).startswith(tuple(names)):
        return ""
    if isinstance(by_list, Exception):
        same = isinstance(by_array, Exception) and "'list'" not in str(by_list)
        return "" if same else f"{type(by_list).__name__}: {by_list}".split("\n")[0]
    return "" if by_list == by_array else f"{by_list} and not {by_array}"


def test_every_function_takes_a_list_as_an_array_or_names_the_argument():
    """The required arguments together, and each of the others."""
    wrong, tried, worked = [], 0, 0
    for function, title in public_functions().items():
        parameters = inspect.signature(function).parameters
        shapes = {name: arrays_of(p.annotation) for name, p in parameters.items()}
        taken = {n: p for n, p in parameters.items() if p.kind not in NOT_BY_NAME}
        required = [name for name, p in taken.items() if p.default is p.empty]
        # Anything, for an argument that is no array.
        others = {name: 0.5 for name in required}
        array = [name for name in taken if shapes[name] is not None]
        first = [name for name in required if name in array]
        groups = [first] if first else []
        if first and isinstance(outcome(function, arrays_for(others, first, shapes)), Exception):
            groups = [[name] for name in first]
        else:
            worked += len(first)
        groups += [[name] for name in array if name not in required]
        others = arrays_for(others, first, shapes)
        for names in groups:
            tried += len(names)
            found = complaint(function, names, others, shapes)
            wrong += [f"{title}: {', '.join(names)}: {found}"] if found else []
    assert not wrong, "\n".join(wrong)
    assert tried > 700 and worked > 500, (tried, worked)


def arrays_for(others, names, shapes):
    return {**others, **{name: numbers(shapes[name]) for name in names}}


class Decay(AbstractSystem):
    """A tree of numbers that decays."""

    def vector_field(self, t, y):
        return jax.tree.map(jnp.negative, y)

    def invariants(self, t, y):
        return {}


def test_integers_of_numpy_are_a_state_as_lists_are():
    """In bodies and in other trees, in one run, a batch and a mission."""
    place, velocity = [7000000, 0, 0], [0, 7500, 0]
    scene = Scene([PointGravity(3.986e14)])
    by_list = simulate(scene, BodyState(place, velocity), [0, 10]).final.position
    y = BodyState(np.array(place), np.array(velocity))
    np.testing.assert_array_equal(simulate(scene, y, np.array([0, 10])).final.position, by_list)
    y = BodyState(jnp.array(place), jnp.array(velocity))
    assert y.position.dtype == y.velocity.dtype == float
    many = BodyState(*(np.array([x, x]).T for x in (place, velocity)))
    found = simulate_batch(scene, many, np.array([0, 10])).final.position
    np.testing.assert_allclose(found[:, 1], by_list, rtol=1e-9)
    found = simulate_mission(Mission([Phase(scene, 10)]), y).final.position
    np.testing.assert_allclose(found, by_list, rtol=1e-9)
    # The precision of the other arrays counts.
    state = {"a": np.array([1, 2]), "b": jnp.ones(2, jnp.float32)}
    final = simulate(Decay(), state, [0, 1]).final
    assert final["a"].dtype == jnp.float32
    np.testing.assert_allclose(final["a"], np.exp(-1.0) * np.array([1, 2]), rtol=1e-5)


def test_an_attitude_is_no_array():
    for given in ([1, 0, 0, 0], np.array([1.0, 0.0, 0.0, 0.0])):
        with pytest.raises(InputError, match="attitude is an array .* it must be a Quaternion"):
            BodyState(attitude=given, omega=[0, 0, 1])
    assert Quaternion(np.array([1, 0, 0, 0])).matrix().dtype == float


def test_the_parts_of_formulas_take_lists():
    """Also within a derivative, and with their rules of differentiation."""
    assert dot([1, 2, 3], (4, 5, 6)) == 32.0
    assert matvec([[0, 1, 0], [1, 0, 0], [0, 0, 1]], [1, 2, 3]).tolist() == [2.0, 1.0, 3.0]
    assert safe_sqrt([0, 4]).tolist() == [0.0, 2.0]
    np.testing.assert_allclose(jax.grad(lambda x: norm([x, 2.0 * x, 2.0 * x]))(1.0), 3.0)
    with pytest.raises(InputError, match=r"^a is \[1, 2, 'x'\]: it must be a number, or an array"):
        norm([1, 2, "x"])
