"""Closed loops as phases of missions, in batches and campaigns, and in scene files."""

from pathlib import Path
from typing import final

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float

import jaxspace
from jaxspace import (
    BodyState,
    Event,
    Mission,
    Phase,
    Scene,
    Status,
    simulate_mission,
    simulate_mission_batch,
)
from jaxspace.bodies import RigidBody
from jaxspace.control import ClosedLoop, CommandedAcceleration, CommandedTorque, Sensor
from jaxspace.control.point_laws import PID
from jaxspace.core import AbstractSystem, InputError, Scalar, quantity
from jaxspace.core.shapes import with_rank
from jaxspace.dispersion import disperse
from jaxspace.io import SceneError
from jaxspace.orbits import UniformGravity
from jaxspace.rockets import Thrust
from jaxspace.rotations import Quaternion

SCENES = Path(__file__).resolve().parents[2] / "examples" / "scenes"
POINT = Scene([CommandedAcceleration()])
FREE = Scene([], RigidBody(), carry=("position", "velocity"))
START = BodyState(jnp.array([1.0, -2.0, 0.5]), jnp.array([0.3, 0.1, -0.2]))
T = 0.4
# Between samples the motion is a polynomial that each step takes exactly: only rounding is left.
ROUNDING = 1e-12


def loop(gain=1.2, **options):
    return ClosedLoop(POINT, PID(gain, 1.5), period=T, **options)


def coasting(y, span):
    return BodyState(y.position + span * y.velocity, y.velocity)


def half(t, y):
    return BodyState(y.position, 0.5 * y.velocity)


def test_a_loop_between_two_coasts():
    """Beside the same loop flown alone; the phase ends at a sample, and the jump follows."""
    mission = Mission(
        [
            Phase(FREE, 1.0, name="before"),
            Phase(loop(), 5 * T, half, "controlled"),
            Phase(FREE, 2.0, name="after"),
        ]
    )
    run = simulate_mission(mission, START, num_saved=6)
    alone = loop().simulate(coasting(START, 1.0), np.linspace(0.0, 5 * T, 6), start=1.0)
    middle = run["controlled"]
    np.testing.assert_allclose(middle.states.position, alone.states.position, atol=ROUNDING)
    np.testing.assert_allclose(middle.control["commands"], alone.commands, atol=ROUNDING)
    # The phase prints as the loop does, and as a row like the others; a step for each sample.
    assert repr(middle).splitlines()[-2:] == repr(alone).splitlines()[-2:]
    row = next(line for line in repr(run).splitlines() if "controlled" in line)
    assert row.split() == "controlled Scene 1 3 FixedSteps 5 COMPLETED".split()
    with pytest.raises(InputError, match="error repeats a run without its controller"):
        middle.error()
    np.testing.assert_allclose(middle.ts, 1.0 + np.linspace(0.0, 5 * T, 6))
    end = coasting(half(0.0, alone.final), 2.0)
    np.testing.assert_allclose(run.final.position, end.position, atol=ROUNDING)
    np.testing.assert_allclose(run.end, 3.0 + 5 * T)
    assert run.status == Status.COMPLETED and int(run.evaluations) > 0


# Until it falls through a height; a landing under a law that only brakes.
fall = Event(lambda t, y: y.position[2], direction=-1, within=8.0)
HEAVY = Scene([UniformGravity(jnp.array([0.0, 0.0, -1.0])), CommandedAcceleration()])


def falling(drag, scene=HEAVY):
    law = jax.tree_util.Partial(lambda k, z: -k * z.velocity, drag)
    return ClosedLoop(scene, law, period=T)


def landing(at):
    """A controlled phase of a traced duration, then one to an event; end, and velocity there."""
    drag, duration = at
    first = ClosedLoop(HEAVY, PID(0.3, drag), period=T, longest=3.0)
    mission = Mission(
        [Phase(first, duration, half, "hold"), Phase(falling(drag), fall, name="fall")]
    )
    y0 = BodyState(jnp.array([0.5, 0.0, 4.0]), jnp.array([0.0, 0.3, 0.0]))
    run = simulate_mission(mission, y0, throw=False, accuracy=1e-8)
    return jnp.stack([run.end, run.final.velocity[1]]), run.status


def test_derivatives_through_the_ends_of_controlled_phases():
    """Of the time of an event and the state there by a gain and by the traced duration before."""
    at, h = jnp.array([0.4, 1.7]), 1e-5
    slope, status = jax.jit(jax.jacrev(landing, has_aux=True))(at)
    assert status == Status.EVENT
    found = jax.jit(landing)
    for k in range(2):
        up, down = (found(at.at[k].add(s * h))[0] for s in (1.0, -1.0))
        # Of second order in the step, and a rounding of 1e-15 over it.
        np.testing.assert_allclose(slope[:, k], (up - down) / (2.0 * h), rtol=1e-6, atol=1e-8)
    # Longer than the longest time that is said to be possible: not flown, and told.
    assert found(at.at[1].set(3.1))[1] == Status.MAX_STEPS


