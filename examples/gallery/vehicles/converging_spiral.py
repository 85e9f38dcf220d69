r"""Jet damping of a coning stage
Spiral of the axis of a rocket

The axis of a spinning rocket with an initial transverse rate, viewed from
behind in inertial space (7.10 P8), with $l^2/k^2 = 4$: jet damping contracts
the coning circle to a spiral. The centre is at $i\omega_{xy0}k^2/(nk_z^2)$,
farther out for slender bodies."""

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.rockets import SpinningRocket

jaxspace.enable_x64()
spin, burning, start = 10.0, 1.0 / 125.0, 0.02  # rad/s, 1/s, rad/s
time = jnp.linspace(0.0, 100.0, 4001)
figure, both = plt.subplots(1, 2, figsize=(8.4, 4.2))
for axes, share in zip(both, (0.05, 0.2), strict=True):
    rocket = SpinningRocket(spin, burning, 2.0, 1.0, jnp.sqrt(share))

    @jax.jit
    @jax.vmap
    def tip(t, rocket=rocket):
        return rocket.complex_tilt(t, jnp.array([start, 0.0]))

    x, y = 1e3 * tip(time).T
    axes.plot(x, y, lw=0.9)
    axes.plot(0.0, 0.0, "o", color="C1", ms=5)
    axes.plot(0.0, 1e3 * start / (spin * share), "k+", ms=8)
    axes.set(xlabel="X, mrad", aspect="equal")
    axes.set_title(f"kz^2 / k^2 = {share:g}")
both[0].set_ylabel("Y, mrad")
plt.show()
