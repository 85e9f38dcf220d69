r"""Stability of a trailer
Roots of a trailer

The roots of a trailer with a flexible hitch, as its wheel moves behind the
centre of mass: unstable for $ac < \rho^2$ at any speed and stiffness, and
stable for $ac > \rho^2$ (Thomson 9.10, problem 22)."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.mechanics import Trailer, TrailerState
from jaxspace.studies import modes

jaxspace.enable_x64()
a, rho, v = 2.5, 1.0, 20.0  # m, m, m/s
c = jnp.linspace(0.05, 1.5, 150)
trailer = Trailer(800.0, rho, a, c, 2e4, v)
straight = TrailerState(*(jnp.zeros_like(c),) * 3)
roots = modes(trailer, straight).eigenvalues
figure, (left, right) = plt.subplots(1, 2, figsize=(8.4, 3.8))
left.plot(c, jnp.max(jnp.real(roots), axis=0))
left.axvline(rho**2 / a, color="0.4", lw=0.8)
left.axhline(0.0, color="0.4", lw=0.8)
left.set(
    xlabel="wheel distance behind mass centre, m", ylabel="growth rate, 1/s"
)
points = right.scatter(
    jnp.real(roots).ravel(),
    jnp.imag(roots).ravel(),
    c=jnp.tile(c, 3),
    s=5,
    cmap="viridis",
)
figure.colorbar(points, label="wheel distance behind mass centre, m")
right.axvline(0.0, color="0.4", lw=0.8)
right.set(xlabel="real part, 1/s", ylabel="imaginary part, rad/s")
plt.show()
