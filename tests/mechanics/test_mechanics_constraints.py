"""Constraints over long times: projection, its derivatives, the variational integrator."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxspace import Accuracy, simulate
from jaxspace.core import InputError
from jaxspace.mechanics import (
    DoublePendulum,
    FramedPendulum,
    InclineDisk,
    Lagrangian,
    SimplePendulum,
)
from jaxspace.mechanics.discrete import variational_motion
from jaxspace.solvers import Tsit5

# A method of few stages, which compiles sooner; `auto` has a test of its own.
COARSE = Accuracy(1e-6, method=Tsit5())
PERIOD = float(SimplePendulum(1.0, 9.8).period(jnp.pi / 2))


def free_point(t, q, v, g):
    return 0.5 * jnp.sum(v * v, axis=0) - g * q[-1]


def circle(t, q, g):
    return (jnp.sum(q * q, axis=0) - 1.0)[None]


def rod(g=9.8, **more):
    """A point on a rod in Cartesian coordinates, whose constraint does not decay."""
    return Lagrangian(free_point, ("x", "z"), g, **{"fixed": circle, "decay": 0.0} | more)


def errors(run):
    x, v = run.states.coordinates, run.states.rates
    return jnp.abs(jnp.sum(x * x, axis=0) - 1.0).max(), jnp.abs(jnp.sum(x * v, axis=0)).max()


# The tests below project the steps of `Tsit5`, too.
@pytest.mark.parametrize("method", ["auto", pytest.param(Tsit5(), marks=pytest.mark.sweep)])
def test_projection_keeps_a_constraint_to_rounding(method):
    system = rod()
    accuracy = Accuracy(1e-6, method=method)
    # Between the ends of steps, too: 51 times in 20 periods.
    run = simulate(
        system, system.state([1.0, 0.0]), jnp.linspace(0.0, 20 * PERIOD, 51), accuracy=accuracy
    )
    place, speed = errors(run)
    # A step leaves 1e-7; Newton's two steps from there leave 1e-28, hence rounding.
    assert place < 1e-15 and speed < 1e-14


@pytest.mark.sweep
def test_a_constraint_does_not_drift_in_ten_thousand_periods():
    system = rod()
    ts = jnp.array([0.0, 1e4 * PERIOD])
    accuracy = Accuracy(1e-6, max_steps=10**6)
    place, speed = errors(simulate(system, system.state([1.0, 0.0]), ts, accuracy=accuracy))
    assert place < 1e-15 and speed < 1e-14


def test_a_constraint_that_moves_and_one_that_rolls():
    # The circle grows with the time: x^2 + z^2 = (1 + t/10)^2.
    moving = rod(fixed=lambda t, q, g: (jnp.sum(q * q, axis=0) - (1.0 + 0.1 * t) ** 2)[None])
    ts = jnp.linspace(0.0, 5.0, 11)
    start = eqx.filter_jit(lambda s: s.consistent(s.state([1.0, 0.0])))(moving)
    run = simulate(moving, start, ts, accuracy=COARSE)
    x, v = run.states.coordinates, run.states.rates
    assert_allclose(jnp.sum(x * x, axis=0), (1.0 + 0.1 * ts) ** 2, rtol=1e-14)
    assert_allclose(jnp.sum(x * v, axis=0), 0.1 * (1.0 + 0.1 * ts), rtol=1e-13)
    disk = InclineDisk(1.0, 0.3, 0.4, 9.8)
    run = simulate(disk, disk.state(0.3, 1.1, 2.0), ts, accuracy=COARSE)
    y = run.states
    assert_allclose(disk.nonholonomic(0.0, y.coordinates, y.rates), 0.0, atol=1e-14)


def test_a_redundant_constraint_is_projected_too():
    twice = rod(fixed=lambda t, q, g: jnp.concatenate([circle(t, q, g)] * 2), redundant=True)
    ts = jnp.array([0.0, 0.2, 0.5 * PERIOD])
    run = simulate(twice, twice.state([1.0, 0.0]), ts, accuracy=Accuracy(1e-9, method=Tsit5()))
    assert errors(run)[0] < 1e-15
    # Half a swing, to the accuracy of the steps.
    assert_allclose(run.final.coordinates, [-1.0, 0.0], atol=1e-7)


@pytest.mark.sweep
def test_derivatives_through_projected_steps():
    ts = jnp.linspace(0.0, 2.0, 4)

    @jax.jit
    def place(g):
        system = rod(g)
        return simulate(system, system.state([1.0, 0.0]), ts, accuracy=1e-12).states.coordinates

    def of_angle(g):
        # The same by the angle, from the horizontal.
        system = SimplePendulum(1.0, g)
        angle = simulate(system, system.state(0.5 * jnp.pi), ts, accuracy=1e-12).states.coordinates
        return jnp.stack([jnp.sin(angle[0]), -jnp.cos(angle[0])])

    truth = jax.jacfwd(of_angle)(9.8)
    # Two integrations of derivatives at 1e-12.
    assert_allclose(jax.jacfwd(place)(9.8), truth, rtol=1e-9, atol=1e-10)
    back = jax.grad(lambda g: place(g)[0, 2])(9.8)
    assert_allclose(back, truth[0, 2], rtol=1e-9)


@pytest.mark.parametrize("order", [2, pytest.param(4, marks=pytest.mark.sweep)])
def test_variational_integrator_has_its_order_and_keeps_constraints(order):
    system, y = rod(), rod().state([1.0, 0.0])
    # Two thirds of a period: at the ends of a swing odd powers of h cancel.
    ts = jnp.array([0.0, PERIOD / 3.0, 2.0 * PERIOD / 3.0])
    angle = simulate(
        SimplePendulum(1.0, 9.8), SimplePendulum.state(0.5 * jnp.pi), ts, accuracy=1e-13
    ).final.coordinates[0]
    truth = np.array([jnp.sin(angle), -jnp.cos(angle)])
    found = []
    for steps in (20, 40):
        states = variational_motion(system, y, ts, steps=steps, order=order)
        found.append(np.abs(states.coordinates[:, -1] - truth).max())
        assert jnp.abs(circle(0.0, states.coordinates, 0.0)).max() < 1e-14
        assert jnp.abs(jnp.sum(states.coordinates * states.rates, axis=0)).max() < 1e-13
    # The ratio of errors at half the step.
    assert 0.75 * 2**order < found[0] / found[1] < 1.5 * 2**order, (order, found)


@pytest.mark.sweep
def test_variational_integrator_of_a_double_pendulum():
    system = DoublePendulum(2.0, 1.0, 1.0, 0.8, 9.8)
    y = system.state(0.6, 0.5, 0.1, -0.3)
    ts = jnp.array([0.0, 1.0, 2.0])
    truth = simulate(system, y, ts, accuracy=1e-13).final.coordinates
    error = [
        np.abs(variational_motion(system, y, ts, steps=k, order=6).coordinates[:, -1] - truth).max()
        for k in (20, 40)
    ]
    assert 0.6 * 2**6 < error[0] / error[1] < 1.6 * 2**6, error


def test_variational_integrator_keeps_momenta_and_bounds_the_energy():
    system = FramedPendulum(0.3, 1.0, 0.8, 9.8)
    ts = jnp.linspace(0.0, 200.0, 41)
    states = variational_motion(system, system.state(0.4, 0.1, 0.0, 2.0), ts, steps=200, order=2)
    momentum, energy = system.momenta(0.0, states)[1], system.energy(0.0, states)
    # Rounding of 8000 steps; order 2 at 180 steps a swing.
    assert_allclose(momentum, momentum[0], rtol=1e-10)
    assert jnp.abs(energy / energy[0] - 1.0).max() < 3e-5
    # No drift: the second half swings as the first one does.
    halves = [jnp.ptp(part) for part in jnp.split(energy[1:], 2)]
    assert halves[1] < 1.5 * halves[0]


def test_variational_integrator_with_friction_and_derivatives():
    damped = Lagrangian(
        lambda t, q, v, k: 0.5 * (v[0] ** 2 - k * q[0] ** 2),
        ("x",),
        4.0,
        rayleigh=lambda t, q, v, k: 0.1 * v[0] ** 2,
    )
    ts = jnp.array([0.0, 3.0])

    def at_end(k):
        system = eqx.tree_at(lambda s: s.parameters, damped, k)
        y = system.state([1.0])
        return variational_motion(system, y, ts, steps=60, order=6).coordinates[0, -1]

    def exact(k):
        w = jnp.sqrt(k - 0.01)
        return jnp.exp(-0.3) * (jnp.cos(3.0 * w) + 0.1 / w * jnp.sin(3.0 * w))

    assert_allclose(at_end(4.0), exact(4.0), rtol=1e-9)
    assert_allclose(jax.grad(at_end)(4.0), jax.grad(exact)(4.0), rtol=1e-8)
    assert_allclose(jax.jvp(at_end, (4.0,), (1.0,))[1], jax.grad(exact)(4.0), rtol=1e-8)


def test_what_the_variational_integrator_refuses():
    disk = InclineDisk(1.0, 0.3, 0.4, 9.8)
    ts = jnp.array([0.0, 1.0])
    with pytest.raises(InputError, match="nonholonomic constraints"):
        variational_motion(disk, disk.state(0.3, 1.1, 2.0), ts, steps=4)
    with pytest.raises(InputError, match="order is 3"):
        variational_motion(rod(), rod().state([1.0, 0.0]), ts, steps=4, order=3)
