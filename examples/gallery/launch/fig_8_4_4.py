"""Propellant split for a short duration
Propellant split

A prescribed duration shorter than the free fall from the target (8.4): both
impulses have vertical components, and for the optimal split,
$V_1/V_2 = W_1/W_2$, they have the same slope."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.optimization import propellant_use

jaxspace.enable_x64()
u0, w0, g, V, climb = 790.0, 460.0, 9.81, 4500.0, 120e3
best = propellant_use(jnp.array([u0, w0]), climb, V, g, 120.0)


def final(share, T):
    """Two impulses, with what they must lift: W1 and W2."""
    W1, W2 = climb / T + 0.5 * g * T - w0, 0.5 * g * T - climb / T
    across = ((share * V) ** 2 - W1**2, ((1.0 - share) * V) ** 2 - W2**2)
    feasible = (across[0] >= 0.0) & (across[1] >= 0.0)
    parts = (jnp.sqrt(jnp.maximum(x, 0.0)) for x in across)
    return jnp.where(feasible, u0 + sum(parts), jnp.nan)


figure, axes = plt.subplots()
share = jnp.linspace(0.0, 1.0, 2001)
T0 = float(best.duration)
for factor in (0.7, 0.85, 1.0, 1.15, 1.3):
    line = "-" if factor == 1.0 else "--"
    axes.plot(
        share, final(share, factor * T0), line, label=f"{factor * T0:.0f} s"
    )
axes.plot(best.first / V, best.final_velocity, "ko", ms=5)
axes.set(
    xlabel="first impulse / total impulse",
    ylabel="final velocity, m/s",
)
axes.legend(title="duration")
plt.show()
