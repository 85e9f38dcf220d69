r"""Resonance of a softening spring
Resonance curve of a softening spring

The amplitude of $m\ddot y + c\dot y + ky - by^3 = F\sin pt$ against the
frequency of the force, by harmonic balance (6.3 P3, P4): the curve bends
towards low frequencies, and between the two vertical tangents there are three
amplitudes. The middle one is unstable, so the oscillator jumps."""

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.gyros.duffing import DuffingOscillator

jaxspace.enable_x64()
amplitude = jnp.linspace(0.02, 3.5, 40000)
natural = 2.0  # rad/s, sqrt(k / m)


def frequencies(damping, a):
    spring = DuffingOscillator(1.0, 4.0, 0.2, 1.0, damping=damping)
    return spring.resonance_frequencies(a)


figure, axes = plt.subplots()
for k, damping in enumerate((0.0, 0.2, 0.3, 0.5)):
    lower, upper = frequencies(damping, amplitude)
    slope = jax.vmap(jax.grad(lambda a, c=damping: frequencies(c, a)[0]))
    # Below the backbone the frequency has to rise with the amplitude.
    stable = slope(amplitude) > 0.0
    style = {"color": f"C{k}", "lw": 1.4}
    axes.plot(upper / natural, amplitude, **style)
    axes.plot(jnp.where(stable, lower, jnp.nan) / natural, amplitude, **style)
    fold = jnp.where(stable, jnp.nan, lower) / natural
    axes.plot(fold, amplitude, "--", **style)
    axes.plot([], [], **style, label=f"{damping:g}")
backbone = jnp.sqrt(4.0 - 0.15 * amplitude**2) / natural
axes.plot(backbone, amplitude, ":", color="0.4", label="backbone")
axes.set(xlabel="p / sqrt(k / m)", ylabel="amplitude, m")
axes.set(xlim=(0.5, 1.4), ylim=(0.0, 3.5))
axes.legend(title="c, N s/m")
plt.show()
