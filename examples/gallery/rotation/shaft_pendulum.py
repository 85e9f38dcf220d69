r"""Equilibria of a disk on a rotating shaft
A disk on a stem that is pinned to a rotating shaft

The disk hangs along the shaft up to the rate $\psi'^2 = 4ga/(4a^2-r^2)$ and
is inclined beyond (5.14 P12): a pitchfork bifurcation. Left: the equilibria,
the unstable one dashed; right: the frequency of small oscillations about the
stable ones, which vanishes at the bifurcation."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.attitude import ShaftPendulum

jaxspace.enable_x64()
m, a, g = 1.0, 0.3, 9.80665
figure, (left, right) = plt.subplots(1, 2, figsize=(8.4, 3.8))
for k, r in enumerate((0.05, 0.2, 0.4)):
    A, C = m * (r * r / 4.0 + a * a), m * r * r / 2.0
    critical = ShaftPendulum(A, C, m * g * a).critical_rate
    ratio = jnp.linspace(0.0, 2.5, 501)
    disk = ShaftPendulum(A, C, m * g * a, ratio * critical)
    out = disk.equilibrium
    own = disk.frequency(out) / jnp.sqrt(g / a)
    right.plot(ratio, own, color=f"C{k}", label=f"{r:g} m")
# Over its own critical rate every disk has the same place of rest.
for sign in (1.0, -1.0):
    left.plot(ratio, sign * jnp.degrees(out), "C0")
left.plot([1.0, 2.5], [0.0, 0.0], "C0--")
left.set(xlabel="rate / critical rate", ylabel="equilibrium angle, deg")
right.set(xlabel="rate / critical rate", ylabel="frequency / sqrt(g / a)")
right.set_ylim(0.0)
right.legend(title="disk radius")
plt.show()
