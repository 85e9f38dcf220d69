r"""Nozzle radius and jet damping of a spinning rocket
Fig. 7.9-3: transverse rate of a spinning rocket with jet damping

The path of $\omega_x + i\omega_y$ in body axes while 80 percent of the mass
burns, for nozzles on a ring inside, at, and outside the axial radius of
gyration. Inside it the spin increases, outside it decreases; the damping is
nearly the same."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.rockets import SpinningRocket

jaxspace.enable_x64()
k, k_z, lever = 1.5, 0.4, 2.0  # m
t = jnp.linspace(0.0, 100.0, 4001)  # s
figure, axes = plt.subplots(1, 3, figsize=(8.4, 3.2), sharey=True)
titles = ("increasing spin", "constant spin", "decreasing spin")
for frame, ring, title in zip(axes, (0.2, 0.4, 0.6), titles, strict=True):
    # A slow spin, so that single turns can be seen.
    rocket = SpinningRocket.of_lengths(0.6, 0.008, k, k_z, lever, ring)
    w = jnp.degrees(
        rocket.transverse_rate(t, jnp.array([0.03, 0.0])[:, None])
    )
    frame.plot(w[0], w[1])
    frame.plot(w[0, ::200], w[1, ::200], ".", ms=3, color="k")
    frame.set(title=f"{title}: ring {ring / k_z:g} k$_z$", aspect="equal")
    frame.set(xlabel="w$_x$, deg/s")
axes[0].set(ylabel="w$_y$, deg/s")
plt.show()
