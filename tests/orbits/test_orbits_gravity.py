"""Attraction by a point and by an oblate body: potentials, published drifts, secular rates."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jaxspace.bodies import BodyState, RigidBody
from jaxspace.orbits import Oblateness, PointGravity
from jaxspace.orbits.elements import angular_momentum, elements_from_state
from jaxspace.orbits.oblateness import (
    apsidal_rate,
    node_regression_rate,
    oblateness,
    oblateness_potential,
)
from jaxspace.orbits.point_gravity import point_gravity, point_gravity_potential
from jaxspace.scene.reading import read_effects

J2 = 0.00108262668
BODY = RigidBody()


def integrate(effects, y0, t_end, event=None):
    """An independent solution: scipy's DOP853 on the sum of the effects' accelerations."""

    @jax.jit
    def rate(y):
        state = BodyState(position=y[:3])
        return jnp.concatenate(
            [y[3:], sum(e.load(0.0, state, BODY).acceleration_N for e in effects)]
        )

    return solve_ivp(
        lambda t, y: np.asarray(rate(y)),
        (0.0, t_end),
        np.asarray(y0),
        method="DOP853",
        rtol=1e-12,
        atol=1e-13,
        events=event,
    )


@pytest.mark.parametrize(
    "effect", [PointGravity(1.3), Oblateness(1.3, 0.1, 0.9)], ids=["point", "oblate"]
)
def test_acceleration_is_minus_the_gradient_of_the_potential(effect):
    for r in np.random.default_rng(1).normal(size=(5, 3)):
        slope = jax.grad(lambda r: effect.potential(0.0, BodyState(position=r), BODY))(
            jnp.asarray(r)
        )
        load = effect.load(0.0, BodyState(position=jnp.asarray(r)), BODY)
        np.testing.assert_allclose(
            load.acceleration_N, -slope, rtol=1e-12, atol=1e-13 * np.abs(slope).max()
        )
        assert load.force_N is None and load.torque_B is None and load.mass_rate is None


@pytest.mark.parametrize(
    ("effect", "kept"),
    [(PointGravity(1.3), 3), (Oblateness(1.3, 0.1, 0.9), 2)],
    ids=["point", "oblate"],
)
def test_what_an_effect_keeps(effect, kept):
    """Integrated with a point's attraction, which keeps all three: the change of each is zero
    exactly where declared."""
    y0 = np.array([1.0, 0.2, 0.5, 0.1, 0.9, 0.4])
    effects = (effect,) if isinstance(effect, PointGravity) else (PointGravity(1.3), effect)
    y1 = integrate(effects, y0, 3.0).y[:, -1]

    def quantities(y):
        state = BodyState(position=jnp.asarray(y[:3]))
        energy = 0.5 * y[3:] @ y[3:] + sum(float(e.potential(0.0, state, BODY)) for e in effects)
        h = np.asarray(angular_momentum(jnp.asarray(y[:3]), jnp.asarray(y[3:])))
        return {"energy": energy, "angular_momentum": h, "axial_angular_momentum": h[2]}

    before, after = quantities(y0), quantities(y1)
    for name in before:
        assert (np.max(np.abs(after[name] - before[name])) < 1e-10) == (name in effect.keeps)
    assert len(effect.keeps) == kept
    reading = read_effects([effect], BODY).effects[0]
    assert reading.needs == {"position"} and reading.adds == {"acceleration"}


def test_node_of_an_inclined_orbit():  # T4.18-J2
    """From the node over one nodal revolution; 1e-7 relative is the case's own tolerance."""
    i, r0 = 0.6108652381980153, 1.1
    speed = np.sqrt(1 / r0)
    y0 = [r0, 0, 0, 0, speed * np.cos(i), speed * np.sin(i)]

    def rising(t, y):
        del t
        return y[2]

    rising.direction = 1.0
    end = integrate((PointGravity(1.0), Oblateness(1.0, J2, 1.0)), y0, 9.0, rising).y_events[0][-1]
    assert np.arctan2(end[1], end[0]) == pytest.approx(-0.006913164000208639, rel=1e-7)
    per_turn = -node_regression_rate(r0, 0.0, i, 1.0, J2, 1.0) * 2 * np.pi * r0**1.5
    assert float(per_turn) == pytest.approx(-0.006907628967326636, rel=1e-9)


