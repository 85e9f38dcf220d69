r"""Nutation amplitude of a heavy top
Fig. 5.13-2: the cubic of the heavy top

$\dot u^2 = f(u) = (\alpha - \beta u)(1 - u^2) - (\gamma - Nu)^2$ with
$u = \cos\theta$: the axis nutates between the two roots within -1 and 1; the
third root is beyond 1 and has no physical meaning."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.attitude import Top

jaxspace.enable_x64()
top = Top(transverse_inertia=1.0e-3, axial_inertia=6.0e-4, weight_moment=0.08)
u = jnp.linspace(-1.2, 2.2, 500)
figure, axes = plt.subplots()
for k, spin in enumerate((15.0, 20.0, 25.0)):
    tilt = jnp.radians(50.0)
    motion = top.nutation(top.state([0.0, tilt, 0.0], [1.5, 0.0, spin]))
    alpha = 0.5 * (motion.alpha_up + motion.alpha_down)
    gamma = 0.5 * (motion.gamma_up + motion.gamma_down)
    f = (alpha - motion.beta * u) * (1 - u**2) - (gamma - motion.N * u) ** 2
    axes.plot(u, f, label=f"{spin:g} rad/s")
    roots = [jnp.cos(x) for x in motion.turning_points]
    roots.append(motion.third_root / motion.beta)
    axes.plot(roots, [0.0] * 3, "o", color=f"C{k}", ms=5)
axes.axvspan(-1.0, 1.0, color="0.95")
axes.axhline(0.0, color="0.4", lw=0.8)
axes.set(xlabel="u, 1", ylabel="f(u), 1/s^2", ylim=(-400, 300))
axes.set(xlim=(-1.2, 2.2))
axes.legend(title="spin")
plt.show()
