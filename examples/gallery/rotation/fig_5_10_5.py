"""Stability of spins about the principal axes
Fig. 5.10-5: polhodes along the three axes

Viewed along the axes of greatest and least inertia the polhodes are ellipses:
small disturbances of these spins remain small. Viewed along the intermediate
axis they are hyperbolas: a disturbed spin about it is unstable."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.attitude.polhode import Polhode
from jaxspace.bodies import PrincipalInertia
from jaxspace.bodies.principal_frame import free_turn

jaxspace.enable_x64()
moments = jnp.array([1.0, 2.0, 3.0])
angles = jnp.radians(jnp.linspace(8.0, 82.0, 9))
start = jnp.stack([jnp.sin(angles), 0.0 * angles, jnp.cos(angles)])
start = start / jnp.sqrt(jnp.sum(moments[:, None] * start**2, axis=0))
period = Polhode.of(moments[:, None], start).period
shares = jnp.linspace(0.0, 1.0, 200)[:, None]
_, path = free_turn(
    shares * period, PrincipalInertia(moments), start[:, None, :]
)
figure, panels = plt.subplots(1, 3, figsize=(9.0, 3.4))
for axes, (i, j, name) in zip(
    panels,
    ((1, 2, "Least"), (0, 2, "Middle"), (0, 1, "Greatest")),
    strict=True,
):
    for k in range(angles.size):
        # Which axis the polhode circles: h^2 against 2 T B.
        h2 = float(jnp.sum((moments * start[:, k]) ** 2))
        color = "C1" if h2 > 2.0 else "C0"
        for s in (1.0, -1.0):
            axes.plot(s * path[i, :, k], s * path[j, :, k], color=color, lw=1)
            axes.plot(
                -s * path[i, :, k], s * path[j, :, k], color=color, lw=1
            )
    edge = jnp.linspace(0.0, 2.0 * jnp.pi, 200)
    axes.plot(
        jnp.cos(edge) / jnp.sqrt(moments[i]),
        jnp.sin(edge) / jnp.sqrt(moments[j]),
        *("--",),
        color="0.6",
        lw=0.8,
    )
    axes.set(xlabel=f"$ω_{i + 1}$", ylabel=f"$ω_{j + 1}$", aspect="equal")
    axes.set_title(f"{name} moment")
plt.show()
