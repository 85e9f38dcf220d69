"""Delta-v of an interception
Fig. 4.16-2: cost of an interception

The first impulse, from the circular orbit through the departure point,
against the time of flight, for several transfer angles to 1.5 times the
radius; dashed: including the second impulse, which circularises the orbit
there."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.orbits.lambert import lambert

jaxspace.enable_x64()
start = jnp.array([[1.0], [0.0], [0.0]])
t = jnp.linspace(0.4, 8.0, 300)
figure, axes = plt.subplots()
for k, degrees in enumerate((60.0, 90.0, 120.0, 150.0)):
    a = jnp.radians(degrees)
    out = jnp.stack([jnp.cos(a), jnp.sin(a), 0.0 * a])[:, None]
    along = jnp.stack([-jnp.sin(a), jnp.cos(a), 0.0 * a])[:, None]
    v1, v2 = lambert(start, 1.5 * out, t, 1.0)
    meet = jnp.linalg.norm(v1 - jnp.array([[0.0], [1.0], [0.0]]), axis=0)
    stay = meet + jnp.linalg.norm(along / jnp.sqrt(1.5) - v2, axis=0)
    turns = t / (2.0 * jnp.pi)
    axes.plot(turns, meet, color=f"C{k}", label=f"{degrees:.0f} deg")
    axes.plot(turns, stay, "--", color=f"C{k}")
axes.set(xlabel="time / period of the initial orbit", ylim=(0.0, 2.5))
axes.set(ylabel="impulse / initial circular speed")
axes.set_title("Interception (solid), rendezvous (dashed)")
axes.legend(title="transfer angle")
plt.show()
