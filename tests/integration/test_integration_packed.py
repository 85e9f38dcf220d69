"""States that are integrated as one vector: the same steps, errors, events and derivatives as block
by block."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace import BodyState, simulate
from jaxspace.core import AbstractSystem
from jaxspace.integration import _integration, programs
from jaxspace.integration._packed import Packing
from jaxspace.integration.field_trace import evaluate_field
from jaxspace.rotations import Quaternion
from jaxspace.simulation import Accuracy, Event, Status
from jaxspace.solvers import DOP853, RKN1210, ExponentialRosenbrock, MuntheKaas
from jaxspace.solvers.embedded_errors import EmbeddedErrors
from jaxspace.solvers.protocol import solver_traits
from jaxspace.solvers.tolerances import Tolerance

ACCURACY = Accuracy(rtol=1e-8, atol=1e-8, method=DOP853(rolled=True))
TIMES = jnp.array([0.0, 0.8, 1.5, 9.0])
GROUND = Event(lambda t, y: y.position[2])


class Fall(AbstractSystem):
    """A turning ball that drag slows and that loses mass.

    `packed` changes nothing but the structure, so that no program serves both."""

    packed: bool = eqx.field(static=True)

    def vector_field(self, t, y):
        speed = jnp.sqrt(jnp.sum(y.velocity * y.velocity, axis=0))
        return BodyState(
            position=y.velocity,
            velocity=jnp.array([0.0, 0.0, -9.81]) - 0.02 / y.mass * speed * y.velocity,
            attitude=y.attitude.rate(y.omega),
            omega=jnp.cross(jnp.array([1.0, 2.0, 3.0]) * y.omega, y.omega),
            mass=-0.1 * jnp.sqrt(y.mass),
        )

    def invariants(self, t, y):
        return {}


def thrown(speed):
    return BodyState(
        position=jnp.array([0.0, 0.0, 10.0]),
        velocity=jnp.stack([3.0 + 0.0 * speed, 1.0 + 0.0 * speed, speed]),
        attitude=Quaternion(jnp.array([1.0, 0.0, 0.0, 0.0])),
        omega=jnp.array([0.3, 1.0, 0.2]),
        mass=jnp.array(2.0),
    )


@pytest.fixture(scope="module")
def both():
    """A throw to the ground with its slopes by the speed, packed and block by block."""

    def found(packed):
        def fall(speed):
            run = simulate(Fall(packed), thrown(speed), TIMES, accuracy=ACCURACY, events=(GROUND,))
            return (run.ts, run.states), (run.status, run.stats)

        def slopes(speed):
            (_, left), slope = eqx.filter_jvp(fall, (speed,), (jnp.ones_like(speed),))
            return fall(speed), left, slope[0]

        return jax.jit(slopes)(jnp.array(12.0))

    with pytest.MonkeyPatch.context() as patch:
        # As if the field were large.
        patch.setitem(programs.ROLLED_FROM, programs.Runs.ONE, programs.Limit(0, ""))
        packed = found(True)
        patch.setattr(_integration.Integration, "_packing", None)
        return packed, found(False)


def test_a_packed_run_takes_the_same_steps(both):
    # The error of a step is that of the worst block, in either form.
    (_, (status, stats)), _, _ = both[0]
    (_, (_, others)), _, _ = both[1]
    assert status == Status.EVENT
    for name in ("steps", "rejected_steps", "evaluations"):
        assert stats[name] == others[name]
    np.testing.assert_allclose(stats["largest_local_error"], others["largest_local_error"], 1e-6)


def test_a_packed_run_has_the_same_states_event_and_slopes(both):
    ((numbers, _), _, slopes), ((others, _), _, other_slopes) = both
    # Sums in another order: some roundings of the largest number, 1e3 times that of the smallest.
    for a, b in zip(jax.tree.leaves(numbers), jax.tree.leaves(others), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-11, atol=1e-11)
    for a, b in zip(jax.tree.leaves(slopes), jax.tree.leaves(other_slopes), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("times", [(), (4,)])
def test_a_state_comes_back_from_its_vector(times):
    y = thrown(jnp.array(1.0))
    packing = Packing.of(y)
    vector = packing.vector(y)
    assert vector.shape == (14,) and packing.sizes == (3, 3, 4, 3, 1)
    along = jnp.broadcast_to(vector[:, *(None,) * len(times)], (14, *times))
    states = jax.tree.map(lambda x: x[..., 0] if times else x, packing.state(along))
    assert eqx.tree_equal(states, y)


@pytest.mark.parametrize("solver", [MuntheKaas(), RKN1210(), ExponentialRosenbrock()])
def test_a_method_that_looks_at_blocks_is_not_packed(solver):
    assert not solver_traits(solver).linear


def test_the_error_is_that_of_the_worst_block():
    rng = np.random.default_rng(3)
    y0, y1, error = (
        jax.tree.map(lambda x: jnp.asarray(rng.normal(size=(*x.shape, 5))), thrown(jnp.array(1.0)))
        for _ in range(3)
    )
    packing = Packing.of(thrown(jnp.array(1.0)))
    blocks = Tolerance(1e-3, 1e-4, 1).error(y0, y1, error)
    packed = Tolerance(1e-3, 1e-4, 1, packing.sizes).error(*map(packing.vector, (y0, y1, error)))
    np.testing.assert_allclose(packed, blocks, rtol=1e-13)


@pytest.mark.parametrize(("dtype", "size"), [(float, 1.0), (jnp.float32, 1e-12)])
def test_an_error_in_parts_is_that_of_its_components_together(dtype, size):
    """Against the formula, in single precision of errors whose fourth powers it cannot hold; one
    run is at rest."""
    rng, ball = np.random.default_rng(4), thrown(jnp.array(1.0))
    packing = Packing.of(ball)

    def some(scale):
        def leaf(x):
            drawn = scale * rng.normal(size=(*x.shape, 5)) * (np.arange(5) > 0)
            return jnp.asarray(drawn, dtype)

        return jax.tree.map(leaf, ball)

    y0, y1, fifth, third = some(1e-3 * size), some(1e-3 * size), some(size), some(30.0 * size)
    error = jax.tree.map(EmbeddedErrors, fifth, third)
    atol = jnp.asarray(1e-3 * size, dtype)

    def ratio(a, b, e5, e3):
        a, b, e5, e3 = (np.float64(x) for x in (a, b, e5, e3))
        if a.ndim == 1:
            a, b, e5, e3 = a[None], b[None], e5[None], e3[None]
        bottom = np.sqrt(e5**2 + 0.01 * e3**2)
        whole = np.divide(e5**2, bottom, out=np.zeros_like(e5), where=bottom > 0.0)
        longest = np.maximum(*(np.linalg.norm(x, axis=0) for x in (a, b)))
        return np.linalg.norm(whole, axis=0) / (np.float64(atol) + 1e-3 * longest)

    expected = np.max(jax.tree.leaves(jax.tree.map(ratio, y0, y1, fifth, third)), axis=0)
    found = Tolerance(1e-3, atol, 1).error(y0, y1, error)
    vectors = EmbeddedErrors(packing.vector(fifth), packing.vector(third))
    starts = map(packing.vector, (y0, y1))
    packed = Tolerance(1e-3, atol, 1, packing.sizes).error(*starts, vectors)
    assert expected[0] == 0.0 and np.all(expected[1:] > 1.0)
    # Some tens of roundings.
    for ours in (found, packed):
        np.testing.assert_allclose(ours, expected, rtol=50.0 * float(jnp.finfo(dtype).eps))


def test_a_block_that_is_not_finite_fails_its_run_alone():
    y = jnp.ones((14, 2)).at[3, 1].set(jnp.inf)
    error = Tolerance(1e-3, 1e-4, 1, (3, 3, 4, 3, 1)).error(jnp.ones((14, 2)), y, y)
    assert np.isfinite(error[0]) and np.isinf(error[1])


class Count:
    """How many times something was done."""

    times = 0


class Pulled(AbstractSystem):
    """A point under a pull, a function of its distance, which may close over anything."""

    pull: Callable
    traced: Count = eqx.field(static=True)

    def vector_field(self, t, y):
        self.traced.times += 1
        return {"x": y["v"], "v": -self.pull(y["x"])}

    def invariants(self, t, y):
        return {}


def test_a_field_is_evaluated_by_its_trace():
    y = {"x": jnp.array(0.5), "v": jnp.array(2.0)}
    system = Pulled(jnp.sin, Count())

    def rate(x):
        once, again = (evaluate_field(system, jnp.zeros(()), {**y, "x": x}) for _ in range(2))
        return 0.5 * (once["v"] + again["v"])

    value, slope = jax.jit(lambda x: jax.value_and_grad(rate)(x))(0.5)
    assert system.traced.times == 1
    np.testing.assert_allclose((value, slope), (-np.sin(0.5), -np.cos(0.5)), rtol=1e-15)

    def of_factor(k):
        # The pull holds a tracer, which the next trace must not meet.
        return evaluate_field(Pulled(lambda x: k * x, Count()), jnp.zeros(()), y)["v"]

    for k in (2.0, 3.0):
        assert jax.value_and_grad(of_factor)(k) == (-0.5 * k, -0.5)
