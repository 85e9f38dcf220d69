"""Time in seconds from the call to the result in a new process without a stored compilation cache,
including compilation, for optimisations and first derivatives. CPU time and wall time are listed;
the wall time includes the load of the machine.

Wanted on two cores: a launch in 60 s (goal 20), the transfer in 15, the gradient of four phases
in 5, the gradient of an orbit by RKN 12(10) in 2 and its Hessian in 8. Most of it is the compiler,
whose time goes with the length of its program. Two things keep that short: the stages of a step are
a loop where one run is differentiated, or runs of a large vector field are, and a stage of that
loop is evaluated once more backwards, in place of hundreds of buffers for what it computed. A
mission to be optimised is flown by `simulate_compact`: `simulate_mission`, which chooses its steps,
records them and searches for the ends of the phases, is a program of twice the length. The pad's
phases fly through the standard atmosphere with wind, tables of drag and thrust against its
pressure, those of the ascent through an exponential one.
Narrower vectors and leaving out the expensive passes of LLVM changed nothing."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
REPEATS = 3
HEAD = """
import json, time, jax, jax.numpy as jnp, numpy as np
jax.config.update("jax_enable_x64", True)
from jaxspace import BodyState, Scene, load, simulate, simulate_mission
from jaxspace.orbits import Oblateness, PointGravity
from jaxspace.simulation import Accuracy, simulate_compact
from jaxspace.solvers import RKN1210
jax.block_until_ready(jnp.ones(3) + 1.0)
"""
TAIL = """
wall, cpu = time.perf_counter(), time.process_time()
seen = answer()
print(json.dumps([time.perf_counter() - wall, time.process_time() - cpu, float(seen)]))
"""
ORBIT = """
y0 = BodyState(jnp.array([1.1, 0.0, 0.0]), jnp.array([0.0, 0.8, 0.4]))
scene = Scene((PointGravity(1.0), Oblateness(1.0, 1e-3, 1.0)))
accuracy = Accuracy(rtol=1e-9, method=RKN1210())
def end(x):
    y = BodyState(x[:3], x[3:])
    return simulate(scene, y, jnp.array([0.0, 7.0]), accuracy=accuracy).final.position[0]
x = jnp.concatenate([y0.position, y0.velocity])
"""
PAD = """
import equinox as eqx
file = load("examples/scenes/pad_to_orbit.toml")
mission, y0 = file.mission, file.y0
mass = lambda y: y.mass
def apoapsis(m):
    flight = simulate_compact(mission, eqx.tree_at(mass, y0, m), steps=40)
    return jnp.linalg.norm(flight.final.position)
"""
ASCENT = """
import equinox as eqx
from jaxspace import Mission, Phase
from benchmarks import ascent
rise, first, second = ascent.mission(np.array([1.0, 1.0, 1.0, np.deg2rad(0.7), 1.0])).phases
# Between the stages gravity and drag alone.
coast = Phase(Scene(rise.system.effects[:2], carry=("mass",)), 6.0, name="coast")
mission = Mission([rise, first, coast, second])
start = [ascent.RADIUS, 0.0, 0.0], [0.0, ascent.SPIN * ascent.RADIUS, 0.0]
y0 = BodyState(*map(jnp.array, start), mass=jnp.array(ascent.LIFT_OFF_MASS))
def distance(m):
    flight = simulate_mission(mission, eqx.tree_at(lambda y: y.mass, y0, m))
    return jnp.linalg.norm(flight.final.position)
"""
FLIGHT = """
import equinox as eqx
file = load("examples/scenes/pad_to_orbit.toml")
first, y0 = file.mission.phases[0].system, file.y0
def height(m):
    y = eqx.tree_at(lambda y: y.mass, y0, m)
    return simulate(first, y, jnp.array([0.0, 100.0])).final.position[0]
"""
FLIGHTS = (
    FLIGHT
    + """
