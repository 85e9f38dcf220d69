"""The kick stage of `examples/scenes`: derivatives of its final orbit through burn, coast and
despin."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace import load
from jaxspace.orbits.elements import apoapsis_radius, inclination, periapsis_radius
from jaxspace.simulation import Accuracy, Status
from jaxspace.simulation.mission_runs import run_mission
from jaxspace.simulation.phases import resolve_phases

FILE = Path(__file__).parents[2] / "examples" / "scenes" / "kick_stage.toml"
STEP = 0.015  # of a standard deviation


@pytest.fixture(scope="module")
def campaign():
    return load(FILE).campaign()


def final_orbit(campaign, samples):
    """Periapsis and apoapsis radius, inclination, spin and time at the end of batched runs, and
    the worst status."""
    mission, y0 = campaign.build(samples)
    configs = resolve_phases(mission, y0, Accuracy(rtol=1e-11))
    result = run_mission(mission, y0, jnp.zeros(()), 2, configs, 1)
    mu = mission.phases[0].system.effects[0].mu
    r, v = result.final.position, result.final.velocity
    orbit = [periapsis_radius(r, v, mu), apoapsis_radius(r, v, mu), inclination(r, v)]
    numbers = jnp.stack([*orbit, result.final.omega[2], result.end])
    return numbers, jnp.max(result.status)


@pytest.mark.sweep
def test_derivatives_of_the_final_orbit_in_every_dispersed_input(campaign):
    """Reverse mode through the whole mission against central differences of order six, input by
    input.

    The point is off the nominal one, where some slopes vanish. All runs of the differences share
    their steps, so that the error of the integration cancels. A step moves the phase of the spin at
    burnout by 0.13 rad, whose sixth power over 140 bounds the truncation to 4e-8 of what
    oscillates; a periapsis radius of 6.6e6 m is known to some 1e-8 m, its differences to 1e-6."""
    names = list(campaign.inputs)
    mean = jnp.array([campaign.inputs[n].mean for n in names])
    sigma = jnp.array([campaign.inputs[n].deviation for n in names])
    shift = jnp.asarray(np.random.default_rng(5).uniform(0.3, 1.0, len(names)))

    def ends(z):
        """The end of runs whose inputs lie `z`, (inputs, runs), standard deviations off."""
        x = mean[:, None] + sigma[:, None] * (shift[:, None] + z)
        return final_orbit(campaign, dict(zip(names, x, strict=True)))

    weights = {-3: -1.0, -2: 9.0, -1: -45.0, 1: 45.0, 2: -9.0, 3: 1.0}
    offsets = jnp.concatenate([k * STEP * jnp.eye(len(names)) for k in weights], axis=1)
    values, status = jax.jit(ends)(offsets)
    assert int(status) == Status.COMPLETED
    shifted = jnp.split(values, len(weights), axis=1)
    total = sum(w * x for w, x in zip(weights.values(), shifted, strict=True))
    differences = total / (60.0 * STEP)

    def slope(row):
        return jax.grad(lambda z: jnp.sum(row * ends(z[:, None])[0][:, 0]))(jnp.zeros(len(names)))

    # One run, once: the compiler's optimisation would cost minutes and save seconds.
    slope = jax.jit(slope, compiler_options={"xla_backend_optimization_level": 0})
    slopes = np.stack([slope(row) for row in jnp.eye(values.shape[0])])
    assert np.all(np.isfinite(slopes))
    for found, expected, value in zip(
        np.asarray(slopes), np.asarray(differences), np.asarray(values), strict=True
    ):
        # Of each slope; slopes ten million times below the largest of an output drown in the error
        # of the integration.
        noise = 20.0 * np.finfo(float).eps * np.max(np.abs(value)) / STEP
        np.testing.assert_allclose(
            found, expected, rtol=1e-6, atol=noise + 1e-7 * np.max(np.abs(expected))
        )
    reached = np.abs(np.asarray(slopes)).max(axis=0) > 0.0
    assert np.all(reached), [n for n, r in zip(names, reached, strict=True) if not r]
