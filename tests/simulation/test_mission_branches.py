"""Missions that part: each part goes on by itself, against closed forms of throws."""

import functools
from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
import pytest
import xarray
from numpy.testing import assert_allclose

from jaxspace import (
    AbstractSystem,
    BodyState,
    Event,
    Mission,
    Phase,
    Scene,
    Status,
    simulate_mission,
    simulate_mission_batch,
)
from jaxspace.bodies import Detached
from jaxspace.bodies.mass_properties import combined
from jaxspace.bodies.parting import come_apart, spring_speed
from jaxspace.bodies.solids import cylinder
from jaxspace.core import AbstractClosedForm, InputError
from jaxspace.core.vectors import axis, cross
from jaxspace.dispersion import Campaign, Normal, disperse
from jaxspace.orbits import UniformGravity
from jaxspace.orbits.uniform_gravity import touchdown
from jaxspace.rotations import Quaternion
from jaxspace.simulation import Accuracy, simulate_compact
from jaxspace.solvers import Tsit5
from jaxspace.studies import propagate_covariance

G, HEIGHT, COAST, FALL = 9.81, 500.0, 2.0, 3.0
MASSES = (60.0, 30.0, 10.0)  # kg, booster, sustainer, fairing
# A short method compiles quickly, and is exact for throws.
ACCURACY = Accuracy(1e-9, method=Tsit5())
FALLING = Scene([UniformGravity([0.0, 0.0, -G])])


@final
class Thrown(AbstractSystem):
    """`FALLING` in closed form, which compiles in no time."""

    def vector_field(self, t, y):
        return BodyState(y.velocity, 0.0 * y.velocity - G * axis(2, y.velocity[2]))

    def invariants(self, t, y):
        return {}

    def closed_form(self):
        return Throw()


@final
class Throw(AbstractClosedForm):
    def flow(self, duration, y):
        g = -G * axis(2, y.velocity[2])
        position = y.position + duration * y.velocity + 0.5 * duration * duration * g
        return BodyState(position, y.velocity + duration * g)


class Above(eqx.Module):
    """Height above `height`, m."""

    height: float

    def __call__(self, t, y):
        return y.position[2] - self.height


def thrown(speed):
    """A throw upwards, of every run."""
    zero = 0.0 * speed
    return BodyState(jnp.stack([zero, zero, zero]), jnp.stack([1.0 + zero, zero, speed]))


PARTING = Event(Above(HEIGHT), 1, 20.0)


def three_parts(energy, parting=PARTING, fall=FALL, system=FALLING, driven=FALLING, parts=2):
    """Up to the parting, where springs drive a booster off, which falls as one that is `driven`;
    the rest, moved by `system`, coasts and drops a fairing. With one of two `parts`, that is the
    booster."""
    booster, sustainer, fairing = MASSES
    lower, upper = (cylinder(m, 0.1, 1.0) for m in (booster, sustainer + fairing))
    # The centres of the parts are 3 m apart.
    stack = [lower, upper.moved(jnp.array([0.0, 0.0, 3.0]))]
    apart = spring_speed(energy, booster, sustainer + fairing)
    zero = 0.0 * apart
    lower, upper = come_apart(*stack, kicks=[jnp.zeros(3), jnp.stack([zero, zero, apart])])
    shell = Detached(fairing, jnp.zeros(3), jnp.array([0.0, 0.5, 0.0]))
    drops = Mission([Phase(system, 1.0, name="fall")], start=shell, name="fairing")
    coasts = [
        Phase(system, COAST, name="coast", branches=[drops]),
        Phase(system, COAST, name="on"),
    ]
    branches = [
        Mission([Phase(driven, fall, name="fall")], start=lower, name="booster"),
        Mission(coasts, start=upper, name="sustainer"),
    ]
    return Mission([Phase(system, parting, name="ascent", branches=branches[:parts])])


def at_height(speed):
    return (speed - jnp.sqrt(speed**2 - 2.0 * G * HEIGHT)) / G


def by_hand(speed, energy, parting, to_ground=False):
    """Times, s, at which the parts end, and where they are then, m: the booster along x and up, the
    sustainer up, the fairing across and up."""
    booster, others = MASSES[0], MASSES[1] + MASSES[2]
    share = booster / (booster + others)
    height, v = speed * parting - 0.5 * G * parting**2, speed - G * parting
    u = jnp.sqrt(2.0 * energy * (1.0 / booster + 1.0 / others))
    z, w = height - 3.0 * (1.0 - share), v - u * (1.0 - share)
    fall = (w + jnp.sqrt(w * w + 2.0 * G * z)) / G if to_ground else FALL + 0.0 * w
    parting = parting + 0.0 * w
    above, up = height + 3.0 * share, v + u * share
    fairing = COAST + 1.0
    return {
        "end": parting + fall,
        "range": parting + fall,
        "height": z + w * fall - 0.5 * G * fall**2,
        "sustainer end": parting + 2.0 * COAST,
        "sustainer height": above + up * 2.0 * COAST - 2.0 * G * COAST**2,
        "fairing end": parting + fairing,
        "fairing y": 0.5 + 0.0 * parting,
        "fairing z": above + up * fairing - 0.5 * G * fairing**2,
    }


