r"""Rolling disk on an incline
A disk on an incline rolls along a cycloid

A thin disk that rotates about its vertical while it rolls on an incline (9.9)
does not run away downhill: it repeatedly returns to rest on the cycloid
$x = a(1-\cos 2nt)$, $y = a(2nt-\sin 2nt)$ with $a = g\sin\alpha/6n^2$, and
drifts across the slope. With some initial roll rate its cusps are unevenly
spaced; with more, it never comes to rest, and its path has loops. Simulated
with constraints; dotted: the closed form."""

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace import simulate
from jaxspace.mechanics import InclineDisk

jaxspace.enable_x64()
disk = InclineDisk(1.0, 0.1, jnp.radians(10.0), 9.80665)
turn = 1.5
time = jnp.linspace(0.0, 3.0 * jnp.pi / turn, 400)
figure, axes = plt.subplots(figsize=(7.2, 3.0))
for k, roll in enumerate((0.0, 4.0, 12.0)):
    run = simulate(disk, disk.state(0.0, turn, roll), time, accuracy=1e-9)
    x, y = run.states.coordinates[:2]
    axes.plot(y, x, color=f"C{k}", label=f"{roll:g}")
    x, y, *_ = jax.vmap(lambda t, r=roll: disk.rolled(t, 0.0, turn, r))(
        time
    ).T
    axes.plot(y, x, "k:", lw=1.6, label="closed form" if k == 2 else None)
axes.plot(0.0, 0.0, "ko", ms=5)
axes.invert_yaxis()
axes.set(xlabel="across the slope, m", ylabel="down the slope, m")
axes.set_aspect("equal")
axes.legend(
    title="rolling rate, rad/s", loc="center left", bbox_to_anchor=(1.0, 0.5)
)
plt.show()
