"""A gravity field and an atmosphere of another library as effects of a scene.

`Custom` turns any JAX function into an acceleration. Here the gravity field JGM-3 to degree and
order 4 and the Harris-Priester density, which includes the diurnal bulge, both from astrojax, act
on a low satellite for two revolutions. The derivative of the final state with respect to the
initial state passes through both. Requires `pip install jaxspace[ephemerides]`.
"""

import jax
import jax.numpy as jnp
from astrojax import Epoch, set_dtype
from astrojax.orbit_dynamics import (
    GravityModel,
    accel_gravity_spherical_harmonics,
    density_harris_priester,
    sun_position,
)

import jaxspace
from jaxspace import Accuracy, BodyState, Scene, simulate
from jaxspace.bodies import Load
from jaxspace.constants import MU_EARTH, ROTATION_RATE_EARTH
from jaxspace.orbits import PointGravity
from jaxspace.orbits.kepler import kepler_flow
from jaxspace.rotations import Quaternion
from jaxspace.scene import Custom
from jaxspace.solvers import DOP853

jaxspace.enable_x64()
set_dtype(jnp.float64)
DEGREE = 4
START = Epoch(2026, 3, 1, 0, 0, 0)
AREA_PER_MASS = 0.02  # drag coefficient times area over mass, m^2/kg


# Coefficients for the Earth from the files of the library, read before compilation.
FIELD = GravityModel.from_type("JGM3")
FIELD.set_max_degree_order(DEGREE, DEGREE)


def over_the_earth(t):
    """The matrix to the axes of the turning earth."""
    axis = jnp.array([0.0, 0.0, 1.0])
    return Quaternion.from_axis_angle(axis, ROTATION_RATE_EARTH * t).matrix().T


def harmonics(t, y, body):
    """The field without its central part, which `PointGravity` has."""
    turned = over_the_earth(t)

    def attraction(r):
        whole = accel_gravity_spherical_harmonics(r, turned, FIELD, DEGREE, DEGREE)
        return whole + FIELD.gm * r / jnp.linalg.norm(r) ** 3

    return Load(acceleration_N=of_each(attraction)(y.position))


def drag(t, y, body):
    """Of air that turns with the earth."""
    omega, sun = jnp.array([0.0, 0.0, ROTATION_RATE_EARTH]), sun_position(START + t)

    def push(r, v):
        wind = v - jnp.cross(omega, r)
        density = density_harris_priester(r, sun)
        return -0.5 * AREA_PER_MASS * density * jnp.linalg.norm(wind) * wind

    return Load(acceleration_N=of_each(push)(y.position, y.velocity))


def of_each(function):
    """A function of one satellite, of one or of many: its library knows no batches."""

    def many(*vectors):
        return function(*vectors) if vectors[0].ndim == 1 else jax.vmap(function, -1, -1)(*vectors)

    return many


EFFECTS = [
    Custom(harmonics),
    Custom(drag),
]
Y0 = BodyState(jnp.array([6.678e6, 0.0, 0.0]), jnp.array([0.0, 4.8e3, 6.06e3]))
SPEED = jnp.linalg.norm(Y0.velocity)
TS = jnp.array([0.0, 2.0 * 5431.0])


def end(y0: BodyState) -> jax.Array:
    """The position after two revolutions, m."""
    scene = Scene([PointGravity(MU_EARTH), *EFFECTS])
    return simulate(scene, y0, TS, accuracy=Accuracy(1e-8, method=DOP853())).final.position


def main() -> None:
    """Print what the effects move, and what a metre a second at the start does at the end."""

    def faster(dv):
        return end(BodyState(Y0.position, Y0.velocity * (1.0 + dv / SPEED)))

    with_all, moved = jax.jvp(faster, (0.0,), (1.0,))
    away = with_all - kepler_flow(Y0.position, Y0.velocity, TS[1], MU_EARTH)[0]
    print(f"field and air move the satellite by {float(jnp.linalg.norm(away)) / 1e3:.3f} km")
    print(f"a metre a second at the start by {float(jnp.linalg.norm(moved)) / 1e3:.3f} km")


if __name__ == "__main__":
    main()
