"""Results: one rule of shapes, failures that cannot be overheard, both modes of differentiation,
mapped runs, networks, and what a trajectory shows."""

import functools
from xml.etree import ElementTree

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float
from systems import Integrated
from unchecked import unchecked

from jaxspace import BodyState, Scene, simulate, simulate_batch, simulate_mission
from jaxspace.core import AbstractSystem, InputError
from jaxspace.orbits import PointGravity, TwoBody
from jaxspace.orbits.elements import specific_energy
from jaxspace.simulation import (
    Accuracy,
    Event,
    Mission,
    MissionTrajectory,
    Phase,
    SimulationError,
    Status,
)
from jaxspace.simulation._dataset import blocks_of
from jaxspace.simulation.checks import as_events
from jaxspace.solvers import DOP853, FixedSteps, Stormer, Tsit5

KEPLER = Integrated(TwoBody(1.0))
QUICK = Accuracy(rtol=1e-8, method=Tsit5(), max_steps=1024)


def start(speed=1.1):
    speed = jnp.asarray(speed)
    zero = jnp.zeros_like(speed)
    return BodyState(jnp.stack([zero + 1.0, zero, zero]), jnp.stack([zero, speed, 0.2 + zero]))


def position(speed, t=1.5, accuracy=QUICK, system=KEPLER):
    ts = jnp.stack([jnp.zeros(()), jnp.asarray(t)])
    return simulate(system, start(speed), ts, accuracy=accuracy).final.position


# ---------------------------------------------------------------- shapes


def test_events_of_a_generator_are_all_there():
    """One gives them a single time, which the check of their kind must not use up."""
    events = (Event(lambda t, y: t), Event(lambda t, y: t - 1.0))
    assert as_events(event for event in events) == events
    with pytest.raises(InputError, match="events is of type generator: it must be a tuple"):
        as_events(event for event in (*events, 3.0))


def test_formulas_apply_to_whole_trajectories():
    ts = jnp.linspace(0.0, 2.0, 5)
    run = simulate(KEPLER, start(), ts, accuracy=QUICK)
    x, y, z = run.states.position
    assert x.shape == y.shape == z.shape == run.ts.shape == (5,)
    energy = specific_energy(run.states.position, run.states.velocity, 1.0)
    assert energy.shape == (5,) and float(jnp.ptp(energy)) < 1e-6
    batch = simulate_batch(KEPLER, start(jnp.linspace(0.9, 1.2, 7)), ts, accuracy=QUICK)
    assert batch.states.position.shape == (3, 5, 7) and batch.ts.shape == (5, 7)
    assert batch.final.position.shape == (3, 7) and batch.status.shape == (7,)
    energy = specific_energy(batch.states.position, batch.states.velocity, 1.0)
    # Of each run by itself, and the same at all of its times.
    assert energy.shape == (5, 7) and float(jnp.ptp(energy, axis=0).max()) < 1e-6
    one = batch.of(3)
    np.testing.assert_array_equal(one.states.position, batch.states.position[:, :, 3])
    np.testing.assert_array_equal(run[2].position, run.states.position[:, 2])
    np.testing.assert_array_equal(batch[2].position, batch.states.position[:, 2])
    with pytest.raises(InputError, match="is a single run"):
        run.of(0)


def test_a_batch_may_hold_one_run():
    run = simulate_batch(KEPLER, start(jnp.array([1.1])), jnp.array([0.0, 1.0]), accuracy=QUICK)
    single = simulate(KEPLER, start(1.1), jnp.array([0.0, 1.0]), accuracy=QUICK)
    np.testing.assert_allclose(run.final.position[:, 0], single.final.position, rtol=1e-12)


