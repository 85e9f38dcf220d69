"""The Runge-Kutta-Nystrom method of order 12: its tableau, its order, its states between the
steps, its derivatives."""

from fractions import Fraction

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace import Scene
from jaxspace.bodies import BodyState, Load, RigidBody
from jaxspace.core import InputError
from jaxspace.orbits import PointGravity, TwoBody
from jaxspace.scene import Custom
from jaxspace.simulation import Accuracy, SimulationError, simulate, simulate_batch
from jaxspace.solvers import DOP853, RKN1210, tableaus

KEPLER = Scene((PointGravity(1.0),))
TURNS = jnp.array([0.0, 20.0])


def start(e=0.3):
    """Periapsis of an inclined ellipse with semi-major axis 1 and gravitational parameter 1."""
    v = np.sqrt((1.0 + e) / (1.0 - e))
    return BodyState(jnp.array([1.0 - e, 0.0, 0.0]), jnp.array([0.0, 0.8 * v, 0.6 * v]))


def by(rtol, method=None, **more):
    """The accuracy of this method."""
    return Accuracy(rtol=rtol, method=RKN1210() if method is None else method, **more)


def far(a, b):
    """The largest distance of two positions or velocities."""
    return float(jnp.max(jnp.linalg.norm(a - b, axis=0)))


def row(weights):
    """A row of the tableau with its zeros."""
    found = np.zeros(17)
    for i, w in weights:
        found[i] = w
    return found


@pytest.mark.parametrize(
    ("order", "position", "velocity"),
    [
        (12, tableaus.RKN1210_POSITION, tableaus.RKN1210_VELOCITY),
        (10, tableaus.RKN1210_POSITION_10, tableaus.RKN1210_VELOCITY_10),
    ],
)
def test_tableau_meets_the_conditions_of_order(order, position, velocity):
    """Of quadrature, and those with one acceleration of an acceleration (Hairer, Norsett, Wanner
    II.14)."""
    c, a = np.array(tableaus.RKN1210_C), np.array([row(r) for r in tableaus.RKN1210_A])
    b, bv = row(position), row(velocity)
    np.testing.assert_allclose(a.sum(axis=1), 0.5 * c**2, atol=1e-14)
    for m in range(order):
        np.testing.assert_allclose(bv @ c**m, 1.0 / (m + 1), atol=1e-15)
        if m < order - 1:
            np.testing.assert_allclose(b @ c**m, 1.0 / ((m + 1) * (m + 2)), atol=1e-15)
        for n in range(order - 2 - m):
            exact = 1.0 / ((n + 1) * (n + 2) * (m + n + 3))
            np.testing.assert_allclose(bv @ (c**m * (a @ c**n)), exact, atol=1e-14)


closed = jax.jit(lambda t: TwoBody(1.0).closed_form().flow(t, start()))


def one_step(h, system=KEPLER):
    """A step of length h, through diffrax alone."""
    term = diffrax.ODETerm(lambda t, y, args: system.vector_field(t, y))
    solve = eqx.filter_jit(
        lambda h: (
            diffrax.diffeqsolve(
                term,
                RKN1210(),
                0.0,
                h,
                h,
                start(),
                stepsize_controller=diffrax.ConstantStepSize(),
                saveat=diffrax.SaveAt(t1=True),
            ).ys
        )
    )
    return jax.tree.map(lambda x: x[0], solve(jnp.asarray(h)))


def test_error_of_a_step_falls_with_the_order():
    """The error of one step is of the order 13 in its length; 12 and a half is seen where the next
    term still counts."""
    ends = {h: one_step(h) for h in (0.3, 0.6)}
    exact = {h: closed(h) for h in ends}
    for part in ("position", "velocity"):
        small, large = (far(getattr(ends[h], part), getattr(exact[h], part)) for h in (0.3, 0.6))
        assert np.log2(large / small) > 12.0


