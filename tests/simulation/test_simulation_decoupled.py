"""Motions of which one part is exact by itself and the rest is stepped: a pair of numbers, and
bodies that turn freely beside forces."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float
from systems import AIR, J2, MU, RADIUS, motor, orbit, turned

from jaxspace import (
    Accuracy,
    Event,
    Mission,
    Phase,
    Scene,
    Status,
    simulate,
    simulate_batch,
    simulate_mission,
)
from jaxspace.attitude import BodyTorque, GravityGradient
from jaxspace.attitude.torque_free import symmetric_flow
from jaxspace.bodies import BodyState, BurningBody, RigidBody
from jaxspace.core import AbstractDecoupled, AbstractSystem
from jaxspace.dispersion import Campaign, Uniform, disperse
from jaxspace.orbits import Oblateness, PointGravity
from jaxspace.solvers import Tsit5

EXACTLY = Accuracy(1e-10, method=Tsit5(), decoupled=True)
# So loose that "auto" takes a method that compiles soon.
LOOSE = 2e-5


class Pair(eqx.Module):
    """A number that falls, and a hand of a clock."""

    slow: Float[Array, "*#runs"]
    hand: Float[Array, "2 *#runs"] | None = None


class Fall(AbstractSystem):
    """x' = -k x^2, x(t) = x_0 / (1 + k x_0 t)."""

    k: Float[Array, "*#runs"]

    def vector_field(self, t, y):
        return Pair(-self.k * y.slow * y.slow)

    def invariants(self, t, y):
        return {}


class Clock(AbstractDecoupled):
    fall: Fall
    w: Float[Array, "*#runs"]
    told: float

    @property
    def rest(self):
        return self.fall

    def rest_of(self, y):
        return Pair(y.slow)

    def joined(self, duration, y, rest):
        c, s = jnp.cos(self.w * duration), jnp.sin(self.w * duration)
        a, b = y.hand
        return Pair(rest.slow, jnp.stack([c * a - s * b, s * a + c * b]))

    def turns(self, duration, y):
        return self.told * jnp.abs(self.w * duration)


class Falling(AbstractSystem):
    """Both. What share of its turns it tells."""

    k: Float[Array, "*#runs"]
    w: Float[Array, "*#runs"]
    told: float = eqx.field(static=True, default=1.0)

    def vector_field(self, t, y):
        a, b = y.hand
        return Pair(-self.k * y.slow * y.slow, self.w * jnp.stack([-b, a]))

    def invariants(self, t, y):
        return {}

    def decoupled(self):
        return Clock(Fall(self.k), self.w, self.told)


def start(x=1.0):
    return Pair(jnp.asarray(x), jnp.array([1.0, 0.0]))


def exact(k, w, t, x=1.0):
    """x, and the second component of the hand."""
    return x / (1.0 + k * x * t), jnp.sin(w * t)


def system(k=0.5, w=3.0):
    return Falling(jnp.asarray(k), jnp.asarray(w))


def test_a_run_and_its_events_and_what_lies_between():
    ts = jnp.array([0.0, 1.0, 4.0])
    event = Event(lambda t, y: y.hand[1], direction=-1, terminal=False, capacity=4)
    run = simulate(system(), start(), ts, accuracy=EXACTLY, events=(event,), dense=True)
    for k, t in enumerate(ts):
        x, s = exact(0.5, 3.0, t)
        # The hand to rounding, the rest within some steps of 1e-10.
        np.testing.assert_allclose(run[k].hand[1], s, atol=1e-14)
        np.testing.assert_allclose(run[k].slow, x, rtol=1e-8)
    np.testing.assert_allclose(
        run.crossings[0].ts[:2], np.pi * np.array([1.0, 3.0]) / 3.0, rtol=1e-13
    )
    within = run.at(jnp.array(2.3))
    x, s = exact(0.5, 3.0, 2.3)
    np.testing.assert_allclose([within.slow, within.hand[1]], [x, s], rtol=1e-8)
    # The steps are those of the rest.
    assert run.dense.states.hand is None and "next to a closed form" in repr(run)


def test_a_run_ends_by_its_exact_part():
    ts = jnp.array([0.0, 1.0, 4.0])
    end = Event(lambda t, y: y.hand[1], direction=-1)
    run = simulate(system(), start(), ts, accuracy=EXACTLY, events=(end,))
    np.testing.assert_allclose(run.ts[-1], np.pi / 3.0, rtol=1e-13)
    np.testing.assert_allclose(run.final.hand, [-1.0, 0.0], atol=1e-13)
    np.testing.assert_allclose(run.final.slow, exact(0.5, 3.0, np.pi / 3.0)[0], rtol=1e-8)


@pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev])
def test_derivatives(mode):
    """By the parameters of both parts, the start and the end."""

    def found(p):
        k, w, t, x = p
        ts = jnp.stack([0.0 * t, t])
        final = simulate(system(k, w), start(x), ts, accuracy=EXACTLY).final
        return jnp.stack([final.slow, final.hand[1]])

    p = jnp.array([0.5, 3.0, 4.0, 1.2])
    slope = mode(lambda p: jnp.stack(exact(*p)))(p)
    np.testing.assert_allclose(jax.jit(mode(found))(p), slope, rtol=1e-7, atol=1e-9)


FAST = system(w=2.5e4)


