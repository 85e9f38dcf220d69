r"""Orbits under power-law attractions
Rosettes of power laws

Orbits under attractions $k/r^n$, launched horizontally at 0.6 of the circular
speed. The angle between periapsis and apoapsis, by quadrature, is $\pi/2$ for
the linear spring ($n = -1$) and $\pi$ for gravity ($n = 2$): only these two
are always closed."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace import BodyState, Scene, simulate_batch
from jaxspace.orbits import PowerLawForce
from jaxspace.orbits.central_force import power_law_potential
from jaxspace.orbits.radial_motion import radial_motion, turning_points

jaxspace.enable_x64()
n = jnp.array([-1.0, 0.0, 1.0, 1.5, 2.0, 2.4])
ones = jnp.ones_like(n)
r = jnp.stack([ones, 0.0 * n, 0.0 * n])
v = jnp.stack([0.0 * n, 0.6 * ones, 0.0 * n])


def potential(radius):
    return power_law_potential(radius, ones, n)


angles = radial_motion(
    potential, *turning_points(potential, r, v)
).apsidal_angle
run = simulate_batch(
    Scene([PowerLawForce(ones, n)]),
    BodyState(r, v),
    jnp.linspace(0, 40, 1500),
)
x, y, _ = run.states.position

figure, panels = plt.subplots(2, 3, figsize=(7.6, 5.2))
for k, axes in enumerate(panels.flat):
    axes.plot(x[:, k], y[:, k], lw=0.9, color=f"C{k}")
    axes.plot(0, 0, "k+")
    axes.set(xlim=(-1.05, 1.05), ylim=(-1.05, 1.05), aspect="equal")
    axes.set(xticks=[-1, 0, 1], yticks=[-1, 0, 1])
    degrees = float(jnp.degrees(angles[k]))
    axes.set_title(f"n = {float(n[k]):g}: {degrees:.1f} deg")
plt.show()
