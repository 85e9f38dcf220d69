"""Wobble of a thrown plate
Wobble of the thrown disk

A thin plate has $C = 2A$: thrown with a small tilt, its axis wobbles twice
for every turn of the mark on its rim, as Feynman observed in the
cafeteria."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace import BodyState, simulate
from jaxspace.attitude import TorqueFreeBody
from jaxspace.attitude.torque_free import coning_omega, precession_rate
from jaxspace.rotations import Quaternion

jaxspace.enable_x64()
tilt, wobble = jnp.radians(8.0), 4.0 * jnp.pi  # two wobbles a second
omega = coning_omega(tilt, wobble, 1.0, 2.0)
# So that the momentum points up.
start = BodyState(attitude=Quaternion.about(0, tilt), omega=omega)
t = jnp.linspace(0.0, 1.0, 401)
y = simulate(TorqueFreeBody(jnp.array([1.0, 1.0, 2.0])), start, t).states
axis = y.attitude.rotate(jnp.array([0.0, 0.0, 1.0])[:, None])
mark = y.attitude.rotate(jnp.array([1.0, 0.0, 0.0])[:, None])
wobbled = jnp.unwrap(jnp.arctan2(axis[1], axis[0])) / (2.0 * jnp.pi)
turned = jnp.unwrap(jnp.arctan2(mark[1], mark[0])) / (2.0 * jnp.pi)

figure, (left, right) = plt.subplots(1, 2, figsize=(8.4, 3.8))
left.plot(t, wobbled - wobbled[0], label="axis wobble")
left.plot(t, turned - turned[0], label="rotation of the mark")
left.set(xlabel="time, s", ylabel="revolutions")
left.set_title(f"ψ' = {float(precession_rate(omega, 1.0, 2.0)):.2f} rad/s")
left.legend()
right.plot(t, jnp.degrees(jnp.arcsin(mark[2])), color="C2")
right.set(xlabel="time, s", ylabel="elevation of the mark, deg")
plt.show()
