"""The inertial navigator against the linear error equations, the ellipsoid and a campaign."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxspace import Accuracy, Mission, Phase, simulate
from jaxspace.dispersion import Campaign, Normal, disperse
from jaxspace.gyros import InertialNavigator, Place
from jaxspace.gyros.gyropendulum import schuler_frequency
from jaxspace.studies import modes

SPHERE = dict(flattening=0.0, j2=0.0)
AIDED = dict(altitude_rate_gain=0.02, altitude_gain=1e-4)
AIRCRAFT = dict(east_speed=200.0, height=1e4, heading=0.4)
DRIFT, BIAS = jnp.array([1e-8, 2e-8, -1e-8]), jnp.array([1e-4, -2e-4, 3e-4])


def faulty(navigator, drift, bias):
    return eqx.tree_at(lambda s: (s.gyro_drift, s.accelerometer_bias), navigator, (drift, bias))


def packed(f):
    """Errors in units in which they are alike: m, mm/s, microradian."""
    return jnp.concatenate([f.position, 1e3 * f.velocity, 1e6 * f.tilt])


@pytest.mark.parametrize("gimballed", [False, True])
def test_its_derivative_is_that_of_the_error_equations(gimballed):
    """Thomson 6.11: to rounding, for a vehicle on a parallel of a sphere."""
    navigator = InertialNavigator(0.8, gimballed=gimballed, **SPHERE, **AIDED, **AIRCRAFT)

    @jax.jit
    @jax.jacfwd
    def rates_of_errors(x):
        made = faulty(navigator, 1e-6 * x[9:12], 1e-3 * x[12:])
        y = made.state(x[:3], 1e-3 * x[3:6], 1e-6 * x[6:9])
        rate = made.vector_field(0.0, y)
        f, f_rate = jax.jvp(lambda t, y: made.errors(t, y), (0.0, y), (1.0, rate))
        return packed(f), packed(f_rate)

    of_errors, of_rates = rates_of_errors(jnp.zeros(15))

    @jax.jit
    @jax.jacfwd
    def linear(x):
        made = faulty(navigator, 1e-6 * x[9:12], 1e-3 * x[12:]).error_equations()
        f = made.errors(x[:3], 1e-3 * x[3:6], 1e-6 * x[6:9])
        return packed(made.vector_field(0.0, f))

    truth = linear(jnp.zeros(15))
    # Of the errors it holds, some differ from those put in: a place turns the level axes.
    truth = truth[:, :9] @ of_errors + jnp.pad(truth[:, 9:], ((0, 0), (9, 0)))
    assert_allclose(of_rates, truth, atol=1e-12 * float(jnp.abs(truth).max()))


@pytest.mark.parametrize("gimballed", [False, True])
def test_a_perfect_navigator_knows_a_wild_path_over_the_ellipsoid(gimballed):
    def path(t):
        return Place(
            0.6 + 1e-4 * jnp.sin(0.02 * t),
            0.3 + 2e-5 * t,
            3e3 + 40.0 * jnp.cos(0.1 * t),
            0.5 + 0.01 * t,
            0.2 * jnp.sin(0.3 * t),
            0.4 * jnp.cos(0.5 * t),
        )

    navigator = InertialNavigator(0.6, path=path, gimballed=gimballed)

    def true(t):
        felt = navigator.felt(t)
        y = navigator.state()
        attitude = y.attitude if gimballed else felt.attitude
        return eqx.tree_at(
            lambda y: (y.latitude, y.longitude, y.height, y.velocity, y.attitude),
            y,
            (*felt.place[:3], felt.velocity, attitude),
        )

    @jax.jit
    def both(t):
        y, y_rate = jax.jvp(true, (t,), (jnp.ones_like(t),))
        return y_rate, navigator.vector_field(t, y)

    for t in (0.0, 7.0):
        rate, found = both(jnp.asarray(t))
        for a, b in zip(jax.tree.leaves(rate), jax.tree.leaves(found), strict=True):
            # Rounding of gravity, and of speeds of 1e3 m/s.
            assert_allclose(b, a, rtol=1e-11, atol=1e-13)


def test_gravity_of_the_ellipsoid():
    earth = InertialNavigator(0.0).earth
    # Of WGS 84 at the equator and at a pole; without J_4, which takes 15/8 and 5 times 2.4e-6.
    assert_allclose(earth.gravity(0.0, 0.0)[2], -9.7803253359, rtol=5e-6)
    assert_allclose(earth.gravity(0.5 * jnp.pi, 0.0)[2], -9.8321849378, rtol=1.3e-5)
    # The plumb line is the normal of the ellipsoid, a level surface, to the same order.
    assert_allclose(earth.gravity(0.8, 0.0)[1], 0.0, atol=2e-5)
    # Radii of curvature of WGS 84 at a pole and at the equator.
    assert_allclose(earth.curvature_radii(0.5 * jnp.pi), [6399593.6258] * 2, rtol=1e-11)
    assert_allclose(earth.curvature_radii(0.0), [6335439.3273, 6378137.0], rtol=1e-11)


def test_a_deflection_of_the_vertical_is_an_error_of_the_accelerometers():
    def anomaly(latitude, longitude, height):
        return jnp.stack([-9.8e-5 * jnp.cos(longitude), 0.0 * height, -1e-4 + 0.0 * height])

    navigator = InertialNavigator(0.8, anomaly=anomaly)
    rate = navigator.vector_field(0.0, navigator.state()).velocity
    # The accelerometers feel its opposite, in all axes.
    assert_allclose(rate, [9.8e-5, 0.0, 1e-4], atol=1e-14)


def test_modes_of_the_navigator_are_those_of_the_error_equations():
    """Schuler's oscillation split by Foucault's turn, the day, and the unstable height."""
    navigator = InertialNavigator(0.8, **SPHERE)

    def roots(system, y):
        found = np.asarray(modes(system, y).eigenvalues)
        return found[np.lexsort((found.real.round(7), found.imag.round(7)))]

    found = roots(navigator, navigator.state())
    equations = navigator.error_equations()
    truth = roots(equations, equations.errors(jnp.zeros(3)))
    w0 = schuler_frequency(equations.gravity, equations.radius)
    # A double root at zero is known to the root of a rounding.
    assert_allclose(found, truth, atol=3e-8 * float(w0) + 1e-10)
    assert_allclose(np.max(found.real), jnp.sqrt(2.0) * w0, rtol=1e-2)
    damped = InertialNavigator(0.8, **SPHERE, **AIDED)
    assert jnp.max(modes(damped, damped.state()).eigenvalues.real) < 1e-9


@pytest.mark.sweep
@pytest.mark.parametrize("gimballed", [False, True])
def test_a_day_of_schuler_s_oscillation_is_that_of_the_error_equations(gimballed):
    navigator = InertialNavigator(0.8, gimballed=gimballed, **SPHERE, **AIDED, **AIRCRAFT)
    ts = jnp.array([0.0, 43200.0, 86400.0])

    @jax.jit
    def drifts(drift, bias):
        def of(drift, bias):
            made = faulty(navigator, drift, bias)
            run = simulate(made, made.state(), ts, accuracy=Accuracy(1e-12, max_step=120.0))
            return packed(made.errors(ts, run.states))

        zero = jnp.zeros(3)
        return jax.jvp(of, (zero, zero), (drift, bias))[1]

    equations = faulty(navigator, DRIFT, BIAS).error_equations()
    truth = packed(equations.closed_form().flow(ts, equations.errors(jnp.zeros((3, 3)))))
    found = drifts(DRIFT, BIAS)
    assert_allclose(found[:, 1:], truth[:, 1:], rtol=1e-9)


@pytest.mark.sweep
def test_a_campaign_of_a_thousand_navigators_has_the_linear_covariance():
    deviations = {
        **{f"drift_{k}": 5e-8 for k in "xyz"},  # 0.01 deg/h
        **{f"bias_{k}": 5e-4 for k in "xyz"},  # 50 micro-g
        **{f"tilt_{k}": 5e-5 for k in "xyz"},
    }

    def vector(samples, name):
        return jnp.stack([samples[f"{name}_{k}"] for k in "xyz"])

    def navigator(samples):
        made = InertialNavigator(0.8, **SPHERE, **AIDED, **AIRCRAFT)
        return faulty(made, vector(samples, "drift"), vector(samples, "bias"))

    def build(samples):
        made = navigator(samples)
        return Mission([Phase(made, 86400.0)]), made.state(tilt=vector(samples, "tilt"))

    def outputs(result, samples):
        f = navigator(samples).errors(86400.0, result.final)
        return {"east": f.position[0], "north": f.position[1]}

    campaign = Campaign(build, {name: Normal(0.0, s) for name, s in deviations.items()}, outputs)
    found = disperse(campaign, runs=1000, accuracy=1e-9)
    assert found.good.all()

    @jax.jacfwd
    def linear(x):
        made = navigator(dict(zip(deviations, x, strict=True))).error_equations()
        f = made.closed_form().flow(86400.0, made.errors(jnp.zeros(3), tilt=x[6:]))
        return f.position[:2]

    slope = np.asarray(linear(jnp.zeros(9)))
    inputs = np.stack([found.inputs[name] for name in deviations])
    places = np.stack([found.values("east"), found.values("north")])
    # Each run is the linear one but for terms of second order, of which the runs that drift most
    # have up to 8 percent of a deviation.
    beyond = (places - slope @ inputs) / places.std(axis=1, keepdims=True)
    assert np.abs(beyond).max() < 0.2
    assert np.sqrt(np.mean(beyond**2)) < 0.03
    covariance = slope @ np.diag(np.square(list(deviations.values()))) @ slope.T
    # Of 1000 samples a deviation is known to 2.2 percent: four of those.
    assert_allclose(places.std(axis=1), np.sqrt(np.diag(covariance)), rtol=0.09)
