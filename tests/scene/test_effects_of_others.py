"""Accelerations of a JAX library of the earth's environment as effects of a scene."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace import BodyState, Scene
from jaxspace.bodies import Load
from jaxspace.orbits import PointGravity, Zonals
from jaxspace.scene import Custom

astrojax = pytest.importorskip("astrojax")


@pytest.fixture
def double():
    before = astrojax.get_dtype()
    astrojax.set_dtype(jnp.float64)
    yield
    astrojax.set_dtype(before)


def test_a_field_of_astrojax_is_the_zonals_of_ours(double):
    """JGM-3 to degree 3 and order 0 is J2 and J3: two libraries, two forms of the potential."""
    from astrojax.orbit_dynamics import GravityModel, accel_gravity_spherical_harmonics

    field = GravityModel.from_type("JGM3")
    field.set_max_degree_order(3, 0)
    harmonics = [-np.sqrt(2 * n + 1) * field.get(n, 0)[0] for n in (2, 3)]

    def attraction(t, y, body):
        whole = accel_gravity_spherical_harmonics(y.position, jnp.eye(3), field, 3, 0)
        central = field.gm * y.position / jnp.linalg.norm(y.position) ** 3
        return Load(acceleration_N=whole + central)

    of_others = Custom(attraction)
    y = BodyState(jnp.array([5.1e6, -3.3e6, 3.7e6]), jnp.array([1e3, 6e3, 4e3]))

    @jax.jit
    def both(y):
        scenes = [
            Scene([PointGravity(field.gm), effect])
            for effect in (of_others, Zonals(field.gm, harmonics, field.radius))
        ]
        return [
            (s.vector_field(0.0, y).velocity, jax.jacfwd(lambda y, s=s: s.vector_field(0.0, y))(y))
            for s in scenes
        ]

    (found, found_slopes), (expected, slopes) = both(y)
    # The central part of 9 m/s^2 is added and taken away: 1e-15 of it is left.
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=2e-14)
    jax.tree.map(
        lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-19), found_slopes, slopes
    )
