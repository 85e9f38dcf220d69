"""Events that jump in place and let the run go on: a ball that bounces, in closed form."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float

from jaxspace import BodyState, Event, Status, simulate, simulate_batch
from jaxspace.core import AbstractSystem, InputError
from jaxspace.simulation import crossings

G, CAPACITY = 9.81, 6
TS = jnp.linspace(0.0, 6.0, 13)


class Fall(AbstractSystem):
    gravity: Float[Array, "*#runs"]

    def vector_field(self, t, y):
        down = jnp.zeros_like(y.velocity).at[2].set(-self.gravity)
        return BodyState(y.velocity, down)

    def invariants(self, t, y):
        return {}


def height(t, y):
    return y.position[2]


def rebound(restitution):
    """A jump whose restitution is differentiable."""
    return jax.tree_util.Partial(
        lambda e, t, y: BodyState(y.position, y.velocity.at[2].multiply(-e)), restitution
    )


def floor(restitution, capacity=CAPACITY, condition=height):
    return Event(condition, -1, terminal=False, capacity=capacity, then=rebound(restitution))


def ball(h):
    zero = jnp.zeros_like(h)
    return BodyState(jnp.stack([zero, zero, h]), jnp.stack([zero + 0.3, zero, zero]))


@functools.partial(jax.jit, static_argnums=4)
def exact(h, e, g, ts, count):
    """Times of the first bounces, and height and vertical velocity at `ts` up to there."""
    first = jnp.sqrt(2.0 * h / g)
    speeds = g * first * e ** jnp.arange(1.0, count)
    times = first + jnp.concatenate([jnp.zeros(1), jnp.cumsum(2.0 * speeds / g)])
    starts = jnp.concatenate([-first[None], times])
    up = jnp.concatenate([g * first[None], speeds, speeds[-1:] * e])
    k = jnp.sum(ts[:, None] >= times, axis=1)
    t = ts - starts[k]
    return times, up[k] * t - 0.5 * g * t * t, up[k] - g * t


def test_a_ball_bounces():
    h, e = jnp.array([10.0, 4.0, 0.2]), 0.8
    y0s, event = ball(h), floor(e)
    run = simulate_batch(Fall(G), y0s, TS, events=(event,), accuracy=1e-11)
    one = simulate(Fall(G), ball(h[0]), TS, events=(floor(e),), accuracy=1e-11)
    found = run.crossings[0]
    for k in range(3):
        times, z, w = exact(h[k], e, G, TS, CAPACITY + 1)
        within = np.asarray(times) < 6.0
        count = min(int(within.sum()), CAPACITY)
        assert found.count[k] == count
        np.testing.assert_allclose(found.ts[:count, k], times[:count], rtol=1e-12)
        assert np.all(np.isnan(found.ts[count:, k]))
        # The seventh bounce, for which there is no room, ends the run.
        stops = bool(within[CAPACITY])
        assert bool(found.overflow[k]) == stops and int(run.event[k]) == (0 if stops else -1)
        assert int(run.status[k]) == (Status.EVENT if stops else Status.COMPLETED)
        before = np.asarray(TS) < (times[CAPACITY] if stops else 7.0)
        np.testing.assert_allclose(run.states.position[2, before, k], z[before], atol=1e-10)
        np.testing.assert_allclose(run.states.velocity[2, before, k], w[before], atol=1e-10)
        if stops:
            np.testing.assert_allclose(run.ts[-1, k], times[CAPACITY], rtol=1e-12)
            np.testing.assert_allclose(run.states.position[2, -1, k], 0.0, atol=1e-12)
    assert int(np.sum(found.overflow)) == 1  # of the lowest ball
    fall, rise = found.states.velocity[2, :4], found.after.velocity[2, :4]
    np.testing.assert_allclose(rise, -e * fall, rtol=1e-14)
    np.testing.assert_allclose(one.states.position, run.of(0).states.position, atol=1e-12)
    np.testing.assert_allclose(one.crossings[0].ts, found.ts[:, 0], rtol=1e-13)


def test_bounces_that_pile_up_are_kept():
    """Each flight takes a tenth of the last, until the time resolves none: the bounces before
    stay, as they are in closed form, and behind the last one nothing is known."""
    h, event, restitution = jnp.array(10.0), floor(0.1, 64), 0.1
    run = simulate(Fall(G), ball(h), TS, events=(event,), accuracy=1e-11, throw=False)
    found = run.crossings[0]
    count = int(found.count)
    times, z, _ = exact(h, restitution, G, TS, count)
    assert run.status == found.status == Status.EVENTS_PILE_UP and run.event == -1
    # The last flight lasts a few hundred roundings of the time: 1e-13 of the first.
    assert count == 14 and not found.overflow
    np.testing.assert_allclose(found.ts[:count], times, rtol=1e-13)
    for empty in (found.ts, found.states.position[2], found.after.velocity[2]):
        assert np.all(np.isnan(empty[count:])) and np.all(np.isfinite(empty[:count]))
    before = np.asarray(TS) <= times[-1]
    np.testing.assert_allclose(run.states.position[2, before], z[before], atol=1e-10)
    assert np.all(np.isnan(run.states.position[:, ~before]))


# `test_integration_crossings.py` has times in both modes, `test_simulation.py` the way after two
# bounces.
@pytest.mark.sweep
@pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev])
def test_derivatives_pass_through_all_jumps(mode):
    """Of a height between bounces and of the time of the third one, against the closed form."""

    def found(x):
        h, e, g = x
        run = simulate(Fall(g), ball(h), TS[:8], events=(floor(e, 4),), accuracy=1e-12)
        return jnp.stack([run.states.position[2, -1], run.crossings[0].ts[2]])

    def truth(x):
        times, z, _ = exact(*x, TS[:8], 4)
        return jnp.stack([z[-1], times[2]])

    x = jnp.array([10.0, 0.45, G])
    np.testing.assert_allclose(jax.jit(mode(found))(x), mode(truth)(x), rtol=1e-9)


@pytest.mark.sweep
def test_beside_an_event_that_ends_the_run_and_another_that_jumps():
    """Between floor and ceiling the ball keeps its energy; the third wall ends the run."""
    ceiling = floor(1.0, 16, lambda t, y: 1.0 - y.position[2])
    wall = Event(lambda t, y: y.position[0] - 1.0, 1)
    y0 = BodyState(jnp.array([0.0, 0.0, 0.5]), jnp.array([0.3, 0.0, 7.0]))
    events = (floor(1.0, 16), wall, ceiling)
    run = simulate(Fall(G), y0, TS, events=events, accuracy=1e-11)
    down, up = run.crossings
    assert int(run.event) == 1 and np.array_equal(run.happened, [False, True, False])
    np.testing.assert_allclose(run.ts[-1], 1.0 / 0.3, rtol=1e-12)
    energy = 0.5 * run.states.velocity[2] ** 2 + G * run.states.position[2]
    np.testing.assert_allclose(energy, 0.5 * 49.0 + 0.5 * G, rtol=1e-10)
    # Up and down in turn, a period of both flights apart.
    w0, w1 = np.sqrt(49.0 + G), np.sqrt(49.0 - G)
    np.testing.assert_allclose(up.ts[0], (7.0 - w1) / G, rtol=1e-11)
    period = 2.0 * (w0 - w1) / G
    for each in (down, up):
        n = int(each.count)
        assert n > 6 and not each.overflow
        np.testing.assert_allclose(np.diff(each.ts[:n]), period, rtol=1e-10)


def test_what_is_refused():
    with pytest.raises(InputError, match="terminal must be False"):
        Event(height, then=rebound(0.5))
    collected = Event(height, terminal=False)
    how = dict(accuracy=1e-9)
    with pytest.raises(InputError, match="only recorded"):
        simulate(Fall(G), ball(jnp.array(1.0)), TS, events=(floor(0.5), collected), **how)
    with pytest.raises(InputError, match="stores no steps"):
        simulate(Fall(G), ball(jnp.array(1.0)), TS, events=(floor(0.5),), dense=True, **how)
    drop = Event(height, terminal=False, then=lambda t, y: BodyState(y.position))
    with pytest.raises(InputError, match="the structure must be unchanged"):
        simulate(Fall(G), ball(jnp.array(1.0)), TS, events=(drop,), **how)
    run = simulate(Fall(G), ball(jnp.array(10.0)), TS, events=(floor(0.5),), accuracy=1e-11)
    for again in (run.error, lambda: crossings(run, height)):
        with pytest.raises(InputError, match="one with jumps"):
            again()
