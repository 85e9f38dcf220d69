"""Every public formula with an argument of another kind or size: a sentence with its name."""

import importlib
import inspect
import pickle
import re
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace.attitude.top_relatives import crusher_force
from jaxspace.attitude.torque_free import precession_rate
from jaxspace.core import InputError, Scalar, Vector
from jaxspace.core.formula import (
    ABOVE_ZERO,
    ANY,
    AWAY,
    BELOW_ONE,
    FINITE,
    NOT_ZERO,
    POSITIVE,
    _checked_value,
    formula,
)
from jaxspace.core.modules import public_names
from jaxspace.orbits.drag import drag_acceleration
from jaxspace.orbits.elements import eccentricity_vector, elements_from_state
from jaxspace.orbits.kepler import kepler_flow
from jaxspace.orbits.oblateness import oblateness
from jaxspace.orbits.point_gravity import point_gravity
from jaxspace.orbits.transfers import hohmann_transfer
from jaxspace.orbits.two_masses import reduced_mass

# The packages of physics. Those of `core` are the parts of formulas, and take what they are given.
PACKAGES = (
    *("rotations", "bodies", "orbits", "attitude", "rockets", "gyros", "mechanics", "vehicles"),
    *("minimisation", "optimization"),
)
WRONG = {"text": "1 km", "complex": 1.0 + 2.0j, "thing": object(), "bytes": b"1", "set": {1.0}}
WRONG |= {"complex array": np.array([1.0j, 2.0, 3.0]), "texts": np.array(["a", "b", "c"])}
BOTH_SIGNS = (ANY, FINITE, NOT_ZERO)
# Those whose arguments are not refused by their own names, each with the reason.
EXCEPTIONS = {
    "work_along": "its second argument is a list of functions, which names no kind",
}


def numbers_of(function):
    """The arguments of a public function that take real numbers, with their ranges."""
    return getattr(function, "numbers", ()) or formula(function).numbers


def formulas():
    """The public functions with arguments of real numbers, and these arguments."""
    found = {}
    for package in PACKAGES:
        for thing in public_names(importlib.import_module(f"jaxspace.{package}")).values():
            own = inspect.isfunction(thing) and thing.__module__.startswith(f"jaxspace.{package}")
            if own and thing.__name__ not in EXCEPTIONS:
                if numbers_of(thing):
                    found[thing] = numbers_of(thing)
    return found


def required(function):
    arguments = inspect.signature(function).parameters.items()
    return [name for name, argument in arguments if argument.default is argument.empty]


def complaint(function, number, value, sentence):
    """How a formula takes a wrong value, unless it refuses it in a `sentence` with its name."""
    # The check comes before anything is computed, so that the others may be anything.
    others = {name: 0.5 for name in required(function) if name != number.name}
    try:
        function(**{number.name: value}, **others)
    except InputError as error:
        found = "" if re.search(sentence, str(error)) else str(error)
    except Exception as error:
        found = str(type(error))
    else:
        found = "nothing"
    return found and f"{function.__name__}.{number.name}, {value}: {found}"


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
        for number in numbers:
            for what, value in wrong_values(number):
                tried += 1
                # Of a range too where the value is a number: NaN.
                sentence = rf"^{number.name} (is|has) .*: it must be a"
                found = complaint(function, number, value, sentence)
                wrong += [f"{what}: {found}"] if found else []
    assert not wrong, "\n".join(wrong)
    assert len(every) > 200 and tried > 4000


def out_of_range(number):
    """Numbers that are not within the declared range, in the shape that the argument has."""
    if number.range is AWAY:
        yield 0.0
        return
    yield np.nan
    if number.range not in BOTH_SIGNS:
        yield -1.0
    if number.range in (POSITIVE, ABOVE_ZERO, NOT_ZERO):
        yield 0.0
    if number.range not in (ANY, ABOVE_ZERO):
        yield np.inf
    if number.range is BELOW_ONE:
        yield 1.0


def test_every_formula_refuses_numbers_out_of_the_range_of_their_argument():
    """Python's numbers, NumPy's and JAX's; of arrays, the components of one run."""
    wrong, tried = [], 0
    for function, numbers in formulas().items():
        for number in numbers:
            # NaN in an array marks its own place.
            if number.shape and number.range is ANY:
                continue
            like = np.ones([3 if n is None else n for n in number.shape])
            for value in out_of_range(number):
                for given in (value * like, jnp.asarray(value * like)):
                    tried += 1
                    sentence = rf"{number.name} is .*({value:.3g}).*: it must be "
                    wrong.append(complaint(function, number, given, sentence))
    assert not any(wrong), "\n".join(filter(None, wrong))
    assert tried > 2000


def test_a_run_out_of_the_range_is_marked_and_harms_no_other():
    """Of a negative radius the force of the wheel would be a number as any other."""
    wheel = {"precession": 1.0, "weight": 1.0, "arm": 1.0, "transverse_inertia": 1.0}
    force = partial(crusher_force, 0.3, axial_inertia=1.0, **wheel)
    radii = jnp.array([-1.0, 1.0, jnp.nan, 2.0])
    expected = [jnp.nan, force(radius=1.0), jnp.nan, force(radius=2.0)]
    # One and the same operations on one number and on four.
    np.testing.assert_allclose(force(radius=radii), expected, rtol=1e-15)
    np.testing.assert_allclose(force(radius=np.asarray(radii)), expected, rtol=1e-15)
    assert np.isnan(crusher_force(0.3, 1.0, 1.0, radii, 1.0, 1.0, 1.0)).tolist() == [1, 0, 1, 0]
    # By the range alone, in every formula, before it computes.
    for number in (n for numbers in formulas().values() for n in numbers if n.range is not ANY):
        if number.range is AWAY:
            continue
        runs = np.ones([*(3 if n is None else n for n in number.shape), 2])
        runs[..., 0] = np.nan if number.range in BOTH_SIGNS else -1.0
        runs[..., 1] = 0.5
        marked = np.asarray(_checked_value(number, jnp.asarray(runs)))
        assert np.isnan(marked[..., 0]).all() and (marked[..., 1] == 0.5).all(), number.name


