"""Gyro suspended from a string
A gyro on a string

A spinning wheel is suspended at one end of its axle from a string and
precesses (5.14 P20). The spin required for a steady motion against the
precession rate, for inclined, horizontal and hanging axles; right: the shape
of the horizontal case at four rates; the distance from the axis increases
with the rate."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.attitude.top_relatives import gyro_on_a_string

jaxspace.enable_x64()
body = (0.3, 1.0e-4, 1.5e-4, 0.5, 0.06, 9.80665)  # m, A, C, l1, l2, g
figure, (left, right) = plt.subplots(1, 2, figsize=(8.4, 3.8))
rate = jnp.linspace(0.5, 8.0, 400)
for degrees in (50.0, 90.0, 130.0):
    _, _, spin = gyro_on_a_string(jnp.radians(degrees), rate, *body)
    left.plot(rate, spin, label=f"{degrees:.0f} deg")
left.set(xlabel="precession rate, rad/s", ylabel="spin, rad/s")
left.set_ylim(0.0, 1000.0)
left.legend(title="axle angle from the vertical")
for k, turning in enumerate((3.0, 4.2, 5.0, 6.5)):
    b, _, spin = gyro_on_a_string(0.5 * jnp.pi, turning, *body)
    x, z = 0.5 * jnp.sin(b), -0.5 * jnp.cos(b)
    right.plot([0.0, x], [0.0, z], color="0.5", lw=0.9)
    right.plot([x, x + 0.06], [z, z], color=f"C{k}", lw=2.0)
    wheel = [z - 0.032, z + 0.032]
    label = f"{turning:g} rad/s"
    right.plot([x + 0.06] * 2, wheel, color=f"C{k}", lw=5.0, label=label)
right.axvline(0.0, color="0.4", lw=0.8, ls="--")
right.set(
    xlabel="distance from the axis, m", ylabel="distance below the support, m"
)
right.set(xlim=(-0.03, 0.56), aspect="equal", title="Horizontal axle")
right.legend(loc="upper right")
plt.show()
