"""A kick stage: burn, coast, yo-yo. Reverse mode through the whole mission gives the sensitivity of
the results to the inputs."""

import jax
import jax.numpy as jnp

import jaxspace
from jaxspace import Accuracy, BodyState, Mission, Phase, Scene, simulate_mission
from jaxspace.attitude import YoYo
from jaxspace.bodies import BurningBody
from jaxspace.constants import MU_EARTH, RADIUS_EARTH
from jaxspace.orbits import PointGravity
from jaxspace.orbits.elements import apoapsis_radius
from jaxspace.rockets import JetDamping, Thrust
from jaxspace.rotations import Quaternion
from jaxspace.solvers import Tsit5

jaxspace.enable_x64()

DRY, PROPELLANT, YO_YO = 1200.0, 1200.0, 4.0  # kg
ACCURACY = Accuracy(rtol=1e-10, method=Tsit5())  # of order 5: a short method compiles quickly


def mission(inputs):
    """A spinning stage that burns, coasts for 20 s and lets its yo-yo go."""
    gravity = PointGravity(MU_EARTH)
    body = BurningBody(
        DRY, [900.0, 900.0, 420.0], gyration_radii=[0.45, 0.45, 0.4], propellant_station=-1.2
    )
    misalignment = jnp.stack([inputs["misalignment"], 0.0 * inputs["misalignment"]])
    motor = Thrust.of_motor(
        3.4e6, inputs["burn_time"], PROPELLANT, point=[0.0, 0.0, -2.0], misalignment=misalignment
    )
    burn = Scene([gravity, motor, JetDamping(motor.mass_rate, exit_station=-2.8)], body)
    coast = Scene([gravity], body, carry=("attitude", "mass"))
    yo_yo = YoYo(axial_inertia=420.0, radius=0.7, mass=YO_YO, cord_length=inputs["cord_length"])
    return Mission(
        [
            Phase(burn, inputs["burn_time"], name="burn"),
            Phase(coast, 20.0, then=yo_yo, name="coast"),
        ]
    )


radius = RADIUS_EARTH + 185e3
start = BodyState(
    position=jnp.array([radius, 0.0, 0.0]),
    velocity=jnp.array([0.0, jnp.sqrt(MU_EARTH / radius), 0.0]),
    attitude=Quaternion.about(
        0, -jnp.pi / 2.0
    ),  # the body's z axis, along which it thrusts, points forwards
    omega=jnp.array([0.0, 0.0, jnp.pi]),  # and it spins about it, 30 turns a minute
    mass=jnp.array(DRY + PROPELLANT),
)


def results(inputs):
    """Apogee height, m, and the spin that is left, rad/s; and three states on the way."""
    flight = simulate_mission(mission(inputs), start, accuracy=ACCURACY)
    end = flight.final
    apogee = apoapsis_radius(end.position, end.velocity, MU_EARTH) - RADIUS_EARTH
    return {"apogee": apogee, "spin": end.omega[2]}, (
        flight["burn"].initial,
        flight["burn"].final,
        end,
    )


@jax.jit
def results_and_derivatives(inputs, result):
    """The results, states on the way, and the derivatives of the weighted `result`: one run
    forwards, one back."""
    value, vjp, flight = jax.vjp(results, inputs, has_aux=True)
    return value, flight, vjp(result)[0]


inputs = {
    "burn_time": jnp.array(84.0),
    "misalignment": jnp.array(1e-3),
    "cord_length": jnp.array(10.0),
}
unit = {
    "apogee": {"apogee": jnp.array(1.0), "spin": jnp.array(0.0)},
    "spin": {"apogee": jnp.array(0.0), "spin": jnp.array(1.0)},
}
value, (at_ignition, at_burnout, end), by_apogee = results_and_derivatives(inputs, unit["apogee"])
derivatives = {"apogee": by_apogee, "spin": results_and_derivatives(inputs, unit["spin"])[2]}
for name, y in (("ignition", at_ignition), ("burnout", at_burnout), ("yo-yo", end)):
    across = jnp.hypot(y.omega[0], y.omega[1])
    print(
        f"after {name:8s}  mass {y.mass:7.1f} kg   spin {y.omega[2]:9.5f} rad/s"
        f"   across it {across:.5f} rad/s"
    )
print(
    f"apogee {value['apogee'] / 1e3:.1f} km\n\nderivative               reverse mode   differences"
)

# The derivatives pass through burnout, whose time is one of the inputs, and through the jump of
# the yo-yo.
for result, least in (("apogee", 1.0), ("spin", 1e-6)):
    for name, step in (("burn_time", 0.01), ("misalignment", 5e-5), ("cord_length", 0.01)):
        above, below = (
            results_and_derivatives(inputs | {name: inputs[name] + s}, unit[result])[0][result]
            for s in (step, -step)
        )
        difference = (above - below) / (2.0 * step)
        print(f"{result:6s} by {name:12s}  {derivatives[result][name]:14.6e}  {difference:12.4e}")
        assert abs(derivatives[result][name] - difference) < 1e-3 * abs(difference) + least
