"""What a first call traces and compiles: counted in operations, because times say too little."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace import (
    Accuracy,
    BodyState,
    Event,
    Mission,
    Phase,
    Scene,
    simulate,
    simulate_batch,
    simulate_mission,
)
from jaxspace.bodies import Load
from jaxspace.core import AbstractSystem
from jaxspace.core.vectors import dot
from jaxspace.integration import select_method
from jaxspace.integration._needed import needed_only
from jaxspace.integration.normalised_time import segments_of
from jaxspace.orbits import PointGravity, TwoBody
from jaxspace.scene import Custom
from jaxspace.solvers import DOP853, RKN1210, AdaptiveRegularised, Tsit5
from jaxspace.solvers.protocol import bind
from jaxspace.solvers.tolerances import Tolerance


def operations(jaxpr) -> list[str]:
    """The names of the operations, and of the programs among them."""
    return [e.params.get("name", e.primitive.name) for e in jaxpr.eqns]


@pytest.mark.parametrize(("save_ts", "evaluations"), [(None, 12), (jnp.array([0.05]), 16)])
def test_dense_output_is_traced_only_where_states_are_saved(save_ts, evaluations):
    term = diffrax.ODETerm(lambda t, y, args: -y)
    solver = bind(DOP853(), tolerance=Tolerance(1e-9, 1e-9, 0), save_ts=save_ts, run_axes=0)

    def step(y):
        y1, _, dense, _, _ = solver.step(term, jnp.array(0.0), jnp.array(0.1), y, None, None, False)
        return y1, dense

    names = operations(jax.make_jaxpr(step)(jnp.ones(2)).jaxpr)
    assert names.count("evaluate") == evaluations


def test_a_run_without_breaks_looks_up_no_segment():
    start, span, s = jnp.array(3.0), jnp.array(-2.0), jnp.array(0.25)

    def place(start, span, s):
        segments = segments_of(TwoBody(1.0), start, start + span, None)
        return segments.time(s), segments.duration(s, 0.5)

    jaxpr = jax.make_jaxpr(place)(start, span, s).jaxpr
    used = {e.primitive.name for e in jaxpr.eqns} - {"convert_element_type"}
    # The ends are made, and read by nobody: no slice, no gather, no rounding to a whole number.
    assert not {"slice", "dynamic_slice", "gather", "floor", "squeeze"} & used
    np.testing.assert_allclose(place(start, span, s), (2.5, -1.0), rtol=1e-15)


class Traces(list):
    """A list that is equal to itself alone, as what is static has to be."""

    __hash__ = object.__hash__
    __eq__ = object.__eq__


class Counted(AbstractSystem):
    """An oscillator that counts how often its field is traced."""

    traced: list = eqx.field(static=True, default_factory=Traces)

    def vector_field(self, t, y):
        self.traced.append(t)
        return (y[1], -y[0])

    def invariants(self, t, y):
        return {}


@pytest.mark.parametrize("kind", ["system", "mission", "batch"])
def test_a_run_from_the_end_of_another_is_the_same_program(kind):
    """A number of Python is of a weak type as an array, the end of a run is not."""
    system, how = Counted(), Accuracy(1e-6, method=Tsit5())
    y0, ts = (jnp.asarray(1.0), jnp.asarray(0.0)), np.array([0.0, 1.0])
    assert y0[0].weak_type
    if kind == "batch":
        y0 = jax.tree.map(lambda x: jnp.broadcast_to(x, (2,)), y0)
        assert y0[0].weak_type

    def end(y0):
        if kind == "system":
            return simulate(system, y0, ts, accuracy=how).final
        if kind == "mission":
            return simulate_mission(Mission([Phase(system, 1.0)]), y0, accuracy=how).final
        return simulate_batch(system, y0, ts, accuracy=how).final

    first = end(y0)
    traces = len(system.traced)
    assert traces > 0
    again = end(first)
    assert len(system.traced) == traces
    np.testing.assert_allclose(again[0], np.cos(2.0) * np.ones(y0[0].shape), atol=1e-5)


class Force(eqx.Module):
    """A load towards the centre that counts how often it is traced."""

    traced: list = eqx.field(static=True, default_factory=Traces)

    def __call__(self, t, y, body):
        self.traced.append(t)
        return Load(acceleration_N=-1e-3 * y.position)


def half_square(t, y, body):
    return 5e-4 * dot(y.position, y.position)


def perturbed(mu, force):
    """Attraction by a point, perturbed by a potential: of such orbits "auto" asks most."""
    custom = Custom(force, keeps={"energy"}, energy=half_square)
    return Scene([PointGravity(mu), custom])


@pytest.mark.parametrize("batch", [False, True])
def test_a_second_call_traces_nothing(batch):
    """A system of the same make with other numbers is no new one."""
    force = Force()
    y0 = BodyState(jnp.array([1.0, 0.0, 0.0]), jnp.array([0.0, 1.1, 0.0]))
    ts = jnp.array([0.0, 10.0])
    if batch:
        y0 = jax.tree.map(lambda x: jnp.broadcast_to(x[:, None], (3, 2)), y0)
    run = simulate_batch if batch else simulate
    first = run(perturbed(1.0, force), y0, ts, accuracy=1e-6)
    traces = len(force.traced)
    assert traces > 0 and isinstance(first.config.method, RKN1210)
    run(perturbed(1.01, force), y0, ts, accuracy=1e-6)
    assert len(force.traced) == traces


class Half(eqx.Module):
    """The condition that x = 1/2, which counts how often it is traced."""

    traced: list = eqx.field(static=True, default_factory=Traces)

    def __call__(self, t, y):
        self.traced.append(t)
        return y[0] - 0.5


@pytest.mark.parametrize("kind", ["event", "mission", "between"])
def test_what_follows_a_run_is_traced_once(kind):
    """Of x = cos t: its event, the phases of a mission, and a state between the save times."""
    system, half, how = Counted(), Half(), Accuracy(1e-6, method=Tsit5())
    y0, ts = (jnp.asarray(1.0), jnp.asarray(0.0)), np.array([0.0, 2.0])
    event = Event(half, within=2.0)
    dense = simulate(system, y0, ts, accuracy=how, dense=True)
    third = float(np.arccos(0.5))
    for _ in range(2):
        traces = len(system.traced), len(half.traced)
        if kind == "event":
            end = simulate(system, y0, ts, accuracy=how, events=(event,)).final
        elif kind == "mission":
            end = simulate_mission(Mission([Phase(system, event)]), y0, accuracy=how).final
        else:
            end = dense.at(third)
        np.testing.assert_allclose(end, (0.5, -np.sqrt(0.75)), atol=1e-5)
    assert (len(system.traced), len(half.traced)) == traces


def test_to_choose_a_method_again_traces_nothing():
    """Of an eccentric orbit, e = v^2 - 1, whose perturbation is asked for its potential."""
    force = Force()
    y0 = BodyState(jnp.array([1.0, 0.0, 0.0]), jnp.array([0.0, 1.3, 0.0]))
    ts = jnp.array([0.0, 40.0])
    for _ in range(2):
        traces = len(force.traced)
        method = select_method(perturbed(1.0, force), y0, 1e-9, ts)
        assert isinstance(method, AdaptiveRegularised)
    assert len(force.traced) == traces > 0


def test_what_is_asked_of_a_run_is_one_program():
    ts = jnp.array([0.0, 1.0])
    y0 = BodyState(jnp.array([1.0, 0.0, 0.0]), jnp.array([0.0, 1.0, 0.0]))
    run = simulate(TwoBody(1.0), y0, ts)
    jaxpr = eqx.filter_make_jaxpr(lambda run: run.drift())(run)[0].jaxpr
    assert operations(jaxpr) == ["_program_drift"]
    jaxpr = eqx.filter_make_jaxpr(lambda run: run.at(0.3))(run)[0].jaxpr
    assert operations(jaxpr) == ["_at"]


def test_what_no_result_needs_is_not_differentiated():
    def both(x, scale):
        # `y` has no reader in what is returned below.
        y = jnp.sin(x) * scale
        return jnp.exp(x), y

    x, scale = jnp.array([0.3, -0.2]), jnp.array(2.0)
    first = needed_only(lambda x, scale: both(x, scale)[0])
    of_first = jax.make_jaxpr(lambda x: jax.jvp(first, (x, scale), (x, scale)))(x).jaxpr
    names = operations(of_first)
    assert "exp" in names
    assert not {"sin", "cos"} & set(names)
    value, slope = jax.jvp(first, (x, scale), (x, scale))
    np.testing.assert_allclose(value, np.exp(x), rtol=1e-14)
    # d exp(x) = exp(x) dx, and nothing of the scale.
    np.testing.assert_allclose(slope, np.exp(x) * x, rtol=1e-14)


def test_needed_only_keeps_trees_and_what_a_function_closes_over():
    def gradient(k):
        function = needed_only(lambda y, none: {"x": k * y["x"], "none": none})
        return jnp.sum(function({"x": jnp.arange(3.0), "y": jnp.ones(2)}, None)["x"])

    np.testing.assert_allclose(jax.grad(gradient)(2.0), 3.0)