def test_a_trajectory_says_what_happened():
    run = simulate(KEPLER, start(), jnp.linspace(0.0, 2.0, 5), accuracy=QUICK)
    lines = repr(run).splitlines()
    assert len(lines) == 7
    for words in ("Integrated", "0 s to 2 s, 5 saved", "Tsit5, rtol 1e-08", "reached its"):
        assert words in repr(run)
    # Name, unit, shape, and the numbers of the first and the last time.
    assert lines[-2].split()[:7] == ["position", "m", "(3,", "5)", "1,", "0,", "0"]
    assert lines[-1].endswith(", ".join(f"{x:.6g}" for x in run.final.velocity.tolist()))
    assert well_formed(run).count("<table>") == 2


def test_a_batch_says_how_its_runs_ended_and_their_ranges():
    speeds = jnp.array([0.9, 1.0, 1.1])
    # The middle run ends by itself at once, and its numbers are no part of the ranges.
    spoiled = start(speeds.at[1].set(jnp.nan))
    batch = simulate_batch(TwoBody(1.0), spoiled, jnp.array([0.0, 1.0]))
    text = repr(batch)
    assert text.startswith("Trajectory of TwoBody, 3 runs\n")
    assert "2 of 3 runs succeeded: 2 COMPLETED, 1 NOT_FINITE" in text
    assert f"Run 1: {Status.NOT_FINITE.sentence}" in text
    ends = np.asarray(batch.final.position)[:, [0, 2]]
    for bound in (ends.min(axis=1), ends.max(axis=1)):
        assert ", ".join(f"{x:.6g}" for x in bound) in text
    well_formed(batch)
    mission = MissionTrajectory((batch,), ("coast",), batch.final, batch.ts[-1], batch.status)
    assert repr(mission).startswith("Mission of 1 phase, 3 runs\n")
    row = next(line for line in repr(mission).splitlines() if "coast" in line)
    assert row.endswith("closed form      0  2 COMPLETED, 1 NOT_FINITE")
    well_formed(mission)


GIVEN = Accuracy(rtol=1e-7, max_steps=77)


def two_phases():
    # A name of a phase that HTML has to escape.
    return Mission([Phase(TwoBody(1.0), 1.0, name="<rise>"), Phase(TwoBody(1.0), 2.0, name="fall")])


@functools.cache
def mission_result():
    return simulate_mission(two_phases(), start(), accuracy=GIVEN)


def test_a_mission_reads_as_a_list_with_names():
    result = mission_result()
    assert len(result) == 2 and [*result] == [*result.phases]
    assert [name for name, _ in result.items()] == ["<rise>", "fall"]
    assert result["fall"] is result[-1] is result.phases[1]
    # Without a jump the mission ends where its last phase does.
    np.testing.assert_array_equal(result.final.position, result["fall"].final.position)
    np.testing.assert_array_equal(result.initial.position, start().position)
    lines = repr(result).splitlines()
    assert len(lines) == 10 and lines[0] == "Mission of 2 phases"
    assert lines[5].split() == ["<rise>", "TwoBody", "0", "1", "closed", "form", "0", "COMPLETED"]
    assert lines[6].split()[:4] == ["fall", "TwoBody", "1", "3"]
    assert "&lt;rise&gt;" in well_formed(result)


def test_a_run_of_a_system_reads_as_a_mission_of_one_phase():
    ts = jnp.linspace(0.0, 1.5, 3)
    runs = [
        simulate(KEPLER, start(), ts, accuracy=QUICK),
        simulate_mission(Mission([Phase(KEPLER, 1.5)]), start(), accuracy=QUICK, num_saved=3),
    ]
    for run in runs:
        assert len(run.phases) == 1 and not run.branches and float(run.end) == 1.5
        # Six stages a step, and one more evaluation at the start.
        assert int(run.evaluations) >= 6 * int(run.phases[0].stats["steps"])
        first = run.with_phases(run.phases, jnp.asarray(Status.BELOW_GROUND))
        assert int(first.status) == Status.BELOW_GROUND
    np.testing.assert_array_equal(runs[0].phases[0].final.position, runs[1].final.position)


