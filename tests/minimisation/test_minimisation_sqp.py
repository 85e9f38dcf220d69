"""Sequential quadratic programming, bounds, several starts, and reasons for stopping, on problems
with known optima."""

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array
from scipy.optimize import minimize_scalar

from jaxspace.core import AbstractSystem, InputError, Scalar
from jaxspace.minimisation import Criterion, StopReason, minimise, minimise_from
from jaxspace.minimisation._drive import drive
from jaxspace.optimization.steering import minimum_time_steering
from jaxspace.simulation import Accuracy, Event, simulate_batch
from jaxspace.solvers import Tsit5


def search(problem, start, **options):
    return jax.jit(lambda x: minimise(problem, x, **options))(start)


def hock_71(x):
    """Hock and Schittkowski, problem 71."""
    return Criterion(
        x[0] * x[3] * (x[0] + x[1] + x[2]) + x[2], jnp.sum(x * x) - 40.0, jnp.prod(x)[None] - 25.0
    )


def test_bounds_and_constraints():
    """The optimum 17.0140173 with x_0 at its bound, by quadratic programmes; its multipliers are
    the derivatives of the optimum."""
    found = search(hock_71, jnp.array([1.0, 5.0, 5.0, 1.0]), bounds=(1.0, 5.0))
    assert found.converged and found.sentence().startswith("Converged after 8 steps")
    np.testing.assert_allclose(found.criterion.objective, 17.0140172891563, rtol=1e-12)
    expected = [1.0, 4.7429996, 3.8211500, 1.3794083]
    np.testing.assert_allclose(found.x, expected, rtol=1e-7)
    np.testing.assert_allclose(found.multipliers.equal_zero, 0.1614686, rtol=1e-6)
    np.testing.assert_allclose(found.multipliers.non_negative, [0.5522937], rtol=1e-6)
    np.testing.assert_allclose(found.bound_multipliers, [1.0878712, 0, 0, 0], rtol=1e-6, atol=1e-7)
    rows = np.asarray(found.history)
    assert np.all(np.isfinite(rows[:8])) and np.all(np.isnan(rows[8:]))


def test_units_do_not_matter():
    """The same problem with other units for unknowns, objective and constraints: the same search,
    with the multipliers in those units. Powers of two change no digit."""
    x, f, c, d = 2.0**20, 2.0**-30, 2.0**15, 2.0**-12

    # One program for both: the units are numbers that it is given.
    @jax.jit
    def searched(x, f, c, d):
        def rescaled(y):
            found = hock_71(y / x)
            equal, above = jnp.asarray(found.equal_zero), jnp.asarray(found.non_negative)
            return Criterion(f * found.objective, c * equal, d * above)

        start = x * jnp.array([1.0, 5.0, 5.0, 1.0])
        return minimise(rescaled, start, bounds=(x, 5.0 * x))

    plain, other = searched(1.0, 1.0, 1.0, 1.0), searched(x, f, c, d)
    assert plain.converged and other.converged
    assert int(plain.steps) == int(other.steps)
    pairs = [
        (plain.x, other.x / x),
        (plain.criterion.objective, other.criterion.objective / f),
        (plain.multipliers.equal_zero, other.multipliers.equal_zero * c / f),
        (plain.multipliers.non_negative, other.multipliers.non_negative * d / f),
        (plain.bound_multipliers, other.bound_multipliers * x / f),
        (plain.history[:, 0], other.history[:, 0] / f),
    ]
    for one, two in pairs:
        np.testing.assert_allclose(two, one, rtol=1e-12, atol=1e-12)
    # The textbook's.
    np.testing.assert_allclose(plain.multipliers.equal_zero, 0.1614686, rtol=1e-6)
    np.testing.assert_allclose(plain.multipliers.non_negative, [0.5522937], rtol=1e-6)


