"""The ascent of two liquid stages by their gimbals, in six degrees of freedom: it follows its laws,
keeps its limits, and ends in a circular orbit."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxspace import BodyState, Mission, Phase, Scene, load
from jaxspace.bodies import RigidBody
from jaxspace.core.vectors import dot, norm
from jaxspace.rockets import Gimbal, GimballedThrust
from jaxspace.rockets.steering import PitchPolynomial
from jaxspace.rotations import Quaternion
from jaxspace.simulation import simulate_compact

FILE = Path(__file__).resolve().parents[2] / "examples" / "scenes" / "gimballed_ascent.toml"
LIMIT = np.radians(2.0)


def axis_of(y):
    """The axis of the body in inertial axes."""
    up = jnp.array([0.0, 0.0, 1.0])
    return y.attitude.rotate(up.reshape(3, *(1,) * (y.position.ndim - 1)) + 0.0 * y.position)


def test_the_file_holds_what_flies():
    file = load(FILE)
    names = {leg.name: leg.body for leg in file.parsed.legs}
    # From the coast on it is the second stage that turns.
    bodies = {"first stage": "body", "coast": "phase.1.body", "second stage": "phase.1.body"}
    assert names == bodies
    assert file.values["phase"][1]["body"]["dry_mass"] == 430.0
    assert [d.spec.take for d in file.task.demands] == ["", "", "greatest", "greatest"]
    assert file.task.demands[3].spec.phases == (0,)


def test_the_axis_follows_a_law_of_constant_rate_late_by_damping_over_gain():
    """theta'' A/(F l) + c theta' + k (theta - law) = 0: behind a ramp the axis stays by c/k times
    its rate."""
    rate, gain, damping = -0.02, 0.4, 0.6
    law = PitchPolynomial([1.2, rate])
    thrust, lever, inertia = 2e4, 2.0, 4e3
    motor = GimballedThrust(Gimbal(law, gain, damping), thrust, 1e9, 60.0, -lever)
    scene = Scene([motor], RigidBody(None, [inertia, inertia, 500.0]), carry=("mass",))
    far = jnp.array([0.0, 0.0, 1e9])
    start = Quaternion.from_rotation_vector(jnp.array([0.0, 0.5 * jnp.pi - 1.2, 0.0]))
    y0 = BodyState(far, jnp.zeros(3), start, jnp.zeros(3), jnp.array(1000.0))
    mission = Mission([Phase(scene, 25.0)])
    (phase,) = jax.jit(lambda y: simulate_compact(mission, y, steps=100))(y0).phases
    y, ts = phase.states, phase.ts
    pitch = jnp.arcsin(dot(axis_of(y), y.position) / norm(y.position))
    # The nozzle is limited smoothly, by which a small command loses its cube.
    late = (pitch - (1.2 + rate * ts))[80:]
    assert_allclose(late, -rate * damping / gain, rtol=1e-3)


@pytest.mark.sweep
def test_the_launcher_meets_its_laws_its_limits_and_its_orbit():
    """By adaptive steps, and by the formulas of its pressure and of what it feels written out."""
    file = load(FILE)
    run = file.nominal_mission(samples=200)
    for name in ("first stage", "second stage"):
        phase = run[name]
        law = phase.system.effects[-1].gimbal.steering
        y = phase.states
        away = jnp.arcsin(norm(axis_of(y) - law.direction(phase.ts, y)))
        assert jnp.max(away) < LIMIT, name
    phase = run["first stage"]
    y = phase.states
    height = np.linalg.norm(y.position, axis=0) - 6378137.0
    wind = 7.2921159e-5 * np.stack([-y.position[1], y.position[0], 0.0 * height])
    speed = np.linalg.norm(y.velocity - wind, axis=0)
    pressure = 0.5 * 1.225 * np.exp(-height / 7200.0) * speed**2
    assert 29.6e3 < pressure.max() < 29.7e3
    felt = jax.vmap(phase.system.proper_acceleration, (0, -1), -1)(phase.ts, y)
    # At the end of the burn thrust alone acts, the air being thin.
    end = 0.883234 * 190e3 / 3494.0
    assert_allclose(np.linalg.norm(felt, axis=0).max(), end, rtol=2e-3)
    r, v = run.final.position, run.final.velocity
    # A circle at 300 km, as the six digits of the file have it.
    assert_allclose(norm(r), 6678137.0, atol=200.0)
    assert abs(dot(r, v) / norm(r)) < 2.0
    assert_allclose(norm(v), np.sqrt(3.986004418e14 / 6678137.0), atol=0.3)
    assert_allclose(run.final.mass, 470.944, atol=0.05)
