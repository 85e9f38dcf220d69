"""The dispersion of the kick stage: runs per second, and the error of the same runs against a reference two orders tighter.

Wanted: 1 m in position and 1e-4 rad in attitude at the end, at 1000 runs per second on two cores."""

import dataclasses
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from jaxspace.cli import load
from jaxspace.dispersion import disperse
from jaxspace.simulation import Accuracy, run_mission

FILE = Path(__file__).parents[1] / "examples" / "scenes" / "kick_stage.toml"
RUNS = 8192
COMPARED = 64  # runs flown again for the reference


def end_states(campaign, numbers, seed, rtol):
    """Final position, attitude and spin axis of the runs of these numbers, each with adaptive steps at the tolerance."""
    samples = campaign.samples(jax.random.key(seed), numbers)
    mission, y0 = campaign.build(samples)
    _, end, _, status = run_mission(mission, y0, jnp.zeros(()), 2, Accuracy(rtol=rtol), 1)
    return end.position, end.attitude.wxyz, status


def ends(result_or_final, lanes):
    """The outputs of the error study: where the body is and how it stands."""
    final = result_or_final.final
    return {f"r{k}": final.position[k] for k in range(3)} | {f"q{k}": final.attitude.wxyz[k] for k in range(4)}


def measure():
    """A dictionary of what was seen."""
    file = load(FILE)
    campaign = dataclasses.replace(file.campaign(None), outputs=ends, units={})
    cpu, wall = time.process_time(), time.perf_counter()
    result = disperse(campaign, RUNS, seed=1, accuracy=file.accuracy, chunk=RUNS)
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    ahead = result.attributes["preparation_seconds"]
    numbers = jnp.arange(COMPARED)
    position, attitude, status = jax.jit(lambda n: end_states(campaign, n, 1, 1e-2 * file.accuracy))(numbers)
    found_r = np.stack([result.outputs[f"r{k}"][:COMPARED] for k in range(3)])
    found_q = np.stack([result.outputs[f"q{k}"][:COMPARED] for k in range(4)])
    cosine = np.abs(np.sum(found_q * attitude, axis=0)) / np.linalg.norm(found_q, axis=0) / np.linalg.norm(attitude, axis=0)
    chord = np.minimum(np.linalg.norm(found_q - attitude, axis=0), np.linalg.norm(found_q + attitude, axis=0))
    assert np.all(np.asarray(status) == 0) and np.all(cosine > 0.9)
    seen = {
        "runs": RUNS,
        "runs per second": RUNS / (result.seconds - ahead),
        "devices": jax.local_device_count(),
        "utilisation of the cores over all": cpu / wall,
        "seconds to compile and plan": ahead,
        "evaluations per run": float(np.mean(result.evaluations)),
        "runs that ended well": int(np.count_nonzero(result.good)),
        "worst position error, m": float(np.max(np.linalg.norm(found_r - position, axis=0))),
        "worst attitude error, rad": float(2.0 * np.max(chord)),
    }
    return {"dispersion": seen}
