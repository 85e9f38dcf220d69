"""The Monte Carlo campaign of the kick stage: runs per second, and the error of the same runs
compared with a reference at a tolerance two orders of magnitude tighter. The row of RocketPy is
only indicative, because the task differs: a sounding rocket in air up to its apogee, with six
degrees of freedom, one run at a time.

Wanted: 1 m in position and 1e-4 rad in attitude at the end, at 1000 runs per second on two cores.
"""

import dataclasses
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from jaxspace import Accuracy, load, simulate_mission_batch
from jaxspace.dispersion import disperse

from ._measure import optional

FILE = Path(__file__).parents[1] / "examples" / "scenes" / "kick_stage.toml"
RUNS = 8192
PLANNED = 2**15  # so many that their stages are written out (`rolls_stages`)
COMPARED = 64  # runs repeated for the reference
SOUNDINGS = 5


def end_states(campaign, numbers, seed, rtol):
    """Final position, attitude and spin axis of the runs of these numbers, each with adaptive steps
    at the tolerance."""
    samples = campaign.samples(jax.random.key(seed), numbers)
    mission, y0 = campaign.build(samples)
    run = simulate_mission_batch(mission, y0, 0.0, accuracy=Accuracy(rtol=rtol))
    return run.final.position, run.final.attitude.wxyz, run.status


def ends(result, samples):
    """The outputs of the error study: where the body is and how it stands."""
    del samples
    final = result.final
    return {f"r{k}": final.position[k] for k in range(3)} | {
        f"q{k}": final.attitude.wxyz[k] for k in range(4)
    }


def sounding_flight(rocketpy, inclination):
    """A flight of RocketPy's own example, simplified: its rocket with a motor of constant thrust in
    a standard atmosphere."""
    air = rocketpy.Environment(latitude=32.99, longitude=-106.97, elevation=1400)
    air.set_atmospheric_model(type="standard_atmosphere")
    grain = {
        "grain_number": 5,
        "grain_density": 1815,
        "grain_outer_radius": 0.033,
        "grain_initial_inner_radius": 0.015,
    }
    grain |= {
        "grain_initial_height": 0.12,
        "grain_separation": 0.005,
        "grains_center_of_mass_position": 0.397,
    }
    nozzle = {
        "nozzle_radius": 0.033,
        "throat_radius": 0.011,
        "coordinate_system_orientation": "nozzle_to_combustion_chamber",
    }
    case = {
        "dry_mass": 1.815,
        "dry_inertia": (0.125, 0.125, 0.002),
        "center_of_dry_mass_position": 0.317,
    }
    motor = rocketpy.SolidMotor(thrust_source=1800.0, burn_time=3.9, **grain, **nozzle, **case)
    mass = {"mass": 14.426, "inertia": (6.321, 6.321, 0.034), "center_of_mass_without_motor": 0}
    drag = {
        "radius": 0.0635,
        "power_off_drag": 0.5,
        "power_on_drag": 0.5,
        "coordinate_system_orientation": "tail_to_nose",
    }
    rocket = rocketpy.Rocket(**mass, **drag)
    rocket.add_motor(motor, position=-1.255)
    rocket.add_nose(length=0.55829, kind="von karman", position=1.278)
    rocket.add_trapezoidal_fins(
        n=4, root_chord=0.12, tip_chord=0.06, span=0.11, position=-1.04956, cant_angle=0.5
    )
    return rocketpy.Flight(
        rocket, air, rail_length=5.2, inclination=inclination, heading=0, terminate_on_apogee=True
    )


def soundings():
    """How many such flights a second, each built and simulated; nothing without RocketPy."""
    rocketpy, seconds = optional("rocketpy"), []
    for k in range(SOUNDINGS + 1 if rocketpy else 0):
        start = time.perf_counter()
        sounding_flight(rocketpy, 85.0 + 0.3 * k)
        seconds.append(time.perf_counter() - start)
    row = {"runs": SOUNDINGS, "runs per second": float(1.0 / np.median(seconds[1:])), "devices": 1}
    return {"RocketPy, another flight": row} if seconds else {}


def measure():
    """A dictionary of what was seen."""
    file = load(FILE)
    campaign = dataclasses.replace(file.campaign(), outputs=ends, units={})
    cpu, wall = time.process_time(), time.perf_counter()
    result = disperse(campaign, PLANNED, seed=1, accuracy=file.accuracy, chunk=RUNS)
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    ahead = result.attributes["preparation_seconds"]
    numbers = jnp.arange(COMPARED)
    tight = 1e-2 * float(file.accuracy.rtol)
    position, attitude, status = jax.jit(lambda n: end_states(campaign, n, 1, tight))(numbers)
    found_r = np.stack([result.outputs[f"r{k}"][:COMPARED] for k in range(3)])
    found_q = np.stack([result.outputs[f"q{k}"][:COMPARED] for k in range(4)])
    cosine = (
        np.abs(np.sum(found_q * attitude, axis=0))
        / np.linalg.norm(found_q, axis=0)
        / np.linalg.norm(attitude, axis=0)
    )
    chord = np.minimum(
        np.linalg.norm(found_q - attitude, axis=0), np.linalg.norm(found_q + attitude, axis=0)
    )
    assert np.all(np.asarray(status) == 0) and np.all(cosine > 0.9)
    seen = {
        "runs": PLANNED,
        "runs per second": PLANNED / (result.seconds - ahead),
        "devices": jax.local_device_count(),
        "utilisation of the cores over all": cpu / wall,
        "seconds to compile and start": ahead,
        "evaluations per run": float(np.mean(result.evaluations)),
        "runs that ended well": int(np.count_nonzero(result.good)),
        "worst position error, m": float(np.max(np.linalg.norm(found_r - position, axis=0))),
        "worst attitude error, rad": float(2.0 * np.max(chord)),
    }
    return {"dispersion": seen} | soundings()
