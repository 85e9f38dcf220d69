"""Several bodies as one state: methods for position and velocity take any state that holds these
two, with whatever axes of components, and runs last."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float

from jaxspace import BodyState, simulate, simulate_batch
from jaxspace.core import AbstractSystem
from jaxspace.core.safe import safe_divide, safe_sqrt
from jaxspace.core.vectors import dot
from jaxspace.integration import select_method
from jaxspace.orbits import TwoBody
from jaxspace.simulation import Accuracy, Status
from jaxspace.solvers import DOP853, RKN1210, Stormer

ENDS = jnp.array([0.0, 20.0])


class Bodies(AbstractSystem):
    """r_i'' = sum_j mu_j (r_j - r_i) / |r_j - r_i|^3 - drag v_i"""

    mu: Float[Array, "bodies *#runs"]
    drag: Float[Array, "*#runs"] | None = None

    def vector_field(self, t, y):
        r = y["position"]
        d = r[:, None] - r[:, :, None]
        r2 = dot(d, d)
        a = jnp.sum(safe_divide(self.mu, r2 * safe_sqrt(r2)) * d, axis=2)
        if self.drag is not None:
            a = a - self.drag * y["velocity"]
        return {"position": y["velocity"], "velocity": a}

    def invariants(self, t, y):
        return {"momentum": jnp.sum(self.mu * y["velocity"], axis=1)}


MU = jnp.array([0.7, 0.3])


def pair(e=0.1):
    """Two bodies about their centre of mass, which moves on, at the periapsis."""
    v = np.sqrt((1.0 + e) / (1.0 - e))
    r, v = np.array([1.0 - e, 0.0, 0.0]), np.array([0.0, 0.8 * v, 0.6 * v])
    drift = np.array([0.01, 0.0, -0.02])
    shares = np.array([-0.3, 0.7])
    return {
        "position": jnp.asarray(np.outer(r, shares)),
        "velocity": jnp.asarray(np.outer(v, shares) + drift[:, None]),
    }


def apart(y):
    """From the first body to the second, as one body of the sum of both attractions."""
    return BodyState(*(y[part][:, 1] - y[part][:, 0] for part in ("position", "velocity")))


@pytest.mark.parametrize("method", ["auto", Stormer(steps=600)])
def test_two_bodies_move_as_one_about_the_other(method):
    """Between the steps, too; against the closed form, to what a run of three revolutions makes of
    a tolerance of 1e-13."""
    ts = jnp.linspace(0.0, 20.0, 7)
    accuracy = Accuracy(rtol=1e-9 if method != "auto" else 1e-13, method=method)
    run = simulate(Bodies(MU), pair(), ts, accuracy=accuracy)
    if method == "auto":
        assert isinstance(run.config.method, RKN1210)
    exact = simulate(TwoBody(1.0), apart(pair()), ts).states
    found = apart(run.states)
    np.testing.assert_allclose(found.position, exact.position, rtol=0.0, atol=2e-11)
    np.testing.assert_allclose(found.velocity, exact.velocity, rtol=0.0, atol=2e-11)
    # The centre of mass: rounding alone.
    assert np.max(run.drift()["momentum"]) < 1e-13


def test_a_batch_and_mapped_runs_of_bodies_are_their_single_runs():
    many = jax.tree.map(lambda *x: jnp.stack(x, axis=-1), pair(0.1), pair(0.2), pair(0.3))
    batch = simulate_batch(Bodies(MU), many, ENDS, accuracy=1e-11).final
    mapped = jax.vmap(lambda y: simulate(Bodies(MU), y, ENDS, accuracy=1e-11).final, -1, -1)(many)
    assert batch["position"].shape == mapped["position"].shape == (3, 2, 3)
    for k, e in enumerate((0.1, 0.2, 0.3)):
        exact = simulate(TwoBody(1.0), apart(pair(e)), ENDS).final
        for runs in (batch, mapped):
            found = apart(jax.tree.map(lambda x, k=k: x[..., k], runs))
            # Steps are shared: as good as the tolerance, which three revolutions make larger.
            np.testing.assert_allclose(found.position, exact.position, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize(
    ("method", "status"),
    [(RKN1210(), Status.NOT_FINITE), (Stormer(steps=300), Status.TOLERANCE_MISSED)],
)
def test_a_run_in_which_the_velocity_matters_fails_alone(method, status):
    many = jax.tree.map(lambda x: jnp.stack([x, x], axis=-1), pair())
    bodies = Bodies(MU, jnp.array([0.0, 0.01]))
    assert isinstance(select_method(bodies, many, 1e-9), DOP853)
    runs = simulate_batch(bodies, many, ENDS, accuracy=Accuracy(1e-6, method=method))
    assert list(runs.status) == [Status.COMPLETED, status]


class Reversed(eqx.Module):
    """A state whose velocity stands first."""

    velocity: Array
    position: Array


class Pair(NamedTuple):
    """A state of numbers."""

    position: Array
    velocity: Array


class Spring(AbstractSystem):
    """r'' = -r, in whatever holds a position and a velocity."""

    made: type = eqx.field(static=True)

    def vector_field(self, t, y):
        r, v = (y["position"], y["velocity"]) if self.made is dict else (y.position, y.velocity)
        return self.made(position=v, velocity=-r)

    def invariants(self, t, y):
        return {}


@pytest.mark.parametrize("made", [dict, Reversed, Pair])
def test_any_state_of_a_position_and_a_velocity_is_taken(made):
    """Of numbers alone, whose runs are their first axis: x = cos t."""
    y0 = made(position=jnp.array([1.0, 2.0]), velocity=jnp.zeros(2))
    runs = simulate_batch(Spring(made), y0, jnp.array([0.0, 3.0]), accuracy=1e-12)
    assert isinstance(runs.config.method, RKN1210)
    end = runs.final["position"] if made is dict else runs.final.position
    np.testing.assert_allclose(end, np.cos(3.0) * np.array([1.0, 2.0]), rtol=1e-11)
