"""Paths of the runs of a campaign, as its page draws them."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace import Mission, Phase
from jaxspace.bodies import BodyState
from jaxspace.dispersion import Campaign, Normal, run_paths
from jaxspace.orbits import TwoBody


def circles(turns):
    """A campaign of circular orbits, x = cos(w t), y = sin(w t) with mu = 1 and w about 1."""

    def build(samples):
        radius = samples["radius"]
        zero = jnp.zeros_like(radius)
        velocity = jnp.stack([zero, 1.0 / jnp.sqrt(radius), zero])
        y0 = BodyState(jnp.stack([radius, zero, zero]), velocity)
        return Mission([Phase(TwoBody(1.0), 2.0 * np.pi * turns, name="orbit")]), y0

    return Campaign(build, {"radius": Normal(1.0, 0.01)}, lambda r, s: {"end": r.final.position[0]})


def test_lines_between_the_positions_show_each_run():
    """Of 39 turns forty positions are one place, and of 30 a polygon."""
    for turns in (39.0, 30.0):
        paths = run_paths(circles(turns), [0, 1], num_saved=40)
        assert len(paths.times) > 15 * turns
        for run in range(3):
            t, r = paths.times[:, run], paths.positions[:, :, run]
            radius = r[0, 0]
            middle = 0.5 * (t[1:] + t[:-1])
            shown = np.interp(middle, t, r[0])
            truth = radius * np.cos(middle / radius**1.5)
            # A hundredth of the diameter.
            assert np.max(np.abs(shown - truth)) < 0.02 * radius


def test_paths_that_turn_too_often_are_said_to():
    with pytest.warns(UserWarning, match="increase num_saved"):
        run_paths(circles(1000.0), [0], num_saved=2000)
