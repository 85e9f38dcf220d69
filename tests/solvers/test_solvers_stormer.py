"""Stormer's method: its order, its states between the steps, its derivatives, and what it says of
its own error."""

from fractions import Fraction

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

from jaxspace import Scene
from jaxspace.bodies import BodyState, Load, RigidBody
from jaxspace.core import AbstractSystem, InputError
from jaxspace.orbits import Oblateness, PointGravity, TwoBody
from jaxspace.scene import Custom
from jaxspace.simulation import Accuracy, SimulationError, Status, simulate, simulate_batch
from jaxspace.solvers import Stormer
from jaxspace.solvers._polynomials import stormer_weights

KEPLER, J2 = Scene((PointGravity(1.0),)), 1.08262668e-3
TURNS = jnp.array([0.0, 20.0])


def start(e=0.05):
    """Periapsis of an inclined ellipse with semi-major axis 1 and gravitational parameter 1."""
    v = np.sqrt((1.0 + e) / (1.0 - e))
    return BodyState(jnp.array([1.0 - e, 0.0, 0.0]), jnp.array([0.0, 0.8 * v, 0.6 * v]))


def equal(steps, order=12, rtol=1e-9, **more):
    """The accuracy that takes so many fixed steps."""
    return Accuracy(rtol=rtol, method=Stormer(order, steps=steps), **more)


def far(a, b):
    """The largest distance of two positions or velocities."""
    return float(jnp.max(jnp.linalg.norm(a - b, axis=0)))


def closed(ts, y0=None):
    """The exact states."""
    return simulate(TwoBody(1.0), start() if y0 is None else y0, ts).states


@pytest.mark.parametrize(("order", "steps"), [(5, 300), (8, 300)])
def test_errors_fall_with_the_order(order, steps):
    """Position and velocity, over three revolutions: each doubling of the steps divides the error
    by two to the order."""
    exact = closed(TURNS)
    runs = [
        simulate(KEPLER, start(), TURNS, accuracy=equal(n, order, 1e-4), throw=False)
        for n in (steps, 2 * steps)
    ]
    for part in ("position", "velocity"):
        first, second = (far(getattr(run.final, part), getattr(exact, part)[:, -1]) for run in runs)
        assert np.log2(first / second) > order - 0.8


class Oscillator(AbstractSystem):
    """r'' = -rate^2 r."""

    rate: Array

    def vector_field(self, t, y):
        return BodyState(position=y.velocity, velocity=-self.rate * self.rate * y.position)

    def invariants(self, t, y):
        return {}


@pytest.mark.slow
@pytest.mark.parametrize("order", [12, 11, 10, 9, 8, 7, 6, 5])
def test_every_order_is_what_it_says(order):
    """An oscillator of ever higher rate in 60 steps: the error grows as its phase per step to the
    order, and as the whole phase.

    Between rounding, at 1e-14, and the phases per step where the higher orders become unstable."""
    phases = np.geomspace(*{11: (0.08, 0.14), 12: (0.1, 0.15)}.get(order, (0.06, 0.2)), 12)
    y, method = BodyState(jnp.array([1.0, 0.0, 0.0]), jnp.zeros(3)), Stormer(order, steps=60)

    def error(rate):
        end = simulate(
            Oscillator(rate),
            y,
            jnp.array([0.0, 1.0]),
            accuracy=Accuracy(rtol=0.5, method=method),
            throw=False,
        ).final
        return jnp.hypot(end.position[0] - jnp.cos(rate), end.velocity[0] / rate + jnp.sin(rate))

    errors = np.array([float(e) for e in map(jax.jit(error), 60.0 * phases)])
    slope = np.polyfit(np.log(phases), np.log(errors / phases), 1)[0]
    assert abs(slope - order) < 0.5