def test_a_mission_takes_more_fixed_steps_where_they_were_too_few():
    """As a run of the system alone, and the phase alone whose steps missed the tolerance."""
    accuracy = Accuracy(1e-8, method=FixedSteps(DOP853(), 2))
    mission = Mission([Phase(KEPLER, 0.1, name="short"), Phase(KEPLER, 1.1, name="long")])
    run = simulate_mission(mission, start(), accuracy=accuracy)
    assert int(run.status) == Status.COMPLETED
    taken = [int(phase.stats["steps"]) for phase in run.phases]
    assert taken[0] == 2 < taken[1] <= 16
    alone = simulate(KEPLER, start(), jnp.array([0.0, 1.2]), accuracy=1e-12)
    # A few steps of 1e-8 each.
    np.testing.assert_allclose(run.final.position, alone.final.position, atol=1e-7)


def test_a_traced_result_says_its_shapes():
    shown = []

    def traced(y):
        for result in (
            simulate(TwoBody(1.0), y, jnp.array([0.0, 1.0])),
            simulate_mission(two_phases(), y),
        ):
            shown.append(repr(result))
            well_formed(result)
        return simulate(TwoBody(1.0), y, jnp.array([0.0, 1.0]))

    shapes = jax.eval_shape(traced, start())
    for text in (*shown, repr(shapes)):
        assert "(traced)" in text.splitlines()[0]
        assert "position" in text and "m/s" in text
    assert "(3, 2)" in shown[0] and "(3,)" in shown[1] and "(3, 2)" in repr(shapes)
    # Trees of the same class that hold no arrays at all are printed in messages of JAX.
    assert "bool" in repr(jax.tree.map(lambda x: True, shapes))


def well_formed(result):
    """The HTML of a result, which is XML."""
    page = result._repr_html_()
    ElementTree.fromstring(page)
    return page


def test_a_trajectory_knows_the_accuracy_that_was_asked_for():
    ts = jnp.array([0.0, 1.0])
    assert simulate(TwoBody(1.0), start(), ts).accuracy == Accuracy()
    run = simulate(TwoBody(1.0), start(), ts, accuracy=1e-7)
    assert run.accuracy.method == "auto" and float(run.accuracy.rtol) == 1e-7
    assert run.config.method == "closed_form"
    assert mission_result().accuracy is mission_result()["fall"].accuracy is GIVEN
    many = start(jnp.array([0.9, 1.0, 1.1]))
    batch = simulate_batch(TwoBody(1.0), many, ts, accuracy=GIVEN)
    # Of one run it is built again, with the tolerance of that run.
    assert batch.accuracy is GIVEN and batch.of(1).accuracy == GIVEN


@pytest.mark.parametrize("through", [jax.jit, lambda f: jax.vmap(f, in_axes=-1)])
def test_transformations_return_runs_whose_method_has_a_name(through):
    """Shapes alone: a text as a leaf is refused where the function is traced."""
    many = start() if through is jax.jit else start(jnp.array([0.9, 1.1]))
    end = through(lambda y: simulate(TwoBody(1.0), y, jnp.array([0.0, 1.0])))
    found = jax.eval_shape(end, many)
    assert found.accuracy.method == "auto" and found.config.method == "closed_form"


def test_another_tolerance_traces_nothing_again():
    traces = []

    @jax.jit
    def end(accuracy):
        traces.append(accuracy)
        return simulate(TwoBody(1.0), start(), jnp.array([0.0, 1.0]), accuracy=accuracy)

    for rtol in (1e-7, 1e-8):
        jax.eval_shape(end, Accuracy(rtol=rtol))
    assert len(traces) == 1


