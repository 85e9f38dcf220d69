"""Splitting of perturbed orbits: its order, that it is exact without a perturbation, its energy,
its derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm

from jaxspace import Scene
from jaxspace.attitude import Top
from jaxspace.bodies import BodyState, BurningBody, Load
from jaxspace.core import InputError
from jaxspace.orbits import Oblateness, PointGravity, TwoBody
from jaxspace.scene import Custom
from jaxspace.simulation import Accuracy, Status, simulate, simulate_batch
from jaxspace.solvers import Splitting
from jaxspace.solvers._split_schemes import SCHEMES

J2 = 1.08262668e-3


def oblate(j2=J2):
    """J2 of a planet of the radius 1. It has a tenth of it, below every periapsis here: what counts
    is J2 R^2."""
    return Scene((PointGravity(1.0), Oblateness(1.0, 100.0 * j2, 0.1)))


def start(e=0.1):
    """Periapsis of an inclined ellipse with semi-major axis 1.2 and gravitational parameter 1."""
    v = np.sqrt((1.0 + e) / (1.0 - e) / 1.2)
    return BodyState(jnp.array([1.2 * (1.0 - e), 0.0, 0.0]), jnp.array([0.0, 0.8 * v, 0.6 * v]))


def by(steps, order=4, rtol=1e-6, **more):
    return Accuracy(rtol=rtol, method=Splitting(order, steps=steps), **more)


def sixty(span, y, order=4, rtol=1e-3, j2=J2):
    """A run of sixty steps: of each order one program, however long the span."""
    return simulate(
        oblate(j2), y, jnp.array([0.0, span]), accuracy=by(60, order, rtol), throw=False
    )


def far(a, b):
    """The largest distance of two positions."""
    return float(jnp.max(jnp.linalg.norm(a - b, axis=0)))


def exact(ts):
    """The positions at seven times, by another method."""
    return simulate(oblate(), start(), ts, accuracy=1e-13).states.position


@pytest.mark.slow
@pytest.mark.parametrize("order", [4, 2, 6])
def test_errors_fall_with_the_order_and_are_estimated(order):
    end = exact(jnp.linspace(0.0, 20.0, 7))[:, -1]
    coarse, half = sixty(20.0, start(), order), sixty(10.0, start(), order)
    errors = [far(run.final.position, end) for run in (coarse, sixty(10.0, half.final, order))]
    # Of the length of the position, near 1.2; the estimate is good to the next order.
    assert 0.2 < 1.2e-3 * coarse.stats["largest_local_error"] / errors[0] < 5.0
    assert np.log2(errors[0] / errors[1]) > order - 0.5


# The kicks of a step; the degrees whose power sums of the places are those of the integral.
PLACES = {(8, 2): (4, 8), (8, 6, 4): (7, 8)}


@pytest.mark.parametrize("order", PLACES)
def test_to_first_order_in_the_kick_it_is_a_quadrature(order):
    """Of the order that stands first: sum b_k c_k^j = 1/(j + 1) for j below it, and no further."""
    scheme = SCHEMES[order]
    kicks, exact = PLACES[order]
    weights, places, *_ = scheme.rows().T
    assert len(weights) == scheme.kicks == kicks
    j = np.arange(exact)
    moments = np.sum(weights * places ** j[:, None], axis=1)
    np.testing.assert_allclose(moments, 1.0 / (j + 1), atol=2e-15)
    assert abs(np.sum(weights * places**exact) - 1.0 / (exact + 1)) > 1e-6
    np.testing.assert_allclose(np.sum(scheme.outside), 1.0, atol=1e-15)


@pytest.mark.parametrize(("order", "square"), [((8, 2), 2), ((8, 6, 4), 6)])
def test_the_square_of_the_kick_has_its_order(order, square):
    """Of a linear system y' = (A + eps B) y: what is even in eps of the error of a step falls with
    one power of h more than the order in the square."""
    a, b = np.random.default_rng(3).standard_normal((2, 3, 3))
    scheme = SCHEMES[order]

    def step(eps, h):
        y = expm(scheme.outside[0] * h * a)
        for drift, kick in zip(scheme.outside[1:], scheme.inside, strict=True):
            y = expm(drift * h * a) @ expm(kick * h * eps * b) @ y
        return y - expm(h * (a + eps * b))

    def even(h):
        return np.max(np.abs(step(0.01, h) + step(-0.01, h)))

    assert abs(np.log2(even(0.25) / even(0.125)) - (square + 1)) < 0.4


@pytest.mark.sweep
@pytest.mark.parametrize("order", PLACES)
def test_a_small_kick_has_the_high_order(order):
    """Of a thousandth of the oblateness the error falls with h^8 until its square is seen, and
    stands below that of order 4 with as many kicks."""
    span, j2 = 20.0, 1e-3 * J2
    end = simulate(
        oblate(j2), start(), jnp.array([0.0, span]), accuracy=Accuracy(1e-13)
    ).final.position

    def error(order, kicks):
        steps = 2 * round(kicks / (2 * SCHEMES[order].kicks))
        method = Splitting(order, steps=steps, estimate=False)
        run = simulate(
            oblate(j2), start(), jnp.array([0.0, span]), accuracy=Accuracy(method=method)
        )
        return far(run.final.position, end)

    assert error(order, 112) < 0.05 * error(4, 110)
    assert np.log2(error(order, 56) / error(order, 112)) > 5.5


def test_without_a_perturbation_every_step_is_exact():
    run = sixty(20.0, start(0.9), j2=0.0)
    closed = simulate(TwoBody(1.0), start(0.9), jnp.array([0.0, 20.0]))
    assert far(run.final.position, closed.final.position) < 1e-11


def test_every_state_asked_for_is_landed_on_backwards_and_in_a_batch():
    ts = jnp.linspace(20.0, 0.0, 7)
    both = jax.tree.map(lambda x: jnp.stack([x, x], axis=-1), start())
    run = simulate_batch(oblate(), both, ts, accuracy=by(30, 6))
    assert far(run.states.position[..., 1], exact(ts)) < 1e-7


def test_energy_swings_and_does_not_wander():
    """Over 300 revolutions with twenty steps in each, as over thirty: the swing is of one size."""
    y, energy = start(), []
    kept = jax.jit(lambda y: oblate().invariants(0.0, y)["energy"])
    for _ in range(100):
        energy.append(float(kept(y)))
        y = sixty(6.0 * np.pi * 1.2**1.5, y).final
    swing = np.abs(np.array(energy) - energy[0]).reshape(10, 10).max(axis=1)
    # Ten times as long an error that wanders would grow tenfold.
    assert swing.max() < 4.0 * swing[0]
    assert swing.max() < 1e-6


def without_estimate():
    return Accuracy(method=Splitting(4, steps=60, estimate=False))


def against_differences(end, derivative, given):
    """The derivatives of `end` against differences of the same steps."""
    found = derivative(lambda *p: end(*p), argnums=(0, 1))(*given)
    for i, value in enumerate(found):
        up, down = (
            [p + (1e-6 if i == k else 0.0) * s for k, p in enumerate(given)] for s in (1.0, -1.0)
        )
        np.testing.assert_allclose(value, (end(*up) - end(*down)) / 2e-6, rtol=1e-6)


@pytest.mark.sweep
def test_derivatives_of_an_orbit_forwards():
    def end(j2, x):
        y = BodyState(jnp.array([1.08, 0.0, 0.0]) + x, start().velocity)
        accuracy = without_estimate()
        return jnp.sum(
            simulate(
                oblate(j2), y, jnp.array([0.0, 20.0]), accuracy=accuracy, throw=False
            ).final.position
            ** 3
        )

    against_differences(end, jax.jacfwd, (jnp.array(J2), jnp.array(0.1)))


@pytest.mark.sweep
def test_derivatives_of_a_top_in_reverse():
    y = Top.state(jnp.array([0.2, 0.7, 0.1]), jnp.array([1.0, 0.3, 14.0]))

    def end(weight, x):
        at = BodyState(attitude=y.attitude, omega=y.omega + x)
        ts = jnp.array([0.0, 1.0])
        return jnp.sum(
            simulate(Top(0.002, 0.0008, weight), at, ts, accuracy=without_estimate()).final.omega
            ** 3
        )

    against_differences(end, jax.grad, (jnp.array(0.03), jnp.array(0.1)))


def test_too_few_steps_are_reported():
    assert sixty(400.0, start(), rtol=1e-9).status == Status.TOLERANCE_MISSED


def refused(scene, reason):
    assert scene.split() is None
    assert reason in scene.missing("split")


def test_it_refuses_what_cannot_be_split():
    with pytest.raises(InputError, match=r"order is 3: .* 2, 4, 6, \(8, 2\)"):
        Splitting(3, steps=10)
    with pytest.raises(InputError, match="steps is 5"):
        Splitting(4, steps=5)
    with pytest.raises(InputError, match="TwoBody offers no split into drift and kick"):
        simulate(TwoBody(1.0), start(), jnp.array([0.0, 1.0]), accuracy=by(10))
    refused(Scene((PointGravity(1.0), PointGravity(1.0))), "PointGravity is a second effect")
    drag = Custom(
        lambda t, y, body: Load(acceleration_N=-0.01 * y.velocity),
    )
    refused(Scene((PointGravity(1.0), drag)), "more than loads by position and attitude")
    body = BurningBody(1.0, [1.0, 1.0, 1.0], [1.0, 1.0, 1.0])
    refused(Scene((PointGravity(1.0),), body, carry=("mass",)), "its mass is part of the state")
