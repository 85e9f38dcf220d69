"""Designs by fresh runs in every step: known optima, limits, ends and wrong settings."""

import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import optax
import pytest
from test_robust_design import SCATTER, algebraic
from unchecked import unchecked

from jaxspace.core import InputError, Scalar, quantity
from jaxspace.core.quantities import quantities
from jaxspace.dispersion import Normal
from jaxspace.optimization import StopReason
from jaxspace.robust import train_design
from jaxspace.robust.statistics import Mean, Quantile

STANDARD = {"w": Normal(0.0, 1.0)}
# The rate falls, so that the noise of the last steps does.
ADAM = optax.chain(
    optax.clip_by_global_norm(10.0), optax.adam(optax.cosine_decay_schedule(0.05, 400, 0.01))
)


class Gain(eqx.Module):
    """What an input may be."""

    w: Scalar = quantity("1", non_negative=True, doc="of an input")

    @classmethod
    def limit(cls):
        return quantities(cls)["w"]


def hermite(x, w):
    """The squared error of a law of three gains for exp(w/2), in Hermite's polynomials."""
    law = x["gains"][0] + x["gains"][1] * w + x["gains"][2] * (w * w - 1.0)
    return (law - jnp.exp(0.5 * w)) ** 2


def test_the_gains_of_a_law_are_its_hermite_coefficients():
    """a_k = E[He_k(w) exp(w/2)]/k! = exp(1/8)/(2^k k!)."""
    found = train_design(
        algebraic(hermite, STANDARD),
        {"gains": jnp.zeros(3)},
        minimise=Mean("y"),
        optimiser=ADAM,
        batch=128,
        max_steps=400,
        patience=200,
    )
    exact = [math.exp(0.125) / (2.0**k * math.factorial(k)) for k in range(3)]
    # The error that is left, y, has the mean 0.004: its gradient scatters by a hundredth a batch.
    np.testing.assert_allclose(found.x["gains"], exact, atol=0.02)
    # E[exp(w)] - sum a_k^2 k!, which the sample of the result knows to a few percent.
    least = math.exp(0.5) - sum(a * a * math.factorial(k) for k, a in enumerate(exact))
    np.testing.assert_allclose(found.objective, least, rtol=0.5)
    assert found.without_influence == () and "gains" in repr(found)


def shifted(x, w):
    """A normal number with the mean x and the deviation 0.4."""
    return x + SCATTER * w


def test_a_limit_is_kept_by_its_multiplier():
    """As far as possible, with 80 % of the runs within 1: x = 1 - 0.842 s."""
    found = train_design(
        algebraic(shifted, STANDARD),
        jnp.asarray(0.0),
        maximise=Mean("y"),
        subject_to=[Quantile("y", 0.8).at_most(1.0)],
        optimiser=ADAM,
        batch=128,
        max_steps=300,
        patience=150,
    )
    # The quantile of one batch has the error 0.05; ten of them at falling rates a third of it.
    np.testing.assert_allclose(found.x, 1.0 - 0.8416 * SCATTER, atol=0.03)
    # The objective grows by 1 for each 1 of x, and so does the quantile: both are scaled to 1.
    np.testing.assert_allclose(found.minimum.multipliers, 1.0, rtol=0.3)


def test_why_a_search_ends():
    campaign = algebraic(shifted, STANDARD)
    settings = {"maximise": Mean("y"), "optimiser": optax.sgd(0.1), "batch": 64}
    limits = (-1.0, 1.0)
    held = train_design(campaign, jnp.asarray(0.0), bounds=limits, patience=20, **settings)
    # At its bound after ten steps, where nothing is left but noise; the average lags behind.
    assert held.converged and 0.99 < float(held.x) <= 1.0
    assert "Converged after" in held.sentence()
    short = train_design(campaign, jnp.asarray(0.0), max_steps=3, average=0.0, **settings)
    assert int(short.minimum.reason) == StopReason.STEP_LIMIT
    # The slope is 1, and three steps of a tenth go there.
    np.testing.assert_allclose(short.x, 0.3, rtol=1e-6)
    # A sample of its own has the mean 0.3 to a hundredth, in the sign of the output.
    np.testing.assert_allclose(short.objective, 0.3, atol=0.05)
    assert short.minimum.history.shape == (3, 3)

    def interrupt(step, objective, violation, gradient):
        if step == 2:
            raise KeyboardInterrupt

    stopped = train_design(campaign, jnp.asarray(0.0), progress=interrupt, average=0.0, **settings)
    assert int(stopped.minimum.reason) == StopReason.INTERRUPTED
    np.testing.assert_allclose(stopped.x, 0.2, rtol=1e-6)


def test_what_is_wrong_is_said():
    campaign = algebraic(shifted, STANDARD)
    good = {"minimise": Mean("y"), "optimiser": optax.sgd(0.1)}
    for wrong, sentence in (
        ({"optimiser": optax.lbfgs()}, "optimiser uses line searches or curvature estimates"),
        ({"optimiser": "sqp"}, "batches require an optax optimiser"),
        ({"optimiser": 3.0}, "optimiser is a float"),
        ({"average": 1.0}, "average is 1.0"),
        ({"patience": 1}, "patience is 1"),
        ({"max_steps": 0}, "max_steps is 0"),
        ({"minimise": Quantile("y", 0.99)}, "runs is 256, too few for the 99 % quantile"),
    ):
        with unchecked(), pytest.raises(InputError, match=sentence):
            train_design(campaign, jnp.asarray(0.0), **(good | wrong))
    # Half of all draws are refused.
    halved = algebraic(shifted, STANDARD, limits={"w": Gain.limit()})
    with pytest.raises(InputError, match="In every batch too many runs fail"):
        train_design(halved, jnp.asarray(0.9), **good)