@pytest.mark.parametrize("rtol", [1e-9, 1e-13])
def test_error_belongs_to_the_tolerance_and_costs_less_than_dop853(rtol):
    exact = simulate(TwoBody(1.0), start(), TURNS).final
    run, other = (
        simulate(KEPLER, start(), TURNS, accuracy=by(rtol, method)) for method in (None, DOP853())
    )
    assert far(run.final.position, exact.position) < max(100.0 * rtol, 2e-12)
    assert run.stats["evaluations"] < other.stats["evaluations"]
    assert float(jnp.max(run.drift()["energy"])) < max(10.0 * rtol, 1e-12)


def test_states_between_the_steps_and_backwards():
    ts = jnp.linspace(20.0, 0.0, 83)
    first = simulate(TwoBody(1.0), start(), TURNS).final
    run = simulate(KEPLER, first, ts, accuracy=by(1e-11)).states
    exact = closed(ts)
    # As exact as the steps: ten times the tolerance, as at the end.
    assert far(run.position, exact.position) < 1e-10
    assert far(run.velocity, exact.velocity) < 1e-10


def test_one_run_like_the_same_run_among_others():
    y0 = jax.tree.map(lambda *x: jnp.stack(x, axis=-1), *[start(e) for e in (0.1, 0.2, 0.3)])
    batch = simulate_batch(KEPLER, y0, TURNS, accuracy=by(1e-12)).final
    for i, e in enumerate((0.1, 0.2, 0.3)):
        # The shared steps are those of the worst run, so both are only as alike as they are exact.
        assert (
            far(
                batch.position[:, i],
                simulate(KEPLER, start(e), TURNS, accuracy=by(1e-12)).final.position,
            )
            < 1e-9
        )


def end(mu, y0, system, accuracy):
    run = simulate(
        Scene((PointGravity(mu),)) if system is Scene else TwoBody(mu), y0, TURNS, accuracy=accuracy
    )
    return run.final.position


@pytest.mark.sweep
def test_derivatives_forwards_and_reverse():
    """Against those of the closed form."""
    reverse, forward = (
        eqx.filter_jit(mode(lambda mu, y: end(mu, y, Scene, by(1e-11)), argnums=(0, 1)))
        for mode in (jax.jacrev, jax.jacfwd)
    )
    exact = jax.jacfwd(lambda mu, y: end(mu, y, TwoBody, 1e-9), argnums=(0, 1))(
        jnp.array(1.0), start()
    )
    for found in (reverse, forward):
        for a, b in zip(
            jax.tree.leaves(found(jnp.array(1.0), start())), jax.tree.leaves(exact), strict=True
        ):
            np.testing.assert_allclose(a, b, rtol=0.0, atol=1e-6)


def test_it_refuses_what_it_cannot_integrate():
    drag = Custom(
        lambda t, y, body: Load(acceleration_N=-0.01 * y.velocity),
    )
    with pytest.raises(SimulationError, match="finite"):
        simulate(Scene((PointGravity(1.0), drag)), start(), TURNS, accuracy=by(1e-9))
    heavy = Scene((PointGravity(1.0),), RigidBody(mass=1.0), ("mass",))
    with pytest.raises(InputError, match="consists of a position and a velocity"):
        simulate(
            heavy,
            BodyState(start().position, start().velocity, mass=jnp.array(1.0)),
            TURNS,
            accuracy=by(1e-9),
        )


def test_rounded_weights_do_not_push_along_the_motion():
    """A step changes the energy of a circular motion by h^2 |a|^2 (sum b' - sum b' c - sum b), or
    by twice h^2 |a|^2 (sum b - sum b A 1 - 1/2) with a Runge-Kutta method: of all that rounding
    leaves, what grows with the time. Half a unit in the last place of one weight is left."""
    velocity = {i: Fraction(w) for i, w in tableaus.RKN1210_VELOCITY}
    position = [Fraction(w) for _, w in tableaus.RKN1210_POSITION]
    nodes = [Fraction(c) for c in tableaus.RKN1210_C]
    push = sum(w * (1 - nodes[i]) for i, w in velocity.items()) - sum(position)
    assert abs(push) < 5e-19
    rows = [sum(Fraction(w) for _, w in row) for row in tableaus.DOP853_A]
    push = sum(Fraction(w) * (1 - rows[i]) for i, w in tableaus.DOP853_B) - Fraction(1, 2)
    assert abs(push) < 4e-18
