"""What solvers declare of themselves, and what they take from the system: against what they do."""

import functools

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix
import pytest
from jax.test_util import check_grads
from jaxtyping import Array, Float

from jaxspace import Scene
from jaxspace.bodies import BodyState, Load
from jaxspace.core import AbstractRegularised, AbstractSplit, AbstractSystem
from jaxspace.orbits import PointGravity
from jaxspace.rotations import Quaternion
from jaxspace.scene import Custom
from jaxspace.simulation import Accuracy, simulate
from jaxspace.solvers import (
    DOP853,
    RKN1210,
    ExponentialRosenbrock,
    MuntheKaas,
    Regularised,
    Splitting,
    Stormer,
    Tsit5,
)
from jaxspace.solvers.embedded_errors import whole_error
from jaxspace.solvers.protocol import bind, linear_errors, refine, solver_traits
from jaxspace.solvers.tolerances import Tolerance

T0, SPEED = 3.0, 2.0
TOLERANCE = Tolerance(jnp.array(1e-7), jnp.array(1e-10), 1)


class Force:
    """The acceleration -r of an oscillator, which counts how often it is evaluated."""

    def __init__(self):
        self.count = 0

        def counted(r):
            self.count += 1
            return r

        @jax.custom_jvp
        def through(r):
            return jax.pure_callback(counted, jax.ShapeDtypeStruct(r.shape, r.dtype), r)

        # The linear part of an exponential method is no evaluation.
        through.defjvp(lambda primals, tangents: (through(*primals), *tangents))
        self.through = through

    def __call__(self, t, r):
        return -self.through(r)


class Split(AbstractSplit):
    force: Force = eqx.field(static=True)

    def drift(self, duration, y):
        return BodyState(y.position + duration * y.velocity, y.velocity)

    def kick(self, t, duration, y):
        return BodyState(y.position, y.velocity + duration * self.force(t, y.position))


class Variables(AbstractRegularised):
    """Position, velocity and time over half the time: no regularisation, but the same protocol."""

    force: Force = eqx.field(static=True)

    def to_regularised(self, y):
        return jnp.concatenate([y.position, y.velocity, jnp.zeros(1)])

    def from_regularised(self, z):
        return BodyState(z[:3], z[3:6])

    def perturbation(self, t, z):
        return self.force(t, z[:3])

    def derivative(self, z, perturbation):
        return 2.0 * jnp.concatenate([z[3:6], perturbation, jnp.ones(1)])

    def fictitious_time(self, duration, z):
        return 0.5 * duration


class Field(eqx.Module):
    """The oscillator in normalised time s: t = 3 + 2 s."""

    force: Force = eqx.field(static=True)

    def __call__(self, s, y):
        a = self.force(self.time(s), y.position)
        return BodyState(SPEED * y.velocity, SPEED * a)

    def time(self, s):
        return T0 + SPEED * s

    def duration(self, s, ds):
        return SPEED * ds

    def projected(self, s, y):
        return y

    def split(self):
        return Split(self.force)

    def regularised(self):
        return Variables(self.force)


TERM = diffrax.ODETerm(lambda s, y, args: args(s, y))


def start():
    return BodyState(jnp.array([1.0, 0.0, 0.5]), jnp.array([0.0, 0.7, 0.0]))


def exact(s):
    """The oscillator at the normalised time s."""
    c, d, y = np.cos(SPEED * s), np.sin(SPEED * s), start()
    return BodyState(c * y.position + d * y.velocity, c * y.velocity - d * y.position)


FIELD = Field(Force())


@eqx.filter_jit
def begin(method, field, s0, s1, y):
    return method.init(TERM, s0, s1, y, field)


@eqx.filter_jit
def go(method, field, s0, s1, y, state):
    # Compiled: evaluations that nothing reads are left out, as in a run.
    y1, error, _, state, _ = method.step(TERM, s0, s1, y, field, state, jnp.array(False))
    return y1, error, state


def step(method, s0=0.0, s1=1.0, y=None, state=None, field=FIELD):
    """The state after one step, its error, and the state of the solver."""
    s0, s1, y = jnp.asarray(s0), jnp.asarray(s1), start() if y is None else y
    state = begin(method, field, s0, s1, y) if state is None else state
    return go(method, field, s0, s1, y, state)


def far(a, b):
    return max(
        float(np.max(np.abs(x - y)))
        for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True)
    )


ADAPTIVE = [DOP853(), Tsit5(), RKN1210(jnp.zeros((0,))), ExponentialRosenbrock()]
EITHER = [Splitting(4, steps=6, estimate=False), Regularised(steps=20, estimate=False)]
FIXED = [
    Stormer(8, steps=40),
    Splitting(2, steps=20),
    Regularised(steps=300),
    *EITHER,
]


