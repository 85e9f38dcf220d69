"""Effect of a misaligned thrust
Epicycle of a misaligned thrust

The axis of a spinning missile with a misaligned thrust, viewed from behind in
inertial space (7.4 P6): a bias and two circles, one at the spin rate, one at
the rate of the free precession. Simulation, with the closed form for small
angles dotted."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace import BodyState, Scene, simulate
from jaxspace.bodies import Load, RigidBody
from jaxspace.rotations import Quaternion
from jaxspace.scene import Custom

jaxspace.enable_x64()
A, C, n, moment = 1.0, 0.3, 6.0, 0.35


def misaligned(t, y, body):
    return Load(torque_B=jnp.array([moment, 0.0, 0.0]))


scene = Scene(
    [Custom(misaligned)],
    RigidBody(inertia=jnp.array([A, A, C])),
)
start = BodyState(
    attitude=Quaternion.identity(), omega=jnp.array([0.0, 0.0, n])
)
t = jnp.linspace(0.0, 7.0, 1201)
run = simulate(scene, start, t, accuracy=1e-10)
x, y, _ = run.states.attitude.rotate(jnp.array([0.0, 0.0, 1.0])[:, None])

free, slow = n * (C - A) / A, n * C / A
# Two circles from the start on, at both rates.
near = (jnp.exp(1j * slow * t) - 1.0) / slow
tip = 1j * moment / (A * free) * (near - (jnp.exp(1j * n * t) - 1.0) / n)
figure, axes = plt.subplots(figsize=(5.4, 4.6))
axes.plot(1e3 * x, 1e3 * y, label="simulated")
axes.plot(1e3 * tip.real, 1e3 * tip.imag, "k:", lw=1.6, label="closed form")
axes.plot(0.0, 0.0, "o", color="C1", ms=5)
axes.set(xlabel="X, mrad", ylabel="Y, mrad", aspect="equal")
axes.legend()
plt.show()
