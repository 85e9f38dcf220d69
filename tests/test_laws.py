"""Laws that every system obeys, run over the registry: a new system in `systems.py` is tested here
without a new test."""

import functools

import equinox as eqx
import fuzz_slopes
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from systems import SAMPLES

from jaxspace.rotations import Quaternion
from jaxspace.simulation import Accuracy, simulate, simulate_batch
from jaxspace.solvers import Tsit5

BY_NAME = {s.name: s for s in SAMPLES}
SWEEP = {True: pytest.mark.sweep, False: ()}
every = pytest.mark.parametrize(
    "name", [pytest.param(s.name, marks=SWEEP[s.sweep]) for s in SAMPLES]
)
CLOSED = [s for s in SAMPLES if s.system.closed_form() is not None]
# Whose second derivatives compile for long: elliptic functions of all kinds.
LONG = ("torque_free_principal", "torque_free_tensor", "free_stage", "top")
RTOL = 1e-10


def scales(tree):
    """The size of each block, to measure changes of states whose blocks differ by many orders."""
    return jax.tree.map(lambda x: jnp.maximum(jnp.max(jnp.abs(x)), 1e-3), tree)


def assert_near(a, b, tolerance):
    """Every block of `a` within `tolerance` of the size of the block of `b`."""
    for x, y, s in zip(
        jax.tree.leaves(a), jax.tree.leaves(b), jax.tree.leaves(scales(b)), strict=True
    ):
        np.testing.assert_allclose(
            np.asarray(x) / float(s), np.asarray(y) / float(s), rtol=0.0, atol=tolerance
        )


def total(a, b):
    """The sum of the products of two trees, number by number."""
    return sum(jnp.sum(x * y) for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True))


def perturbed(state, key, count):
    """`count` states about `state`, the runs on a new last axis."""
    leaves, tree = jax.tree.flatten(state)
    keys = jax.random.split(key, len(leaves))
    size = jax.tree.leaves(scales(state))
    states = [
        x[..., None] + 1e-2 * s * jax.random.normal(k, (*x.shape, count))
        for x, s, k in zip(leaves, size, keys, strict=True)
    ]
    return jax.tree.unflatten(tree, states)


def lane(state, i):
    """One run of states side by side."""
    return jax.tree.map(lambda x: x[..., i], state)


@every
def test_compiled_is_eager(name):
    s = BY_NAME[name]
    t = jnp.array(0.3 * s.span)
    # The compiler contracts products and sums: a few roundings. The gyro's slow rates are small
    # rests of large terms.
    tolerance = 1e-8 if name == "two_gimbal_gyro" else 1e-11
    assert_near(
        eqx.filter_jit(s.system.vector_field)(t, s.state),
        s.system.vector_field(t, s.state),
        tolerance,
    )


@every
def test_side_by_side_is_one_by_one(name, key):
    s = BY_NAME[name]
    states = perturbed(s.state, key, 4)
    shared = jax.tree.map(lambda x: x[..., None] if x.ndim else x, s.system)
    t = jnp.array(0.3 * s.span)
    together = shared.vector_field(t, states)
    mapped = jax.vmap(s.system.vector_field, (None, -1), -1)(t, states)
    for i in range(4):
        alone = s.system.vector_field(t, lane(states, i))
        assert_near(lane(together, i), alone, 1e-12)
        assert_near(lane(mapped, i), alone, 1e-12)


# Each of these compiles in a second; the others take three minutes together.
QUICK = ("two_body", "double_pendulum", "trailer")