@pytest.mark.slow
@pytest.mark.parametrize("method", [Tsit5(), DOP853(), Stormer(8, steps=64)])
def test_states_between_the_save_times(method):
    accuracy = Accuracy(rtol=1e-9, method=method, max_steps=512)
    run = simulate(KEPLER, start(), jnp.array([0.0, 3.0]), accuracy=accuracy, dense=True)
    ts = jnp.array([0.0, 0.1234, 1.7, 2.99999, 3.0])
    found = jax.vmap(run.at, out_axes=-1)(ts)
    exact = simulate(TwoBody(1.0), start(), ts).states
    # One more step than the run itself: a few times its tolerance; Stormer's is a tenth of it.
    np.testing.assert_allclose(found.position, exact.position, atol=3e-8)
    assert np.all(np.isnan(run.at(3.1).position))
    with pytest.raises(InputError, match="dense=True"):
        simulate(KEPLER, start(), jnp.array([0.0, 3.0]), accuracy=accuracy).at(1.0)


def test_states_between_the_save_times_of_a_batch():
    # At times of their own; runs that an event ends are integrated through such times, too.
    ts = jnp.array([[0.0, 0.0], [0.5, 1.0], [2.0, 1.8]])
    run = simulate_batch(KEPLER, start(jnp.array([0.9, 1.1])), ts, accuracy=QUICK, dense=True)
    exact = simulate_batch(TwoBody(1.0), start(jnp.array([0.9, 1.1])), jnp.array([0.0, 0.7]))
    np.testing.assert_allclose(run.at(0.7).position, exact.final.position, atol=1e-6)


def test_blocks_of_a_state_have_their_units():
    inner = BodyState(mass=jnp.array(2.0))
    state = BodyState(jnp.zeros(3), parts={"damper": inner, "valve": jnp.array(1.0)})
    # Also within a dictionary, through whose keys the classes of the parts are reached.
    assert [(name, unit) for name, unit, _ in blocks_of(state)] == [
        ("position", "m"),
        ("parts.damper.mass", "kg"),
        ("parts.valve", ""),
    ]


def test_a_data_set_has_named_axes():
    pytest.importorskip("xarray")
    run = simulate_batch(
        KEPLER, start(jnp.array([0.9, 1.1])), jnp.linspace(0.0, 1.0, 3), accuracy=QUICK
    )
    data = run.to_xarray()
    assert data["position"].dims[1:] == ("time", "run")
    np.testing.assert_array_equal(data["position"].values, run.states.position)
    assert data["time"].attrs["units"] == "s"


# ---------------------------------------------------------------- failures


FALLING = BodyState(jnp.array([1.0, 0.0, 0.0]), jnp.zeros(3))


@pytest.mark.parametrize("returned", ["final", "states", "status", "gradient"])
def test_a_failed_run_is_loud_under_jit(returned):
    """Whatever the caller returns: the steps run out, or the point falls into the centre."""

    def run(y0, duration):
        ts = jnp.stack([jnp.zeros(()), duration])
        result = simulate(KEPLER, y0, ts, accuracy=QUICK)
        return {
            "final": result.final.position,
            "states": result.states.velocity,
            "status": result.status,
            "gradient": jnp.sum(result.final.position),
        }[returned]

    function = jax.jit(jax.grad(run) if returned == "gradient" else run)
    # 1024 steps last for a hundred revolutions at most.
    for y0, duration in ((start(), 1e4), (FALLING, 5.0)):
        with pytest.raises(
            Exception, match="maximum number of steps|not meet the tolerance|NaN or infinite"
        ):
            jax.block_until_ready(function(y0, duration))


@pytest.mark.parametrize("mapped", [False, True])
def test_the_sentence_of_a_failed_run_comes_first_and_last(mapped, caplog):
    """In the log of JAX alone, and at the end of what it raises; of mapped runs one fails."""

    def end(duration):
        ts = jnp.stack([jnp.zeros(()), duration])
        return simulate(KEPLER, start(), ts, accuracy=Accuracy(1e-6, max_steps=16)).final.position

    function = jax.jit(jax.vmap(end) if mapped else end)
    fine, failing = (jnp.array([0.1, 0.2]), jnp.array([0.1, 1e4])) if mapped else (0.1, 1e4)
    assert np.all(np.isfinite(function(fine))) and not caplog.records
    # Which of them depends on the way that JAX calls the program.
    with pytest.raises((jax.errors.JaxRuntimeError, ValueError)) as raised:
        jax.block_until_ready(function(failing))
    (record,) = caplog.records
    sentence = record.getMessage()
    assert sentence.startswith(Status.MAX_STEPS.sentence) and record.exc_info is None
    assert str(raised.value).rstrip().endswith(f"SimulationError: {sentence}")