def test_bounds_of_a_tree():
    """One number at its lower bound, one within, one above a bound of its own."""

    def problem(p):
        x, y = p["x"], p["y"]
        return Criterion((x[0] + 1.0) ** 2 + (x[1] - 0.3) ** 2 + (y - 2.0) ** 2)

    bounds = (
        {"x": jnp.array([0.0, 0.0]), "y": jnp.array(-jnp.inf)},
        {"x": jnp.array([1.0, 1.0]), "y": jnp.array(1.5)},
    )
    start = {"x": jnp.array([0.0, 0.9]), "y": jnp.array(-3.0)}
    found = search(problem, start, bounds=bounds)
    assert found.converged and int(found.reason) == StopReason.CONVERGED
    np.testing.assert_allclose(found.x["x"], [0.0, 0.3], atol=1e-8)
    np.testing.assert_allclose(found.x["y"], 1.5, atol=1e-8)
    np.testing.assert_allclose(found.bound_multipliers["x"], [2.0, 0.0], atol=1e-7)
    np.testing.assert_allclose(found.bound_multipliers["y"], -1.0, atol=1e-7)
    with pytest.raises(InputError, match="the lower one must be below"):
        minimise(problem, start, bounds=(1.0, 0.0))


def test_an_infeasible_target_ends_at_what_can_be_reached():
    """x <= 1 and x >= 2 + y^2: the least sum of violations, on the line y = 0."""

    def problem(x):
        return Criterion(x[1] + x[0], None, jnp.stack([1.0 - x[0], x[0] - 2.0 - x[1] ** 2]))

    found = search(problem, jnp.array([0.5, 3.0]))
    assert not found.converged and int(found.reason) == StopReason.INFEASIBLE
    sentence = found.sentence()
    assert "cannot be satisfied" in sentence
    np.testing.assert_allclose(found.x[1], 0.0, atol=1e-5)
    # Every constraint that is not met with its value, and no other.
    for k, (value, unmet) in enumerate(
        zip(found.criterion.non_negative, found.unmet[1], strict=True)
    ):
        assert bool(unmet) == bool(value < -1e-5)
        assert (
            f"non_negative[{k}] is {value:.3g} where at least 0 is required" in sentence
        ) == unmet
    assert np.all(np.isfinite(found.x)) and 0.5 - 1e-6 < found.violation < 1.0 + 1e-6


def test_of_many_targets_those_out_of_reach_are_named():
    """x within 1 of zero, whose five components are asked to be 3, 0, 4e-6, -7 and 0.5, the third
    in units of 1e-6 of the others; the bounds hold the first, third and fourth."""
    asked = jnp.array([3.0, 0.0, 4e-6, -7.0, 0.5])
    unit = jnp.array([1.0, 1.0, 1e-6, 1.0, 1.0])

    def problem(x):
        return Criterion(jnp.sum(x * x), unit * x - asked)

    # One program for both searches.
    within = jax.jit(lambda x, most: minimise(problem, x, bounds=(-most, most)))
    found = within(jnp.full(5, 0.1), 1.0)
    assert int(found.reason) == StopReason.INFEASIBLE
    np.testing.assert_array_equal(found.unmet[0], [True, False, True, True, False])
    assert "equal_zero[2] is -3e-06 where 0 is required, equal_zero[3] is 6" in found.sentence()
    converged = within(0.1 * asked, jnp.inf)
    assert converged.converged and not np.any(converged.unmet[0])


def on_a_shell(x):
    """The least sum on a sphere, the radius of which float32 does not hold to ten digits."""
    return Criterion(jnp.sum(x), jnp.stack([x @ x - 40.1, x[0] * x[1] - 1.3]))


def test_a_search_that_stops_short_is_not_infeasible():
    """A problem that can be met, as float64 does: with float32 beyond its digits, and with too few
    steps, the sentence names what is missing and what helps."""
    start = jnp.array([2.0, 3.0, 4.0])
    assert search(on_a_shell, start).converged
    # 1e-12 of numbers of the order of one, of which float32 has seven digits.
    rough = search(on_a_shell, start.astype(jnp.float32), tolerance=1e-12)
    assert not rough.converged and int(rough.reason) == StopReason.NO_PROGRESS
    # What is missing may be the gradient alone.
    assert rough.violation < 1e-4 and (rough.violation > 0.0) == np.any(rough.unmet[0])
    sentence = rough.sentence()
    assert "the tolerance 1.0e-12 is not reached" in sentence and "compute in float64" in sentence
    few = search(on_a_shell, start, max_steps=2)
    assert int(few.reason) == StopReason.STEP_LIMIT and few.violation > 1e-3
    sentence = few.sentence()
    assert "where 0 is required. Increase max_steps, or start closer." in sentence
    # An unknown that starts at zero has the size 1, whatever those of the others.
    uneven = dataclasses.replace(few, search=few.search._replace(size=jnp.array([7.0, 1.0, 2e4])))
    assert uneven.sentence() == (
        f"{sentence} x[1] has the scale 1, because it starts near zero, and x[2] has 2e+04: pass "
        "typical changes with minimise(scale=...)."
    )
    assert f"equal_zero[0] is {few.criterion.equal_zero[0]:.3g}" in sentence


