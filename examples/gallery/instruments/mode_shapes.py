"""Autopilot gain of a flexible missile
Mode shapes of a missile and root locus of its autopilot

The first bending modes of a free beam, and the roots of a flexible missile
with a gimballed engine for increasing autopilot gain, with the gyro at the
centre of mass and at the nose, where the second mode is unstable for any
gain."""

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.mechanics import FlexibleMissile
from jaxspace.mechanics.beams import beam_roots, beam_shape
from jaxspace.mechanics.missile_loop import MissileLoop
from jaxspace.studies import modes

jaxspace.enable_x64()
missile = FlexibleMissile(
    *(2e4, 20.0, 2e8, 1.5, 0.0, 4e5),
    actuator_stiffness=3e6,
    actuator_damping=4e4,
    damping_ratio=0.005,
)


@jax.jit
@jax.vmap
def roots(gain, place):
    loop = MissileLoop(missile, gain, 0.1 * gain, gyro_place=place)
    return modes(loop, loop.state()).eigenvalues


x = jnp.linspace(0.0, 1.0, 200)
figure, (left, right) = plt.subplots(1, 2, figsize=(8.4, 3.8))
for k, root in enumerate(beam_roots("free-free", 3)):
    left.plot(x, beam_shape("free-free", root, x), label=f"mode {k + 1}")
left.set(xlabel="position along the missile / length", ylabel="shape")
left.legend()
gain = jnp.linspace(0.0, 2.0, 150)
for place, label in ((0.0, "gyro at mid-length"), (9.9, "gyro at the nose")):
    found = roots(gain, jnp.full_like(gain, place)).ravel()
    right.plot(jnp.real(found), jnp.imag(found), ".", ms=2, label=label)
right.axvline(0.0, color="0.4", lw=0.8)
right.set(xlabel="real part, 1/s", ylabel="imaginary part, rad/s")
right.set(xlim=(-30.0, 30.0), ylim=(0.0, 220.0))
right.legend()
plt.show()
