"""Impulses at the start, at the end or split, against the textbook's numbers and searches over the
time of flight and over the use of the propellant; steering to the greatest velocity; equal
stages."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array
from scipy.integrate import quad
from scipy.optimize import brentq, fsolve

from jaxspace import Mission, Phase, Scene, simulate_mission
from jaxspace.bodies import BodyState
from jaxspace.core import InputError
from jaxspace.optimization import Criterion, minimise, propellant_use
from jaxspace.optimization.ascent import (
    AbstractThrustAcceleration,
    Ascent,
    ConstantThrustAcceleration,
    apex,
    burnout_state,
)
from jaxspace.optimization.staging import equal_stages_payload
from jaxspace.optimization.steering import maximum_velocity_steering, minimum_time_steering
from jaxspace.orbits import UniformGravity

G = 32.2
use = jax.jit(propellant_use)


def released(speed, angle):
    return jnp.array([speed * np.cos(np.radians(angle)), speed * np.sin(np.radians(angle))])


def test_textbook_impulses():
    """T8.4-split-up-low, T8.4-split-down, T8.4-P8 and T8.4-P5."""
    up = propellant_use(released(3000.0, 30.0), 4e5, 15000.0, G)
    found = (up.final_velocity, up.first_angle, up.duration, up.first, up.last)
    expected = (17165.72163017579, 0.24067895642322526, 157.62208124782012, 15000.0, 0.0)
    np.testing.assert_allclose(found, expected, rtol=1e-11)
    assert up.corner and not up.degenerate and up.sentence() == "All propellant at the start."

    down = propellant_use(released(3000.0, 20.0), -3e5, 15000.0, G)
    found = (down.final_velocity, down.last_angle, down.duration, down.first, down.last)
    expected = (17123.87426056051, 0.30564490647498105, 172.03988359983938, 0.0, 15000.0)
    np.testing.assert_allclose(found, expected, rtol=1e-11)
    assert down.corner and down.sentence() == "All propellant at the end."

    split = propellant_use(released(3000.0, 30.0), 4e5, 15000.0, G, 120.0)
    found = (split.first, split.last, split.first_angle, split.last_angle, split.final_velocity)
    expected = (10931.612903225807, 4068.387096774193, 0.351646953029878, -0.3516469530298779)
    np.testing.assert_allclose(found, (*expected, 16680.17674911243), rtol=1e-11)
    assert not split.corner and split.sentence().startswith("72.9% of the propellant at the start")

    rest = propellant_use(jnp.zeros(2), 300.0 * 5280.0, 24207.635159180667, G)
    found = (rest.duration, np.degrees(rest.first_angle), rest.final_velocity)
    np.testing.assert_allclose(found, (313.66398130435994, 24.65938247810715, 22000.0), rtol=1e-11)


def test_the_slope_of_the_steering_is_no_free_constant():
    """Erratum 28, to 8.4-2 and Prob. 8.4-1: with T free and no thrust at T, lambda_1(T) = 0 leaves
    tan phi = (1 - t/T) tan phi_0, so C_2 = tan(phi_0)/T. The burn of 160 s of T8.4-finite, with
    phi_0 chosen anew for the height: slopes of 0.8 and 1.2 times that lose some feet per second,
    4.2 here. The losses are those of a root in (phi_0, T) by SciPy, to its tolerance."""
    ascent = Ascent(ConstantThrustAcceleration(93.75), 160.0, 3000.0, 0.0, 4e5, G)
    release = jnp.asarray(np.pi / 6.0)

    @jax.jit
    def flown(x):
        """Velocity, time and height of the apex for tan phi = x_0 - x_1 t/(1000 s)."""
        end = burnout_state(ascent, release, lambda t: jnp.arctan(x[0] - 1e-3 * x[1] * t))
        return end.u, *apex(ascent, end)

    def problem(x):
        u, _, height = flown(x)
        return Criterion(-u, height - 4e5)

    # Both constants are free: the optimum has the slope of the erratum.
    best = jax.jit(lambda x: minimise(problem, x))(jnp.array([0.8, 2.0]))
    assert best.converged
    start, slope = best.x
    top, T, _ = flown(best.x)
    np.testing.assert_allclose(1e-3 * slope, start / T, rtol=1e-7)
    case = (16431.319928700537, 218.46891178586966, 0.5700864745693154)
    np.testing.assert_allclose((top, T, jnp.arctan(start)), case, rtol=1e-7)

    def loss(scale):
        def miss(start):
            return float(flown(jnp.array([start, scale * slope]))[2]) - 4e5

        again = brentq(miss, float(start) - 0.2, float(start) + 0.2, xtol=1e-14)
        return float(top - flown(jnp.array([again, scale * slope]))[0])

    np.testing.assert_allclose([loss(0.8), loss(1.2)], [4.21011734, 4.18908356], rtol=1e-6)
    # Quadratic about the optimum, so that no slope beside it is better.
    np.testing.assert_allclose([loss(0.99), loss(1.01)], 4.2 / 20**2, rtol=0.01)


@pytest.mark.parametrize(("angle", "climb", "guess"), [(30.0, 4e5, 170.0), (60.0, 5e4, 60.0)])
def test_a_use_that_is_earlier_gains_velocity(angle, climb, guess):
    """Errata 29 and 30: dU = C_2 int Phi dV dt with C_2 = tan(phi_0)/T and Phi = sin(phi), which
    keeps its sign. So dU is positive for a thrust downwards, too, where both are negative. A burn
    of 40 s, of which a gain dV = eps sin^2(pi t/40 s) comes earlier, steered anew by SciPy."""
    burn = 40.0

    @jax.jit
    def flown(x, eps):
        """Velocity, time and height of the apex for tan phi = x_0 (1 - t/(100 s x_1))."""
        ascent = Ascent(Earlier(eps), burn, 3000.0, 0.0, climb, G)
        steering = lambda t: jnp.arctan(x[0] * (1.0 - 0.01 * t / x[1]))  # noqa: E731
        end = burnout_state(ascent, jnp.asarray(np.radians(angle)), steering)
        return end.u, *apex(ascent, end)

    def best(eps):
        def miss(x):
            _, T, height = flown(x, eps)
            return [0.01 * T - x[1], height / climb - 1.0]

        first = [0.3 * np.sign(climb - 2e5), 0.01 * guess]
        x, _, ok, text = fsolve(miss, first, full_output=True, xtol=1e-13)
        assert ok == 1, text
        return x, float(flown(x, eps)[0])

    (tangent, T), _ = best(0.0)
    T = 100.0 * T
    assert T > burn and (tangent < 0.0) == (angle == 60.0)
    gains = [best(eps)[1] for eps in (-1.0, 1.0)]

    def integrand(t):
        return np.sin(np.arctan(tangent * (1.0 - t / T))) * np.sin(np.pi * t / burn) ** 2

    expected = tangent / T * quad(integrand, 0.0, burn)[0]
    assert expected > 0.0
    # The rounding of the velocities is 1e-11 of their difference; their third derivative, less.
    np.testing.assert_allclose(0.5 * (gains[1] - gains[0]), expected, rtol=1e-6)


class Earlier(AbstractThrustAcceleration):
    """15,000 ft/s in 40 s, of which the gain eps sin^2(pi t/40 s), ft/s, comes earlier."""

    eps: Array

    def __call__(self, t):
        return GAIN / 40.0 + self.eps * jnp.pi / 40.0 * jnp.sin(2.0 * jnp.pi * t / 40.0)


def test_no_time_of_flight_is_better():
    """Against all times on a grid, for climbs and descents, rising and sinking releases."""
    climbs, speeds = (x.ravel() for x in np.meshgrid([-3e5, -1e3, 0.0, 1e3, 2e5], [-900.0, 1500.0]))
    velocity = jnp.stack([jnp.full(climbs.size, 1000.0), jnp.asarray(speeds)])
    best = use(velocity, jnp.asarray(climbs), 15000.0, G)
    times = np.geomspace(0.05, 400.0, 4000)[:, None]
    tried = use(
        velocity[:, None], jnp.asarray(climbs), 15000.0, G, jnp.asarray(times) + 0.0 * climbs
    )
    reached = np.where(tried.feasible, tried.final_velocity, -np.inf).max(axis=0)
    assert np.all(best.feasible) and np.all(best.final_velocity >= reached - 1e-9)
    # The grid comes near every optimum: that of Y = y_0 in free fall lies at T = 0.
    np.testing.assert_allclose(best.final_velocity, reached, rtol=2e-4)
    np.testing.assert_array_equal(best.degenerate, (climbs == 0.0) & (speeds > 0.0))
    # Erratum 30: at the lower altitude, also where the impulse points downwards.
    up, down = climbs > 0.0, climbs < 0.0
    assert np.all(best.first[up] == 15000.0) and np.all(best.last[down] == 15000.0)
    assert best.first_angle[up & (climbs == 1e3) & (speeds > 0.0)] < 0.0


def test_degenerate_and_infeasible_cases_are_reported():
    same = propellant_use(released(3000.0, 30.0), 0.0, 15000.0, G)
    assert same.degenerate and "Every split" in same.sentence()
    shorter = propellant_use(released(3000.0, 30.0), 0.0, 15000.0, G, 40.0)
    assert shorter.degenerate
    np.testing.assert_allclose(shorter.final_velocity, same.final_velocity, rtol=1e-14)
    poor = propellant_use(released(100.0, 30.0), 4e5, 1000.0, G)
    # (50 + 1000)^2 / 64.4 = 17119.6; sqrt(64.4 4e5) - 50 = 5025.43.
    assert not poor.feasible and "insufficient" in poor.sentence()
    assert "provides 1000 m/s, where 5025.43 m/s are required; the closest" in poor.sentence()
    assert "17119.6 m above" in poor.sentence()
    sinking = propellant_use(jnp.array([500.0, -2000.0]), 4e5, 1000.0, G)
    assert sinking.sentence().endswith("no height is reached this way.")
    with pytest.raises(InputError, match="gravity is 0"):
        propellant_use(jnp.ones(2), 1.0, 1.0, 0.0)
    slopes = jax.jit(jax.grad(lambda x: propellant_use(x[:2], x[2], x[3], G).final_velocity))
    for climb, gain in ((0.0, 15000.0), (4e5, 1000.0), (4e5, 15000.0), (-1.0, 0.0)):
        assert np.all(np.isfinite(slopes(jnp.array([2000.0, 1500.0, climb, gain]))))


GAIN, BINS = 15000.0, 12


@jax.jit  # one program for all releases
def searched(velocity, climb, duration, within=(0.1, 10.0), slope=0.3):
    """The greatest velocity over the use of the propellant: shares of the gain at times that divide
    the flight evenly, from its start to its end, by the linear-tangent law. From a uniform use with
    the `slope` at the start and its negative at the end; `duration`: given, or `None` and a first
    guess in s, with its bounds as multiples of it."""
    (u0, w0), (T, guess) = velocity, duration
    place = jnp.linspace(0.0, 1.0, BINS)
    unit = GAIN / G

    def problem(x):
        t = x["duration"] * guess if T is None else T
        angle = jnp.arctan(x["first"] + (x["last"] - x["first"]) * place)
        across, up = (GAIN * x["used"] * f(angle) for f in (jnp.cos, jnp.sin))
        rate = w0 - G * t + jnp.sum(up)
        height = w0 * t - 0.5 * G * t * t + jnp.sum(up * (1.0 - place)) * t
        miss = [rate / GAIN, (height - climb) / (GAIN * unit), jnp.sum(x["used"]) - 1.0]
        return Criterion(-(u0 + jnp.sum(across)) / GAIN, jnp.stack(miss), report=t)

    start = {
        "used": jnp.full(BINS, 1.0 / BINS),
        "first": jnp.asarray(slope),
        "last": -jnp.asarray(slope),
    }
    low = {"used": jnp.zeros(BINS), "first": jnp.array(-jnp.inf), "last": jnp.array(-jnp.inf)}
    high = {
        "used": jnp.full(BINS, jnp.inf),
        "first": jnp.array(jnp.inf),
        "last": jnp.array(jnp.inf),
    }
    if T is None:
        start["duration"] = jnp.array(1.0)
        low["duration"], high["duration"] = (jnp.asarray(x) for x in within)
    # The law has no effect in a bin without propellant: differences of gradients would take what
    # they say about it for curvature.
    return minimise(problem, start, bounds=(low, high), exact_hessian=True)


@pytest.mark.parametrize(
    ("angle", "climb", "duration", "sentence", "burns"),
    [
        (30.0, 4e5, None, "All propellant at the start.", [0]),
        (20.0, -3e5, None, "All propellant at the end.", [BINS - 1]),
        (30.0, 4e5, 120.0, "72.9% of the propellant at the start", [0, BINS - 1]),
    ],
)
def test_impulses_are_found_from_a_smooth_use(angle, climb, duration, sentence, burns):
    """A uniform use ends in impulses; the bounds of all other bins hold, and their prices say that
    propellant there loses velocity."""
    velocity = released(3000.0, angle)
    exact = propellant_use(velocity, climb, GAIN, G, duration)
    guess = float(velocity[1]) / G + np.sqrt(2.0 * abs(climb) / G)
    found = searched(velocity, climb, (duration, guess))
    assert found.converged and exact.sentence().startswith(sentence)
    # The ends are among the times, so that the impulses themselves are among the uses: what is left
    # is the tolerance of the search, 1e-9 of each constraint.
    np.testing.assert_allclose(-GAIN * found.criterion.objective, exact.final_velocity, rtol=1e-8)
    np.testing.assert_allclose(found.criterion.report, exact.duration, rtol=1e-7)
    used, prices = found.x["used"], found.bound_multipliers["used"]
    shares = jnp.zeros(BINS).at[0].set(exact.first / GAIN).at[-1].set(exact.last / GAIN)
    np.testing.assert_allclose(used, shares, atol=1e-7)
    held = np.setdiff1d(np.arange(BINS), burns)
    assert np.all(prices[held] > 1e-3)
    np.testing.assert_allclose(prices[np.asarray(burns)], 0.0, atol=1e-7)
    slopes = [found.x["first"], found.x["last"]]
    angles = [exact.first_angle, exact.last_angle]
    for k, place in enumerate((0, BINS - 1)):
        if place in burns:
            np.testing.assert_allclose(jnp.arctan(slopes[k]), angles[k], rtol=1e-6)


def test_the_height_of_the_release_has_many_best_uses():
    """Searches from two durations end at different splits with the same velocity, that of the
    closed form, which calls it degenerate."""
    velocity = released(3000.0, 30.0)
    exact = propellant_use(velocity, 0.0, GAIN, G)
    assert exact.degenerate and exact.sentence().startswith("Every split")
    shares = []
    for guess in (30.0, 70.0):
        # Up to 2 w_0/g, 93 s, every duration has the same velocity; about zero, where the thrust
        # has no time to change the height, they are kept from.
        found = searched(velocity, 0.0, (None, guess), within=(0.5, 1.3), slope=-0.1)
        reached = -GAIN * found.criterion.objective
        np.testing.assert_allclose(reached, exact.final_velocity, rtol=1e-8)
        used = found.x["used"]
        own = propellant_use(velocity, 0.0, GAIN, G, found.criterion.report)
        assert own.degenerate
        # The velocity is flat there: its error of 1e-8 leaves the split known to the root of that.
        np.testing.assert_allclose(used[0], own.first / GAIN, atol=1e-4)
        np.testing.assert_allclose(used[1:-1], 0.0, atol=1e-4)
        shares.append(float(used[0]))
    assert abs(shares[0] - shares[1]) > 0.1


@pytest.mark.parametrize("duration", [None, 30.0])
def test_what_too_little_propellant_reaches(duration):
    """The least gain just suffices and a thousandth less does not; and so with the nearest climb
    and one a little farther. Climbs and descents of rising and sinking releases."""
    grid = np.meshgrid([-3e5, -2e4, -1e3, 1e3, 3e4, 3e5], [-1200.0, 400.0, 1500.0], [700.0, 1300.0])
    climbs, speeds, gains = (jnp.asarray(x.ravel()) for x in grid)
    velocity = jnp.stack([0.0 * speeds, speeds])

    def feasible(climb, gain):
        return np.asarray(use(velocity, climb, gain, G, duration).feasible)

    found = use(velocity, climbs, gains, G, duration)
    assert np.all(feasible(climbs, found.least_gain * (1.0 + 1e-12)))
    assert not np.any(feasible(climbs, found.least_gain * (1.0 - 1e-3)))
    nearest, reached = found.nearest_climb, jnp.isfinite(found.nearest_climb)
    np.testing.assert_array_equal(nearest[found.feasible], climbs[found.feasible])
    # Off the edge of what is reached by the rounding of a square root.
    inside, outside = (nearest + share * (climbs - nearest) for share in (-1e-9, 1e-3))
    missed = np.asarray(reached & ~found.feasible)
    assert jnp.any(missed) and np.all(feasible(inside, gains)[missed])
    assert not np.any(feasible(outside, gains)[missed])
    every = jnp.linspace(-4e5, 4e5, 2001)[:, None] + 0.0 * gains
    tried = use(velocity[:, None], every, gains, G, duration)
    np.testing.assert_array_equal(jnp.any(tried.feasible, axis=0), reached)


def test_greatest_velocity_is_the_least_time_seen_from_the_other_side():
    least = minimum_time_steering(100.0, jnp.array([5.0, 0.0, -3.0]), 45.0)
    best = maximum_velocity_steering(100.0, jnp.array([5.0, 0.0, -3.0]), least.duration)
    np.testing.assert_allclose(best.final_velocity, 45.0, rtol=1e-13)
    np.testing.assert_allclose(best.initial_angle, least.initial_angle, rtol=1e-11, atol=1e-15)
    slope = jax.grad(lambda h: maximum_velocity_steering(100.0, h, 0.5).initial_angle)(0.0)
    np.testing.assert_allclose(slope, 6.0 / (100.0 * 0.25), rtol=1e-12)  # theta_0 = 6 h/(a T^2)
    with pytest.raises(InputError, match="height is 7"):
        maximum_velocity_steering(100.0, 7.0, 0.5)


def test_equal_stages_and_their_limit():
    """T8.2-P1."""
    N = jnp.array([1.0, 2.0, 3.0, 4.0, 6.0, 10.0, 1e9, jnp.inf])
    found = equal_stages_payload(26000.0, 9660.0, 0.12, N)
    expected = [0.0, 0.025434049470903525, 0.03495182077357057, 0.03867122038984796]
    expected += [0.04185542436001801, 0.04407773192010848, 0.04695640470304318, 0.04695640470304318]
    # A billion stages differ from the limit by 1e-9 of it.
    np.testing.assert_allclose(found, expected, rtol=2e-9)
    slopes = jax.grad(lambda v: jnp.sum(equal_stages_payload(v, 9660.0, 0.12, N)))(26000.0)
    assert np.isfinite(slopes)


def test_a_level_split_without_time_is_one_impulse():
    """T = 0: both impulses act at one moment, and no other height is reached; the best use of a
    level release that sinks is such a one."""
    u0, w0 = 300.0, 120.0
    one = propellant_use(jnp.array([u0, w0]), 0.0, 200.0, 9.8, 0.0)
    assert one.degenerate and one.feasible and one.duration == 0.0
    # sqrt(200^2 - 120^2) = 160, exactly.
    np.testing.assert_allclose(one.final_velocity, u0 + 160.0, rtol=1e-15)
    best = propellant_use(jnp.array([u0, -w0]), 0.0, 200.0, 9.8)
    assert best.duration == 0.0
    np.testing.assert_allclose(best.final_velocity, u0 + 160.0, rtol=1e-15)
    missed = propellant_use(jnp.array([u0, w0]), 5.0, 200.0, 9.8, 0.0)
    assert not missed.feasible and missed.least_gain == np.inf and missed.nearest_climb == 0.0
    assert all(np.all(np.isfinite(x)) for x in (missed.first_angle, missed.final_velocity))

    @jax.jit
    def slopes(x):
        def velocity(x):
            return propellant_use(x[:2], 0.0, x[2], 9.8, 0.0).final_velocity

        return jax.jacfwd(velocity)(x), jax.jacrev(velocity)(x)

    # By u_0, w_0 and V: 1, -w_0/160, V/160.
    for found in slopes(jnp.array([u0, w0, 200.0])):
        np.testing.assert_allclose(found, [1.0, -0.75, 1.25], rtol=1e-14)
    with pytest.raises(InputError, match="duration is -1"):
        propellant_use(jnp.array([u0, w0]), 0.0, 200.0, 9.8, -1.0)


def test_a_level_split_flies_as_a_phase_without_duration():
    """The mission of the two impulses of T = 0, with the slope by the duration of its phase: that
    of gravity, -g."""
    use = propellant_use(jnp.array([300.0, 120.0]), 0.0, 200.0, 9.8, 0.0)
    gains = use.first, use.last
    angles = use.first_angle, use.last_angle
    start = BodyState(position=jnp.zeros(3), velocity=jnp.array([300.0, 0.0, 120.0]))
    system = Scene((UniformGravity([0.0, 0.0, -9.8]),))

    def kick(k):
        def then(t, y):
            gained = gains[k] * jnp.array([jnp.cos(angles[k]), 0.0, jnp.sin(angles[k])])
            return BodyState(position=y.position, velocity=y.velocity + gained)

        return then

    def end(duration):
        phases = [Phase(system, 0.0, kick(0), "start"), Phase(system, duration, kick(1), "split")]
        return simulate_mission(Mission(phases), start).final.velocity

    velocity, slope = jax.jvp(end, (0.0,), (1.0,))
    np.testing.assert_allclose(velocity, [460.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(slope, [0.0, 0.0, -9.8], rtol=1e-12)