@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])
def test_circles_that_do_not_meet_are_infeasible_in_any_precision(dtype):
    """Unit circles, three apart: on the line between them no step brings one nearer without
    leaving the other, and the gradient of the squared violation vanishes where the multipliers
    end: (x^2 - 1)^2 + ((x - 3)^2 - 1)^2 at x = 3/2 is 2 (5/4)^2. From starts beside the line,
    inside of a circle and outside, since rounding decides where a search of so flat a sum ends."""
    far = jnp.array([3.0, 0.0], dtype)

    def problem(x):
        return Criterion(x[0], jnp.stack([x @ x - 1.0, (x - far) @ (x - far) - 1.0]))

    # One program for all starts.
    search_from = jax.jit(lambda x: minimise(problem, x))
    for start in ([0.5, 0.5], [-0.48, 0.46], [0.64, -0.79], [2.88, 0.083], [3.17, 0.94]):
        found = search_from(jnp.array(start, dtype))
        assert int(found.reason) == StopReason.INFEASIBLE, start
        assert "cannot be satisfied" in found.sentence()
        assert abs(found.x[1]) < 1e-2


def test_a_far_target_is_no_infeasible_one():
    """A thousand sizes of the unknown away, with four steps: the slope does not vanish, although
    a step reduces little of the violation."""
    found = search(lambda x: Criterion(x * x, x - 1e5), jnp.asarray(0.5), max_steps=4)
    assert int(found.reason) == StopReason.STEP_LIMIT


def tangent_burn(x):
    """The linear-tangent problem: tan phi = a + b t with the acceleration 100 from rest to the
    height 5 and the velocity (45, 0) in the least time, integrals in closed form."""
    start, end, time = x
    low, high = jnp.arcsinh(start), jnp.arcsinh(end)
    rate = (end - start) / time
    across = 100.0 * (high - low) / rate
    up = 100.0 * (jnp.cosh(high) - jnp.cosh(low)) / rate

    def twice(s):
        # The integral of sqrt(1 + q^2) over q, for q = sinh s.
        return 0.5 * (s + 0.5 * jnp.sinh(2.0 * s))

    height = 100.0 * ((twice(high) - twice(low)) / rate - time * jnp.cosh(low)) / rate
    return Criterion(time, jnp.stack([across - 45.0, up, height - 5.0]))


def test_linear_tangent_steering_in_the_least_time():
    """0.5545709 (Betts): 1e-5 of the optimum is wanted."""
    found = search(tangent_burn, jnp.array([0.5, -0.5, 1.0]))
    assert found.converged
    exact = minimum_time_steering(100.0, 5.0, 45.0)
    np.testing.assert_allclose(found.x[2], exact.duration, rtol=1e-9)
    np.testing.assert_allclose(jnp.arctan(found.x[0]), exact.initial_angle, rtol=1e-8)


@pytest.mark.sweep
def test_several_starts():
    """A wave on a bowl, with five minima: the best of five starts is the lowest."""

    def problem(x):
        return Criterion(0.05 * (x[0] - 1.0) ** 2 - jnp.cos(3.0 * x[0]), x[1] - x[0])

    starts = jnp.stack([jnp.linspace(-5.0, 5.0, 5), jnp.zeros(5)])
    best, every = minimise_from(problem, starts)
    assert every.x.shape == (2, 5) and bool(jnp.all(every.converged))
    grid = np.linspace(-5.0, 5.0, 200001)
    lowest = np.min(0.05 * (grid - 1.0) ** 2 - np.cos(3.0 * grid))
    np.testing.assert_allclose(best.criterion.objective, lowest, atol=1e-8)


