"""A mission from the pad to orbit: its gradient from end to end against differences of a mapped
batch."""

from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace import load
from jaxspace.simulation import fly_compact

pytestmark = pytest.mark.sweep

FILE = Path(__file__).resolve().parents[1] / "examples" / "scenes" / "pad_to_orbit.toml"
INPUTS = ("lift-off mass", "drag area", "thrust", "dropped stage", "pitch", "tangent")


@pytest.fixture(scope="module")
def pad():
    file = load(FILE)
    return file.mission, file.y0


def places(given):
    """What the inputs multiply: in every phase, the first stage, the second."""
    mission, y0 = given
    first, coast, second = (phase.system.effects for phase in mission.phases[:3])
    return (
        *(y0.mass, first[1].area, coast[1].area, second[1].area, first[2].mean_thrust),
        *(mission.phases[0].then.dropped, first[2].steering.angles, second[2].steering.tangent),
    )


def changed(given, x):
    """Mission and start with their inputs multiplied by `x`, (6, *runs); the area is the same in
    three phases."""
    factors = [x[k] for k in (0, 1, 1, 1, 2, 3, 4, 5)]
    new = [jnp.multiply.outer(a, f) for a, f in zip(places(given), factors, strict=True)]
    return eqx.tree_at(places, given, tuple(new))


def apoapsis(given, x):
    """Its distance from the centre, m, where the mission ends."""
    flight = fly_compact(*changed(given, x), steps=60)
    return jnp.linalg.norm(flight.final.position), flight.error


def test_gradient_from_end_to_end(pad):
    """Reverse mode through four phases, two separations and an event, against central differences
    of 1e-5, whose error is some 1e-8 of the value."""
    one = jnp.ones(len(INPUTS))
    (value, error), slopes = jax.jit(jax.value_and_grad(lambda x: apoapsis(pad, x), has_aux=True))(
        one
    )
    assert 9.4e6 < value < 9.6e6 and error < 1e-4
    step = 1e-5
    moved = 1.0 + step * np.concatenate([np.eye(6), -np.eye(6)])
    far = jax.jit(jax.vmap(lambda x: apoapsis(pad, x)[0]))(jnp.asarray(moved))
    np.testing.assert_allclose(slopes, (far[:6] - far[6:]) / (2.0 * step), rtol=1e-5, atol=20.0)
