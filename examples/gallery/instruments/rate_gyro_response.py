"""Response of a rate gyro
Step and frequency response of a rate gyro

The gimbal angle of a rate gyro after a step of the input rate (6.6), relative
to its final angle, and the response to oscillating rates. With 0.6 to 0.7 of
the critical damping the settling time is shortest and the amplitude is flat
up to the natural frequency."""

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.gyros import RateGyro

jaxspace.enable_x64()
A, H, K = 1.0e-4, 0.05, 0.2  # kg m^2, kg m^2/s, N m
natural = jnp.sqrt(K / A)
time = jnp.linspace(0.0, 12.0, 500) / natural
ratio = jnp.geomspace(0.1, 10.0, 400)
figure, (left, right) = plt.subplots(1, 2, figsize=(8.4, 3.8))
for share in (0.1, 0.3, 0.65, 1.0, 2.0):
    gyro = RateGyro(A, 2.0 * share * A * natural, H, spring=K, input_rate=0.1)
    angle = jax.vmap(gyro.step_response)(time) / gyro.steady_angle
    left.plot(time * natural, angle)
    answer = jnp.abs(gyro.frequency_response(ratio * natural)) * K / H
    right.loglog(ratio, answer, label=f"{share:g}")
left.set(
    xlabel="time x natural frequency", ylabel="angle / steady-state angle"
)
left.set_title("Step response")
right.set(xlabel="frequency / natural frequency", ylabel="amplitude ratio")
right.set(ylim=(0.009, 9.0), title="Frequency response")
right.legend(title="damping ratio", loc="lower left")
plt.show()