@pytest.mark.parametrize(
    "name", [pytest.param(s.name, marks=SWEEP[s.name not in QUICK]) for s in SAMPLES]
)
def test_runs_are_not_taken_for_another_axis(name, key):
    """In batches of as many runs as any axis of the system or of its state has places, such as
    modes, wheels, nodes of a table or components, each run with its own parameters."""
    s = BY_NAME[name]
    leaves = jax.tree.leaves((s.system, s.state))
    t = jnp.array(0.3 * s.span)
    rate = eqx.filter_jit(lambda system, y: system.vector_field(t, y))
    for count in sorted({1} | {places for x in leaves for places in np.shape(x)}):
        factors = 1.0 + 1e-3 * np.arange(count)
        systems = jax.tree.map(lambda x, f=factors: x[..., None] * f.astype(x.dtype), s.system)
        states = perturbed(s.state, key, count)
        together = rate(systems, states)
        for i in range(count):
            alone = rate(lane(systems, i), lane(states, i))
            # Sums are ordered otherwise, and the gyro's slow rates are rests of large terms.
            assert_near(lane(together, i), alone, 1e-11)


@every
def test_slopes_agree_with_differences(name, key):
    """Forward and reverse derivatives of the vector field along a random direction, against central
    differences."""
    s = BY_NAME[name]
    t = jnp.array(0.3 * s.span)
    direction = jax.tree.map(lambda a, b: b - a, s.state, lane(perturbed(s.state, key, 1), 0))
    weights = jax.tree.map(
        lambda x, size: jnp.ones_like(x) / size, s.state, scales(s.system.vector_field(t, s.state))
    )

    def measure(y):
        return sum(
            jnp.sum(w * k)
            for w, k in zip(
                jax.tree.leaves(weights), jax.tree.leaves(s.system.vector_field(t, y)), strict=True
            )
        )

    _, forward = jax.jvp(measure, (s.state,), (direction,))
    gradient = jax.grad(measure)(s.state)
    reverse = total(gradient, direction)
    h = 1e-4
    ahead, behind = (jax.tree.map(lambda y, d, h=h: y + h * d, s.state, direction) for h in (h, -h))
    difference = (measure(ahead) - measure(behind)) / (2.0 * h)
    scale = max(abs(float(forward)), 1e-2)
    assert abs(forward - reverse) < 1e-10 * scale
    # Central differences at 1e-4 of a change of 1e-2: truncation 1e-12, rounding 1e-16 / 1e-6.
    assert abs(forward - difference) < 1e-7 * scale


@every
def test_single_precision_stays(name):
    s = BY_NAME[name]

    def single(tree):
        return jax.tree.map(lambda x: x.astype(jnp.float32), tree)

    rate = single(s.system).vector_field(jnp.float32(0.3 * s.span), single(s.state))
    assert {x.dtype for x in jax.tree.leaves(rate)} == {jnp.dtype("float32")}
    # A few hundred units in the last place: sums of large terms that cancel.
    assert_near(rate, s.system.vector_field(jnp.array(0.3 * s.span), s.state), 5e-5)


@every
def test_the_way_back_and_what_stays(name):
    """The run forth and back ends where it began, and keeps its invariants."""
    s = BY_NAME[name]
    accuracy = Accuracy(rtol=RTOL, method=Tsit5())
    forth = simulate(s.system, s.state, jnp.array([0.0, s.span]), accuracy=accuracy)
    back = simulate(s.system, forth.final, jnp.array([s.span, 0.0]), accuracy=accuracy)
    # Thousands of steps, each within 1e-10.
    assert_near(back.final, s.state, 3e-7)
    for quantity, drift in forth.drift().items():
        assert float(drift.max()) < 3e-8, quantity


# The way of a batch is that of each system; `test_side_by_side_is_one_by_one` asks all of them.
@pytest.mark.slow
@every
def test_a_batch_is_its_runs(name, key):
    """The runs of a batch agree with single runs, and with their reverse and forward
    derivatives."""
    s = BY_NAME[name]
    states = perturbed(s.state, key, 3)
    ts = jnp.array([0.0, 0.3 * s.span])
    accuracy = Accuracy(rtol=RTOL, method=Tsit5())
    batch = simulate_batch(s.system, states, ts, accuracy=accuracy)
    assert np.all(batch.status == 0)
    for i in range(3):
        single = simulate(s.system, lane(states, i), ts, accuracy=accuracy)
        assert_near(lane(batch.final, i), single.final, 1e-7)


