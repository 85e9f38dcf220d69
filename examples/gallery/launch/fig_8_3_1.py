r"""Steering for maximum velocity at a given height
Linear-tangent steering

The ascent with the maximum velocity at the apex (8.3): 3 g for 160 s from 900
m/s, to 183 km. Left: the burn, the coast, and the thrust direction. Right:
the loss of other steering laws, $\phi + \epsilon\sin(k\pi t/t_b)$ with the
release angle adjusted to reach the height: the optimum is flat."""

import jax.numpy as jnp
import matplotlib.pyplot as plt
from scipy.optimize import brentq

import jaxspace
from jaxspace.optimization.ascent import (
    Ascent,
    ConstantThrustAcceleration,
    apex,
    burnout_state,
)
from jaxspace.optimization.steering import linear_tangent_steering

jaxspace.enable_x64()
tb, Y, g = 160.0, 182880.0, 9.81456
ascent = Ascent(ConstantThrustAcceleration(3 * g), tb, 914.4, 0.0, Y, g)
best = linear_tangent_steering(ascent)
path = []
for t in jnp.linspace(0.5, tb, 60):
    part = Ascent(ascent.thrust, t, 914.4, 0.0, Y, g)
    path.append(burnout_state(part, best.initial_angle, best.angle))
x, y = (jnp.stack([getattr(s, n) for s in path]) / 1e3 for n in "xy")
end = path[-1]
coast = jnp.linspace(0.0, end.w / g, 60)

figure, (left, right) = plt.subplots(1, 2, figsize=(8.4, 3.6))
left.plot(x, y, label="burn")
fall = end.y + end.w * coast - 0.5 * g * coast**2
left.plot((end.x + end.u * coast) / 1e3, fall / 1e3, "C0--", label="coast")
at = jnp.arange(4, 60, 9)
phi = best.angle(jnp.linspace(0.5, tb, 60)[at])
left.quiver(x[at], y[at], jnp.cos(phi), jnp.sin(phi), color="C1", width=5e-3)
left.set(xlabel="range, km", ylabel="height, km")
left.legend()


def loss(eps, k):
    def steering(t):
        return best.angle(t) + eps * jnp.sin(k * jnp.pi * t / tb)

    def miss(angle):
        return (
            float(apex(ascent, burnout_state(ascent, angle, steering))[1]) - Y
        )

    angle = brentq(miss, 0.2, 1.2)
    return best.final_velocity - burnout_state(ascent, angle, steering).u


eps = jnp.linspace(-0.1, 0.1, 25)
for k in (1, 2, 3):
    right.plot(eps, [loss(float(e), k) for e in eps], label=f"k = {k}")
right.set_xticks([-0.1, -0.05, 0.0, 0.05, 0.1])
right.set(xlabel="eps, rad", ylabel="velocity loss, m/s")
right.legend()
plt.show()
