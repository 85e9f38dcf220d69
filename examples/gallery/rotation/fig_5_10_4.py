"""Angular velocity in the invariable plane
Fig. 5.10-4: herpolhode

The path of the angular velocity in the invariable plane, which is
perpendicular to the angular momentum: it oscillates between two circles,
known in closed form, and is closed only in special cases."""

import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.attitude.polhode import Polhode
from jaxspace.bodies import PrincipalInertia
from jaxspace.bodies.principal_frame import free_turn
from jaxspace.core.vectors import cross, norm

jaxspace.enable_x64()
moments = jnp.array([1.0, 2.0, 3.0])
omega = jnp.array([0.35, 0.1, 1.0])
polhode = Polhode.of(moments, omega)
t = jnp.linspace(0.0, 7.0 * polhode.period, 2500)
turn, rate = free_turn(
    t, PrincipalInertia(moments[:, None]), omega[:, None] + 0.0 * t
)
space = turn.rotate(rate)
# Two axes across the momentum, which stays where it is.
up = moments * omega / norm(moments * omega)
east = cross(jnp.array([0.0, 1.0, 0.0]), up)
east = east / norm(east)
x, y = east @ space, cross(up, east) @ space

figure, axes = plt.subplots(figsize=(4.8, 4.6))
circle = jnp.linspace(0.0, 2.0 * jnp.pi, 200)
for radius in polhode.herpolhode_radii:
    axes.plot(
        radius * jnp.cos(circle), radius * jnp.sin(circle), "--", color="0.6"
    )
axes.plot(x, y, lw=1.0)
axes.plot(x[0], y[0], "o", ms=4, color="C1")
axes.set(xlabel="rad/s", ylabel="rad/s", aspect="equal")
plt.show()
