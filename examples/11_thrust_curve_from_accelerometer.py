"""The thrust curve of a black-powder motor, an Estes C6, from an accelerometer on a sled.

The true curve is the published one from a test stand (RASP file Estes_C6.eng). The thrust at its
nodes, the drag coefficient and the bias of the instrument are estimated together."""

from typing import final

import jax
import jax.numpy as jnp
import numpy as np

import jaxspace
from jaxspace import AbstractSystem, Accuracy, simulate
from jaxspace.core import Scalar, Table
from jaxspace.estimation import fit
from jaxspace.solvers import Tsit5

jaxspace.enable_x64()

# s, N
CURVE = np.array(
    """
0 0  0.031 0.946  0.092 4.826  0.139 9.936  0.192 14.09  0.209 11.446  0.231 7.381  0.288 6.151
0.352 5.489  0.489 4.921  0.699 4.446  1.010 4.258  1.219 4.542  1.398 4.164  1.646 4.448
1.85 2.877  1.9 1.23  1.958 0.478  2 0
""".split(),
    float,
).reshape(-1, 2)
nodes, published = CURVE.T
EXHAUST_VELOCITY, MASS, AREA, AIR = 820.0, 0.15, 5e-3, 1.225  # m/s, kg, m^2, kg/m^3
NOISE = 1.0  # m/s^2, of one reading at 200 Hz
ts = np.linspace(0.0, 3.0, 601)


@final
class Sled(AbstractSystem):
    """m v' = F(t) - rho C A v |v| / 2 and m' = -F / c."""

    thrust: Table
    drag: Scalar

    def vector_field(self, t, y):
        F = self.thrust(t)
        air = 0.5 * AIR * AREA * self.drag * y["speed"] * jnp.abs(y["speed"])
        return {"mass": -F / EXHAUST_VELOCITY, "speed": (F - air) / y["mass"]}

    def invariants(self, t, y):
        return {}


def readings(p):
    """What the accelerometer reads, m/s^2. The thrust is zero at both ends of the table."""
    sled = Sled(Table(nodes, jnp.pad(p["thrust"], 1)), p["drag"])
    y0 = {"mass": jnp.array(MASS), "speed": jnp.array(0.0)}
    accuracy = Accuracy(1e-7, method=Tsit5(), max_steps=256)
    run = simulate(sled, y0, ts, accuracy=accuracy, throw=False)
    felt = jax.vmap(sled.vector_field, in_axes=(0, -1), out_axes=-1)(run.ts, run.states)
    return felt["speed"] + p["bias"]


truth = {"thrust": published[1:-1], "drag": 0.6, "bias": 0.4}
data = readings(jax.tree.map(jnp.asarray, truth)) + NOISE * jax.random.normal(
    jax.random.key(6), ts.shape
)
guess = {"thrust": jnp.full(nodes.size - 2, 4.0), "drag": jnp.array(0.5), "bias": jnp.array(0.0)}
found = fit(readings, data, guess, noise=NOISE)
print(found)
impulse = np.trapezoid(np.pad(found.parameters["thrust"], 1), nodes)
print(f"total impulse {impulse:.3f} N s; on the stand {np.trapezoid(published, nodes):.3f} N s")

error = (found.parameters["thrust"] - published[1:-1]) / found.std[2:]
print(
    f"p-value of the residuals {found.p_value:.2f}; largest error {np.abs(error).max():.1f} sigma"
)
assert found.converged and found.observability() == ""
assert np.abs(error).max() < 4.0 and abs(impulse - 9.1) < 0.5
