"""Gyro under a steady moment
Fig. 6.2-3: a gyro under a steady moment

The end of the axis of a gyro in massless gimbals under a constant moment
about the inner axis, applied at rest: a cycloid, the superposition of a
steady precession and a nutation."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.gyros import TwoGimbalGyro

jaxspace.enable_x64()
A, C, n = 0.002, 0.0008, 500.0  # kg m^2, rad/s
gyro = TwoGimbalGyro(A, C, n, moment_inner=0.5)
period = 2.0 * jnp.pi * A / (C * n)
t = jnp.linspace(0.0, 4.0 * period, 600)
theta, psi = gyro.step_response(t)
figure, axes = plt.subplots(figsize=(8.4, 1.5))
axes.plot(jnp.degrees(psi), jnp.degrees(theta))
axes.set(xlabel="ψ, deg", ylabel="θ, deg", aspect="equal")
plt.show()
