"""Derivatives of runs through a place where the vector field is continuous and its slope infinite:
the motion passes it easily, but the stages of a step see the slope wherever they happen to be.

    x' = 1 + |x - 1|^p,   z' = |x - 1|^p        h = x - 1

    of the start a, with f(x) = x':   dt(x)/da = -1/f(a),   dx(t)/da = f(x)/f(a)

The flow from a to x is that from any other start, so that the derivatives need no integral. z and t
differ by x - a, because z' = x' - 1.
"""

from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad

from jaxspace import Event, Mission, Phase, Status, simulate, simulate_batch, simulate_mission
from jaxspace.core import AbstractSystem, Scalar, quantity

ROOT, CUBE_ROOT = 0.5, 1.0 / 3.0
# Errors of a derivative by the tolerance. Where the slope is infinite at an event they are those of
# any other run, and within a run a power of the length of the shortest steps.
AT_EVENT = {1e-6: 1e-5, 1e-9: 1e-6}
WITHIN = {ROOT: 1e-3, CUBE_ROOT: 1e-2}


class Place(eqx.Module):
    x: Scalar
    z: Scalar


@final
class Steep(AbstractSystem):
    """x' = 1 + |x - 1|^p, z' = |x - 1|^p"""

    p: Scalar = quantity("1", doc="exponent")

    def vector_field(self, t, y):
        h = jnp.abs(y.x - 1.0)
        # Infinite next to zero; at zero itself a power would have no derivative in p.
        root = jnp.where(h > 0.0, jnp.where(h > 0.0, h, 1.0) ** self.p, 0.0)
        return Place(1.0 + root, root)

    def invariants(self, t, y):
        return {}


def at(place, within=3.0, **options):
    return Event(lambda t, y: y.x - place, within=within, **options)


def time(p, a, b):
    """From x = a to x = b."""
    parts = [1.0] if a < 1.0 < b else None
    return quad(lambda x: 1.0 / rate(x, p), a, b, points=parts, epsabs=1e-13, epsrel=1e-13)[0]


def rate(x, p):
    return 1.0 + abs(x - 1.0) ** p


def start(a):
    return Place(a, jnp.zeros_like(a))


def both(f, p, rtol, a=0.0, *times):
    """Values and derivatives by the start, forward and reverse (from the sum of the results)."""
    values, along = jax.linearize(lambda a: f(a, p, rtol, *times), jnp.asarray(a))
    forward = along(jnp.ones(()))
    back = jax.linear_transpose(along, jnp.zeros(()))
    reverse = jnp.stack([back(row)[0] for row in jnp.eye(forward.size)])
    return values, forward, reverse


BOTH = jax.jit(both, static_argnums=0)


def to_event(a, p, rtol):
    run = simulate(Steep(p), start(a), np.array([0.0, 3.0]), accuracy=rtol, events=(at(1.0),))
    return jnp.stack([run.ts[-1], run.final.x, run.final.z])


def two_phases(a, p, rtol):
    phases = [Phase(Steep(p), at(1.0), name="up"), Phase(Steep(p), at(2.0), name="on")]
    run = simulate_mission(Mission(phases), start(a), accuracy=rtol)
    return jnp.stack([run["up"].ts[-1], run["up"].final.x, run.end, run.final.z])


@pytest.mark.parametrize("p", [ROOT, CUBE_ROOT])
@pytest.mark.parametrize("rtol", AT_EVENT)
def test_at_the_event_of_a_run(p, rtol):
    (t, x, z), *slopes = BOTH(to_event, p, rtol)
    np.testing.assert_allclose([t, x, z], [time(p, 0.0, 1.0), 1.0, 1.0 - t], atol=100.0 * rtol)
    exact = np.array([-1.0, 0.0, 1.0 - rate(0.0, p)]) / rate(0.0, p)
    for slope in slopes:
        np.testing.assert_allclose(slope, exact, atol=AT_EVENT[rtol])


def test_at_the_boundary_of_two_phases():
    """The second phase starts at the infinite slope: its time does not depend on the start."""
    values, *slopes = BOTH(two_phases, ROOT, 1e-9)
    f = rate(0.0, ROOT)
    for slope in slopes:
        np.testing.assert_allclose(slope, [-1.0 / f, 0.0, -1.0 / f, 1.0 / f - 1.0], atol=1e-6)
    assert abs(values[1] - 1.0) < 1e-12


def saved(a, p, rtol, ts):
    run = simulate(Steep(p), start(a), ts, accuracy=rtol, throw=False)
    return jnp.stack([run.states.x[1], run.states.x[2]])


@pytest.mark.parametrize("p", [ROOT, CUBE_ROOT])
def test_at_a_saved_time_and_behind_it(p):
    """Within the bound, or not at all."""
    ts = jnp.array([0.0, time(p, 0.0, 1.0), time(p, 0.0, 2.0)])
    for rtol in (1e-6, 1e-9):
        _, *slopes = BOTH(saved, p, rtol, 0.0, ts)
        for slope in slopes:
            exact = np.array([rate(1.0, p), rate(2.0, p)]) / rate(0.0, p)
            known = np.isfinite(slope)
            np.testing.assert_allclose(slope[known], exact[known], rtol=WITHIN[p])
            assert np.all(known) or p == CUBE_ROOT


def test_from_the_place_itself():
    ts = jnp.array([0.0, 0.5 * time(ROOT, 1.0, 2.0), time(ROOT, 1.0, 2.0)])
    for rtol in (1e-6, 1e-9):
        (_, x), *slopes = BOTH(saved, ROOT, rtol, 1.0, ts)
        for slope in slopes:
            # An error of the first step that a kink would have as well: it is not controlled.
            np.testing.assert_allclose(slope[1], rate(x, ROOT), rtol=4.0 * np.sqrt(rtol))


def test_each_run_of_a_batch():
    """Also next to runs that end before the infinite slope."""
    p, starts = ROOT, jnp.array([-0.5, 0.0, 0.5])
    places = jnp.array([1.0, 1.0, 0.9])
    systems, y0s = Steep(jnp.full(3, p)), Place(starts, jnp.zeros(3))

    def ends(a):
        y0 = Place(a, y0s.z)
        stop = Event(lambda t, y: y.x - places)
        run = simulate_batch(systems, y0, np.array([0.0, 3.0]), events=(stop,), accuracy=1e-9)
        return run.ts[-1], run.status

    times, back, status = jax.vjp(ends, starts, has_aux=True)
    assert np.all(status == Status.EVENT)
    np.testing.assert_allclose(times, [time(p, a, b) for a, b in zip(starts, places, strict=True)])
    (slopes,) = back(jnp.ones(3))
    np.testing.assert_allclose(slopes, [-1.0 / rate(a, p) for a in starts], atol=1e-6)
