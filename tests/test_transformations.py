"""Transformations of JAX around the verbs: no compilation, and programs that are exported."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import export
from unchecked import unchecked

from jaxspace import (
    Accuracy,
    BodyState,
    Event,
    Mission,
    Phase,
    Scene,
    simulate,
    simulate_batch,
    simulate_mission,
)
from jaxspace.bodies import Load
from jaxspace.core.square_roots import inverse_sqrt, sqrt
from jaxspace.core.status import SimulationError, Status
from jaxspace.orbits import PointGravity, TwoBody
from jaxspace.scene import Custom

CIRCLE = BodyState(jnp.array([1.0, 0.0, 0.0]), jnp.array([0.0, 1.0, 0.0]))
TS = jnp.array([0.0, 0.5])
LOOSE = Accuracy(1e-6)


def scene(mu):
    """A circular orbit, stepped because of an effect that does nothing."""
    return Scene(
        [PointGravity(mu), Custom(lambda t, y, body: Load(acceleration_N=0.0 * y.velocity))]
    )


def end(mu, accuracy=LOOSE):
    return simulate(scene(mu), CIRCLE, TS, accuracy=accuracy).final.position


def pair(mu):
    y0s = jax.tree.map(lambda x: jnp.stack([x, x], axis=-1), CIRCLE)
    return simulate_batch(scene(mu), y0s, TS, accuracy=LOOSE).final.position[:, 0]


def at_event(mu):
    # A quarter of a radian along the circle, by the closed form.
    event = Event(lambda t, y: y.position[1] - np.sin(0.5))
    return simulate(TwoBody(mu), CIRCLE, jnp.array([0.0, 1.0]), events=[event]).final.position


def phases(mu):
    mission = Mission([Phase(scene(mu), 0.25, name="a"), Phase(TwoBody(mu), 0.25, name="b")])
    return simulate_mission(mission, CIRCLE, accuracy=LOOSE).final.position


VERBS = {f.__name__: f for f in (end, pair, at_event, phases)}


@pytest.mark.parametrize("verb", VERBS)
def test_without_compilation(verb):
    """A user's own function then meets numbers, which a debugger shows."""
    # Without `jit`, JAX takes a member of an enumeration for an array of 64 bits, and arrays of
    # NumPy stay what they are, which the annotations do not name.
    with unchecked(), jax.disable_jit(), jax.numpy_dtype_promotion("standard"):
        position = VERBS[verb](1.0)
    np.testing.assert_allclose(position, [np.cos(0.5), np.sin(0.5), 0.0], atol=1e-6)


def test_roots_without_compilation():
    with jax.disable_jit():
        assert sqrt(4.0) == 2.0 and inverse_sqrt(4.0, 3) == 0.125
        assert jax.grad(sqrt)(4.0) == 0.25
        assert np.all(jax.vmap(sqrt)(jnp.array([1.0, 4.0])) == np.array([1.0, 2.0]))


def radius(mu, accuracy=LOOSE):
    return end(mu, accuracy)[0]


@pytest.mark.parametrize("verb", [end, phases])
def test_gradients_are_exported(verb):
    """By a program without Python, in which failed runs give NaN."""

    def first(mu):
        return verb(mu)[0]

    program = export.export(jax.jit(jax.value_and_grad(first)))(jnp.asarray(1.0))
    value, slope = export.deserialize(program.serialize()).call(jnp.asarray(1.0))
    expected, of_first = jax.value_and_grad(first)(1.0)
    np.testing.assert_allclose([value, slope], [expected, of_first], rtol=1e-12)


def test_failed_runs_of_an_exported_program_are_nan():
    few = Accuracy(1e-9, max_steps=2)
    program = export.export(jax.jit(jax.value_and_grad(lambda mu: radius(mu, few))))
    assert np.all(np.isnan(program(jnp.asarray(1.0)).call(jnp.asarray(1.0))))


@pytest.mark.parametrize("transformed", [jax.grad, jax.jacfwd, jax.vmap])
def test_failed_runs_outside_of_jit_raise_their_sentence(transformed):
    few = Accuracy(1e-9, max_steps=2)
    x = jnp.asarray([1.0, 1.1] if transformed is jax.vmap else 1.0)
    with pytest.raises(SimulationError, match="The maximum number of steps was reached"):
        transformed(lambda mu: radius(mu, few))(x)


DURATION = 0.5


def braked(x):
    """The distance of a point that a user's own effect brakes by k, from the speed v: (v, k)."""
    v, k = x
    y0 = BodyState(jnp.zeros(3), v * jnp.array([1.0, 0.0, 0.0]))
    scene = Scene([Custom(lambda t, y, body: Load(acceleration_N=-k * y.velocity))])
    run = simulate(scene, y0, jnp.array([0.0, DURATION]), accuracy=Accuracy(1e-9))
    return run.final.position[0]


def exact(x):
    v, k = x
    return v * (1.0 - jnp.exp(-k * DURATION)) / k


MODES = {"forward": jax.jacfwd, "reverse": jax.jacrev}
POINTS = jnp.array([[1.0, 0.3], [2.0, 1.7]])


@pytest.mark.parametrize("inner", MODES)
@pytest.mark.parametrize("outer", MODES)
@pytest.mark.parametrize("mapped", ["inside", "between", "outside"])
def test_second_derivatives_of_mapped_runs(outer, inner, mapped):
    """All combinations of both modes with a map, of a function that captures what is moved."""
    one, two = MODES[inner], MODES[outer]

    def hessians(f):
        if mapped == "inside":
            return two(one(lambda x: jax.vmap(f)(jnp.stack([x, 1.5 * x]))))(POINTS[0])
        if mapped == "between":
            return two(jax.vmap(one(f)))(POINTS)
        return jax.vmap(two(one(f)))(POINTS)

    # The derivatives of a closed form; the tolerance is a hundred times that of the run.
    np.testing.assert_allclose(jax.jit(lambda: hessians(braked))(), hessians(exact), atol=1e-7)


@pytest.mark.parametrize("ts", [[0.0, 9e18], [1e18, 1e18 + 10.0]])
def test_runs_of_no_sensible_time_end_with_a_status(ts):
    """Steps that are too long for their tolerance, or shorter than the spacing of the times."""
    run = simulate(scene(1.0), CIRCLE, jnp.array(ts), accuracy=LOOSE, throw=False)
    assert run.status > Status.EVENT and np.all(np.isnan(run.final.position))
