"""Delta-v of transfers
Fig. 4.11-2: cost of a Hohmann transfer

Both impulses of the Hohmann transfer between circular orbits, in units of the
speed on the first one. It costs as much as escape at a ratio of 3.304, and
most at 15.58; beyond 11.94 a transfer by way of a more distant apsis can be
cheaper."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.orbits.transfers import bielliptic_transfer, hohmann_transfer

jaxspace.enable_x64()
ratio = jnp.geomspace(1.0, 100.0, 400)
hohmann = hohmann_transfer(1.0, ratio, 1.0)
figure, axes = plt.subplots()
axes.semilogx(ratio, hohmann.total, label="Hohmann")
for k, out in enumerate((30.0, 1e6)):
    wide = ratio[ratio < out]
    cost = bielliptic_transfer(1.0, out, wide, 1.0).total
    name = "infinity" if out > 1e3 else f"{out:.0f} radii"
    axes.semilogx(wide, cost, "--", color=f"C{k + 1}", label=f"via {name}")
axes.axhline(jnp.sqrt(2.0) - 1.0, color="0.5", lw=0.9, ls=":")
axes.text(30.0, 0.42, "escape", fontsize=8, color="0.4")
best = int(jnp.argmax(hohmann.total))
axes.plot(ratio[best], hohmann.total[best], "ko", ms=4)
axes.set(xlabel="final radius / initial radius")
axes.set(ylabel="total impulse / initial circular speed", ylim=(0.0, 0.65))
axes.set_xticks([1, 2, 5, 10, 20, 50, 100])
axes.set_xticklabels(["1", "2", "5", "10", "20", "50", "100"])
axes.minorticks_off()
axes.legend(loc="lower right")
plt.show()