def test_fast_turns_are_exact_by_themselves():
    """Of a hand that turns through 1e5 radians. A slow one is stepped."""
    ts = jnp.array([0.0, 4.0])
    run = simulate(FAST, start(), ts, accuracy=LOOSE)
    assert run.config.decoupled and run.stats["steps"] < 100
    np.testing.assert_allclose(run.final.hand[1], exact(0.5, 2.5e4, 4.0)[1], atol=1e-10)
    assert not simulate(system(), start(), ts, accuracy=LOOSE).config.decoupled
    # An exact part that is no number marks its run, where the rest has its end.
    lost = Pair(start().slow, jnp.array([jnp.nan, 0.0]))
    starts = jax.tree.map(lambda *x: jnp.stack(x, axis=-1), start(), lost)
    batch = simulate_batch(FAST, starts, ts, accuracy=LOOSE)
    np.testing.assert_array_equal(batch.status, [Status.COMPLETED, Status.NOT_FINITE])
    np.testing.assert_allclose(batch.of(0).final.hand, run.final.hand, atol=1e-10)


def campaign_of(moving, accuracy):
    """Four seconds of it, from starts that scatter."""

    def build(samples):
        x = samples["x"]
        hand = jnp.stack([jnp.ones_like(x), jnp.zeros_like(x)])
        return Mission([Phase(moving, 4.0)]), Pair(x, hand)

    def outputs(result, samples):
        return {"slow": result.final.slow, "hand": result.final.hand[1]}

    inputs, units = {"x": Uniform(0.9, 1.1)}, {"slow": "", "hand": ""}
    return Campaign(build, inputs, outputs, units, accuracy=accuracy)


def test_fast_turns_are_exact_in_missions_and_campaigns():
    run = simulate_mission(Mission([Phase(FAST, 4.0)]), start(), accuracy=LOOSE)
    np.testing.assert_allclose(run.final.hand[1], exact(0.5, 2.5e4, 4.0)[1], atol=1e-10)
    campaign = campaign_of(FAST, LOOSE)
    found = disperse(campaign, 16)
    assert np.all(found.good)
    np.testing.assert_allclose(
        found.outputs["slow"], exact(0.5, 0.0, 4.0, found.inputs["x"])[0], rtol=1e-4
    )
    np.testing.assert_allclose(found.outputs["hand"], run.final.hand[1], atol=1e-10)
    assert campaign.replay(3).status == Status.COMPLETED


# Whose turns are taken for none.
QUIET = Falling(jnp.array(0.01), jnp.array(1.4), told=0.0)
FEW = Accuracy(LOOSE, max_steps=3)


def test_steps_that_run_out_are_no_end_where_turns_need_none():
    """Three steps do not follow the hand; where the user says that all is to be stepped, they run
    out."""
    ts = jnp.array([0.0, 4.0])
    run = simulate(QUIET, start(), ts, accuracy=FEW)
    assert run.config.decoupled and run.status == Status.COMPLETED
    starts = jax.tree.map(lambda x: jnp.stack([x, x], axis=-1), start())
    batch = simulate_batch(QUIET, starts, ts, accuracy=FEW)
    mission = simulate_mission(Mission([Phase(QUIET, 4.0)]), start(), accuracy=FEW)
    for final in (run.final, batch.of(1).final, mission.final):
        np.testing.assert_allclose(final.hand[1], exact(0.01, 1.4, 4.0)[1], atol=1e-14)
    stepped = Accuracy(LOOSE, max_steps=3, decoupled=False)
    run = simulate(QUIET, start(), ts, accuracy=stepped, throw=False)
    assert run.status == Status.MAX_STEPS


def test_a_campaign_whose_steps_run_out_takes_its_turns_exactly():
    campaign = campaign_of(QUIET, FEW)
    found = disperse(campaign, 16)
    assert np.all(found.good)
    np.testing.assert_allclose(found.outputs["hand"], exact(0.01, 1.4, 4.0)[1], atol=1e-13)
    assert campaign.replay(3).status == Status.COMPLETED


# ----------------------------------------------------------------------------------- free rotation

FORCES = (PointGravity(MU), Oblateness(MU, J2, RADIUS))
A, C = 520.0, 340.0
MOMENTS = [A, A, C]
BODY = RigidBody(900.0, MOMENTS)
STAGE = Scene(FORCES, BODY, ("attitude", "mass"))


def test_a_long_spinning_coast_needs_no_steps_for_its_spin():
    """211 rpm for ten minutes beside the oblate earth: 13,000 radians."""
    rates = jnp.array([0.3, -0.1, 22.1])
    y0 = orbit(attitude=turned(), omega=rates, mass=jnp.array(900.0))
    ts = jnp.array([0.0, 600.0])
    run = simulate(STAGE, y0, ts)
    assert run.status == Status.COMPLETED and run.stats["steps"] < 10
    after = jax.jit(symmetric_flow)(ts[1], BodyState(attitude=y0.attitude, omega=rates), A, C)
    # Roundings of 13,000 radians.
    turn = run.final.attitude.inverse().then(after.attitude)
    np.testing.assert_allclose(turn.wxyz[1:], 0.0, atol=1e-11)
    np.testing.assert_allclose(run.final.omega, after.omega, atol=1e-10)
    assert run.final.mass == 900.0


@pytest.mark.parametrize(
    "scene",
    [
        Scene((*FORCES, GravityGradient(MU)), BODY),
        Scene((*FORCES, BodyTorque([0.1, 0.0, 0.0])), BODY),
        Scene((*FORCES, motor()), BurningBody(1100.0, MOMENTS, [0.42, 0.42, 0.4], -0.6)),
        Scene((), BODY, ("attitude",)),
        Scene((*FORCES, AIR), BODY),
    ],
    ids=[
        "reads the attitude",
        "torque",
        "mass that changes",
        "rotation alone",
        "translation alone",
    ],
)
def test_other_scenes_stay_whole(scene):
    assert scene.decoupled() is None
