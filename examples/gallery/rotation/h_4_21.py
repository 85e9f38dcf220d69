"""Types of nutation of a top
H 4.21 to 4.24: the four paths of a top's axis

Nutation against precession for a given spin and several initial precession
rates: steady at one rate, otherwise wavy, cuspidal or looping between two
circles (H 4.11)."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace import simulate_batch
from jaxspace.attitude import Top
from jaxspace.attitude.outputs import continuous_precession

jaxspace.enable_x64()
top = Top(transverse_inertia=1.0e-3, axial_inertia=6.0e-4, weight_moment=0.08)
spin = 60.0
tilt = jnp.radians(50.0) * jnp.ones(4)
slow, _ = top.steady_precession_rates(tilt[0], spin)
push = jnp.stack([slow, 0.5 * slow, 0.0 * slow, -1.0 * slow])
start = top.state(
    [0.0 * tilt, tilt, 0.0 * tilt],
    [push, 0.0 * tilt, spin - push * jnp.cos(tilt)],
)
run = simulate_batch(top, start, jnp.linspace(0.0, 0.9, 900))
psi = jnp.degrees(continuous_precession(run.states))
theta = jnp.degrees(Top.angles(run.states)[1])

figure, axes = plt.subplots(figsize=(7.6, 3.8))
for k, name in enumerate(("steady", "waves", "cusps", "loops")):
    axes.plot(psi[:, k], theta[:, k], label=name)
axes.invert_yaxis()
axes.set(xlabel="precession ψ, deg", ylabel="nutation θ, deg")
axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=4)
plt.show()