@pytest.mark.parametrize("method", [*ADAPTIVE, *FIXED], ids=repr)
def test_a_step_costs_as_many_evaluations_as_declared(method):
    s0, s1 = jnp.array(0.0), jnp.array(1.0)
    state = begin(method, FIELD, s0, s1, start())
    before = FIELD.force.count
    jax.block_until_ready(go(method, FIELD, s0, s1, start(), state))
    assert FIELD.force.count - before == solver_traits(method).evaluations


@pytest.mark.parametrize("method", ADAPTIVE, ids=repr)
def test_a_step_needs_only_the_state_before_it(method):
    middle, _, state = step(method, 0.0, 0.1)
    carried = step(method, 0.1, 0.2, middle, state)[0]
    repeated = step(method, 0.1, 0.2, middle)[0]
    # Some roundings: Tsit5 evaluates its first stage in another program.
    assert far(carried, repeated) < 1e-14


@pytest.mark.parametrize("method", FIXED, ids=repr)
def test_a_fixed_step_method_passes_a_segment_in_seconds_and_refines(method):
    """The fields are in normalised time, drift, kick and regularised variables in seconds."""
    coarse, fine = (far(step(m)[0], exact(1.0)) for m in (method, refine(method, 2)))
    assert solver_traits(refine(method, 2)).steps == 2 * solver_traits(method).steps
    assert coarse < 5e-2
    # A quarter for order 2; rounding for those that are already exact.
    assert fine < max(0.26 * coarse, 1e-13)


def test_a_regularised_step_sees_the_perturbation_within_the_segment_only():
    class Ending(Force):
        def __call__(self, t, r):
            inside = (t >= T0) & (t < T0 + SPEED)
            return jnp.where(inside, -r, jnp.nan)

    assert far(step(Regularised(steps=20), field=Field(Ending()))[0], exact(1.0)) < 1e-6


def test_traits_of_the_room():
    kinds = {
        method: solver_traits(method)[:3]
        for method in (DOP853(), Tsit5(), RKN1210(), ExponentialRosenbrock(), MuntheKaas())
    }
    assert kinds.pop(ExponentialRosenbrock()) == (True, False, "")
    assert set(kinds.values()) == {(False, False, "")}
    assert solver_traits(Stormer(steps=30))[:3] == (False, True, "")
    assert solver_traits(Splitting(steps=30))[:3] == (True, True, "split")
    assert solver_traits(Regularised(steps=32))[:3] == (True, True, "regularised")
    assert solver_traits(MuntheKaas(ExponentialRosenbrock())).lands_on_save_times


def test_traits_of_the_solvers_of_diffrax():
    assert solver_traits(diffrax.Dopri8()) == (False, False, "", 13, 1, False, False)
    # The last of the seven stages is the first one of the next step.
    assert solver_traits(diffrax.Tsit5()) == (False, False, "", 6, 1, False, False)
    # A step and two halves of it, each with six stages.
    half = solver_traits(diffrax.HalfSolver(diffrax.Tsit5()))
    assert half == (False, False, "", 18, 1, False, False)
    assert solver_traits(diffrax.HalfSolver(Stormer(steps=30))).fixed_step


def bound(method, save_ts=None):
    return bind(method, tolerance=TOLERANCE, save_ts=save_ts, run_axes=1)


def test_an_estimate_of_errors_is_differentiable_and_has_linear_parts():
    """Of y' = -k y^2 with a quaternion beside it: both modes of derivative of the estimate against
    differences, and the estimate from its parts. At rest the parts alone have derivatives."""
    y0 = {"y": jnp.array([1.0, 2.0]), "q": Quaternion(jnp.array([1.0, 0.0, 0.0, 0.0]))}

    def rate(t, y, k):
        omega = k * jnp.array([jnp.sin(3.0 * t), 0.2, 0.1 * t])
        return {"y": -k * y["y"] ** 2, "q": y["q"].rate(omega)}

    def error(k, method):
        given = (diffrax.ODETerm(rate), jnp.array(0.0), jnp.array(0.7), y0, k)
        found = method.step(*given, method.init(*given[:4], k), jnp.array(False))[1]
        return jnp.concatenate([jnp.ravel(x) for x in jax.tree.leaves(found)])

    for method in (DOP853(dense=False), MuntheKaas(DOP853(dense=False))):
        k = jnp.array(0.8)
        # Differences at 1e-5 of an estimate of 1e-6 to 1e-3.
        check_grads(lambda k, m=method: 1e3 * error(k, m), (k,), 1, ("fwd", "rev"), 1e-6, 1e-6)
        in_parts = linear_errors(method)
        given = (diffrax.ODETerm(rate), jnp.array(0.0), jnp.array(0.7), y0, k)
        parts = in_parts.step(*given, in_parts.init(*given[:4], k), jnp.array(False))[1]
        whole = jnp.concatenate([jnp.ravel(x) for x in jax.tree.leaves(whole_error(parts))])
        if isinstance(method, DOP853):
            # On the group the parts are put together in other components.
            np.testing.assert_allclose(whole, error(k, method), rtol=1e-9, atol=1e-15)
        at_rest = jax.jvp(lambda k, m=in_parts: error(k, m), (0.0 * k,), (1.0,))[1]
        assert np.max(np.abs(at_rest)) > 1e-9
        assert np.max(np.abs(jax.jacfwd(lambda k, m=method: error(k, m))(0.0 * k))) == 0.0


