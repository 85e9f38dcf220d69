"""Short pulses between the stages of long steps: what `Accuracy.max_step` makes sure of, in every
way of running.

r'' = -r + k p(t),   p(t) = (1 + cos(2 pi (t - c) / w)) / w   within w/2 of c, else 0
r(T) = r_0 cos T + v_0 sin T + k sin(T - c) (2/w) sin(w/2) (1 + 1/((2 pi/w)^2 - 1))
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float

from jaxspace import BodyState
from jaxspace.core import AbstractSystem, InputError
from jaxspace.dispersion import Campaign, Uniform, disperse
from jaxspace.simulation import (
    Accuracy,
    Event,
    Mission,
    Phase,
    Status,
    simulate,
    simulate_batch,
    simulate_mission,
)
from jaxspace.solvers import DOP853, RKN1210, ExponentialRosenbrock, Stormer, Tsit5

T, WIDTH = 5.0, 0.02
KICK = jnp.array([0.0, 1e-3, 0.0])
traced = []


class Struck(AbstractSystem):
    """An oscillator that is struck once: the change of velocity `kick` about the `centre`, for a
    time `width`."""

    centre: Float[Array, "*#runs"]
    kick: Float[Array, "3 *#runs"]
    width: Float[Array, "*#runs"]

    def vector_field(self, t, y):
        traced.append(t)
        x = (t - self.centre) / self.width
        pulse = jnp.where(jnp.abs(x) < 0.5, (1.0 + jnp.cos(2.0 * jnp.pi * x)) / self.width, 0.0)
        return BodyState(y.velocity, self.kick * pulse - y.position)

    def invariants(self, t, y):
        return {}


class Announced(AbstractSystem):
    """The same with the times of the pulse told."""

    struck: Struck

    def vector_field(self, t, y):
        return self.struck.vector_field(t, y)

    def invariants(self, t, y):
        return {}

    def breaks(self):
        return self.struck.centre + 0.5 * jnp.stack([-self.struck.width, self.struck.width])


def struck(centre=2.345, kick=KICK, width=WIDTH):
    return Struck(*map(jnp.asarray, (centre, kick, width)))


def start():
    return BodyState(jnp.array([1.0, 0.0, 0.0]), jnp.array([0.0, 0.5, 0.0]))


def exact(system, t=T):
    """The position at the time `t`, after the pulse."""
    w, y = system.width, start()
    push = (
        jnp.sin(t - system.centre)
        * (2.0 / w)
        * jnp.sin(0.5 * w)
        * (1.0 + 1.0 / ((2.0 * jnp.pi / w) ** 2 - 1.0))
    )
    return y.position * jnp.cos(t) + y.velocity * jnp.sin(t) + system.kick * push


def final(system, accuracy, t=T):
    return simulate(system, start(), jnp.array([0.0, t]), accuracy=accuracy).final.position


def error(system, accuracy):
    return float(jnp.max(jnp.abs(final(system, accuracy) - exact(system))))


@pytest.mark.parametrize(
    "method",
    [RKN1210(), DOP853(), Tsit5(), ExponentialRosenbrock()],
    ids=lambda m: type(m).__name__,
)
def test_a_pulse_as_long_as_two_steps_is_seen(method):
    # Methods of order 5 are asked for less: they would take thousands of steps.
    rtol = 1e-9 if isinstance(method, DOP853 | RKN1210) else 1e-6
    # What the steps before, within and after the pulse may leave.
    assert error(struck(), Accuracy(rtol, method=method, max_step=0.5 * WIDTH)) < 30.0 * rtol


def test_without_a_limit_it_is_passed_over_and_nothing_tells():
    """What the manual says of long steps: here the whole effect is missing. Known times are the
    better cure."""
    run = simulate(
        struck(), start(), jnp.array([0.0, T]), accuracy=Accuracy(1e-9, method=RKN1210())
    )
    assert run.status == Status.COMPLETED
    np.testing.assert_allclose(run.final.position, exact(struck(kick=0.0 * KICK)), atol=1e-8)
    told = simulate(
        Announced(struck()), start(), jnp.array([0.0, T]), accuracy=Accuracy(1e-9, method=RKN1210())
    )
    np.testing.assert_allclose(told.final.position, exact(struck()), atol=1e-8)
    assert told.stats["steps"] < 40


@pytest.mark.parametrize("centre", np.linspace(1.9, 2.1, 7))
def test_it_is_seen_wherever_it_falls(centre):
    assert error(struck(centre), Accuracy(1e-9, method=RKN1210(), max_step=WIDTH)) < 1e-8


@pytest.mark.slow
@pytest.mark.parametrize("forward", [False, True])
def test_derivatives_of_a_pulse_that_is_seen(forward):
    accuracy = Accuracy(1e-11, method=RKN1210(), max_step=0.5 * WIDTH)

    def slope(f):
        return (jax.jacfwd if forward else jax.grad)(lambda system: f(system)[1])(struck())

    found, true = slope(lambda system: final(system, accuracy)), slope(exact)
    # By the time and the width, what is integrated has kinks where the pulse begins and ends.
    for name, atol in (("kick", 1e-9), ("centre", 5e-7), ("width", 5e-7)):
        np.testing.assert_allclose(getattr(found, name), getattr(true, name), atol=atol)


def test_the_limit_is_traced_and_none_is_as_before():
    ts = jnp.array([0.0, T])
    runs = [
        simulate(struck(), start(), ts, accuracy=Accuracy(1e-9, method=RKN1210(), max_step=0.3))
    ]
    traced.clear()
    for max_step in (0.02, 1e3):
        runs.append(
            simulate(
                struck(), start(), ts, accuracy=Accuracy(1e-9, method=RKN1210(), max_step=max_step)
            )
        )
    assert not traced
    free = simulate(struck(), start(), ts, accuracy=Accuracy(1e-9, method=RKN1210()))
    assert int(runs[1].stats["steps"]) >= T / 0.02
    assert runs[2].stats["steps"] == free.stats["steps"]
    np.testing.assert_allclose(runs[2].final.position, free.final.position, rtol=1e-15)


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_no_step_of_any_run_is_longer(precision):
    """Runs side by side, one of them over another span and backwards, with their own break
    times."""
    spans = (5.0, -2.0)
    system = Announced(
        Struck(
            *(jnp.asarray(x, precision) for x in ([2.0, -0.7], 1e-3 * np.ones((3, 1)), [0.02, 0.1]))
        )
    )
    y0 = jax.tree.map(lambda x: jnp.asarray(x, precision)[:, None], start())
    accuracy = Accuracy(jnp.asarray(1e-4, precision), max_step=jnp.asarray(0.3, precision))
    ts = jnp.stack([jnp.zeros(2, precision), jnp.asarray(spans, precision)])
    result = simulate_batch(system, y0, ts, accuracy=accuracy, dense=True)
    assert result.status.tolist() == [Status.COMPLETED] * 2
    for k, span in enumerate(spans):
        times = np.asarray(result.dense.ts)[:, k]
        times = times[np.isfinite(times)]
        assert np.max(np.abs(np.diff(times))) < 0.3 * (1.0 + 1e-5)
        # As few as that takes, about.
        assert times[-1] == span and times.size < 1.5 * abs(span) / 0.3 + 20


def test_runs_of_a_batch_see_their_pulses():
    centres, kicks = jnp.linspace(1.0, 3.0, 70), KICK[:, None] * jnp.linspace(0.5, 1.0, 70)
    y0s = jax.tree.map(lambda x: jnp.tile(x[:, None], (1, 70)), start())
    systems = Struck(centres, kicks, jnp.asarray(WIDTH))
    ts = jnp.stack([jnp.zeros(70), jnp.linspace(4.0, 5.0, 70)])
    accuracy = Accuracy(1e-9, method=RKN1210(), max_step=WIDTH)
    batch = simulate_batch(systems, y0s, ts, accuracy=accuracy)
    ends = jax.vmap(lambda c, k, t: exact(struck(c, k), t), in_axes=(0, -1, 0), out_axes=-1)(
        centres, kicks, ts[1]
    )
    np.testing.assert_allclose(batch.final.position, ends, atol=1e-8)


def test_phases_and_the_search_for_events_see_their_pulses():
    """The kick changes when the event is: it is found where the exact motion has it."""
    low = Event(lambda t, y: y.position[1], direction=-1, within=4.0)
    mission = Mission([Phase(struck(kick=100.0 * KICK), low)])
    run = simulate_mission(
        mission, start(), accuracy=Accuracy(1e-9, method=DOP853(), max_step=0.5 * WIDTH)
    )
    assert run.status == Status.EVENT and abs(run.end - jnp.pi) > 0.1
    np.testing.assert_allclose(exact(struck(kick=100.0 * KICK), run.end)[1], 0.0, atol=1e-8)


def test_runs_of_a_dispersion_keep_to_it():
    def build(samples):
        system = Struck(jnp.asarray(2.345), jnp.zeros((3, 1)), jnp.asarray(WIDTH))
        y0 = jax.tree.map(lambda x: x[:, None] + 0.0 * samples["span"], start())
        return Mission([Phase(system, samples["span"])]), y0

    campaign = Campaign(
        build,
        {"span": Uniform(1.0, 4.0)},
        lambda result, samples: {"x": result.final.position[0]},
        {"x": "m"},
    )
    table = disperse(campaign, 100, accuracy=Accuracy(1e-6, method=DOP853(), max_step=0.1))
    assert np.all(table.status == Status.COMPLETED)
    assert np.all(table.evaluations >= 12.0 * table.inputs["span"] / 0.1001)


def test_the_error_is_estimated_with_half_of_it():
    """A limit that is too long for the pulse shows when it is halved."""
    run = simulate(
        struck(2.346),
        start(),
        jnp.array([0.0, T]),
        accuracy=Accuracy(1e-9, method=DOP853(), max_step=5.0 * WIDTH),
    )
    off = jnp.max(jnp.abs(run.final.position - exact(struck(2.346))))
    assert off > 1e-4
    np.testing.assert_allclose(jnp.max(run.error().position), off, rtol=1e-3)


def test_what_cannot_be_meant_is_refused():
    with pytest.raises(InputError, match=r"Accuracy.max_step is -1: it must be positive"):
        Accuracy(max_step=-1.0)
    with pytest.raises(
        InputError, match=r"for Stormer: set the number of steps with Stormer\(steps=...\)"
    ):
        Accuracy(method=Stormer(8, steps=80), max_step=1.0)
    run = simulate(
        struck(),
        start(),
        jnp.array([0.0, T]),
        accuracy=Accuracy(max_step=1e-3, max_steps=100),
        throw=False,
    )
    assert run.status == Status.MAX_STEPS and "or max_step," in Status.MAX_STEPS.sentence
    assert eqx.tree_equal(Accuracy(), Accuracy(max_step=None))