def test_runs_of_a_batch_end_at_their_own_times():
    """Each with a duration of its own, one of them at a sample, beside the runs alone."""
    spans = jnp.array([3.0 * T, 3.3 * T, 1.1])
    starts = jax.tree.map(lambda x: x[:, None] * jnp.linspace(1.0, 2.0, 3), START)
    run = simulate_mission_batch(Mission([Phase(loop(), spans, name="loop")]), starts)
    np.testing.assert_allclose(run.end, spans)
    for k in range(3):
        own = jax.tree.map(lambda x, k=k: x[:, k], starts)
        alone = loop().simulate(own, [0.0, float(spans[k])]).final
        np.testing.assert_allclose(run.final.position[:, k], alone.position, atol=ROUNDING)
    assert run.of(1)["loop"].control["commands"].shape == (3, 2)


def test_breaks_that_all_runs_share_are_ends_of_their_steps():
    """A motor that stops for all at one time, in runs that begin at their own: the speed is that of
    its impulse."""
    motor = Thrust(3.0, 1e9, 1.05)
    guided = ClosedLoop(
        Scene([motor, CommandedTorque()], RigidBody(inertia=[1.0, 1.0, 1.0])),
        lambda y: 0.0 * y.omega,
        period=T,
    )
    coast = Scene(
        [], guided.system.body, carry=("position", "velocity", "attitude", "omega", "mass")
    )
    y0 = BodyState(
        *(jnp.zeros((3, 2)),) * 2,
        Quaternion(jnp.zeros((4, 2)).at[0].set(1.0)),
        jnp.zeros((3, 2)),
        jnp.ones(2),
    )
    waits = jnp.array([0.1, 0.35])
    mission = Mission([Phase(coast, waits, name="wait"), Phase(guided, 5.0 * T, name="burn")])
    run = simulate_mission_batch(mission, y0)
    np.testing.assert_allclose(run.final.velocity[2], 3.0 * (1.05 - waits), rtol=1e-8)


def test_noise_in_a_mission():
    """From the key of the loop; of many runs each needs one of its own."""
    sensors = {"position": Sensor("position", noise=0.1), "velocity": Sensor("velocity")}
    keys = jax.random.split(jax.random.key(5), 3)

    def noisy(key):
        return ClosedLoop(POINT, PID(1.2, 1.5), sensors, period=T, key=key)

    starts = jax.tree.map(lambda x: jnp.repeat(x[:, None], 3, axis=1), START)
    batch = simulate_mission_batch(Mission([Phase(noisy(keys), 2.0)]), starts).final.position
    alone = noisy(keys[1]).simulate(START, [0.0, 2.0]).final.position
    np.testing.assert_allclose(batch[:, 1], alone, atol=ROUNDING)
    assert jnp.abs(batch[:, 0] - batch[:, 1]).max() > 1e-3
    with pytest.raises(InputError, match="a key for each"):
        simulate_mission_batch(Mission([Phase(noisy(keys[0]), 2.0)]), starts)


def test_a_phase_whose_length_is_not_known_says_so():
    def end(span):
        return simulate_mission(Mission([Phase(loop(), span)]), START, throw=False).end

    with pytest.raises(InputError, match="longest"):
        jax.jit(end)(jnp.array(1.0))


TEXT = (SCENES / "powered_landing.toml").read_text()
SCATTER = """
[dispersion]
runs = 40
seed = 3
outputs = ["final.position.0", "final.velocity.2", "final.mass"]

[dispersion.inputs]
"initial.position.0" = { deviation = "20 m" }
"effects.commanded_engine.max_thrust" = { deviation = "50 N" }
"control.law.least_effort_guidance.least_time" = { deviation = "0.1 s" }

[control.sensors.position]
noise = 0.5

[control.sensors.velocity]
noise = 0.02

[control.sensors.mass]
"""


@pytest.mark.sweep  # compiles a whole campaign
def test_a_campaign_of_a_controlled_scene(tmp_path):
    """A run of it is the loop alone with the numbers of that run, its noise among them."""
    path = tmp_path / "landing.toml"
    path.write_text(TEXT + SCATTER)
    file = jaxspace.load(path)
    found = disperse(file.campaign(), runs=40, seed=3, accuracy=file.accuracy)
    assert np.all(found.good) and np.all(found.status == Status.EVENT)
    # Each lands at the target, whose aim the noise of the position spoils by less than its size.
    assert np.std(found.outputs["final.position.0"]) < 0.5
    assert 60.0 < 2000.0 - np.mean(found.outputs["final.mass"]) < 90.0
    inputs = {name: np.asarray(x)[7:9] for name, x in found.inputs.items()}
    assert "control.noise" in inputs
    mission, y0s = file.build({name: jnp.asarray(x) for name, x in inputs.items()})
    again = simulate_mission_batch(mission, y0s, accuracy=file.accuracy)
    np.testing.assert_allclose(
        again.final.velocity[2], found.outputs["final.velocity.2"][7:9], rtol=1e-9
    )
    assert jnp.abs(jnp.diff(again["scene"].control["readings"]["mass"][-1])).max() > 0.0


