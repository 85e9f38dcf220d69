"""Ascent with gimballed engines
Gimballed engines steer a launcher into orbit

Two stages in six degrees of freedom, from a scene file: the nozzles align the
axis with a pitch table, then with a linear tangent law (dashed), into a
circular orbit. Below: the dynamic pressure, and the acceleration of the
payload; the first stage is throttled to 48 m/s^2."""

from pathlib import Path

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt

import jaxspace
from jaxspace.core.vectors import dot, norm

jaxspace.enable_x64()
file = jaxspace.load(Path("examples") / "scenes" / "gimballed_ascent.toml")
run = file.nominal_mission(samples=200)
radius = file.values["planet"]["radius"]


def pitch(direction, y):
    """Angle above the local horizontal, deg."""
    up = y.position / norm(y.position)
    return jnp.degrees(jnp.arcsin(dot(direction, up)))


@jax.jit
def felt(scene, ts, states):
    along = jax.vmap(scene.proper_acceleration, (0, -1), -1)(ts, states)
    return norm(along)


figure, axes = plt.subplots(2, 2, figsize=(8.4, 5.0), sharex=True)
(left, high), (press, feel) = axes
for name, phase in run.items():
    t, y, scene = phase.ts, phase.states, phase.system
    up = jnp.array([0.0, 0.0, 1.0])[:, None]
    axis = y.attitude.rotate(up + 0.0 * y.position)
    left.plot(t, pitch(axis, y), color="C0")
    if name != "coast":
        law = scene.effects[-1].gimbal.steering
        wanted = law.direction(t, y)
        left.plot(t, pitch(wanted, y), "k--", lw=0.8)
        away = jnp.degrees(jnp.arcsin(norm(axis - wanted)))
        print(name, "from its law, deg", away.max(), jnp.median(away))
    high.plot(t, (norm(y.position) - radius) / 1e3, color="C0")
    if name == "first stage":
        press.plot(t, scene.effects[2].dynamic_pressure(y) / 1e3, color="C1")
    feel.plot(t, felt(scene, t, y), color="C1")
r, v = run.final.position, run.final.velocity
print("height, km", (norm(r) - radius) / 1e3, "m/s", dot(r, v) / norm(r))
print("mass, kg", run.final.mass)
left.set(ylabel="pitch, deg")
high.set(ylabel="height, km")
press.set(xlabel="time, s", ylabel="dynamic pressure, kPa")
feel.set(xlabel="time, s", ylabel="proper acceleration, m/s$^2$")
plt.show()