def of_booster(result):
    booster = result["booster"]
    position = booster.final.position
    return {"end": booster.end, "range": position[0], "height": position[2]}


def of_result(result):
    sustainer = result["sustainer"]
    fairing = sustainer["fairing"]
    return {
        **of_booster(result),
        "sustainer end": sustainer.end,
        "sustainer height": sustainer.final.position[2],
        "fairing end": fairing.end,
        "fairing y": fairing.final.position[1],
        "fairing z": fairing.final.position[2],
    }


@functools.cache
def one_run():
    start = thrown(jnp.array(120.0))
    return simulate_mission(three_parts(400.0), start, accuracy=ACCURACY)


def test_names_of_branches_and_of_their_phases_lead_to_the_same():
    run = one_run()
    whole = ("ascent", "booster.fall", "sustainer.coast", "sustainer.on", "sustainer.fairing.fall")
    assert run.names == whole
    assert run.branch_names == ("booster", "sustainer", "sustainer.fairing")
    assert run["booster"]["fall"] is run["booster.fall"] is run.phases[1]
    fairing = run["sustainer"]["fairing"]
    assert fairing["fall"] is run["sustainer.fairing"]["fall"] is run[-1]
    assert fairing.final is run.branches[2].final and len(run["sustainer"]) == 3
    assert fairing.status == Status.COMPLETED
    # What is left of the whole is its state at the parting.
    assert run.without_branches().names == ("ascent",) and run.status == Status.EVENT
    assert_allclose(run.final.position[2], HEIGHT, rtol=1e-9)
    assert repr(run).startswith("Mission of 5 phases") and "sustainer.fairing.fall" in repr(run)
    with pytest.raises(InputError, match="no phase or branch 'boster'.*Did you mean booster"):
        run["boster"]
    with pytest.raises(InputError, match=r"no phase 'down': its phases are fall\."):
        run["booster"]["down"]


@pytest.mark.parametrize("event", [False, pytest.param(True, marks=pytest.mark.sweep)])
def test_parts_end_where_closed_forms_say_and_so_do_their_derivatives(event):
    """Also through the parting, whose time moves with the inputs; of all parts at an event, and of
    the booster, which compiles sooner, at a time."""
    place = {"system": Thrown(), "driven": FALLING if event else Thrown(), "parts": 1 + event}

    def flown(x):
        mission = three_parts(x[1], PARTING if event else 0.04 * x[0], **place)
        run = simulate_mission(mission, thrown(x[0]), accuracy=ACCURACY)
        found = of_result(run) if event else of_booster(run)
        return jnp.stack(list(found.values()))

    def exact(x):
        parting = at_height(x[0]) if event else 0.04 * x[0]
        return jnp.stack(list(by_hand(*x, parting).values()))[: 8 if event else 3]

    # Weights of outputs and inputs: one derivative of each mode shows an error in any of them.
    weights = jnp.array([1.0, 0.7, -0.3, 0.9, 0.2, -0.5, 0.8, 0.1])[: 8 if event else 3]
    change = jnp.array([1.0, 10.0])

    @jax.jit
    def both(x):
        value, tangent = jax.jvp(flown, (x,), (change,))
        _, pull = jax.vjp(flown, x)
        return value, tangent, pull(weights)[0]

    inputs = jnp.array([120.0, 400.0])
    value, tangent, gradient = both(inputs)
    slopes = jax.jacfwd(exact)(inputs)
    # The tolerance of the events is 1e-9 of the time that is searched.
    assert_allclose(value, exact(inputs), rtol=1e-8)
    assert_allclose(tangent, slopes @ change, rtol=1e-7, atol=1e-9)
    assert_allclose(gradient, weights @ slopes, rtol=1e-7)


def test_parts_cost_what_each_costs_alone():
    run = one_run()
    whole = run["ascent"]
    evaluations = [whole.stats["evaluations"]]
    # A branch is a mission that runs by itself, from the state of the whole.
    for branch in three_parts(400.0).phases[0].branches:
        part = simulate_mission(branch, whole.final, whole.ts[-1], accuracy=ACCURACY)
        evaluations.append(part.evaluations)
        assert_allclose(part.end, run[branch.name].end, rtol=1e-12)
    assert int(run.evaluations) == sum(map(int, evaluations))


