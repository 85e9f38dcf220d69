"""The multistage optimum against 40-digit bisection of its stationarity condition, and against
descent without that condition."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq, minimize

from jaxspace.core import InputError
from jaxspace.optimization import optimal_staging
from jaxspace.optimization.staging import optimal_staging_by_gradient, stationary_mass_ratio

P4 = ([8050.0, 8050.0], [0.18, 0.15], 26000.0)
N3 = ([8500.0, 10500.0, 13500.0], [0.1, 0.12, 0.15], 36000.0)
N4 = ([8000.0, 9500.0, 11000.0, 13000.0], [0.1, 0.11, 0.13, 0.16], 45000.0)
BOUND = ([5000.0, 13000.0], [0.3, 0.08], 12000.0)

CASES = [
    # lambda, mass ratios (1e-11), m01/P and P/m01 (1e-10)
    pytest.param(
        P4,
        -0.0007142954267293376,
        [4.589385118102594, 5.507262141723114],
        582.4659336063554,
        0.0017168386034329423,
        id="T8.2-P4",
    ),
    pytest.param(
        N3,
        -0.000153452624240856,
        [2.3333302766544364, 3.161373599330374, 3.448558387731492],
        74.55876094480529,
        0.013412240055065893,
        id="T8.2-N3",
    ),
    pytest.param(
        N4,
        -0.00015882019333111376,
        [2.1294643094032923, 3.065618610069506, 3.2892108024633804, 3.2228708882320354],
        280.1087469373267,
        0.0035700420316533217,
        id="T8.2-N4",
    ),
]


@pytest.mark.parametrize(
    ("rocket", "multiplier", "mass_ratio", "initial_mass", "payload_ratio"), CASES
)
def test_optimum(rocket, multiplier, mass_ratio, initial_mass, payload_ratio):
    found = optimal_staging(*rocket)
    np.testing.assert_allclose(found.multiplier, multiplier, rtol=1e-11)
    np.testing.assert_allclose(found.mass_ratio, mass_ratio, rtol=1e-11)
    np.testing.assert_allclose(found.initial_mass, initial_mass, rtol=1e-10)
    np.testing.assert_allclose(found.payload_ratio, payload_ratio, rtol=1e-10)
    assert np.all(found.used) and found.feasible


def log_mass_of(v, u, b):
    return jnp.log(optimal_staging(u, b, v).initial_mass)


by_reverse, by_forward = jax.jit(jax.grad(log_mass_of)), jax.jit(jax.jacfwd(log_mass_of))


@pytest.mark.parametrize(
    ("rocket", "multiplier"), [pytest.param(*case.values[:2], id=case.id) for case in CASES]
)
def test_multiplier_is_the_price_of_velocity(rocket, multiplier):
    # T8.2-*: dln_ratio_dvm, 1e-11
    u, b, v = (jnp.asarray(x) for x in rocket)
    for derivative in (by_reverse, by_forward):
        price = derivative(v, u, b)
        np.testing.assert_allclose(price, -multiplier, rtol=1e-11)


def test_equal_exhaust_velocities_leave_equal_structure_shares():
    # T8.2-P4: Ex8.2-1_factor = beta_i mu_i, the same for every stage of the same exhaust velocity
    np.testing.assert_allclose(
        np.asarray(P4[1]) * optimal_staging(*P4).mass_ratio, 0.8260893212584671, rtol=1e-12
    )


def test_bound():
    # T8.2-bound: stationarity alone asks for mu_1 < 1; the optimum leaves the stage out
    u, b, v = (np.asarray(x) for x in BOUND)
    found = optimal_staging(u, b, v)
    assert found.mass_ratio[0] == 1.0
    assert list(found.used) == [False, True]
    np.testing.assert_allclose(found.mass_ratio[1], 2.5170231739337443, rtol=1e-12)
    np.testing.assert_allclose(found.initial_mass, 2.8995125406540687, rtol=1e-12)

    def missing_velocity(x):
        return float(np.sum(u * np.log(stationary_mass_ratio(-1.0 / x, u, b))) - v)

    x = brentq(missing_velocity, 1e-3, 4999.9, xtol=1e-12, rtol=1e-15)
    stationary = stationary_mass_ratio(-1.0 / x, u, b)
    # 1 - x/u_1 = 0.016: the root of brentq loses two of its sixteen digits there
    np.testing.assert_allclose(stationary, [0.05337227771502246, 7.769286939012051], rtol=1e-11)


@pytest.mark.parametrize(
    ("stages", "payload_ratio"),
    [
        (2, 0.025434049470903525),
        (3, 0.03495182077357057),
        (4, 0.03867122038984796),
        (6, 0.04185542436001801),
        (10, 0.04407773192010848),
    ],
)
def test_equal_stages(stages, payload_ratio):
    # T8.2-P1, 1e-11; erratum 26: the mass ratio of two stages is 3.8411 and not 3.85
    found = optimal_staging(np.full(stages, 9660.0), np.full(stages, 0.12), 26000.0)
    np.testing.assert_allclose(found.payload_ratio, payload_ratio, rtol=1e-11)
    np.testing.assert_allclose(found.mass_ratio, 3.8411 ** (2.0 / stages), rtol=1e-5)


def test_many_equal_stages():
    # T8.2-P1: limit exp(-v/(u (1 - beta))) of infinitely many stages; the error falls as 1/N, hence
    # extrapolation
    def ratio(n):
        return float(optimal_staging(np.full(n, 9660.0), np.full(n, 0.12), 26000.0).payload_ratio)

    r1, r2, r4 = ratio(200), ratio(400), ratio(800)
    limit = (8.0 * r4 - 6.0 * r2 + r1) / 3.0
    np.testing.assert_allclose(
        limit, 0.04695640470304318, rtol=1e-7
    )  # the next term of the series is of the order (v/u)^2/800^3


def test_one_stage_cannot():
    # 9660 ln(1/0.12), by hand
    sentence = r"total_velocity is 26000: it must be below .* u ln\(1/beta\), 20481.74576 m/s\."
    with pytest.raises(InputError, match=sentence):
        optimal_staging([9660.0], [0.12], 26000.0)
    # The number is that of the rocket that cannot: of two the second one.
    with pytest.raises(InputError, match=r"sum of u ln\(1/beta\), 20481.74576 m/s"):
        optimal_staging(np.array([[19660.0, 9660.0]]), [0.12], 26000.0)


# One program for all rockets of as many stages.
EXACT, DESCENT = jax.jit(optimal_staging), jax.jit(optimal_staging_by_gradient)
DESCENTS = jax.jit(jax.vmap(optimal_staging_by_gradient, (None, None, 0), -1))


@pytest.mark.parametrize(
    "rocket", [P4, N3, N4, BOUND, ([5000.0, 13000.0, 12000.0], [0.3, 0.08, 0.1], 60.0)]
)
def test_descent_agrees(rocket):
    given = [jnp.asarray(x) for x in rocket]
    exact, found = EXACT(*given), DESCENT(*given)
    assert found.feasible
    np.testing.assert_array_equal(found.used, exact.used)
    np.testing.assert_allclose(found.mass_ratio, exact.mass_ratio, rtol=1e-10)
    np.testing.assert_allclose(found.initial_mass, exact.initial_mass, rtol=1e-10)
    np.testing.assert_allclose(found.multiplier, exact.multiplier, rtol=1e-10)


# Three stages are between two and four, which have a program of their own.
@pytest.mark.parametrize(
    "stages",
    [
        P4[:2],
        pytest.param(N3[:2], marks=pytest.mark.sweep),
        N4[:2],
        BOUND[:2],
        ([3000.0, 3000.0], [0.1, 0.1]),
    ],
)
def test_descent_converges_up_to_the_greatest_velocity(stages):
    """From where almost nothing is left to the limit of the stages, a trillionth of it, to slow
    rockets. What is left to the limit is a difference: its rounding, of the few parts in 1e16 of
    the limit that three logarithms make, is that of the initial mass, once for each stage. In
    float64 both functions have the mass ratios to 12 digits everywhere."""
    u, b = (np.asarray(x) for x in stages)
    limit = -np.sum(u * np.log(b))
    parts = np.array([1e-12, 1e-10, 1e-8, 1e-6, 1e-4, 1e-3, 1e-2, 0.1, 0.5, 0.999, 1.0 - 1e-6])
    found = jax.tree.map(np.asarray, DESCENTS(u, b, (1.0 - parts) * limit))
    exact = optimal_staging(u, b, (1.0 - parts) * limit)
    assert np.all(found.feasible)
    np.testing.assert_array_equal(found.used, exact.used)
    np.testing.assert_allclose(found.mass_ratio, exact.mass_ratio, rtol=1e-12)
    for k, part in enumerate(parts):
        rtol = 1e-12 + len(u) * 5e-16 / part
        np.testing.assert_allclose(found.initial_mass[k], exact.initial_mass[k], rtol=rtol)
        # The slope of ln(m01/P) by the velocity, negative.
        np.testing.assert_allclose(found.multiplier[k], exact.multiplier[k], rtol=rtol)
    if np.ptp(u) == 0.0 and np.ptp(b) == 0.0:
        # Equal stages: [(1/mu - b)/(1 - b)]^N, whose difference is that of v from the limit.
        left = b[0] * np.expm1(parts * limit / np.sum(u)) / (1.0 - b[0])
        rtol = 1e-12 + len(u) * 5e-16 / parts
        assert np.all(np.abs(found.payload_ratio / left ** len(u) - 1.0) < rtol)


def _log_mass(s, b):
    return np.sum(s + np.log1p(-b) - np.log(1.0 - b * np.exp(s)))


stage = st.tuples(st.floats(1000.0, 5000.0), st.floats(0.03, 0.4))


@settings(max_examples=40, deadline=None)
@given(st.lists(stage, min_size=3, max_size=3), st.floats(0.02, 0.97))
def test_optimality_conditions(stages, part):
    """The constraint holds, and no shift of velocity between two stages lowers the mass: the
    conditions of Kuhn and Tucker."""
    u, b = (np.asarray(column) for column in zip(*stages, strict=True))
    v = part * np.sum(-u * np.log(b))
    found = optimal_staging(u, b, v)
    mu, used = np.asarray(found.mass_ratio), np.asarray(found.used)
    np.testing.assert_allclose(np.sum(u * np.log(mu)), v, rtol=1e-12)
    slope = 1.0 / (u * (1.0 - b * mu))  # of ln m by the velocity of each stage
    np.testing.assert_allclose(
        slope[used], -found.multiplier, rtol=1e-9
    )  # 1 - b mu loses digits near the limit
    assert np.all(slope[~used] >= -found.multiplier * (1.0 - 1e-12))
    np.testing.assert_allclose(np.log(found.initial_mass), _log_mass(np.log(mu), b), rtol=1e-9)


def test_derivatives_by_differences():
    u, b, v = (jnp.asarray(x) for x in N3)

    @jax.jit
    def log_mass(u, b, v):
        return jnp.log(optimal_staging(u, b, v).initial_mass)

    reverse = jax.jit(jax.grad(log_mass, (0, 1, 2)))(u, b, v)
    forward = jax.jit(jax.jacfwd(log_mass, (0, 1, 2)))(u, b, v)
    for i, (r, f, x) in enumerate(zip(reverse, forward, (u, b, v), strict=True)):
        np.testing.assert_allclose(r, f, rtol=1e-12)
        for k in np.ndindex(x.shape):
            h = 1e-5 * x[k]
            plus, minus = ([u, b, v], [u, b, v])
            plus[i], minus[i] = x.at[k].add(h), x.at[k].add(-h)
            difference = (log_mass(*plus) - log_mass(*minus)) / (2.0 * h)
            np.testing.assert_allclose(
                r[k], difference, rtol=1e-7
            )  # rounding 1e-16/1e-5 beside curvature 1e-10


def test_second_derivative_at_a_bound():
    """With one stage left the price is the single rocket's: 1/(u (1 - b e^(v/u))), and so is its
    slope."""
    u, b, v = (jnp.asarray(x) for x in BOUND)
    first = jax.jit(jax.grad(lambda v: jnp.log(optimal_staging(u, b, v).initial_mass)))
    share = 0.08 * np.exp(12000.0 / 13000.0)
    np.testing.assert_allclose(first(v), 1.0 / (13000.0 * (1.0 - share)), rtol=1e-12)
    np.testing.assert_allclose(
        jax.jit(jax.grad(first))(v), share / (13000.0 * (1.0 - share)) ** 2, rtol=1e-10
    )


def test_traced_demand_beyond_the_limit_is_marked():
    u, b, _ = (jnp.asarray(x) for x in N3)
    found = jax.jit(optimal_staging)(u, b, 1e6)
    assert not found.feasible
    assert found.payload_ratio == 0.0 and np.isinf(found.initial_mass)
    np.testing.assert_allclose(found.mass_ratio, 1.0 / b)
    slopes = jax.grad(lambda u, b, v: optimal_staging(u, b, v).payload_ratio, (0, 1, 2))
    derivatives = jax.jit(slopes)(u, b, 1e6)
    assert all(np.all(np.isfinite(d)) for d in derivatives)


def test_runs_trail():
    u, b, _ = (np.asarray(x) for x in N3)
    demands = np.array([2000.0, 20000.0, 36000.0, 40000.0])
    batch = optimal_staging(u, b, demands)
    assert batch.mass_ratio.shape == (3, 4)
    for i, demand in enumerate(demands):
        np.testing.assert_allclose(
            batch.mass_ratio[:, i], optimal_staging(u, b, demand).mass_ratio, rtol=1e-13
        )
    single = optimal_staging(u.astype(np.float32), b.astype(np.float32), 36000.0)
    assert single.mass_ratio.dtype == np.float32
    np.testing.assert_allclose(single.mass_ratio, batch.mass_ratio[:, 2], rtol=1e-5)


def test_bad_input_is_told():
    with pytest.raises(InputError, match="structural_factor is .1.2"):
        optimal_staging([3000.0], [1.2], 100.0)
    with pytest.raises(InputError, match="exhaust_velocity is a scalar"):
        optimal_staging(np.array(3000.0), [0.1], 100.0)
    with pytest.raises(InputError, match="the descent does not accept a batch"):
        optimal_staging_by_gradient([3000.0], [0.1], np.array([100.0, 200.0]))


def test_independent_optimiser():
    """The same optimum from scipy's constrained search on the mass ratios themselves."""
    u, b, v = (np.asarray(x) for x in N4)
    start = np.full(4, v / np.sum(u))
    constraint = {"type": "eq", "fun": lambda s: (u @ s - v) / 1e4}
    found = minimize(
        _log_mass,
        start,
        args=(b,),
        constraints=constraint,
        method="SLSQP",
        options={"ftol": 1e-15, "maxiter": 500},
    )
    np.testing.assert_allclose(
        np.exp(found.fun), optimal_staging(u, b, v).initial_mass, rtol=1e-8
    )  # flat: half the digits
