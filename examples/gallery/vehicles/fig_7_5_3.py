"""Yo-yo despin
Fig. 7.5-3: yo-yo

Spin of a satellite of 100 kg m² and cord tension while two masses of 0.6 kg
unwind: the spin decreases to zero at the cord length $l_0$, independently of
its initial value, and reverses beyond."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.attitude import YoYo
from jaxspace.attitude.despin import zero_spin_cord_length

jaxspace.enable_x64()
I, R, m, w0 = 100.0, 0.5, 1.2, 10.0  # kg m^2, m, kg, rad/s
yo_yo = YoYo(axial_inertia=I, radius=R, mass=m, cord_length=10.0)
length = jnp.linspace(0.0, 14.0, 300)
stop = zero_spin_cord_length(I, R, m)
figure, (left, right) = plt.subplots(1, 2, figsize=(8.4, 3.8))
left.plot(length, yo_yo.spin_rate(length / R, w0) / w0)
left.axhline(0.0, color="0.4", lw=0.8)
left.plot(stop, 0.0, "ko", ms=4)
left.set(xlabel="deployed cord length, m", ylabel="spin / initial spin rate")
right.plot(length, yo_yo.tension(length / R, w0), color="C1")
right.set(xlabel="deployed cord length, m", ylabel="tension, N")
plt.show()