def test_states_between_the_steps_are_as_good_as_those_at_the_end():
    ts = jnp.linspace(0.0, 20.0, 98)
    run, exact = simulate(KEPLER, start(), ts, accuracy=equal(400)).states, closed(ts)
    # The end alone is off by 7e-12; nothing in between may be worse by more than the growth along
    # the orbit.
    assert far(run.position, exact.position) < 1.5e-11
    assert far(run.velocity, exact.velocity) < 1.5e-11


def test_backwards_is_as_good_as_forwards():
    there = closed(TURNS)
    back = simulate(
        KEPLER, jax.tree.map(lambda x: x[..., -1], there), TURNS[::-1], accuracy=equal(400)
    ).final
    assert far(back.position, start().position) < 1.5e-11


def orbits(n):
    """Low, nearly circular orbits of every inclination in the field of an oblate earth of radius
    1."""
    g = np.random.default_rng(0)
    a, e = 1.0 + g.uniform(400.0, 1200.0, n) / 6378.137, g.uniform(0.0, 0.02, n)
    tilt = np.arccos(g.uniform(-1.0, 1.0, n))
    speed = np.sqrt((1.0 + e) / (a * (1.0 - e)))
    return BodyState(
        jnp.asarray(np.stack([a * (1.0 - e), np.zeros(n), np.zeros(n)])),
        jnp.asarray(np.stack([np.zeros(n), speed * np.cos(tilt), speed * np.sin(tilt)])),
    )


OBLATE = Scene((PointGravity(1.0), Oblateness(1.0, J2, 1.0)))
DAY = jnp.array([0.0, 86400.0 / 806.8110])


def test_a_day_of_low_orbits():
    """Nine digits with 1310 steps, energy to eleven, and one run alone like the same run among
    others."""
    y0 = orbits(20)
    batch = simulate_batch(OBLATE, y0, DAY, accuracy=equal(1310))
    fine = simulate_batch(OBLATE, y0, DAY, accuracy=1e-13).final
    assert np.all(batch.status == Status.COMPLETED)
    assert far(batch.final.position, fine.position) < 1.5e-9
    assert float(jnp.max(batch.drift()["energy"])) < 1e-11
    alone = simulate(OBLATE, jax.tree.map(lambda x: x[:, 3], y0), DAY, accuracy=equal(1310)).final
    # The same operations in another order: the rounding of 1310 steps grows with the square of
    # their number.
    assert far(alone.position, batch.final.position[:, 3]) < 1e-11


def end(mu, y0, system):
    accuracy = equal(300) if system is Scene else 1e-9
    run = simulate(
        Scene((PointGravity(mu),)) if system is Scene else TwoBody(mu), y0, TURNS, accuracy=accuracy
    )
    return run.final.position


def test_derivatives_forwards_and_reverse():
    """Against those of the closed form, to the accuracy of the run times the sensitivity of the
    orbit."""
    reverse, forward = (
        eqx.filter_jit(mode(lambda mu, y: end(mu, y, Scene), argnums=(0, 1)))
        for mode in (jax.jacrev, jax.jacfwd)
    )
    exact = jax.jacfwd(lambda mu, y: end(mu, y, TwoBody), argnums=(0, 1))(jnp.array(1.0), start())
    for found in (reverse, forward):
        for a, b in zip(
            jax.tree.leaves(found(jnp.array(1.0), start())), jax.tree.leaves(exact), strict=True
        ):
            np.testing.assert_allclose(a, b, rtol=0.0, atol=1e-7)


@pytest.mark.sweep
def test_reverse_mode_through_states_between_the_steps():
    ts = jnp.linspace(0.0, 20.0, 7)

    def size(e, system, accuracy):
        return jnp.sum(
            simulate(
                system, jax.tree.map(lambda x: x * e, start()), ts, accuracy=accuracy
            ).states.velocity
            ** 3
        )

    found = jax.grad(size)(1.0, KEPLER, equal(300))
    np.testing.assert_allclose(found, jax.grad(size)(1.0, TwoBody(1.0), 1e-9), rtol=1e-7)


