"""Moment for a steady precession
Fig. 5.14-2: moment for a steady precession

The moment that maintains a spinning body at a constant angle, against the
precession rate. Each moment below the maximum corresponds to a slow and a
fast precession; above the horizontal plane the moment has a maximum, below it
there is none."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.attitude import Top

jaxspace.enable_x64()
top = Top(transverse_inertia=1.0e-3, axial_inertia=6.0e-4, weight_moment=0.08)
spin = 60.0
rate = jnp.linspace(-10.0, 70.0, 400)
figure, axes = plt.subplots()
for k, degrees in enumerate((30.0, 50.0, 70.0, 90.0, 110.0)):
    tilt = jnp.radians(degrees)
    moment = top.precession_moment(tilt, rate, spin)
    axes.plot(rate, moment, label=f"{degrees:.0f} deg")
    # The weight asks for W l sin theta: these are its two rates.
    for steady in top.steady_precession_rates(tilt, spin):
        weight = top.weight_moment * jnp.sin(tilt)
        axes.plot(steady, weight, "o", color=f"C{k}", ms=4)
axes.axhline(0.0, color="0.4", lw=0.8)
axes.set(xlabel="precession rate, rad/s", ylabel="moment, N m")
axes.set(xlim=(-10, 70), ylim=(-0.4, 1.0))
axes.set_title("Spin 60 rad/s; dots: moment of the weight")
axes.legend(title="θ")
plt.show()