SYSTEM = """
[system]
name = "cart"
friction = "0.1 s^-1"

[control]
period = "5 s"

[control.law.pid]
proportional = 1e-3
derivative = 0.05

[initial]
position = [100.0, -50.0, 20.0]
velocity = [0.1, 0.0, 0.0]

[times]
end = "600 s"
"""


@final
class Cart(AbstractSystem):
    """A cart with friction under a commanded acceleration."""

    friction: Scalar = quantity("1/s", non_negative=True, doc="share of the speed lost in a second")
    command: Float[Array, "3 *#runs"] = quantity(
        "m/s^2", default=(0.0, 0.0, 0.0), doc="acceleration before the first command"
    )

    def vector_field(self, t: Scalar, y: BodyState) -> BodyState:
        push = with_rank(self.command, y.velocity.ndim - 1)
        return BodyState(position=y.velocity, velocity=push - self.friction * y.velocity)

    def invariants(self, t, y):
        return {}


def test_a_controlled_system_in_a_scene_file(tmp_path):
    """The law of springs and dampers brings it home, as the same loop in Python does."""
    path = tmp_path / "system.toml"
    path.write_text(SYSTEM)
    file = jaxspace.load(path, also=[Cart])
    run = file.simulate()
    loop = ClosedLoop(Cart(0.1), PID(1e-3, 0.05), period=5.0)
    alone = loop.simulate(file.y0, [0.0, 600.0])
    np.testing.assert_allclose(run.final.position, alone.final.position, rtol=1e-9, atol=1e-9)
    assert file.loop is not None and jnp.linalg.norm(run.final.position) < 5.0


MISSION = (
    TEXT.partition("[control]")[0]
    + "[initial]"
    + TEXT.partition("[initial]")[2].partition("[times]")[0]
    + """
[[phase]]
name = "coast"
effects = ["uniform_gravity"]
duration = "2 s"

[[phase]]
name = "landing"
effects = ["uniform_gravity", "commanded_engine"]
until = "touchdown"
within = "60 s"

[phase.control]
period = "0.1 s"

"""
    + "[phase.control.law"
    + TEXT.partition("[control.law")[2].partition("[initial]")[0]
)


def test_a_controlled_phase_in_a_scene_file(tmp_path):
    path = tmp_path / "mission.toml"
    path.write_text(MISSION)
    run = jaxspace.load(path).simulate(num_saved=301)
    assert run.status == Status.EVENT and jnp.abs(run.final.position[2]) < 1e-9
    assert jnp.linalg.norm(run.final.velocity) < 1.0
    commands = run["landing"].control["commands"]
    assert run["coast"].control is None and commands.shape == (3, 301)
    scattered = (
        MISSION
        + """
[dispersion]
outputs = ["final.mass"]
[dispersion.inputs]
"phase.1.within" = { deviation = "1 s" }
"""
    )
    for text, words in (
        (scattered, "cannot be dispersed"),
        (MISSION.replace("period", 'until = "touchdown"\nperiod'), "phase.1.control.until"),
    ):
        path.write_text(text)
        with pytest.raises(SceneError, match=words):
            jaxspace.load(path)


@pytest.mark.parametrize(
    ("ts", "refused"),
    [
        ([0.0, 9e18], "which is 2.25e\\+19 periods"),
        ([0.0, 4e11], "which is 1e\\+12 periods"),
        # Numbers of this size are 128 s apart.
        ([1e18, 1e18 + 1280.0], "use a time origin close"),
        ([0.0, np.inf], "two finite times"),
    ],
)
def test_loops_of_too_many_samples_are_refused(ts, refused):
    with pytest.raises(InputError, match=refused):
        loop().simulate(START, np.array(ts))


@pytest.mark.parametrize("t0", [np.inf, np.nan])
def test_missions_that_start_at_no_time_are_refused(t0):
    mission = Mission([Phase(Scene([UniformGravity([0.0, 0.0, -9.8])]), 1.0)])
    with pytest.raises(InputError, match="t0 is .*: it must be finite"):
        simulate_mission(mission, START, t0)
    starts = jax.tree.map(lambda x: jnp.stack([x, x], axis=-1), START)
    with pytest.raises(InputError, match="t0 is .*: it must be finite"):
        simulate_mission_batch(mission, starts, np.array([0.0, t0]))
