"""Regularised variables for eccentric orbits: against the closed form, under perturbations,
landing, derivatives, honest errors."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jaxspace import Scene
from jaxspace.bodies import BodyState, Load, RigidBody
from jaxspace.core import InputError
from jaxspace.orbits import Oblateness, PointGravity, TwoBody
from jaxspace.orbits._ks_map import ks_map, ks_parameters
from jaxspace.orbits.kepler import kepler_flow
from jaxspace.rockets import JetDamping
from jaxspace.scene import Custom
from jaxspace.simulation import Accuracy, Status, simulate, simulate_batch
from jaxspace.solvers import Regularised

J2, TURN, AXES = 1.08262668e-3, 2.0 * np.pi, np.eye(3)


def by(steps, rtol=1e-9, **more):
    return Accuracy(rtol=rtol, method=Regularised(steps=steps), **more)


def periapsis(e, q=None, axes=AXES):
    """Periapsis along the first of the `axes`, motion along the second; semi-major axis 1 unless
    the distance q is given."""
    q = 1.0 - e if q is None else q
    return BodyState(jnp.array(q * axes[0]), jnp.array(np.sqrt((1.0 + e) / q) * axes[1]))


def apoapsis(e, axes=AXES):
    """Apoapsis against the first of the `axes`: from there the energy of a narrow orbit is well
    defined."""
    return BodyState(
        jnp.array(-(1.0 + e) * axes[0]), jnp.array(-np.sqrt((1.0 - e) / (1.0 + e)) * axes[1])
    )


def oblate(j2, radius=0.5):
    return Scene((PointGravity(1.0), Oblateness(1.0, j2, radius)))


@jax.jit
def flown(y, j2, ts):
    """Under oblateness, with 400 steps."""
    return simulate(oblate(j2), y, ts, accuracy=by(400), throw=False)


def far(a, b):
    """The largest distance of two positions."""
    return float(np.max(np.linalg.norm(np.asarray(a) - np.asarray(b), axis=0)))


def by_scipy(force, y, ts):
    """Positions by scipy's DOP853 at a tolerance of 1e-13, about a point mass of gravitational
    parameter 1."""

    def rate(t, s):
        r, v = s[:3], s[3:]
        return np.concatenate([v, force(t, r, v) - r / np.linalg.norm(r) ** 3])

    start = np.concatenate([y.position, y.velocity])
    return solve_ivp(
        rate, (ts[0], ts[-1]), start, method="DOP853", rtol=1e-13, atol=1e-14, t_eval=ts
    ).y[:3]


def oblate_force(t, r, v):
    c, s = 1.5 * J2 * 0.25 / np.linalg.norm(r) ** 5, 5.0 * r[2] ** 2 / (r @ r)
    return -c * r * np.array([1.0 - s, 1.0 - s, 3.0 - s])


@pytest.mark.parametrize(
    "axis", [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (-0.6, 0, 0.8)]
)
def test_parameters_exist_in_every_direction_and_are_smooth(axis):
    r = jnp.array(axis, dtype=float)

    def again(r):
        u = ks_parameters(r)
        return ks_map(u, u)

    np.testing.assert_allclose(again(r), r, atol=1e-15)
    for jacobian in (jax.jacfwd, jax.jacrev):
        np.testing.assert_allclose(jacobian(again)(r), np.eye(3), atol=1e-15)


def test_every_conic_in_every_direction_agrees_with_the_closed_form():
    """With 32 steps a revolution over twenty of them, forwards and backwards, up to a periapsis at
    1e-6 of the semi-major axis; and the fall from rest through the centre, of which the closed form
    takes whole periods off."""
    turned = np.roll(np.eye(3), 1, axis=0)
    mirrored = np.array([[-1.0, 0.0, 0.0], [0.0, 0.6, -0.8], [0.0, 0.8, 0.6]])
    # 20 revolutions and a bit, but for the open orbits and for a time before the start
    runs = [
        (periapsis(0.0), 126.0),
        (periapsis(0.95, axes=turned), 127.3),
        (periapsis(0.95, axes=mirrored), -128.1),
        (apoapsis(0.9999, mirrored), 126.5),
        (apoapsis(1.0 - 1e-6), 129.0),
        (periapsis(1.0, 0.1), 40.0),
        (periapsis(3.0, 0.2, turned), 15.0),
        (BodyState(jnp.array([0.0, -1.2, 1.6]), jnp.zeros(3)), 20.0 * TURN + 1.0),
    ]
    y = jax.tree.map(lambda *x: jnp.stack(x, axis=-1), *(y for y, _ in runs))
    spans = jnp.array([span for _, span in runs])
    ts = jnp.stack([jnp.zeros_like(spans), spans])
    found = simulate_batch(Scene((PointGravity(1.0),)), y, ts, accuracy=by(640))
    exact = jax.jit(kepler_flow)(y.position, y.velocity, spans, 1.0)[0]
    assert np.all(found.status == Status.COMPLETED)
    # 640 steps with an error of some 1e-13 each at most, where a phase error grows with the square
    # of their number
    assert far(found.final.position, exact) < 1e-10


def test_oblateness_forwards_backwards_and_not_at_all():
    """Against an integration in time by scipy, and there and back again."""
    y = periapsis(0.5, axes=np.array([[0.6, 0.0, 0.8], [0.0, 1.0, 0.0], [-0.8, 0.0, 0.6]]))
    run = flown(y, J2, jnp.array([0.0, 60.0]))
    assert run.status == Status.COMPLETED
    # a tolerance of 1e-13 in each of scipy's steps, some hundreds of them
    assert far(run.final.position, by_scipy(oblate_force, y, [0.0, 60.0])[:, -1]) < 2e-10
    assert float(run.drift()["energy"][-1]) < 1e-12
    back = flown(run.final, J2, jnp.array([60.0, 0.0]))
    assert far(back.final.position, y.position) < 1e-10
    assert far(flown(y, J2, jnp.array([3.0, 3.0])).final.position, y.position) < 1e-15


@pytest.mark.sweep
def test_derivatives_agree_with_the_closed_form_and_with_differences():
    y, ts = periapsis(0.9), jnp.array([0.0, 20.0])

    def end(y, j2, span):
        accuracy = Accuracy(method=Regularised(steps=144, estimate=False))
        return simulate(
            oblate(j2, 0.05), y, jnp.stack([ts[0], span]), accuracy=accuracy, throw=False
        ).final.position

    def closed(y, span):
        return kepler_flow(y.position, y.velocity, span, 1.0)[0]

    given = (y, jnp.array(0.0), ts[1])
    cotangent = jnp.array([0.3, -0.5, 0.8])
    reverse = jax.jit(lambda *p: jax.vjp(end, *p)[1](cotangent))(*given)
    exact = jax.vjp(closed, y, ts[1])[1](cotangent)
    # three revolutions at a periapsis of 0.1: the derivatives are up to some 1e4
    for a, b in zip(jax.tree.leaves((reverse[0], reverse[2])), jax.tree.leaves(exact), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-7, atol=1e-6)
    tangent = jax.tree.map(jnp.ones_like, given)
    value = jax.jit(lambda *p: jax.jvp(end, p, tangent))
    forward = value(*given)[1]
    expected = sum(jnp.sum(x) for x in jax.tree.leaves(reverse))
    np.testing.assert_allclose(cotangent @ forward, expected, rtol=1e-8)
    more, less = value(y, jnp.array(1e-5), ts[1])[0], value(y, jnp.array(-1e-5), ts[1])[0]
    np.testing.assert_allclose(reverse[1], cotangent @ (more - less) / 2e-5, rtol=1e-5)


def test_forces_of_any_kind_and_every_time_asked_for():
    """Drag and a push that turns with the time, against scipy."""

    def push(t, y, body):
        turning = 1e-3 * jnp.stack([jnp.cos(0.3 * t), jnp.sin(0.3 * t), jnp.ones_like(t)])
        return Load(acceleration_N=turning - 1e-3 * y.velocity)

    scene = Scene((PointGravity(1.0), Custom(push)))
    y, ts = periapsis(0.7), np.array([2.0, 5.0, 11.0, 12.0, 30.0])
    exact = by_scipy(
        lambda t, r, v: 1e-3 * np.array([np.cos(0.3 * t), np.sin(0.3 * t), 1.0]) - 1e-3 * v, y, ts
    )
    run = simulate(scene, y, jnp.array(ts), accuracy=by(100))
    assert far(run.states.position, exact) < 1e-10


def test_errors_fall_with_the_order_and_are_not_understated():
    y, ts = (
        periapsis(0.5, axes=np.array([[0.6, 0.0, 0.8], [0.0, 1.0, 0.0], [-0.8, 0.0, 0.6]])),
        jnp.array([0.0, 32.0]),
    )
    exact = by_scipy(oblate_force, y, [0.0, 32.0])[:, -1]

    # In a program of its own, where too few steps are not repeated with more.
    @eqx.filter_jit
    def run_at(rtol):
        return simulate(oblate(J2), y, ts, accuracy=by(112, rtol), throw=False)

    # Nothing is left of a run that misses its tolerance: a loose one shows its error.
    missed, run = run_at(jnp.array(1e-12)), run_at(jnp.array(1e-3))
    assert missed.status == Status.TOLERANCE_MISSED
    assert run.status == Status.COMPLETED
    error = far(run.final.position, exact)
    # The largest local error is a sixteenth of the difference to half as many steps, relative to
    # the length of the position.
    difference = 16.0 * 1e-3 * float(run.stats["largest_local_error"]) * np.linalg.norm(exact)
    assert difference / 16.0 > error
    assert np.log2(difference / error) > 6.5


def test_single_precision_stays_single():
    y = jax.tree.map(lambda x: x.astype(jnp.float32), periapsis(0.9))
    run = simulate(
        oblate(0.0, 0.05),
        y,
        jnp.array([0.0, 4.5]),
        accuracy=Accuracy(rtol=1e-4, method=Regularised(steps=36, estimate=False)),
    )
    exact = kepler_flow(periapsis(0.9).position, periapsis(0.9).velocity, 4.5, 1.0)[0]
    assert run.final.position.dtype == jnp.float32
    assert far(run.final.position, exact) < 2e-5  # a hundred roundings of 6e-8


def refused(scene, reason):
    assert scene.regularised() is None
    assert reason in scene.missing("regularised")


def test_it_refuses_what_has_no_regularised_variables():
    y, ts = periapsis(0.5), jnp.array([0.0, 1.0])
    with pytest.raises(InputError, match="steps is 3"):
        Regularised(steps=3)
    with pytest.raises(InputError, match="TwoBody offers no regular"):
        simulate(TwoBody(1.0), y, ts, accuracy=by(10))
    refused(Scene((Oblateness(1.0, J2, 1.0),)), "one effect such as PointGravity, and has 0")
    body = RigidBody(mass=1.0, inertia=(1.0, 1.0, 2.0))
    damped = Scene((PointGravity(1.0), JetDamping(lambda t, m: -1.0 * m, 1.0, 0.1)), body)
    refused(damped, "JetDamping reads the omega")
    turning = Scene((PointGravity(1.0),), body, carry=("attitude",))
    refused(turning, "state has position, velocity, attitude, omega")
