"""DOP853 for r' = v, v' = a(t, r), whose steps sum accelerations alone: the step of its plain form
up to rounding, with its error, its states within and its derivatives, and only where the system is
of second order."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace import Scene
from jaxspace.bodies import BodyState
from jaxspace.core import AbstractSystem
from jaxspace.core.vectors import dot
from jaxspace.integration.config import IntegrationConfig
from jaxspace.integration.integrate import _method
from jaxspace.orbits import PointGravity
from jaxspace.solvers import DOP853, FixedSteps, Tsit5

TERM = diffrax.ODETerm(lambda t, y, system: system.vector_field(t, y))
# Sums of some fifty products of order one, in another order.
ROUNDINGS = 50.0 * np.finfo(float).eps


class Swing(AbstractSystem):
    """r'' = -r sin(|r|^2 + t)."""

    def vector_field(self, t, y):
        a = -y.position * jnp.sin(dot(y.position, y.position) + t)
        return BodyState(y.velocity, a)

    def invariants(self, t, y):
        return {}


def starts():
    """Three runs."""
    g = np.random.default_rng(3)
    r, v = g.uniform(-1.0, 1.0, (2, 3, 3))
    return BodyState(jnp.asarray(r), jnp.asarray(v))


def step(method):
    """End, error and states within a step, from its start."""

    def go(y):
        t0, t1 = jnp.array(0.3), jnp.array(1.1)
        y1, error, dense, _, _ = method.step(TERM, t0, t1, y, Swing(), None, jnp.array(False))
        if not method.dense:
            return y1, error, ()
        polynomial = method.interpolation_cls(t0=t0, t1=t1, **dense)
        return y1, error, [polynomial.state(jnp.array(t)) for t in (0.3, 0.45, 0.7, 1.0, 1.1)]

    return jax.jit(go)


def both(method):
    return step(method), step(method.for_second_order())


@pytest.mark.parametrize("dense", [True, False])
@pytest.mark.parametrize("rolled", [True, False])
def test_the_step_is_that_of_the_plain_form(dense, rolled):
    plain, summed = both(DOP853(dense=dense, rolled=rolled))
    y = starts()
    expected, found = plain(y), summed(y)
    # The error is one of a long step: a difference of sums that is far above their roundings.
    assert all(np.min(np.abs(x)) > 1e3 * ROUNDINGS for x in jax.tree.leaves(expected[1]))
    for x, z in zip(jax.tree.leaves(expected), jax.tree.leaves(found), strict=True):
        np.testing.assert_allclose(z, x, rtol=0.0, atol=ROUNDINGS)


@pytest.mark.parametrize("rolled", [True, False])
def test_derivatives_are_those_of_the_plain_form(rolled):
    plain, summed = both(DOP853(rolled=rolled))
    y = starts()
    along = jax.tree.map(lambda x: jnp.cos(3.0 * x), y)
    forward = [jax.jvp(f, (y,), (along,))[1] for f in (plain, summed)]
    # Slopes of the field are of order ten here, and are multiplied through the stages.
    for x, z in zip(*map(jax.tree.leaves, forward), strict=True):
        np.testing.assert_allclose(z, x, rtol=0.0, atol=100.0 * ROUNDINGS)
    weights = jax.tree.map(jnp.sin, plain(y))
    backward = [jax.vjp(f, y)[1](weights)[0] for f in (plain, summed)]
    for x, z in zip(*map(jax.tree.leaves, backward), strict=True):
        np.testing.assert_allclose(z, x, rtol=0.0, atol=1e3 * ROUNDINGS)


def test_single_precision():
    y = jax.tree.map(lambda x: x.astype(jnp.float32), starts())
    long = step(DOP853())(starts())[0]
    t0, t1 = jnp.float32(0.3), jnp.float32(1.1)
    method = DOP853().for_second_order()
    y1, *_ = method.step(TERM, t0, t1, y, Swing(), None, jnp.array(False))
    for x, z in zip(jax.tree.leaves(long), jax.tree.leaves(y1), strict=True):
        assert z.dtype == jnp.float32
        np.testing.assert_allclose(z, x, rtol=0.0, atol=50.0 * np.finfo(np.float32).eps)


class Damped(Swing):
    """The same with a drag."""

    def vector_field(self, t, y):
        rate = super().vector_field(t, y)
        return BodyState(rate.position, rate.velocity - 0.1 * y.velocity)


def method_of(system, y, method):
    config = IntegrationConfig(
        rtol=np.asarray(1e-9),
        atol=np.asarray(1e-9),
        method=method,
        max_steps=64,
        max_step=None,
    )
    return _method(config, system, y)


def test_a_run_has_the_form_where_its_system_is_of_second_order():
    y = starts()
    for system in (Swing(), Scene((PointGravity(1.0),))):
        assert method_of(system, y, DOP853()) == DOP853(second_order=True)
    fixed = method_of(Swing(), y, FixedSteps(DOP853(), 8))
    assert fixed == FixedSteps(DOP853(second_order=True), 8)


def test_other_runs_keep_the_plain_form():
    y = starts()
    assert method_of(Damped(), y, DOP853()) == DOP853()
    assert method_of(Swing(), y, Tsit5()) == Tsit5()
    # A mass is a third part of the state.
    scene = Scene((PointGravity(1.0),), carry=("mass",))
    heavy = BodyState(y.position, y.velocity, mass=jnp.ones(3))
    assert method_of(scene, heavy, DOP853()) == DOP853()