def test_failed_rows_are_nan_beside_their_status():
    y0 = jax.tree.map(lambda a, b: jnp.stack([a, b], axis=-1), start(), FALLING)
    run = simulate_batch(KEPLER, y0, jnp.array([0.0, 1.0, 5.0]), accuracy=QUICK)
    assert run.status[0] == Status.COMPLETED and run.status[1] > Status.EVENT
    assert np.all(np.isfinite(run.states.position[..., 0]))
    assert np.all(np.isnan(run.final.position[:, 1])) and np.all(np.isnan(run.final.velocity[:, 1]))

    def total(mu):
        run = simulate_batch(Integrated(TwoBody(mu)), y0, jnp.array([0.0, 5.0]), accuracy=QUICK)
        return run.final.position[0]

    slopes = jax.jacfwd(total)(1.0)
    assert np.isfinite(slopes[0]) and np.isnan(slopes[1])


def test_a_run_that_does_not_end_leaves_no_number_of_another_time():
    accuracy = Accuracy(rtol=1e-8, method=Tsit5(), max_steps=20)
    ts = jnp.linspace(0.0, 50.0, 11)
    run = simulate(KEPLER, start(), ts, accuracy=accuracy, throw=False)
    assert run.status == Status.MAX_STEPS
    exact = simulate(TwoBody(1.0), start(), ts).states.position
    reached = np.isfinite(run.states.position[0])
    assert 1 <= reached.sum() < 11 and not reached[-1]
    np.testing.assert_allclose(run.states.position[:, reached], exact[:, reached], atol=1e-5)


def test_a_failed_phase_leaves_no_final_state():
    never = Event(lambda t, y: y.position[0] - 100.0, within=0.5)
    mission = Mission([Phase(KEPLER, never, name="a"), Phase(KEPLER, 0.5, name="b")])
    run = simulate_mission(mission, start(), accuracy=QUICK, throw=False)
    assert run.status == Status.EVENT_MISSED and np.all(np.isnan(run.final.position))
    with pytest.raises(SimulationError, match="within its time limit"):
        simulate_mission(mission, start(), accuracy=QUICK)


# ---------------------------------------------------------------- derivatives


def exact_position(speed, t=1.5):
    return position(speed, t, accuracy=1e-9, system=TwoBody(1.0))


def test_every_mode_of_differentiation_by_default():
    """Against the closed form, whose derivatives JAX has."""
    tight = Accuracy(rtol=1e-10, method=Tsit5(), max_steps=512)

    def f(x):
        return position(x[0], x[1], tight)[0]

    def g(x):
        return exact_position(x[0], x[1])[0]

    x, v = jnp.array([1.1, 1.5]), jnp.array([0.3, -0.2])
    # One program for the gradient and its derivative along v.
    slope, bend = jax.jit(lambda x: jax.jvp(jax.grad(f), (x,), (v,)))(x)
    exact_slope, exact_bend = jax.jit(lambda x: jax.jvp(jax.grad(g), (x,), (v,)))(x)
    # Errors of derivatives exceed those of the run by their growth, here some tens.
    np.testing.assert_allclose(slope, exact_slope, atol=3e-9)
    np.testing.assert_allclose(bend, exact_bend, atol=1e-7)
    forward, bend = jax.jit(lambda x: jax.jvp(jax.jacfwd(f), (x,), (v,)))(x)
    np.testing.assert_allclose(forward, slope, atol=1e-12)
    np.testing.assert_allclose(bend, exact_bend, atol=1e-7)
    np.testing.assert_allclose(jax.jvp(f, (x,), (v,))[1], slope @ v, atol=1e-12)
    np.testing.assert_allclose(jax.linearize(f, x)[1](v), slope @ v, atol=1e-12)
    outside = jax.jit(jax.jacrev(jax.jacfwd(f)))(x)
    np.testing.assert_allclose(outside @ v, exact_bend, atol=1e-7)