def test_drift_over_48_hours():  # PERT-CURTIS-12-2
    mu, radius = 398600.4418, 6378.137
    y0 = np.array([-2384.46, 5729.01, 3050.46, -7.36138, -2.98997, 1.64354])
    y1 = integrate((PointGravity(mu), Oblateness(mu, J2, radius)), y0, 172800.0).y[:, -1]
    before, after = (
        elements_from_state(jnp.asarray(y[:3]), jnp.asarray(y[3:]), mu) for y in (y0, y1)
    )
    hours = 48.0
    node, periapsis = (
        np.degrees(float(getattr(after, n) - getattr(before, n))) / hours
        for n in ("node", "argument_of_periapsis")
    )
    assert node == pytest.approx(-0.172, rel=1e-2)
    assert periapsis == pytest.approx(0.282, rel=1e-2)
    a = before.semi_latus_rectum / (1 - before.eccentricity**2)
    elements = (a, before.eccentricity, before.inclination, mu, J2, radius)
    # First order in J2, and mean against osculating elements: a few parts in a thousand.
    assert -np.degrees(float(node_regression_rate(*elements))) * 3600 == pytest.approx(
        node, rel=1e-2
    )
    assert np.degrees(float(apsidal_rate(*elements))) * 3600 == pytest.approx(periapsis, rel=1e-2)


def test_periapsis_stands_at_the_critical_inclination():
    assert abs(float(apsidal_rate(1.2, 0.1, float(np.arccos(np.sqrt(0.2))), 1.0, J2, 1.0))) < 1e-18


def test_single_precision_and_batches():
    r = jnp.asarray(np.random.default_rng(2).normal(size=(3, 8)), jnp.float32)
    assert point_gravity(r, 1.0).dtype == oblateness(r, 1.0, J2, 1.0).dtype == jnp.float32
    for field in (point_gravity, point_gravity_potential):
        np.testing.assert_allclose(field(r, 1.3)[..., 5], field(r[:, 5], 1.3), rtol=1e-6)
    for field in (oblateness, oblateness_potential):
        np.testing.assert_allclose(
            field(r, 1.3, J2, 0.9)[..., 5], field(r[:, 5], 1.3, J2, 0.9), rtol=1e-4
        )
    mu = jnp.linspace(1.0, 2.0, 8, dtype=jnp.float32)
    load = PointGravity(mu).load(0.0, BodyState(position=r), BODY)
    np.testing.assert_allclose(load.acceleration_N[:, 3], point_gravity(r[:, 3], mu[3]), rtol=1e-6)


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: PointGravity(-1.0), "PointGravity.mu"),
        (lambda: Oblateness(0.0, J2, 1.0), "Oblateness.mu"),
        (lambda: Oblateness(1.0, float("nan"), 1.0), "Oblateness.j2"),
        (lambda: Oblateness(1.0, J2, -1.0), "Oblateness.radius"),
    ],
)
def test_input_is_checked(make, field):
    with pytest.raises(ValueError, match=field.replace(".", r"\.")):
        make()


@pytest.mark.parametrize("r", [[6.6e6, 4.0e5, -3.0e5], [4.2e7, 1.0e6, 2.0e6]])
def test_derivatives_in_single_precision(r):
    """In metres the sixth power of a radius, and the fifth one of a high orbit, is beyond float32,
    and must not be formed. A unit in the last place is 1.2e-7; the element of the gradient sums a
    few such."""
    of_point = point_gravity, point_gravity_potential, (3.986e14,)
    of_bulge = oblateness, oblateness_potential, (3.986e14, J2, 6.378e6)
    for acceleration, potential, numbers in (of_point, of_bulge):
        exact = -jax.hessian(lambda r: potential(r, *numbers))(jnp.array(r))  # noqa: B023
        single = jnp.array(r, jnp.float32)
        for derivative in (jax.jacfwd, jax.jacrev):
            found = derivative(lambda r: acceleration(r, *numbers))(single)  # noqa: B023
            np.testing.assert_allclose(found, exact, atol=2e-6 * np.abs(exact).max())


@pytest.mark.skipif(
    jax.__version_info__ < (0, 11, 2),
    reason="The compiler of earlier releases computes them again whatever stands between.",
)
def test_stages_that_follow_from_one_another_compute_each_once():
    """In a step of a user's own, outside of the library's loop. With eight stages, each from the
    sum of those before, the work is some twelve times that of one; 39 times where the compiler
    computes each stage again for those that follow from it."""

    def work(stages):
        def step(r):
            rates = []
            for _ in range(stages):
                q = r + 1e-3 * sum(rates, 0.0 * r)
                rates.append(point_gravity(q, 1.0) + oblateness(q, 1.0, J2, 1.0))
            return sum(rates)

        runs = jnp.full((64, 3), 1.1)
        return jax.jit(jax.vmap(step)).lower(runs).compile().cost_analysis()["flops"]

    assert work(8) < 16.0 * work(1)
