"""The drag of Tiangong-1 from its two-line elements of early 2018, and its re-entry date.

Mean motions as published (NORAD 37820, 2011-053A; 27 January to 15 February 2018). It re-entered on
2 April 2018 at 00:16 UTC, day 92.01."""

from typing import final

import jax.numpy as jnp
import numpy as np

import jaxspace
from jaxspace import AbstractSystem, Accuracy, Event, simulate
from jaxspace.bodies import AbstractAtmosphere, StandardAtmosphere
from jaxspace.constants import MU_EARTH
from jaxspace.core import Scalar, quantity
from jaxspace.estimation import fit
from jaxspace.orbits.drag import circular_decay_rate
from jaxspace.solvers import Tsit5
from jaxspace.studies import sensitivity

jaxspace.enable_x64()

# Day of 2018, revolutions per day.
ELEMENTS = np.array(
    [[27.60500207, 16.01003387], [46.14148403, 16.04256914], [46.58112813, 16.04338150]]
)
days, revolutions = ELEMENTS.T
DAY, MEAN_RADIUS = 86400.0, 6371e3  # s, m
ACCURACY = Accuracy(1e-9, method=Tsit5(), max_steps=1024)


@final
class Decay(AbstractSystem):
    """A circular orbit that shrinks: a' = -rho sqrt(mu a) / B (King-Hele 4.2); a in km."""

    ballistic_coefficient: Scalar = quantity("kg/m^2", positive=True, doc="B = m / (C_D A)")
    air: AbstractAtmosphere = StandardAtmosphere()

    def vector_field(self, t, y):
        a = 1e3 * y["a"]
        density = self.air.density_at(a - MEAN_RADIUS)
        rate = circular_decay_rate(a, density, self.ballistic_coefficient, MU_EARTH)
        # The event search also samples later times: the values must be finite after re-entry.
        return {"a": jnp.where(a - MEAN_RADIUS > 110e3, 1e-3 * rate, 0.0)}

    def invariants(self, t, y):
        return {}


def orbit_of(revolutions):
    """Semi-major axis, km, of a mean motion in revolutions a day."""
    return 1e-3 * (MU_EARTH / (2.0 * np.pi * revolutions / DAY) ** 2) ** (1.0 / 3.0)


def readings(p):
    """Revolutions a day at the days of the elements."""
    ts = (days - days[0]) * DAY
    run = simulate(Decay(p["B"]), {"a": p["a"]}, ts, accuracy=ACCURACY, throw=False)
    return DAY / (2.0 * jnp.pi) * jnp.sqrt(MU_EARTH / (1e3 * run.states["a"]) ** 3)


guess = {"B": jnp.array(100.0), "a": jnp.asarray(orbit_of(revolutions[0]))}
found = fit(readings, jnp.asarray(revolutions), guess, noise=2e-5)
print(found)

# Decay to 120 km, an hour before re-entry at most; and the influence of the error of B.
down = Event(lambda t, y: y["a"] - 1e-3 * (MEAN_RADIUS + 120e3), direction=-1)
p = found.parameters
run, change = sensitivity(
    Decay(p["B"]), {"a": p["a"]}, np.array([0.0, 200.0 * DAY]),
    wrt=lambda system, y0: (system.ballistic_coefficient, y0), events=(down,), accuracy=ACCURACY,
)  # fmt: skip
end = days[0] + float(run.ts[-1]) / DAY
slope = change.times[:, -1] / DAY
spread = float(jnp.sqrt(slope @ found.covariance @ slope))
print(f"re-entry on day {end:.1f} +- {spread:.1f} by the elements alone; it was day 92.0")
print(f"one percent of drag moves it by {float(slope[0] * p['B']) / 100.0:.2f} days")
# Standard air is for mean solar activity; in the minimum of 2018 re-entry was earlier.
assert found.converged and 92.0 < end < 125.0