@pytest.mark.sweep
@pytest.mark.parametrize("exact", [False, True])
def test_hard_valleys(exact):
    """Rosenbrock's valley and Maratos' problem, where full steps raise both objective and
    violation."""
    valley = search(
        lambda x: Criterion(100.0 * (x[1] - x[0] ** 2) ** 2 + (1.0 - x[0]) ** 2),
        jnp.array([-1.2, 1.0]),
        exact_hessian=exact,
    )
    assert valley.converged
    np.testing.assert_allclose(valley.x, [1.0, 1.0], atol=1e-6)
    ring = search(
        lambda x: Criterion(2.0 * (x @ x - 1.0) - x[0], x @ x - 1.0),
        jnp.array([0.8, 0.6]),
    )
    assert ring.converged and int(ring.steps) < 20
    np.testing.assert_allclose(ring.x, [1.0, 0.0], atol=1e-7)
    np.testing.assert_allclose(ring.multipliers.equal_zero, -1.5, rtol=1e-6)


def valley(x):
    return Criterion(100.0 * (x[1] - x[0] ** 2) ** 2 + (1.0 - x[0]) ** 2, x[0] + x[1] - 1.5)


class Counted(NamedTuple):
    """A search that counts its steps."""

    taken: Array


def test_an_interruption_before_the_first_step_is_passed_on():
    """Nothing is known that a result could tell, as which of the unknowns matter."""

    def stopped(state: Counted, evaluation: Array) -> Counted:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        drive(lambda s: s.taken, stopped, lambda s: s.taken < 3, Counted(jnp.asarray(0)), print)


def test_a_search_is_watched_and_goes_on():
    """It is interrupted after two steps, goes on where it stood, and ends where it would
    have ended."""
    start, rows = jnp.array([-1.2, 1.0]), []

    def watch(number, objective, violation, gradient):
        rows.append((number, objective, violation, gradient))
        if len(rows) == 2:
            raise KeyboardInterrupt

    straight = minimise(valley, start)
    begun = minimise(valley, start, progress=watch)
    assert int(begun.reason) == StopReason.INTERRUPTED and not begun.converged
    assert begun.sentence().startswith("Interrupted after ")
    found = minimise(valley, begun)
    assert found.converged
    np.testing.assert_allclose(found.x, straight.x, rtol=1e-12)
    assert int(found.steps) == int(straight.steps)
    taken = int(jnp.sum(~jnp.isnan(straight.history[:, 0])))
    np.testing.assert_array_equal(found.history[:taken], straight.history[:taken])
    assert [row[0] for row in rows] == [1, 2]
    # The figure holds what was taken.
    (line,) = found.plot("valley").axes[0].lines
    assert len(line.get_xdata()) == taken


@pytest.mark.sweep
def test_maratos_with_the_exact_curvature():
    """Full steps raise both objective and violation: with the exact Hessian the correction keeps
    the convergence of second order. A step and its correction are two."""
    found = search(
        lambda x: Criterion(2.0 * (x @ x - 1.0) - x[0], x @ x - 1.0),
        jnp.array([0.8, 0.6]),
        exact_hessian=True,
    )
    assert found.converged and int(found.steps) <= 12
    np.testing.assert_allclose(found.x, [1.0, 0.0], atol=1e-8)


RUNS, ENERGY, TARGET = 400, 1.2, 1.0
PUSH = 0.02 + 0.05 * np.random.default_rng(1).normal(size=RUNS)


class Shot(AbstractSystem):
    """A shot under unit gravity, which the wind pushes along with a constant acceleration."""

    push: Scalar

    def vector_field(self, t, y):
        return {"u": self.push, "v": -1.0 + 0.0 * self.push, "x": y["u"], "z": y["v"]}

    def invariants(self, t, y):
        return {}


def misses(p):
    """How far beyond the target each of the dispersed shots lands, flown up to the ground."""
    ground = Event(lambda t, y: y["z"], direction=-1, within=4.0)
    start = {"u": p["u"], "v": p["v"], "x": 0.0, "z": 0.0}
    y0s = jax.tree.map(lambda x: jnp.full(RUNS, x), start)
    ts = jnp.array([0.0, 4.0])
    accuracy = Accuracy(1e-9, method=Tsit5(), max_steps=64)
    flown = simulate_batch(Shot(jnp.asarray(PUSH)), y0s, ts, events=(ground,), accuracy=accuracy)
    return flown.final["x"] - TARGET