from jaxspace import simulate_batch
masses = y0.mass * (1.0 + 1e-3 * jnp.linspace(-1.0, 1.0, 64))
def heights(m):
    y = jax.tree.map(lambda x: jnp.broadcast_to(x[..., None], (*x.shape, 64)), y0)
    y = eqx.tree_at(lambda y: y.mass, y, m)
    return jnp.sum(simulate_batch(first, y, jnp.array([0.0, 100.0])).final.position[0])
"""
)
# A model rocket from its rail to its apogee: two phases that end at events.
APOGEE = """
import dataclasses, sys
import equinox as eqx
sys.path.insert(0, "examples/model_rockets")
from rockets import ROCKETS, site, vehicle
from jaxspace import Mission
from jaxspace.vehicles import sounding_flight
mission, y0 = sounding_flight(vehicle(ROCKETS["Calisto"]), site(ROCKETS["Calisto"]))
mission = Mission(mission.phases[:2])
def apogee(share):
    def pushed(effect):
        if type(effect).__name__ != "Thrust":
            return effect
        more = {name: share * getattr(effect, name) for name in ("mean_thrust", "exhaust_velocity")}
        return dataclasses.replace(effect, **more)
    def stronger(phase):
        effects = tuple(map(pushed, phase.system.effects))
        return eqx.tree_at(lambda p: p.system.effects, phase, effects)
    flight = simulate_mission(Mission(tuple(map(stronger, mission.phases))), y0)
    return flight.final.position[2]
"""
# A problem of the examples.
KNOWN = """
import sys
sys.path.insert(0, "examples/known_optima")
from {} import optimum, search
answer = lambda: optimum(search())
"""
# Each gives a function `answer` and returns a number of the result.
ANSWERS = {
    "launch to orbit from its file": """
file = load("examples/scenes/launch.toml")
answer = lambda: file.optimize().objective
""",
    "ascent of a Delta III, 37 unknowns in four phases": KNOWN.format("delta_iii"),
    "two-burn transfer to the geostationary ring": KNOWN.format("transfer"),
    "gradient of four phases from the pad, compact": PAD
    + "answer = lambda: jax.jit(jax.grad(apoapsis))(y0.mass)\n",
    "gradient of four phases from the pad, adaptive steps": PAD.replace(
        "simulate_compact(mission, eqx.tree_at(mass, y0, m), steps=40)",
        "simulate_mission(mission, eqx.tree_at(mass, y0, m))",
    )
    + "answer = lambda: jax.jit(jax.grad(apoapsis))(y0.mass)\n",
    "gradient of four phases of an ascent, adaptive steps": ASCENT
    + "answer = lambda: jax.jit(jax.grad(distance))(y0.mass)\n",
    "gradient of a flight through the standard atmosphere": FLIGHT
    + "answer = lambda: jax.jit(jax.grad(height))(y0.mass)\n",
    "gradient of 64 flights through the standard atmosphere": FLIGHTS
    + "answer = lambda: jax.jit(jax.grad(heights))(masses)[0]\n",
    "gradient of the apogee of a model rocket": APOGEE
    + "answer = lambda: jax.jit(jax.grad(apogee))(1.0)\n",
    "gradient of an orbit, RKN 12(10)": ORBIT + "answer = lambda: jax.jit(jax.grad(end))(x)[0]\n",
    "Hessian of an orbit, RKN 12(10)": ORBIT
    + "answer = lambda: jax.jit(jax.hessian(end))(x)[0, 0]\n",
}


def _seconds(code: str) -> list[float]:
    bare = {k: v for k, v in os.environ.items() if not k.startswith("JAX_")}
    done = subprocess.run(
        [sys.executable, "-c", HEAD + code + TAIL],
        env=bare,
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout.splitlines()[-1])


def measure() -> dict:
    """Medians of new processes."""
    rows = {}
    for name, code in ANSWERS.items():
        wall, cpu, number = np.median([_seconds(code) for _ in range(REPEATS)], axis=0)
        rows[name] = {"seconds": wall, "cpu_seconds": cpu, "answer": number}
    return rows
