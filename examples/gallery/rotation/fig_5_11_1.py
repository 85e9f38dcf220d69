"""Angular velocity of a free body
Fig. 5.11-1 to 5.11-3: rates of a free asymmetric body

Moments $A > B > C$. Below $h^2 = 2TB$ the motion circles the axis of least
inertia, above it that of greatest inertia. On the separatrix the body
approaches the spin about the intermediate axis asymptotically."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.bodies import PrincipalInertia
from jaxspace.bodies.principal_frame import free_turn

jaxspace.enable_x64()
moments = jnp.array([3.0, 2.0, 1.0])
# On the separatrix the outer rates have the ratio
# sqrt(C (B - C) / A (A - B)).
ratio = jnp.sqrt(1.0 / 3.0)
starts = jnp.stack([0.8 * ratio, ratio, 1.25 * ratio]), jnp.ones(3)
omega = jnp.stack([starts[0], jnp.zeros(3), starts[1]])
t = jnp.linspace(0.0, 16.0, 600)
_, rates = free_turn(t[:, None], PrincipalInertia(moments), omega[:, None, :])
titles = ("h^2 < 2 T B", "h^2 = 2 T B", "h^2 > 2 T B")
figure, panels = plt.subplots(1, 3, figsize=(9.2, 3.3), sharey=True)
for k, (axes, title) in enumerate(zip(panels, titles, strict=True)):
    for i, name in enumerate("ABC"):
        axes.plot(t, rates[i, :, k], color=f"C{i}", label=f"about {name}")
    axes.set(xlabel="time, s", title=title)
panels[0].set_ylabel("rate, rad/s")
figure.legend(
    *panels[0].get_legend_handles_labels(), loc="outside right center"
)
plt.show()
