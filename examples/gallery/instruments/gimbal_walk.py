"""Gimbal walk
Drift of a gyro whose gimbals have mass

The outer gimbal of a nutating gyro whose gimbals have mass: with every
nutation it returns to a slightly different angle. The line is the exact mean
drift; the dashed line is Thomson's 6.3-22."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace import simulate
from jaxspace.gyros import TwoGimbalGyro

jaxspace.enable_x64()
theta, rate = 1.0, 30.0  # rad, rad/s
gyro = TwoGimbalGyro(0.002, 0.0008, 500.0, 0.0006, 0.0005, 0.0004, 0.0015)
walk = gyro.walk(theta, rate)
period = 2.0 * jnp.pi / gyro.nutation_frequency(theta)
t = jnp.linspace(0.0, 8.0 * period, 800)
y0 = gyro.state(theta, 0.0, rate, 0.0)
run = simulate(gyro, y0, t, accuracy=1e-10)
figure, axes = plt.subplots(figsize=(7.4, 4.0))
axes.plot(1e3 * t, jnp.degrees(run.states.psi), label="ψ")
axes.plot(1e3 * t, jnp.degrees(walk.drift * t), label="mean drift")
mean = walk.drift_to_second_order * t
axes.plot(1e3 * t, jnp.degrees(mean), "k--", lw=0.8, label="second order")
axes.set(xlabel="time, ms", ylabel="outer gimbal, deg")
axes.legend()
plt.show()
