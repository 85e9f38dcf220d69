"""Despin with hinged arms
Despin by arms that swing out

Four hinged arms along the axis of a spinning satellite are released (7.6 P3):
the spin decreases as they swing out, and the lost energy is the kinetic
energy of the arms. Left: against the angle of the arms, for three arm
lengths; right: against time, for the arms of the problem."""

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.attitude.swinging import SwingOutArms

jaxspace.enable_x64()
w0 = 10.0
angle = jnp.linspace(0.0, jnp.pi / 2.0, 200)
figure, (left, right) = plt.subplots(1, 2, figsize=(8.4, 3.8))
for length in (0.4, 0.8, 1.6):
    arms = SwingOutArms(2.0, 0.2, 0.5, length)
    left.plot(
        jnp.degrees(angle), arms.spin_rate(angle, w0), label=f"{length:g}"
    )
left.set(xlabel="arm angle, deg", ylabel="spin, rad/s")
left.set(xticks=range(0, 91, 15), ylim=(0.0, 10.5))
left.legend(title="length, m")
arms = SwingOutArms(2.0, 0.2, 0.5, 0.8)
time = jax.vmap(lambda theta: arms.swing_time(theta, w0))(angle)
right.plot(1e3 * time, arms.spin_rate(angle, w0), label="spin")
right.plot(1e3 * time, arms.angle_rate(angle, w0), label="arm rate")
right.set(xlabel="time, ms", ylabel="rad/s", ylim=(0.0, 15.0))
right.legend()
plt.show()
