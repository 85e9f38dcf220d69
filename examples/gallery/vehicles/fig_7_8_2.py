"""Jet damping of a nonspinning rocket
Fig. 7.8-2: jet damping of a rocket without spin

The ratio of the angular velocity to that at ignition against the remaining
mass, for nozzles at $l/k$ radii of gyration behind the centre of mass. Lines:
closed form. Dots: simulation for $l/k$ of 1.5. A nozzle close to the centre
of mass accelerates the rotation."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace import BodyState, Scene, simulate
from jaxspace.bodies import BurningBody
from jaxspace.rockets import JetDamping, Thrust
from jaxspace.rockets.jet_damping import jet_damping_ratio
from jaxspace.rotations import Quaternion

jaxspace.enable_x64()
xi = jnp.linspace(1.0, 0.1, 181)
figure, axes = plt.subplots(figsize=(5.6, 4.2))
for lever in (0.9, 1.0, 1.25, 1.5, 2.0, 3.0):  # l / k
    axes.plot(xi, jet_damping_ratio(xi, lever), label=f"{lever:g}")

# Dry and loaded parts with one radius of gyration k about one centre.
k, dry, loaded, burn = 1.5, 100.0, 1000.0, 90.0
motor = Thrust(1e4, 1000.0, burn)
stage = BurningBody(dry, [dry * k**2] * 3, [k, k, k])
start = BodyState(
    attitude=Quaternion.identity(),
    omega=jnp.array([0.05, 0.0, 0.0]),
    mass=jnp.array(loaded),
)
damping = JetDamping(lambda t, m: -10.0 + 0.0 * m, -1.5 * k)
burning = Scene([motor, damping], stage)
at_rest = BodyState(
    jnp.zeros(3), jnp.zeros(3), start.attitude, start.omega, start.mass
)
y = simulate(burning, at_rest, jnp.linspace(0.0, burn, 13)).states
axes.plot(y.mass / loaded, y.omega[0] / 0.05, "k.", ms=5)
axes.set(xlabel="mass / initial mass", xlim=(1.0, 0.1), ylim=(0.0, 1.3))
axes.set(ylabel="rate / initial rate")
axes.legend(title="l / k")
plt.show()