def spare(p, energy=ENERGY):
    """What is left of the energy of the gun."""
    return energy - p["u"] ** 2 - p["v"] ** 2


AIM = {"u": jnp.asarray(0.9), "v": jnp.asarray(0.6)}


@pytest.mark.sweep
def test_the_least_99_percent_miss_of_dispersed_shots():
    """Runs of `simulate_batch` and the gradients of their quantiles. A shot lands at 2 u v + 2 a
    v^2 for the push a, so that the flattest shot whose tails are equally far beyond and short of
    the target is best, and its v^2 solves a quadratic."""

    def problem(p):
        # |miss| has a corner where both tails are equally far, the optimum: no quantile of it.
        short, far = jnp.quantile(misses(p), jnp.array([0.005, 0.995]))
        return Criterion(
            p["miss"], non_negative=jnp.stack([p["miss"] - far, p["miss"] + short, spare(p)])
        )

    found = minimise(problem, AIM | {"miss": jnp.asarray(0.5)}, tolerance=1e-8)
    assert found.converged, found.sentence()
    low, high = np.quantile(PUSH, [0.005, 0.995])
    both = high + low
    half = TARGET * both + 2.0 * ENERGY
    square = (half - np.sqrt(half**2 - TARGET**2 * (both**2 + 4.0))) / (both**2 + 4.0)
    np.testing.assert_allclose(found.x["v"], np.sqrt(square), rtol=1e-6)
    np.testing.assert_allclose(found.x["miss"], square * (high - low), rtol=1e-6)
    # Two runs of 400 are beyond on either side: the miss is what 99 % of all stay below.
    assert int(jnp.sum(jnp.abs(misses(found.x)) > found.x["miss"])) == 4


@pytest.mark.sweep
def test_the_99_percent_miss_of_a_gun_that_is_too_weak():
    """All shots fall short, and the quantile itself is the objective: 1 - 2 u v + 2 q v^2 for the
    push -q of the worst percent, which is least at 1 - E / (q + sqrt(1 + q^2))."""
    weak = 0.7

    def problem(p):
        return Criterion(jnp.quantile(jnp.abs(misses(p)), 0.99), non_negative=spare(p, weak)[None])

    # From a shot that falls short: on the way from one beyond the target the quantile has a corner.
    start = {"u": jnp.asarray(0.4), "v": jnp.asarray(0.6)}
    found = minimise(problem, start, tolerance=1e-8)
    assert found.converged, found.sentence()
    q = -np.quantile(PUSH, 0.01)
    np.testing.assert_allclose(
        found.criterion.objective, TARGET - weak / (q + np.hypot(1.0, q)), rtol=1e-8
    )


@pytest.mark.sweep
def test_the_trade_of_mean_against_spread():
    """A flatter shot spreads less, and falls short: with the weight of the variance the spread of
    the flown shots falls and their mean miss rises, each at the optimum of the closed form by
    SciPy."""

    def searched(weight):
        def problem(p):
            m = misses(p)
            cost = jnp.mean(m) ** 2 + weight * jnp.var(m)
            return Criterion(100.0 * cost, non_negative=spare(p)[None], report=m)

        return minimise(problem, AIM, tolerance=1e-8)

    # One program for all weights.
    search_with = jax.jit(searched)
    means, spreads = [], []
    for weight in (0.1, 1.0, 10.0):
        found = search_with(weight)
        assert found.converged, found.sentence()

        def exact(v, weight=weight):
            m = 2.0 * v * np.sqrt(ENERGY - v * v) + 2.0 * PUSH * v * v - TARGET
            return np.mean(m) ** 2 + weight * np.var(m)

        best = minimize_scalar(exact, bounds=(0.2, 0.7), method="bounded", options={"xatol": 1e-10})
        # A search by values alone finds the place to the root of rounding.
        np.testing.assert_allclose(found.x["v"], best.x, atol=1e-6)
        means.append(float(jnp.abs(jnp.mean(found.criterion.report))))
        spreads.append(float(jnp.std(found.criterion.report)))
    assert spreads[0] > spreads[1] > spreads[2]
    assert means[0] < means[1] < means[2]