# `test_integration_save_times.py` and `test_solvers_rolled_stages.py` differentiate saved states,
# too.
@pytest.mark.sweep
def test_derivatives_through_saved_states():
    """Of all saved states, in both modes, for a method with dense output."""

    def f(speed):
        run = simulate(KEPLER, start(speed), jnp.linspace(0.0, 1.5, 4), accuracy=QUICK)
        return run.states.position

    def g(speed):
        return simulate(TwoBody(1.0), start(speed), jnp.linspace(0.0, 1.5, 4)).states.position

    forward, exact = jax.jit(jax.jacfwd(f))(1.1), jax.jit(jax.jacfwd(g))(1.1)
    weights = np.arange(12.0).reshape(3, 4)
    reverse = jax.jit(jax.grad(lambda s: jnp.sum(weights * f(s))))(1.1)
    np.testing.assert_allclose(forward, exact, atol=1e-5)
    np.testing.assert_allclose(reverse, np.sum(weights * forward), rtol=1e-10)


# ---------------------------------------------------------------- mapped runs


def test_mapped_runs_take_the_batch_path():
    speeds = jnp.linspace(0.9, 1.2, 70)
    f = lambda v: jnp.sum(position(v))  # noqa: E731
    values, slopes = jax.jit(jax.vmap(jax.value_and_grad(f)))(speeds)
    for k in (0, 33, 69):
        value, slope = jax.value_and_grad(f)(speeds[k])
        # A block takes the steps of its worst run: each within the tolerance of 1e-8.
        np.testing.assert_allclose(values[k], value, atol=1e-6)
        np.testing.assert_allclose(slopes[k], slope, atol=1e-5)
    # The batch path takes no map of the loop: its program holds no loop over a mapped condition.
    text = str(jax.make_jaxpr(jax.vmap(f))(speeds))
    assert "integrate" in text


class Oscillators(AbstractSystem):
    """x'' = -k |x|^2 x / (x . x): right for one run, and a sum over all of its axes."""

    k: Float[Array, "*#runs"]

    def vector_field(self, t, y):
        x, v = y
        return v, -self.k * x / jnp.sqrt(jnp.sum(x * x)) * jnp.linalg.norm(x)

    def invariants(self, t, y):
        return {}


def test_a_field_that_mixes_its_axes_is_mapped_as_it_stands():
    """It does not keep to the layout: the map must not make a batch of it."""
    k = jnp.array([1.0, 2.0, 3.0])
    y0 = (jnp.array([1.0, 0.0]), jnp.array([0.0, 0.5]))
    ts = jnp.array([0.0, 1.0])

    def end(k):
        return simulate(Oscillators(k), y0, ts, accuracy=QUICK).final[0]

    each = jnp.stack([end(x) for x in k])
    np.testing.assert_allclose(jax.vmap(end)(k), each, atol=1e-12)


class Learned(AbstractSystem):
    """An oscillator with a force from a network, whose weights declare nothing about runs."""

    network: eqx.nn.MLP

    def vector_field(self, t, y):
        x, v = y
        features = jnp.stack([x, v])
        shape = features.shape[1:]
        out = jax.vmap(self.network, in_axes=-1, out_axes=-1)(features.reshape(2, -1))
        return v, -x + 0.1 * out.reshape(shape)

    def invariants(self, t, y):
        return {}


