"""Steering into an orbit in an inverse-square field: laws of few numbers and free profiles against
the optimality conditions, solved by SciPy."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

from jaxspace.core import InputError, Spline
from jaxspace.optimization import Insertion, InsertionState, SteeringProfile, optimise_insertion
from jaxspace.optimization.ascent import ConstantMassFlow
from jaxspace.optimization.laws import SteeringNetwork, TangentLaw
from jaxspace.optimization.optimisers import lbfgs, named_optimiser

# Of Electron's second stage, with the first burnt out at 100 km; to a circle at 185 km.
MU, EARTH = 3.986004418e14, 6378137.0
EXHAUST, DEPLETION = 3363.7, 333.0
START, RADIUS = (EARTH + 100e3, 900.0, 3000.0), EARTH + 185e3
SPEED = float(np.sqrt(MU / RADIUS))
GIVEN = Insertion(
    ConstantMassFlow(EXHAUST, DEPLETION), InsertionState(*START), mu=MU, radius=RADIUS
)


def flown(start, duration, accuracy=1e-11):
    """The end of the optimal flight with the costates `start` of r and w, that of v being 1, in
    units of the target's radius and speed: Pontryagin's conditions, and the thrust along the
    costates of the velocity."""
    unit = RADIUS / SPEED

    def rate(t, y):
        r, w, v, p, q, s = y
        a = EXHAUST / SPEED / (DEPLETION / unit - t)
        size = np.hypot(q, s)
        return [
            w,
            v * v / r - 1.0 / r**2 + a * q / size,
            -w * v / r + a * s / size,
            q * (v * v / r**2 - 2.0 / r**3) - s * w * v / r**2,
            -p + s * v / r,
            -2.0 * q * v / r + s * w / r,
        ]

    y0 = [START[0] / RADIUS, START[1] / SPEED, START[2] / SPEED, *start, 1.0]
    run = solve_ivp(rate, (0.0, duration), y0, rtol=accuracy, atol=accuracy, method="DOP853")
    return run.y[:, -1]


def least_time():
    """The duration of the optimum, s."""
    unit = RADIUS / SPEED

    def miss(x):
        return flown(x[:2], x[2])[:3] - [1.0, 0.0, 1.0]

    found, _, ok, text = fsolve(miss, [0.0, 0.3, 262.0 / unit], full_output=True, xtol=1e-12)
    assert ok == 1, text
    return found[2] * unit


def greatest_velocity(duration):
    """The velocity across at the target's radius, m/s."""
    unit = RADIUS / SPEED

    def miss(x):
        return flown(x, duration / unit)[:2] - [1.0, 0.0]

    found, _, ok, text = fsolve(miss, [0.0, 0.3], full_output=True, xtol=1e-12)
    assert ok == 1, text
    return flown(found, duration / unit)[2] * SPEED


NODES = np.linspace(0.0, 1.0, 7)
LAWS = {
    "linear": (TangentLaw(0.5, -0.4), 1e-5),
    "bilinear": (TangentLaw(0.5, -0.4, 0.1), 1e-6),
    "lines": (SteeringProfile(NODES, 0.45 - 0.4 * NODES), 1e-7),
    "spline": (Spline(NODES, 0.45 - 0.4 * NODES), 2e-8),
}


def network():
    """Nineteen weights."""
    made = eqx.nn.MLP("scalar", "scalar", 6, 1, jax.nn.tanh, key=jax.random.key(3))
    return SteeringNetwork(made)


@pytest.fixture(scope="module")
def best():
    return least_time()


@pytest.mark.parametrize(
    "name",
    [
        "bilinear",
        *(pytest.param(n, marks=pytest.mark.sweep) for n in ("linear", "lines", "spline")),
    ],
)
def test_least_time_to_orbit(best, name):
    """A law of few numbers comes near the optimum, and more numbers nearer: none is below it."""
    law, above = LAWS[name]
    found = optimise_insertion(GIVEN, law, 270.0)
    assert found.converged, found.minimum.sentence()
    end = found.end
    np.testing.assert_allclose([end.radius, end.across], [RADIUS, SPEED], rtol=1e-6)
    np.testing.assert_allclose(end.radial, 0.0, atol=1e-2)
    assert -1e-8 < found.duration / best - 1.0 < above
    assert found.error < 1e-7


@pytest.mark.sweep
def test_a_network_steers_to_orbit(best):
    """A network's weights are moved through the optimiser like the numbers of any law."""
    found = optimise_insertion(GIVEN, network(), 270.0, tolerance=1e-5)
    np.testing.assert_allclose(found.end.radius, RADIUS, rtol=1e-6)
    assert -1e-7 < found.duration / best - 1.0 < 5e-6


@pytest.mark.sweep
def test_optimisers_of_optax_steer_to_orbit(best):
    """L-BFGS to the digits of the quadratic programmes; Adam with a rate that falls trains the
    network as networks are trained, and ends nearer than the linear tangent needs to be."""
    law, above = LAWS["bilinear"]
    found = optimise_insertion(GIVEN, law, 270.0, optimiser=lbfgs(), max_steps=400)
    assert found.converged, found.minimum.sentence()
    assert -1e-7 < found.duration / best - 1.0 < above
    trained = optimise_insertion(
        GIVEN,
        network(),
        270.0,
        tolerance=1e-5,
        max_steps=4000,
        optimiser=named_optimiser("adam", 0.03, 4000),
    )
    np.testing.assert_allclose(trained.end.radius, RADIUS, rtol=1e-6)
    # Measured: 1.7e-5, where steps of a rate of 3e-5 end.
    assert -1e-7 < trained.duration / best - 1.0 < 5e-5


@pytest.mark.sweep
def test_greatest_velocity_and_its_price():
    """The counterpart at a given time; the multiplier is the slope by the radius."""
    law = LAWS["bilinear"][0]
    found = optimise_insertion(GIVEN, law, 255.0, form="velocity")
    assert found.converged, found.minimum.sentence()
    assert -1e-7 < 1.0 - found.end.across / greatest_velocity(255.0) < 2e-5
    ends = []
    for radius in (RADIUS - 500.0, RADIUS + 500.0):
        other = eqx.tree_at(lambda g: g.radius, GIVEN, jnp.asarray(radius))
        ends.append(float(optimise_insertion(other, law, 255.0, form="velocity").end.across))
    np.testing.assert_allclose(found.radius_price, (ends[1] - ends[0]) / 1e3, rtol=1e-3)


def test_wrong_forms_are_refused():
    with pytest.raises(InputError, match="one of time, velocity"):
        optimise_insertion(GIVEN, LAWS["linear"][0], 270.0, form="height")


@pytest.mark.sweep
def test_an_orbit_out_of_reach_is_said_in_a_sentence():
    """The radius of the moon's orbit in the stage's last seconds: the nearest place, and no NaN."""
    far = eqx.tree_at(lambda g: g.radius, GIVEN, jnp.asarray(3.8e8))
    found = optimise_insertion(far, LAWS["linear"][0], 250.0, form="velocity")
    assert not found.converged and "cannot be satisfied" in found.minimum.sentence()
    assert bool(jnp.isfinite(found.end.radius))
