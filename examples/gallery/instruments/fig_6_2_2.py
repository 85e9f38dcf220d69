"""Gyro after an impulse
Fig. 6.2-2: a gyro after an impulse

The end of the axis of a gyro in massless gimbals after an impulse about the
inner axis: a circle of radius $M/H$, at the nutation frequency."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.gyros import TwoGimbalGyro

jaxspace.enable_x64()
A, C, n, impulse = 0.002, 0.0008, 500.0, 2e-3  # kg m^2, rad/s, N m s
gyro = TwoGimbalGyro(A, C, n)
period = 2.0 * jnp.pi * A / (C * n)
t = jnp.linspace(0.0, 2.0 * period, 400)
theta, psi = gyro.impulse_response(t, impulse)
figure, (left, right) = plt.subplots(1, 2, figsize=(8.4, 3.8))
left.plot(1e3 * t, jnp.degrees(theta), label="θ")
left.plot(1e3 * t, jnp.degrees(psi), label="ψ")
left.set(xlabel="time, ms", ylabel="deviation, deg")
left.legend()
right.plot(jnp.degrees(psi), jnp.degrees(theta))
right.set(xlabel="ψ, deg", ylabel="θ, deg", aspect="equal")
plt.show()