def test_too_few_steps_are_reported_or_repeated_with_more():
    """In a compiled program the status tells; outside of it, as in a batch, the run takes as many
    more as it needs."""

    def run(y):
        return simulate(KEPLER, y, TURNS, accuracy=equal(200), throw=False)

    assert jax.jit(lambda y: run(y).status)(start(0.3)) == Status.TOLERANCE_MISSED
    more = run(start(0.3))
    assert (
        more.status == Status.COMPLETED and more.stats["steps"] == more.config.method.steps == 600
    )
    assert far(more.final.position, closed(TURNS, start(0.3)).position[:, -1]) < 1e-7
    both = jax.tree.map(lambda *x: jnp.stack(x, axis=-1), start(0.3), start())
    batch = simulate_batch(KEPLER, both, TURNS, accuracy=equal(200))
    assert batch.config.method.steps == 600
    np.testing.assert_allclose(batch.final.position[:, 0], more.final.position, atol=1e-11)


def test_error_estimate_of_a_run_is_that_of_half_the_steps():
    run = simulate(KEPLER, start(), TURNS, accuracy=equal(200))
    np.testing.assert_allclose(
        run.error().position, jnp.abs(run.final.position - closed(TURNS).position[:, -1]), rtol=0.01
    )


def test_an_acceleration_that_depends_on_the_velocity_is_reported():
    drag = Custom(
        lambda t, y, body: Load(acceleration_N=-0.01 * y.velocity),
    )
    with pytest.raises(SimulationError, match="tolerance"):
        simulate(Scene((PointGravity(1.0), drag)), start(), TURNS, accuracy=equal(200))


def test_it_refuses_what_it_cannot_integrate():
    with pytest.raises(InputError, match="order is 20"):
        Stormer(20, steps=100)
    with pytest.raises(InputError, match="steps is 10"):
        Stormer(12, steps=10)
    turning = Scene((PointGravity(1.0),), RigidBody(mass=1.0), ("mass",))
    with pytest.raises(InputError, match="consists of a position and a velocity"):
        simulate(
            turning,
            BodyState(start().position, start().velocity, mass=jnp.array(1.0)),
            TURNS,
            accuracy=equal(100),
        )


@pytest.mark.parametrize("order", range(5, 13))
def test_rounded_weights_do_not_push_along_the_motion(order):
    """sum_j -j b_j is int (1 - x)(x - x) dx = 0, also of the rounded weights."""
    weights = stormer_weights(order).step
    assert abs(sum(-j * Fraction(w) for j, w in enumerate(weights))) < Fraction(1, 10**18)
    np.testing.assert_allclose(sum(weights), 1.0, rtol=1e-14)


def test_the_energy_of_long_runs_is_that_of_rounding():
    """Eight circles in 32000 steps, 250 to 2000 in a revolution: as a random walk the energy
    strays by 2e-14; a push of the rounded weights would make it 1e-13, and grow with the time."""
    g = np.random.default_rng(0)
    f, i, a = g.uniform(0.0, 6.28, 8), g.uniform(0.0, 3.0, 8), 10.0 ** g.uniform(-0.3, 0.3, 8)
    r = a * np.stack([np.cos(f), np.sin(f) * np.cos(i), np.sin(f) * np.sin(i)])
    v = np.stack([-np.sin(f), np.cos(f) * np.cos(i), np.cos(f) * np.sin(i)]) / np.sqrt(a)
    ts = jnp.array([0.0, 300.0])
    y0 = BodyState(jnp.asarray(r), jnp.asarray(v))
    run = simulate_batch(KEPLER, y0, ts, accuracy=equal(32000), throw=False)
    r, v = (np.asarray(x, np.longdouble) for x in (run.states.position, run.states.velocity))
    energy = 0.5 * np.sum(v * v, axis=0) - 1.0 / np.sqrt(np.sum(r * r, axis=0))
    assert np.sqrt(np.mean((energy[-1] / energy[0] - 1.0) ** 2)) < 5e-14