def test_limits_with_a_meaning_are_in_the_range():
    """A body without mass, a thin rod, and a body that the air does not slow down."""
    assert reduced_mass(5.0, 0.0) == 0.0 and reduced_mass(0.0, 5.0) == 0.0
    assert precession_rate(jnp.array([0.0, 2.0, 3.0]), 4.0, 0.0) == 2.0
    assert not np.any(drag_acceleration(jnp.ones(3), 1e-9, np.inf))


# Names of arguments that mean the same size in every formula.
SIZES = {
    *("A", "C", "I", "R", "ballistic_coefficient", "density", "drag_area", "eccentricity"),
    *("exhaust_velocity", "flattening", "mass", "mass_ratio", "mean_motion", "moments", "mu"),
    *("period", "radius", "restitution", "semi_latus_rectum", "semi_major_axis"),
}
# Those without a range of the formula, each with the reason.
FORCES = (
    *("oblateness", "oblateness_potential", "point_gravity", "point_gravity_potential"),
    *("shell_gravity", "shell_potential", "sphere_gravity", "sphere_potential"),
    *("spherical_harmonics", "spherical_harmonics_potential"),
    *("third_body", "third_body_potential", "zonal_potential", "zonals"),
)
SOLIDS = ("box", "cone", "conical_shell", "cylinder", "ellipsoid", "simplex", "sphere")
QUANTITIES = ("orbit_from_altitude", "orbit_from_burnout", "orbit_from_radius")
NO_RANGE = {
    **{("mu", name): "a centre may repel, and a body may lack mass" for name in FORCES},
    ("mu", "escape_speed"): "nothing is held by a centre that repels",
    ("mu", "excess_speed"): "a centre that repels adds speed",
    ("mu", "specific_energy"): "of either sign, as the force",
    **{("mass", name): "refused with the name of the solid" for name in SOLIDS},
    **{("radius", name): "refused with the name of the solid" for name in SOLIDS},
    **{("mu", name): "a declared quantity" for name in QUANTITIES},
    ("radius", "orbit_from_altitude"): "a declared quantity",
    ("eccentricity", "orbit_from_radius"): "a declared quantity",
    ("semi_major_axis", "vis_viva_speed"): "negative on a hyperbola",
    ("semi_major_axis", "period"): "negative on a hyperbola",
    ("semi_major_axis", "eccentricities_through"): "negative on a hyperbola",
}


def test_a_size_has_a_range_in_every_formula():
    """So that the radius of a new formula is not left without one."""
    bare = {
        (number.name, function.__name__)
        for function, numbers in formulas().items()
        for number in numbers
        if number.name in SIZES and number.range is ANY
    }
    assert bare <= set(NO_RANGE), bare - set(NO_RANGE)


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


ROWS = jnp.asarray([[7e6, 0.0, 0.0], [7.1e6, 0.0, 0.0], [7.2e6, 0.0, 0.0]])


def test_runs_that_lead_are_refused_where_they_put_a_run_at_the_centre():
    """Three runs of three components have one shape both ways round."""
    velocity = jnp.asarray([[0.0, 7.5e3, 0.0]] * 3)
    calls = {
        elements_from_state: (ROWS, velocity, 4e14),
        eccentricity_vector: (ROWS, velocity, 4e14),
        point_gravity: (ROWS, 4e14),
        oblateness: (ROWS, 4e14, 1e-3, 6e6),
    }
    for function, args in calls.items():
        with pytest.raises(InputError, match=r"the components are on the first axis"):
            function(*args)
    with pytest.raises(InputError, match="position is .*: it must be away from the centre"):
        eccentricity_vector(jnp.zeros(3), velocity[0], 4e14)
    # A run at the centre marks its own row.
    place = jnp.asarray([[7e6, 0.0], [0.0, 0.0], [0.0, 0.0]])
    found = eccentricity_vector(place, velocity[:2].T, 4e14)
    assert np.isfinite(found[:, 0]).all() and np.isnan(found[:, 1]).all()


def test_a_list_of_numbers_is_an_array():
    """In the precision of the others."""
    single = jnp.asarray([1.0, 0.0, 0.0], jnp.float32)
    for found in kepler_flow(single, [0.0, 1.0, 0.0], 1.0, 1.0):
        assert found.dtype == jnp.float32
    found = kepler_flow([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], 1.0, 1.0)
    np.testing.assert_allclose(found[0], [np.cos(1.0), np.sin(1.0), 0.0], atol=1e-15)


@pytest.mark.parametrize("duration", [np.inf, -np.inf, np.nan, jnp.asarray(np.inf)])
def test_a_duration_is_finite(duration):
    r, v = jnp.asarray([1.0, 0.0, 0.0]), jnp.asarray([0.0, 1.0, 0.0])
    with pytest.raises(InputError, match="duration is .*: it must be finite"):
        kepler_flow(r, v, duration, 1.0)
