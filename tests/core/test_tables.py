"""Functions of time given at nodes: their values, and runs, with their gradients, through kinks and
jumps."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array
from scipy.interpolate import CubicSpline

from jaxspace import BodyState, Scene, simulate, simulate_batch
from jaxspace.bodies import Load
from jaxspace.core import AbstractSystem, InputError, Spline, Table
from jaxspace.core.tables import breaks_of, polygon, within
from jaxspace.orbits import PointGravity
from jaxspace.scene import Custom
from jaxspace.simulation import Accuracy, Status
from jaxspace.solvers import DOP853

TIMES = np.array([0.0, 0.7, 1.0, 2.5, 4.0])
VALUES = np.array([1.0, -2.0, 0.5, 3.0, 0.0])
DATA = TIMES, VALUES


@pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev])
def test_a_number_within_limits_has_the_mean_slope_at_them(mode):
    """Of the number and of either limit, which may be infinite."""
    x = jnp.array([-1.0, 0.0, 1.0, 2.0, 3.0])

    def sums(x, low, high):
        return jnp.sum(within(x, low, high))

    np.testing.assert_array_equal(within(x, 0.0, 2.0), [0.0, 0.0, 1.0, 2.0, 2.0])
    of_x, of_low, of_high = mode(sums, argnums=(0, 1, 2))(x, 0.0, 2.0)
    np.testing.assert_array_equal(of_x, [0.0, 0.5, 1.0, 0.5, 0.0])
    assert of_low == of_high == 1.5
    np.testing.assert_array_equal(mode(sums)(x, -jnp.inf, 2.0), [1.0, 1.0, 1.0, 0.5, 0.0])


def test_values_between_nodes_and_beyond_them():
    """Against NumPy and SciPy; with one value for each run, and times for each run."""
    t = np.linspace(-0.5, 4.5, 201)
    within = np.clip(t, TIMES[0], TIMES[-1])
    linear = np.interp(t, TIMES, VALUES)
    cubic = CubicSpline(TIMES, VALUES, bc_type="natural")(within)
    for make, expected in ((Table, linear), (Spline, cubic)):
        np.testing.assert_allclose(jax.vmap(make(TIMES, VALUES))(t), expected, atol=1e-14)
        runs = make(np.stack([TIMES, 2.0 * TIMES], -1), np.stack([VALUES, 3.0 * VALUES], -1))
        found = runs(jnp.stack([jnp.asarray(0.8), jnp.asarray(1.6)]))
        np.testing.assert_allclose(found[1], 3.0 * found[0], rtol=1e-14)
        shared = make(TIMES, np.stack([VALUES, 3.0 * VALUES], -1))(0.8)
        np.testing.assert_allclose(shared, found, rtol=1e-13)
        assert make(np.float32(TIMES), np.float32(VALUES))(jnp.float32(0.8)).dtype == jnp.float32
    assert Spline([0.0, 1.0], [1.0, 2.0])(0.25) == 1.25


@pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev])
@pytest.mark.parametrize("own", [False, True])
def test_derivatives_of_a_polygon_are_those_of_its_sum(mode, own):
    """By the place, the nodes and the values, of tables that the runs share and of their own; first
    and second ones, against the sum over all intervals differentiated term by term."""
    x = jnp.array([-0.5, 0.3, 0.7, 1.9, 4.0, 4.5])
    grow = 1.0 + 0.1 * jnp.arange(6.0) if own else 1.0
    nodes, values = (jnp.asarray(a)[:, None] * grow if own else jnp.asarray(a) for a in DATA)
    weights = jnp.linspace(1.0, 2.0, 6)

    def by_terms(x, nodes, values):
        nodes, values = (a.reshape(5, -1) for a in (nodes, values))
        widths = jnp.diff(nodes, axis=0)
        terms = jnp.diff(values, axis=0) / widths * within(x - nodes[:-1], 0.0, widths)
        return jnp.sum(weights * (values[0] + jnp.sum(terms, axis=0)) ** 2)

    def whole(x, nodes, values):
        return jnp.sum(weights * polygon(x, nodes, values) ** 2)

    every = (0, 1, 2)
    # At a node a second derivative is none: there it is looked at beside it.
    for wrap, at in (
        (mode, x),
        (lambda f, argnums: jax.jacfwd(mode(f, argnums), argnums), x + 1e-3),
    ):
        found, expected = (wrap(f, argnums=every)(at, nodes, values) for f in (whole, by_terms))
        # Sums of some dozen terms of about ten, in another order.
        jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-12), found, expected)
    # One of them alone, in single precision.
    x, nodes, values = (jnp.asarray(a, jnp.float32) for a in (x, nodes, values))
    slopes = mode(lambda x: jnp.sum(polygon(x, nodes, values)))(x)
    assert slopes.dtype == jnp.float32 and np.isfinite(slopes).all()


class Push(eqx.Module):
    """A push along x that follows a table, as the function of an effect."""

    control: Table | Spline

    def __call__(self, t, y, body):
        push = self.control(t)
        push = push * jnp.array([1.0, 0.0, 0.0]).reshape(3, *(1,) * jnp.ndim(push))
        return Load(acceleration_N=push + 0.0 * y.position)


def scene(control, *effects):
    return Scene((Custom(Push(control)), *effects))


def test_the_nodes_are_breaks_wherever_the_table_is():
    control = Table(TIMES, VALUES)
    np.testing.assert_array_equal(breaks_of(scene(control)), TIMES)
    hidden = Custom(lambda t, y, body: Push(control)(t, y, body))
    np.testing.assert_array_equal(breaks_of(Scene((hidden,))), TIMES)
    assert breaks_of(Scene((PointGravity(1.0),))) is None


def test_the_gradient_of_a_run_through_a_table_is_right():
    """Of the end of a flight under gravity by 31 values of its control, against differences."""
    nodes = np.linspace(0.0, 3.0, 31)
    values = 0.2 * np.sin(2.0 * nodes)
    y0 = BodyState(jnp.array([1.0, 0.0, 0.0]), jnp.array([0.0, 1.1, 0.0]))

    @jax.jit
    def end(values):
        flight = scene(Table(nodes, values), PointGravity(1.0))
        return simulate(flight, y0, jnp.array([0.0, 3.0]), accuracy=1e-11).final.position[0]

    slopes = jax.grad(end)(jnp.asarray(values))
    for k in (0, 7, 16, 30):
        h = 1e-4 * np.eye(31)[k]
        # A central difference of runs good to 1e-11: 1e-7 from both, against slopes of 0.1.
        np.testing.assert_allclose(
            slopes[k], (end(values + h) - end(values - h)) / 2e-4, rtol=0.0, atol=2e-8
        )


def test_the_gradient_of_a_run_through_a_spline_is_right():
    """Of x(T) = int (T - t) u(t) dt by every value of u, in closed form."""
    y0 = BodyState(jnp.zeros(3), jnp.zeros(3))

    def end(values):
        flight = scene(Spline(TIMES, values))
        return simulate(flight, y0, jnp.array([0.0, 4.0]), accuracy=1e-9).final.position[0]

    value, slopes = jax.jit(jax.value_and_grad(end))(jnp.asarray(VALUES))
    exact = []
    for k in range(5):
        hill = CubicSpline(TIMES, np.eye(5)[k], bc_type="natural")
        exact.append(hill.antiderivative(2)(4.0))
    # A polynomial of degree three between the nodes: the method integrates it exactly.
    np.testing.assert_allclose(slopes, exact, atol=1e-12)
    np.testing.assert_allclose(value, np.dot(exact, VALUES), rtol=1e-12)


def test_the_runs_of_a_batch_have_tables_of_their_own():
    values = np.stack([VALUES, 2.0 * VALUES, -VALUES], -1)
    y0s = BodyState(jnp.zeros((3, 3)), jnp.zeros((3, 3)))
    run = simulate_batch(scene(Table(TIMES, values)), y0s, jnp.array([0.0, 4.0]))
    x = np.asarray(run.final.position[0])
    np.testing.assert_allclose(x / x[0], [1.0, 2.0, -1.0], rtol=1e-12)


@pytest.mark.parametrize(
    ("times", "values", "sentence"),
    [
        ([0.0, 1.0, 1.0], [0.0, 1.0, 2.0], "Table.times is .* it must be ascending"),
        ([0.0, 1.0], [0.0, 1.0, 2.0], "it must have the same number of both, at least two"),
        ([0.0], [0.0], "at least two"),
        ([0.0, 1.0], [0.0, np.nan], "Table.values is .* it must be finite"),
    ],
)
def test_tables_that_are_none_are_refused(times, values, sentence):
    with pytest.raises(InputError, match=sentence):
        Table(times, values)


class Switch(AbstractSystem):
    """dy/dt = 3 until the time `at`, then -1; which of them at that time itself does not matter."""

    at: Array
    late: bool = eqx.field(static=True)

    def vector_field(self, t, y):
        first = t <= self.at if self.late else t < self.at
        return jnp.where(first, 3.0, -1.0) * jnp.ones_like(y)

    def invariants(self, t, y):
        return {}

    def breaks(self):
        return self.at[None]


@pytest.mark.parametrize("late", [False, True])
def test_a_step_that_begins_or_ends_at_a_break_sees_its_own_side(late):
    """Forwards and backwards, wherever the break lies: the polygon is exact, from step to step and
    within the step that begins at the break."""

    @jax.jit
    def integrate(at, start, end):
        ts = jnp.stack([start, end])
        system, accuracy = Switch(at, late), Accuracy(rtol=1e-12, method=DOP853())
        there = simulate(system, jnp.ones(1), ts, accuracy=accuracy, dense=True, throw=False)
        back = simulate(system, there.final, ts[::-1], accuracy=accuracy, throw=False)
        within = there.at(at + 1e-3 * (end - start))
        return there, back, jnp.concatenate([there.final, back.final, within])

    for at, start, end in ((10.0, 0.0, 20.0), (17.4, 0.0, 31.7), (700_012.7, 700_000.3, 700_021.1)):
        there, back, found = integrate(at, start, end)
        assert there.status == back.status == Status.COMPLETED
        assert there.stats["rejected_steps"] == back.stats["rejected_steps"] == 0
        highest = 1.0 + 3.0 * (at - start)
        expected = [highest - (end - at), 1.0, highest - 1e-3 * (end - start)]
        # The times are rounded to a unit in the last place of the start.
        np.testing.assert_allclose(found, expected, rtol=1e-13, atol=4e-16 * (1.0 + 4.0 * end))