def test_a_solver_is_bound_to_what_it_has_to_know():
    ts = jnp.array([0.0, 0.5])
    for wrap in (lambda m: m, MuntheKaas, diffrax.HalfSolver):
        inner = bound(wrap(RKN1210()), ts)
        found = getattr(inner, "solver", inner)
        np.testing.assert_array_equal(found.save_ts, ts)
        assert type(inner) is type(wrap(RKN1210()))
    assert bound(RKN1210()).save_ts.shape == (0,)
    assert bound(ExponentialRosenbrock()).run_axes == 1
    assert bound(DOP853()) == DOP853(dense=False)
    assert bound(DOP853(), ts) == DOP853()
    assert refine(DOP853(), 2) == DOP853()
    assert refine(diffrax.HalfSolver(Stormer(steps=30)), 2).solver.steps == 60


def test_a_root_finder_takes_the_tolerance_unless_it_has_its_own():
    finder = bound(diffrax.Kvaerno5()).root_finder
    assert (float(finder.rtol), float(finder.atol)) == (1e-7, 1e-10)
    own = diffrax.Kvaerno5(root_finder=diffrax.VeryChord(1e-3, 1e-4, optimistix.rms_norm))
    finder = bound(own).root_finder
    assert (finder.rtol, finder.atol) == (1e-3, 1e-4)
    assert finder.norm is optimistix.rms_norm


@pytest.mark.parametrize(
    "method", [pytest.param(EITHER[0], marks=pytest.mark.sweep), EITHER[1]], ids=repr
)
def test_reverse_mode_sees_what_an_effect_closes_over(method):
    """A spring beside a point mass, whose stiffness is no field of the scene."""

    def end(k):
        spring = Custom(
            lambda t, y, body: Load(acceleration_N=-k * y.position),
        )
        y = BodyState(jnp.array([1.0, 0.0, 0.0]), jnp.array([0.0, 1.1, 0.0]))
        accuracy = Accuracy(rtol=1e-3, method=method)
        scene = Scene((PointGravity(1.0), spring))
        ts = jnp.array([0.0, 1.0])
        return simulate(scene, y, ts, accuracy=accuracy, throw=False).final.position[0]

    value, slope = jax.jit(end), jax.jit(jax.grad(end))(0.1)
    # The square of 1e-4, and the roundings of the values over it.
    np.testing.assert_allclose(slope, (value(0.1001) - value(0.0999)) / 2e-4, rtol=1e-7)


class Switched(AbstractSystem):
    """y' = rate - y, and the rate ends after a second of two."""

    rate: Float[Array, ""]

    def vector_field(self, t, y):
        return jnp.where(t < 1.0, self.rate, 0.0) - y

    def invariants(self, t, y):
        return {}

    def breaks(self):
        return jnp.array([1.0])


def test_a_method_of_diffrax_sees_the_field_of_its_segment_alone():
    """At the end of a step, too, where a method of this package does not look."""

    @functools.partial(jax.jit, static_argnums=1)
    def end(rate, method):
        def final(rate):
            accuracy = Accuracy(rtol=1e-9, method=method)
            run = simulate(
                Switched(rate), jnp.asarray(0.0), jnp.array([0.0, 2.0]), accuracy=accuracy
            )
            return run.final, (run.stats["steps"], run.stats["rejected_steps"])

        return jax.value_and_grad(final, has_aux=True)(rate)

    (value, (steps, rejected)), slope = end(jnp.asarray(3.0), diffrax.Tsit5())
    (_, (own_steps, _)), _ = end(jnp.asarray(3.0), Tsit5())
    # The tolerance of a step times their number.
    np.testing.assert_allclose(value, 3.0 * slope, rtol=1e-12)
    np.testing.assert_allclose(slope, (1.0 - np.exp(-1.0)) * np.exp(-1.0), rtol=1e-7)
    # Without a rejection at the jump. Roundings decide whether a step more is needed to its end.
    assert abs(steps - own_steps) <= 1 and rejected == 0
