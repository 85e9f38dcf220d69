"""A program as a user writes it, for type checkers: `test_types_for_users` has it checked in their
strict modes. Its annotations say what the interface promises."""

import jax
import jax.numpy as jnp
from jax import Array

import jaxspace
from jaxspace import Accuracy, BodyState, Event, Mission, Phase, Scene, simulate, simulate_batch
from jaxspace.attitude import Top
from jaxspace.core.vectors import dot
from jaxspace.dispersion import Campaign, Normal
from jaxspace.orbits import Oblateness, PointGravity, TwoBody
from jaxspace.simulation import MissionTrajectory, Trajectory, simulate_mission

jaxspace.enable_x64()
version: str = jaxspace.__version__

top = Top(transverse_inertia=1e-3, axial_inertia=6e-4, weight_moment=0.08)
y0 = top.state(angles=[0.0, 0.6, 0.0], rates=[0.0, 0.0, 60.0])
ts = jnp.linspace(0.0, 2.0, 21)
run: Trajectory = simulate(top, y0, ts, accuracy=1e-10)
precession, nutation, spin = top.angles(run.states)
drift: dict[str, Array] = run.drift()

position = jnp.array([7e6, 0.0, 0.0])
velocity = jnp.array([0.0, 8.5e3, 0.0])
start = BodyState(position=position, velocity=velocity)


def height_rate(t: Array, y: BodyState) -> Array:
    return jnp.asarray(dot(y.position, y.velocity))


apogee = Event(height_rate, direction=-1, within=jnp.asarray(2e4))
coast = Scene((PointGravity(3.986e14), Oblateness(3.986e14, 1.08e-3, 6.378e6)))
orbit: Trajectory = simulate(coast, start, jnp.array([0.0, 2e4]), events=(apogee,))
end: float = float(orbit.ts[-1])
kepler = TwoBody(jnp.full(4, 3.986e14))
many: Trajectory = simulate_batch(kepler, start, jnp.linspace(0.0, 100.0, 3))

# Of arrays and tuples, because mypy does not know that fields convert lists and numbers.
wait = Phase(coast, jnp.asarray(100.0), name="wait")
mission = Mission((wait, Phase(coast, apogee, name="climb")))
flight: MissionTrajectory = simulate_mission(mission, start)
status: Array = flight.status


def build(samples: dict[str, Array]) -> tuple[Mission, BodyState]:
    return mission, start


def outputs(result: MissionTrajectory, samples: dict[str, Array]) -> dict[str, Array]:
    return {"speed": result.final.velocity[0]}


campaign = Campaign(build, {"speed": Normal(8.5e3, 10.0)}, outputs, {"speed": "m/s"})


def final_nutation(rate: float) -> Array:
    y = top.state([0.0, 0.6, 0.0], [0.0, 0.0, rate])
    return top.angles(simulate(top, y, ts, accuracy=Accuracy(1e-9)).final)[1]


slope: Array = jax.grad(final_nutation)(60.0)
