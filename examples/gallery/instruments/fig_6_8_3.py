"""Stable platform under a torque
Fig. 6.8-3: a platform under a torque

The gyro of a single-axis stable platform after a torque of 0.01 N m is
applied: without a servo it nutates about $Tt/h$, with a servo the torque is
compensated immediately. Right: the frequency response of both."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.gyros import PlatformAxis
from jaxspace.studies import modes

jaxspace.enable_x64()
free = PlatformAxis(0.4, 2e-4, 0.05, torque=0.01)
held = PlatformAxis(
    0.4, 2e-4, 0.05, torque=0.01, gain=2.0, rate_gain=0.05, gyro_damping=0.01
)
t = jnp.linspace(0.0, 4.0, 400)
w = jnp.logspace(-1.0, 2.0, 400)
figure, (left, right) = plt.subplots(1, 2, figsize=(8.4, 3.8))
for axis, label in ((free, "without servo"), (held, "with servo")):
    start = axis.at_rest
    angle = axis.closed_form().flow(t, start).gyro_angle
    left.plot(t, jnp.degrees(angle), label=label)
    found = modes(axis, start, inputs=("torque",), outputs=("gyro_angle",))
    magnitude, _ = found.bode(w)
    right.semilogx(w, magnitude[0, 0])
left.plot(t, jnp.degrees(0.01 / 0.05 * t), "k--", lw=0.8, label="T t / h")
left.set(xlabel="time, s", ylabel="gyro angle, deg")
left.legend()
right.set(xlabel="frequency, rad/s", ylabel="gyro angle / torque, dB")
plt.show()