BATCH = jnp.array([110.0, 120.0, 130.0]), jnp.array([100.0, 400.0, 900.0])


def check_second_failed(runs, exact, why, well):
    """The booster of the second run alone failed, and every other part is where it should be."""
    done = Status.COMPLETED
    assert runs["booster"].status.tolist() == [well, why, well]
    assert runs.status.tolist() == [done, why, done]
    assert runs["sustainer"].status.tolist() == [done] * 3
    found = of_result(runs)
    for name, values in exact.items():
        good = jnp.array([0, 2]) if name in ("end", "range", "height") else slice(None)
        # On the ground the height is zero to the tolerance.
        assert_allclose(found[name][good], values[good], rtol=1e-8, atol=1e-6, err_msg=name)
    assert jnp.isnan(found["height"][1]) and jnp.isfinite(runs.final.position).all()
    assert_allclose(runs.of(2)["sustainer"].end, exact["sustainer end"][2], rtol=1e-8)


def test_a_run_whose_booster_fails_marks_its_own_row():
    speeds, energies = BATCH
    mission = three_parts(energies, 5.0, system=Thrown(), driven=Thrown())

    def kick(mission):
        return mission.phases[0].branches[0].start.kick

    mission = eqx.tree_at(kick, mission, kick(mission).at[2, 1].set(jnp.nan))
    runs = simulate_mission_batch(mission, thrown(speeds), accuracy=ACCURACY)
    exact = by_hand(speeds, energies, 5.0)
    check_second_failed(runs, exact, Status.NOT_FINITE, Status.COMPLETED)


@pytest.mark.sweep
def test_a_booster_that_is_not_down_in_time_marks_its_own_row():
    ground = Event(touchdown, -1, jnp.array([60.0, 1.0, 60.0]))
    speeds, energies = BATCH
    mission = three_parts(energies, 5.0, ground, Thrown())
    runs = simulate_mission_batch(mission, thrown(speeds), accuracy=ACCURACY)
    exact = by_hand(speeds, energies, 5.0, to_ground=True)
    check_second_failed(runs, exact, Status.EVENT_MISSED, Status.EVENT)


# The times of every part are one more program.
@pytest.mark.parametrize("kept", [False, pytest.param(True, marks=pytest.mark.sweep)])
def test_a_campaign_has_outputs_and_states_of_every_branch(kept, tmp_path):
    def build(samples):
        return three_parts(400.0, 5.0, system=Thrown(), driven=Thrown()), thrown(samples["speed"])

    def outputs(result, samples):
        return of_result(result)

    campaign = Campaign(build, {"speed": Normal(120.0, 3.0)}, outputs, accuracy=ACCURACY)
    path = tmp_path / "parts.zarr"
    found = disperse(campaign, 32, **({"store": path, "times": [4.0, 7.0]} if kept else {}))
    assert (found.status == Status.COMPLETED).all()
    exact = by_hand(jnp.asarray(found.inputs["speed"]), 400.0, 5.0)
    for name, values in exact.items():
        assert_allclose(found.outputs[name], values, rtol=1e-12, err_msg=name)
    if not kept:
        return
    with xarray.open_zarr(path) as data:
        # Before the parting there is the whole, and later every part by itself.
        assert data["ascent.time"].values.tolist() == [[4.0]] * 32
        for name in ("booster.fall", "sustainer.coast"):
            assert data[f"{name}.time"].values.tolist() == [[7.0]] * 32
        assert "sustainer.on.time" not in data
        x = data["sustainer.coast.position"].values[:, 0, 0]
        assert_allclose(x, 7.0, rtol=1e-12)