# One of those whose tangents grow from rest; `make fuzz` looks at all.
@pytest.mark.parametrize(
    "name", [pytest.param(s.name, marks=SWEEP[s.name != "two_gimbal_gyro"]) for s in SAMPLES]
)
def test_derivatives_where_the_motion_leaves_nothing_to_resolve(name):
    """At rest, on straight lines, and where parameters are zero; both modes, by every array."""
    found = fuzz_slopes.look(BY_NAME[name])
    assert not [x for x in found if x.wrong]


@pytest.mark.parametrize("name", [s.name for s in CLOSED])
def test_a_closed_form_over_no_time_returns_its_input(name):
    sample = BY_NAME[name]
    flow = eqx.filter_jit(lambda system, t, y: system.closed_form().flow(t, y))
    after = flow(sample.system, jnp.zeros(()), sample.state)
    for a, b in zip(jax.tree.leaves(after), jax.tree.leaves(sample.state), strict=True):
        np.testing.assert_array_equal(a, b)


def formula_behind_a_flow(s):
    """A measure of the state a share u of the span after a start z, and this start: all of order
    one, and so their derivatives."""
    size = scales(s.state)
    start = jax.tree.map(lambda x, size: x / size, s.state, size)

    def measure(u, z):
        y = jax.tree.map(lambda x, size: x * size, z, size)
        after = s.system.closed_form().flow(u * s.span, y)
        after = jax.tree.map(lambda x, size: x / size, after, size)
        # What a formula keeps beside the flow, such as a direction, is a constant to derivatives.
        turned = [
            x.rotate(jnp.array([0.3, -1.0, 0.5]))
            for x in jax.tree.leaves(after, is_leaf=lambda x: isinstance(x, Quaternion))
            if isinstance(x, Quaternion)
        ]
        return sum(jnp.sum(jnp.sin(x + k)) for k, x in enumerate(jax.tree.leaves((after, turned))))

    return measure, start


def rate_along(measure, u, z):
    """The derivative by u, forwards."""
    return jax.jvp(lambda u: measure(u, z), (u,), (1.0,))[1]


@pytest.mark.parametrize(
    "name", [pytest.param(s.name, marks=SWEEP[s.sweep or s.name in LONG]) for s in CLOSED]
)
def test_second_derivatives_of_a_closed_form(name):
    """By the time, and by time and start, of a formula behind the flow: `grad` of `jvp` and `jvp`
    of `grad`, against differences of the gradient."""
    measure, start = formula_behind_a_flow(BY_NAME[name])

    @jax.jit
    def derivatives(u):
        of_rate = jax.grad(functools.partial(rate_along, measure), (0, 1))(u, start)
        return *jax.jvp(lambda u: jax.grad(measure, (0, 1))(u, start), (u,), (1.0,)), of_rate

    def difference(h):
        (ahead, *_), (behind, *_) = derivatives(u + h), derivatives(u - h)
        return jax.tree.map(lambda a, b: (a - b) / (2.0 * h), ahead, behind)

    u, h = 0.3, 1e-5
    _, forward_of_reverse, reverse_of_forward = derivatives(u)
    assert_near(forward_of_reverse, reverse_of_forward, 1e-9)
    # Richardson's extrapolation: of up to 500 radians in the span, truncation (1000 h)^4 / 30 and
    # rounding 1e-14 / h.
    differences = jax.tree.map(lambda a, b: (4.0 * a - b) / 3.0, difference(h), difference(2.0 * h))
    assert_near(reverse_of_forward, differences, 1e-7)


def test_reverse_mode_of_the_rate_of_a_free_rotation():
    """Traced alone, because it is there that constants beside what moves can go wrong; the law
    above has the values, and compiles for long."""
    measure, start = formula_behind_a_flow(BY_NAME["torque_free_principal"])
    jax.eval_shape(jax.grad(functools.partial(rate_along, measure), (0, 1)), 0.3, start)
