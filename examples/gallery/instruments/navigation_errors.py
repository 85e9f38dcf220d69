"""Inertial navigation errors over one day
Errors of an inertial navigator over a day

A strapdown navigator in an aircraft at 200 m/s with a gyro drift of 0.01
deg/h and an accelerometer bias of 50 micro-g: the Schuler period of 84
minutes is modulated by the Earth's rotation."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.gyros import InertialNavigator

jaxspace.enable_x64()
drift, bias = jnp.radians(0.01) / 3600.0, 5e-4
navigator = InertialNavigator(
    latitude=0.8,
    height=1e4,
    east_speed=200.0,
    gyro_drift=[drift, -drift, drift],
    accelerometer_bias=[bias, -bias, 0.0],
    altitude_rate_gain=0.02,
    altitude_gain=1e-4,
)
equations = navigator.error_equations()
t = jnp.linspace(0.0, 86400.0, 1000)
start = equations.errors(position=jnp.zeros((3, t.size)))
found = equations.closed_form().flow(t, start)
figure, (left, right) = plt.subplots(1, 2, figsize=(8.4, 3.8))
for k, name in enumerate(("east", "north")):
    left.plot(t / 3600.0, found.position[k] / 1e3, label=name)
    right.plot(t / 3600.0, found.velocity[k], label=name)
left.set(xlabel="time, h", ylabel="position error, km")
right.set(xlabel="time, h", ylabel="velocity error, m/s")
left.legend()
plt.show()
