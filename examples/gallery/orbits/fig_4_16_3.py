"""Phasing on the same orbit
Fig. 4.16-3: phasing

A satellite catches up with another one on the same circular orbit during N
revolutions on an ellipse with a different period. Both impulses in units of
the circular speed against the lead angle of the target."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.orbits.burnout import vis_viva_speed

jaxspace.enable_x64()
ahead = jnp.radians(jnp.linspace(0.0, 360.0, 300))
figure, axes = plt.subplots()
for k, turns in enumerate((1, 2, 3, 5)):
    for style, whole in (("-", turns), ("--", turns + 1)):
        # The other one passes the place of the impulse after this many turns.
        passed = whole - ahead / (2.0 * jnp.pi)
        size = (passed / turns) ** (2.0 / 3.0)
        speed = jnp.where(size > 0.5, vis_viva_speed(1.0, size, 1.0), jnp.nan)
        name = f"{turns}" if style == "-" else None
        axes.plot(
            jnp.degrees(ahead),
            *(2.0 * jnp.abs(speed - 1.0), style),
            color=f"C{k}",
            label=name,
        )
axes.set(
    xlabel="lead angle of the target, deg",
    ylabel="total impulse / circular speed",
)
axes.set(xticks=range(0, 361, 60), ylim=(0.0, 0.8))
axes.set_title("Inner ellipse (solid), outer ellipse (dashed)")
axes.legend(title="revolutions N")
plt.show()
