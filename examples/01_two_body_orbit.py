"""A satellite on an eccentric orbit: simulation, error estimates, and the derivative with respect
to a burn."""

import jax
import jax.numpy as jnp

import jaxspace
from jaxspace import Accuracy, BodyState, simulate
from jaxspace.constants import MU_EARTH, RADIUS_EARTH
from jaxspace.orbits import ClassicalElements, TwoBody
from jaxspace.orbits.elements import apoapsis_radius, state_from_elements
from jaxspace.solvers import DOP853

jaxspace.enable_x64()

# The fields of a system are its physical parameters. The state has named parts.
earth = TwoBody(MU_EARTH)
elements = ClassicalElements.from_periapsis(
    RADIUS_EARTH + 500e3, eccentricity=0.7, inclination=jnp.radians(63.4)
)
y0 = BodyState(*state_from_elements(elements, MU_EARTH))
period = 2.0 * jnp.pi * jnp.sqrt((elements.semi_latus_rectum / (1.0 - 0.7**2)) ** 3 / MU_EARTH)
ts = jnp.linspace(0.0, 5.0 * period, 101)

# Two-body motion has a closed form, which `simulate` evaluates.
exact = simulate(earth, y0, ts)
closing = jnp.linalg.norm(exact.final.position - y0.position)
print(f"closed form: after five revolutions the orbit closes to {closing:.1e} m")
assert closing < 1e-5

# Specifying a method requests an integration. The closed form then provides the true error,
# which the trajectory estimates independently: from the drift of conserved quantities, and from
# a repetition with a tighter tolerance.
print("\n      rtol  evaluations   true error  its estimate  energy drift")
for rtol in (1e-6, 1e-8, 1e-10, 1e-12):
    run = simulate(earth, y0, ts, accuracy=Accuracy(rtol=rtol, method=DOP853()))
    error = jnp.linalg.norm(run.final.position - exact.final.position)
    estimate = jnp.linalg.norm(run.error().position)
    drift = jnp.max(run.drift()["energy"])
    print(
        f"{rtol:10.0e}  {run.stats['evaluations']:11d}  {error:9.2e} m  {estimate:10.2e} m"
        f"  {drift:12.1e}"
    )
assert error < 0.1 and 0.2 < estimate / error < 5.0

# A burn at periapsis, a coast of two hours, and the resulting apogee. Its derivative passes
# through the whole run.
forwards = y0.velocity / jnp.linalg.norm(y0.velocity)


def apogee(burn, accuracy):
    """Radius of the apogee, m, after a burn of `burn`, m/s, along the velocity."""
    kicked = BodyState(y0.position, y0.velocity + burn * forwards)
    end = simulate(earth, kicked, jnp.array([0.0, 7200.0]), accuracy=accuracy).final
    return apoapsis_radius(end.position, end.velocity, MU_EARTH)


by_flow = jax.grad(apogee)(10.0, 1e-9)
by_integration = jax.grad(apogee)(10.0, Accuracy(rtol=1e-12, method=DOP853()))
# From the energy integral: r_a = 2 a - r_p, and d(2a)/dv = 4 a^2 v / mu.
speed = jnp.linalg.norm(y0.velocity) + 10.0
semi_major_axis = 1.0 / (2.0 / jnp.linalg.norm(y0.position) - speed**2 / MU_EARTH)
by_hand = 4.0 * semi_major_axis**2 * speed / MU_EARTH
print(
    f"\napogee by burn, m/(m/s): {by_flow:.6f} closed form, {by_integration:.6f} integrated,"
    f" {by_hand:.6f} by hand"
)
assert abs(by_flow / by_hand - 1.0) < 1e-9 and abs(by_integration / by_hand - 1.0) < 1e-8
