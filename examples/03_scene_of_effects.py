"""A scene with gravity, the Earth's oblateness and a user-defined drag: the cost and the influence
of each effect."""

from typing import final

import jax.numpy as jnp

import jaxspace
from jaxspace import BodyState, Scene, simulate
from jaxspace.bodies import AbstractEffect, Load
from jaxspace.constants import J2_EARTH, MU_EARTH, RADIUS_EARTH
from jaxspace.core import Scalar, quantity
from jaxspace.core.vectors import norm
from jaxspace.orbits import ClassicalElements, Oblateness, PointGravity
from jaxspace.orbits.elements import elements_from_state, semi_major_axis, state_from_elements
from jaxspace.orbits.oblateness import node_regression_rate

jaxspace.enable_x64()


@final
class AirDrag(AbstractEffect):
    """Drag in an exponential atmosphere at rest, as an acceleration: no mass is needed."""

    ballistic_coefficient: Scalar = quantity("kg/m^2", positive=True, doc="mass over drag area")
    density: Scalar = quantity("kg/m^3", non_negative=True, default=3.7e-12, doc="at 400 km")
    scale_height: Scalar = quantity("m", positive=True, default=60e3, doc="of the atmosphere")

    def load(self, t, y, body):
        height = norm(y.position) - RADIUS_EARTH
        density = self.density * jnp.exp(-(height - 400e3) / self.scale_height)
        factor = -0.5 * density * norm(y.velocity) / self.ballistic_coefficient
        return Load(acceleration_N=factor * y.velocity)


effects = {
    "gravity": PointGravity(MU_EARTH),
    "oblateness": Oblateness(MU_EARTH, J2_EARTH, RADIUS_EARTH),
    "drag": AirDrag(100.0),
}
scene = Scene(list(effects.values()))

# The state contains only the parts that the effects need, without mass and attitude. The table
# lists the compiled operations.
print(scene.explain())

inclination = jnp.radians(51.6)
orbit = ClassicalElements.from_periapsis(
    RADIUS_EARTH + 400e3, eccentricity=0.001, inclination=inclination
)
y0 = BodyState(*state_from_elements(orbit, MU_EARTH))
a = float(semi_major_axis(y0.position, y0.velocity, MU_EARTH))
day = 86400.0
ts = jnp.linspace(0.0, 3.0 * day, 1201)


def node(run):
    """Longitude of the ascending node, rad, at every time."""
    elements = elements_from_state(run.states.position, run.states.velocity, MU_EARTH)
    return jnp.unwrap(elements.node)


# Oblateness makes the node regress: the rate of the node compared with the closed form of first
# order in J2.
run = simulate(scene, y0, ts, accuracy=1e-10)
simulated = jnp.polyfit(ts, node(run), 1)[0]
predicted = -node_regression_rate(a, 0.001, inclination, MU_EARTH, J2_EARTH, RADIUS_EARTH)
print(
    f"\nthe node moves {jnp.degrees(simulated) * day:.4f} deg a day;"
    f" closed form {jnp.degrees(predicted) * day:.4f}"
)
assert abs(simulated / predicted - 1.0) < 0.01

# Omitting one effect shows its influence on the result. Absent effects are not computed.
print("\nwithout     evaluations  the satellite ends up elsewhere by   energy drift")
for name in ("oblateness", "drag"):
    rest = Scene([effect for other, effect in effects.items() if other != name])
    without = simulate(rest, y0, ts, accuracy=1e-10)
    apart = jnp.linalg.norm(without.final.position - run.final.position)
    kept = without.drift()  # the energy is in it only where every effect keeps it
    drift = f"{jnp.max(kept['energy']):.0e}" if "energy" in kept else "drag keeps none"
    print(f"{name:10s}  {without.stats['evaluations']:11d}  {apart / 1e3:24.1f} km  {drift:>15s}")