def test_momentum_and_energy_of_the_parts_are_those_of_the_whole():
    """Of a stack that turns and comes apart into three, with springs between two of them."""
    stack = [cylinder(m, 0.2, length).moved(jnp.array([x, 0.0, z])) for m, length, x, z in
             ((40.0, 2.0, 0.0, 0.0), (20.0, 1.5, 0.1, 2.0), (5.0, 0.5, -0.1, 3.2))]  # fmt: skip
    turn = Quaternion.from_rotation_vector(jnp.array([0.3, -0.2, 0.9]))
    y = BodyState(
        *(jnp.array([1.0, -2.0, 3.0]), jnp.array([10.0, 4.0, -7.0])),
        *(turn, jnp.array([0.2, 0.5, 1.1]), jnp.array(65.0)),
    )
    energy = 30.0
    apart = spring_speed(energy, stack[0].mass, stack[1].mass)
    # Along the line of the two centres, or the springs would have a moment.
    along = stack[1].centre - stack[0].centre
    along = along / jnp.linalg.norm(along)
    share = stack[1].mass / (stack[0].mass + stack[1].mass)
    kicks = [-apart * share * along, apart * (1.0 - share) * along, jnp.zeros(3)]

    def totals(states, tensors):
        momentum, spin, work = jnp.zeros(3), jnp.zeros(3), 0.0
        for state, tensor in zip(states, tensors, strict=True):
            own = state.attitude.rotate(tensor @ state.omega)
            momentum += state.mass * state.velocity
            spin += state.mass * cross(state.position, state.velocity) + own
            work += 0.5 * state.mass * state.velocity @ state.velocity
            work += 0.5 * state.omega @ tensor @ state.omega
        return momentum, spin, work

    before = totals([y], [combined(*stack).tensor])
    for springs, more in ((None, 0.0), (kicks, energy)):
        parts = [part(0.0, y) for part in come_apart(*stack, kicks=springs)]
        after = totals(parts, [part.tensor for part in stack])
        # Sums of a dozen numbers of up to a thousand.
        assert_allclose(after[0], before[0], rtol=1e-13, atol=1e-11)
        assert_allclose(after[1], before[1], rtol=1e-12, atol=1e-11)
        assert_allclose(after[2], before[2] + more, rtol=1e-13)
    point = come_apart(*stack)[0].as_point()(0.0, y)
    assert point.attitude is None and point.omega is None


def test_springs_without_energy_have_an_infinite_slope():
    value, slopes = jax.value_and_grad(spring_speed, argnums=(0, 1))(0.0, 2.0, 3.0)
    assert value == 0.0 and slopes[0] == jnp.inf and slopes[1] == 0.0
    # Momentum and energy of two masses that were at rest.
    v = spring_speed(30.0, 2.0, 3.0)
    assert_allclose(0.5 * 2.0 * (0.6 * v) ** 2 + 0.5 * 3.0 * (0.4 * v) ** 2, 30.0, rtol=1e-14)


def test_studies_of_one_sequence_refuse_branches():
    mission, start = three_parts(400.0), thrown(jnp.array(120.0))
    with pytest.raises(
        InputError, match="propagate_covariance requires a single sequence of phases"
    ):
        propagate_covariance(mission, start, 0.0)
    begins = Mission([Phase(FALLING, 1.0)], start=Detached(1.0, jnp.zeros(3)))
    with pytest.raises(InputError, match=r"propagate_covariance starts from y0 itself"):
        propagate_covariance(begins, start, 0.0)


def test_fixed_steps_fly_all_parts():
    run = simulate_compact(three_parts(400.0), thrown(jnp.array(120.0)), steps=4)
    exact = by_hand(120.0, 400.0, at_height(120.0))
    booster, sustainer, fairing = run.branches
    found = [booster.end, booster.final.position[2], sustainer.final.position[2]]
    found += [fairing.end, fairing.final.position[2]]
    names = ("end", "height", "sustainer height", "fairing end", "fairing z")
    assert_allclose(jnp.stack(found), [exact[name] for name in names], rtol=1e-12)
    assert len(run.phases) == 5


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        (
            lambda: Phase(FALLING, 1.0, branches=[Phase(FALLING, 1.0)]),
            "branches contains an object of type Phase",
        ),
        (lambda: Mission([Phase(FALLING, 1.0)], start=3.0), "Mission.start is 3.0: it must be a"),
        (
            lambda: Mission([Phase(FALLING, 1.0, name="a", branches=[named("a")])]),
            "Mission.name of a branch is 'a': it must be text without a dot",
        ),
        (
            lambda: Mission([Phase(FALLING, 1.0, branches=[named("a"), named("a")])]),
            "Mission.name of a branch is 'a'",
        ),
        (lambda: Mission([Phase(FALLING, 1.0, branches=[named("a.b")])]), "without a dot"),
        (lambda: come_apart(cylinder(1.0, 0.1, 1.0)), "come_apart got 1 parts"),
        (
            lambda: come_apart(*[cylinder(1.0, 0.1, 1.0)] * 2, kicks=[jnp.zeros(3)]),
            "got 1 kicks for 2 parts",
        ),
        (
            lambda: simulate_mission(
                Mission([Phase(FALLING, 1.0, branches=[named("a", lambda t, y: None)])]),
                thrown(jnp.array(1.0)),
            ),
            "Mission.start before the phase 'a.phase' returns nothing",
        ),
    ],
)
def test_wrong_branches_are_refused_in_a_sentence(wrong, sentence):
    with pytest.raises(InputError, match=sentence):
        wrong()


def named(name, start=None):
    return Mission([Phase(FALLING, 1.0)], start=start, name=name)
