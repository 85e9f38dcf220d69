"""Numbers that a user's function captures are differentiated and mapped as fields are."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace import BodyState, Event, Scene, simulate
from jaxspace.bodies import Load
from jaxspace.core.captured import captured_as_leaves
from jaxspace.scene import Custom

SPAN = 3.0
UP = BodyState(jnp.array([0.0, 0.0, 1.0]), jnp.array([0.0, 0.0, 1.0]))


def by_closure(g):
    return lambda t, y, body: Load(acceleration_N=-g * jnp.array([0.0, 0.0, 1.0]))


def by_default(g):
    return lambda t, y, body, g=g: Load(acceleration_N=-g * jnp.array([0.0, 0.0, 1.0]))


def pulled(g, t, y, body):
    return Load(acceleration_N=-g * jnp.array([0.0, 0.0, 1.0]))


def by_partial(g):
    return functools.partial(pulled, g)


def by_partial_tree(g):
    return jax.tree_util.Partial(pulled, g)


class Pull:
    """A class of a user that is no module, whose method is given."""

    def __init__(self, g):
        self.g = g

    def load(self, t, y, body):
        return by_closure(self.g)(t, y, body)


def by_function_of_function(g):
    inner = by_closure(g)
    return lambda t, y, body: inner(t, y, body)


def drag(k):
    return Custom(lambda t, y, body: Load(acceleration_N=-k * y.velocity))


def way(k):
    """How far a body gets that linear drag slows down, neither compiled as a whole nor of second
    order, so that it is asked whether it is stiff."""
    return simulate(Scene([drag(k)]), UP, np.array([0.0, SPAN]), accuracy=1e-4).final.position[2]


def way_by_hand(k):
    return 1.0 + (1.0 - np.exp(-k * SPAN)) / k


def slope_by_hand(k):
    return (k * SPAN * np.exp(-k * SPAN) - 1.0 + np.exp(-k * SPAN)) / k**2


@pytest.mark.parametrize("pull", [by_closure, by_partial, by_partial_tree])
def test_the_time_of_an_event_outside_of_jit(pull):
    """By the captured numbers of the motion and of the condition, in reverse mode."""

    def time(g, h):
        low = Event(lambda t, y: y.position[2] - h, direction=-1)
        run = simulate(Scene([Custom(pull(g))]), UP, np.array([0.0, SPAN]), events=[low])
        return run.ts[-1]

    g, h = 1.5, 0.25
    t, (by_g, by_h) = jax.value_and_grad(time, argnums=(0, 1))(g, h)
    # 1 + t - g t^2 / 2 = h.
    right = (1.0 + np.sqrt(1.0 + 2.0 * g * (1.0 - h))) / g
    rate = 1.0 - g * right
    # The steps are exact for a parabola.
    np.testing.assert_allclose([t, by_g, by_h], [right, right**2 / (2.0 * rate), 1.0 / rate], 1e-12)


def test_derivatives_and_maps_outside_of_jit():
    ks = np.array([0.3, 0.7])
    by_map = jax.vmap(jax.grad(way))(jnp.asarray(ks))
    # Tens of steps, each within 1e-4.
    np.testing.assert_allclose(by_map, slope_by_hand(ks), rtol=1e-2)


def test_an_array_made_within_shard_map():
    mesh = jax.make_mesh((1,), ("runs",), axis_types=(jax.sharding.AxisType.Auto,))
    runs = jax.sharding.PartitionSpec("runs")

    @jax.jit
    @functools.partial(jax.shard_map, mesh=mesh, in_specs=runs, out_specs=runs, check_vma=False)
    def ways(ks):
        made = 2.0 * ks[0]
        return way(made)[None]

    value, slope = jax.value_and_grad(lambda k: ways(k)[0])(jnp.array([0.2]))
    np.testing.assert_allclose(value, way_by_hand(0.4), rtol=1e-2)
    np.testing.assert_allclose(slope, [2.0 * slope_by_hand(0.4)], rtol=1e-2)


def test_what_is_taken_for_leaves():
    """Each array that a function captures, in whatever way; nothing else is changed."""
    fixed = by_closure(jnp.asarray(1.0))
    assert captured_as_leaves({"f": fixed})["f"] is fixed
    state = jnp.zeros(3)

    def load(g):
        def again(n):
            # Captures itself.
            return g if n == 0 else again(n - 1)

        def keyword(t, y, body, *, g=g):
            return by_closure(g)(t, y, body)

        functions = [
            *(make(g) for make in (by_closure, by_default, by_partial, by_function_of_function)),
            keyword,
            # Hashes the function that it is given.
            jax.checkpoint(by_closure(g)),
            lambda t, y, body: by_closure(again(2))(t, y, body),
        ]
        taken = captured_as_leaves(functions)
        for each in taken:
            assert any(isinstance(x, jax.Array) for x in jax.tree.leaves(each))
        # A method of what is no tree stays as it is.
        method = Pull(g).load
        assert captured_as_leaves(method) is method
        return [f(0.0, state, None).acceleration_N for f in taken]

    np.testing.assert_array_equal(jax.jit(load)(2.0), 7 * [[0.0, 0.0, -2.0]])
