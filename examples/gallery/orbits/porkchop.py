"""Transfer window
Fig. 4.16-4: porkchop plot from Earth to Mars

Total impulse at departure and arrival against the departure and arrival
dates, for planets on coplanar circular orbits: 200 000 transfers in one call
of `lambert`."""

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.orbits.lambert import lambert

jaxspace.enable_x64()
MU, AU, DAY = 1.32712440018e20, 1.495978707e11, 86400.0


def planet(radius, at_zero, t):
    """Position and velocity on a circle."""
    rate = jnp.sqrt(MU / radius**3)
    a = at_zero + rate * t
    out = jnp.stack([jnp.cos(a), jnp.sin(a), 0.0 * a])
    along = jnp.stack([-jnp.sin(a), jnp.cos(a), 0.0 * a])
    return radius * out, radius * rate * along


@jax.jit
def cost(leave, duration):
    r1, v1 = planet(AU, 0.0, leave * DAY)
    r2, v2 = planet(1.524 * AU, 0.0, (leave + duration) * DAY)
    up = jnp.zeros_like(r1).at[2].set(1.0)
    go, come = lambert(r1, r2, duration * DAY, MU, normal=up)
    return jnp.linalg.norm(go - v1, axis=0) + jnp.linalg.norm(
        v2 - come, axis=0
    )


leave, duration = jnp.meshgrid(
    jnp.linspace(480, 800, 500), jnp.linspace(80, 420, 400)
)
total = cost(leave.ravel(), duration.ravel()).reshape(leave.shape) / 1e3
figure, axes = plt.subplots(figsize=(6.8, 4.8))
levels = [5.6, 5.8, 6, 6.5, 7, 8, 10, 12, 15, 20, 25]
lines = axes.contour(
    leave, leave + duration, total, levels, cmap="viridis", vmax=40.0
)
axes.clabel(lines, fontsize=7)
axes.set(xlabel="departure, days after the opposition")
axes.set(ylabel="arrival, days after the opposition")
axes.set_title("Total impulse, km/s")
plt.show()
