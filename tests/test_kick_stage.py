"""The kick stage of `examples/scenes`: derivatives of its final orbit through burn, coast and despin."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace.cli import load
from jaxspace.orbits import apoapsis_radius, inclination, periapsis_radius
from jaxspace.simulation import Accuracy, Status, run_mission

FILE = Path(__file__).parents[1] / "examples" / "scenes" / "kick_stage.toml"
STEP = 0.01  # of a standard deviation


@pytest.fixture(scope="module")
def campaign():
    return load(FILE).campaign(None)


def final_orbit(campaign, samples):
    """Perigee and apogee radius, inclination, spin and time at the end of runs side by side, and the worst status."""
    mission, y0 = campaign.build(samples)
    _, end, time, status = run_mission(mission, y0, jnp.zeros(()), 2, Accuracy(rtol=1e-12), 1)
    mu = mission.phases[0].system.effects[0].mu
    r, v = end.position, end.velocity
    orbit = [periapsis_radius(r, v, mu), apoapsis_radius(r, v, mu), inclination(r, v)]
    return jnp.stack([*orbit, end.omega[2], time]), jnp.max(status)


def test_derivatives_of_the_final_orbit_in_every_dispersed_input(campaign):
    """Reverse mode through the whole mission against central differences of order four, input by input.

    The point is off the nominal one, where some slopes vanish. All runs of the differences share their steps, so that the
    error of the integration cancels; a hundredth of a deviation moves the phase of the spin at burnout by 0.07 rad, whose
    fourth power over thirty bounds the truncation to 1e-6."""
    names = list(campaign.inputs)
    mean = jnp.array([campaign.inputs[n].mean for n in names])
    sigma = jnp.array([campaign.inputs[n].deviation for n in names])
    shift = jnp.asarray(np.random.default_rng(5).uniform(0.3, 1.0, len(names)))

    def flown(z):
        """The end of runs whose inputs lie `z`, (inputs, runs), standard deviations off."""
        x = mean[:, None] + sigma[:, None] * (shift[:, None] + z)
        return final_orbit(campaign, dict(zip(names, x, strict=True)))

    offsets = jnp.concatenate([k * STEP * jnp.eye(len(names)) for k in (-2.0, -1.0, 1.0, 2.0)], axis=1)
    values, status = jax.jit(flown)(offsets)
    assert int(status) == Status.COMPLETED
    far_below, below, above, far_above = jnp.split(values, 4, axis=1)
    differences = (8.0 * (above - below) - (far_above - far_below)) / (12.0 * STEP)

    def slope(weights):
        return jax.grad(lambda z: jnp.sum(weights * flown(z[:, None])[0][:, 0]))(jnp.zeros(len(names)))

    # One run, once: the compiler's optimisation would cost minutes and save seconds.
    slope = jax.jit(slope, compiler_options={"xla_backend_optimization_level": 0})

    slopes = jnp.stack([slope(row) for row in jnp.eye(values.shape[0])])
    assert np.all(np.isfinite(slopes))
    for found, expected in zip(np.asarray(slopes), np.asarray(differences), strict=True):
        # Relative to each slope; slopes that are a hundred times below the largest one, to 1e-6 of that bound.
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-8 * np.max(np.abs(expected)))
    reached = np.abs(np.asarray(slopes)).max(axis=0) > 0.0
    assert np.all(reached), [n for n, r in zip(names, reached, strict=True) if not r]