def test_a_network_in_a_system_is_shared_by_the_runs(key):
    network = eqx.nn.MLP(2, "scalar", 4, 1, key=key)
    y0 = (jnp.linspace(0.0, 1.0, 5), jnp.zeros(5))
    ts = jnp.array([0.0, 1.0])
    batch = simulate_batch(Learned(network), y0, ts, accuracy=QUICK)
    single = simulate(Learned(network), (y0[0][3], y0[1][3]), ts, accuracy=QUICK)
    np.testing.assert_allclose(batch.final[0][3], single.final[0], atol=1e-6)
    slopes = eqx.filter_grad(
        lambda n: jnp.sum(simulate_batch(Learned(n), y0, ts, accuracy=QUICK).final[0])
    )(network)
    assert all(np.all(np.isfinite(x)) for x in jax.tree.leaves(eqx.filter(slopes, eqx.is_array)))


class Unmapped(AbstractSystem):
    """The same, written for one run."""

    network: eqx.nn.MLP

    def vector_field(self, t, y):
        x, v = y
        return v, -x + 0.1 * self.network(jnp.stack([x, v]))

    def invariants(self, t, y):
        return {}


def test_a_network_of_one_run_is_mapped_or_told_how(key):
    system = Unmapped(eqx.nn.MLP(2, "scalar", 4, 1, key=key))
    xs, ts = jnp.linspace(0.0, 1.0, 3), jnp.array([0.0, 1.0])
    with pytest.raises(InputError, match=r"jax.vmap\(f, in_axes=-1, out_axes=-1\)"):
        simulate_batch(system, (xs, jnp.zeros(3)), ts, accuracy=QUICK)

    def end(x):
        return simulate(system, (x, jnp.zeros(())), ts, accuracy=QUICK).final[0]

    many = simulate_batch(Learned(system.network), (xs, jnp.zeros(3)), ts, accuracy=QUICK)
    # Other steps, each within the tolerance.
    np.testing.assert_allclose(jax.vmap(end)(xs), many.final[0], atol=1e-6)


# ---------------------------------------------------------------- closed forms of scenes


def test_a_scene_of_one_point_takes_the_closed_form():
    ts = jnp.linspace(0.0, 3.0, 4)
    run = simulate(Scene([PointGravity(1.0)]), start(), ts)
    assert run.config.method == "closed_form" and run.stats["evaluations"] == 0
    np.testing.assert_array_equal(
        run.states.position, simulate(TwoBody(1.0), start(), ts).states.position
    )


# ---------------------------------------------------------------- sentences


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: simulate(3.0, start(), SPAN), "system is of type float"),
        (lambda: simulate(KEPLER, ["a"], SPAN), "y0 contains 'a' of type str"),
        (lambda: simulate(KEPLER, start(), SPAN, accuracy=Accuracy(method="rk4")), '"rk4"'),
        (
            lambda: simulate(KEPLER, start(), SPAN, accuracy=Accuracy(method="closed_form")),
            "Integrated offers no closed form",
        ),
        (
            lambda: simulate(
                KEPLER, start(), SPAN, events=(Event(lambda t, y: y.position),), accuracy=QUICK
            ),
            r"events\[0\].condition returns \(3,\)",
        ),
        (
            lambda: simulate_mission(Mission([Phase(KEPLER, 1.0)]), start(), SPAN),
            "it must be a scalar, the start time",
        ),
        (
            lambda: simulate_mission(Mission([Phase(KEPLER, 1.0)]), start(), num_saved=10**12),
            "num_saved is",
        ),
        # Room for these would end the process.
        (lambda: Event(lambda t, y: y.mass, samples=10**12), "samples is 1000000000000: it must"),
        (lambda: Event(lambda t, y: y.mass, capacity=10**12), "capacity is 1000000000000"),
        (lambda: simulate(Truncated(), start(), SPAN), "must have the structure of the state"),
    ],
)
def test_wrong_calls_get_a_sentence(call, sentence):
    with unchecked(), pytest.raises(InputError, match=sentence):
        call()


SPAN = jnp.array([0.0, 1.0])


class Truncated(AbstractSystem):
    """A derivative that lacks a part of the state."""

    def vector_field(self, t, y):
        return BodyState(position=y.velocity)

    def invariants(self, t, y):
        return {}
