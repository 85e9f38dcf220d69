"""The verbs as editors show them: what each takes and returns is written out."""

import inspect
import traceback
import typing
import warnings

import jax
import jax.numpy as jnp
import pytest

import jaxspace
from jaxspace import Mission, Phase, Trajectory, dispersion, estimation, optimization, studies
from jaxspace.control import ClosedLoop, LoopRun
from jaxspace.core import AbstractSystem
from jaxspace.io import SceneFile
from jaxspace.simulation import MissionTrajectory, crossings, simulate_compact

# What each takes in order, those after the third by name alone, and what it returns.
OF_RUNS = {
    "simulate": ("system y0 ts accuracy events dense throw", Trajectory),
    "simulate_mission": ("mission y0 t0 accuracy num_saved throw", MissionTrajectory),
    "simulate_batch": ("systems y0s ts accuracy events dense in_axes throw", Trajectory),
    "simulate_mission_batch": (
        "missions y0s t0 accuracy num_saved in_axes throw",
        MissionTrajectory,
    ),
}
VERBS = [
    *(getattr(jaxspace, name) for name in OF_RUNS),
    jaxspace.load,
    crossings,
    simulate_compact,
    studies.accuracy_cost,
    studies.effect_budget,
    studies.modes,
    studies.propagate_covariance,
    studies.sensitivity,
    dispersion.disperse,
    estimation.fit,
    optimization.minimise,
    optimization.minimise_from,
    ClosedLoop.simulate,
    ClosedLoop.simulate_batch,
    SceneFile.campaign,
    SceneFile.nominal_mission,
    SceneFile.optimize,
    SceneFile.simulate,
]


@pytest.mark.parametrize("verb", VERBS, ids=lambda verb: verb.__qualname__)
def test_a_verb_has_its_arguments_and_its_result_written_out(verb):
    signature = inspect.signature(verb)
    for name, argument in signature.parameters.items():
        assert argument.kind not in (argument.VAR_POSITIONAL, argument.VAR_KEYWORD), name
        assert name == "self" or argument.annotation is not argument.empty, name
        assert argument.annotation is not typing.Any, name
    assert signature.return_annotation not in (signature.empty, typing.Any)


@pytest.mark.parametrize("name", OF_RUNS)
def test_a_verb_of_runs_returns_one_type(name):
    names, result = OF_RUNS[name]
    verb = getattr(jaxspace, name)
    signature = inspect.signature(verb)
    assert list(signature.parameters) == names.split()
    by_name = [p for p in signature.parameters.values() if p.kind is p.KEYWORD_ONLY]
    assert [p.name for p in by_name] == names.split()[3:]
    assert signature.return_annotation is result
    for part in (f"**Returns** a `{result.__name__}`", "**Arguments**", "**Raises** `InputError`"):
        assert part in verb.__doc__
    with pytest.raises(TypeError, match="tolerance"):
        verb(None, None, None, tolerance=1e-3)


def test_a_loop_returns_its_run():
    for verb in (ClosedLoop.simulate, ClosedLoop.simulate_batch):
        assert inspect.signature(verb).return_annotation is LoopRun


class Kinked(AbstractSystem):
    """A decay whose rate is interpolated in time."""

    rates: jax.Array

    def vector_field(self, t, y):
        return -jnp.interp(t, jnp.linspace(0.0, 1.0, 5), self.rates) * y

    def invariants(self, t, y):
        return {}


def test_a_warning_points_to_the_line_of_the_caller(monkeypatch):
    """Each verb is another number of calls away from what warns."""
    places = []

    def warn(message, stacklevel=1):
        # The checks of shapes, which the tests alone turn on, stand between all calls.
        files = [frame.filename for frame in traceback.extract_stack()[:-1]]
        own = [file for file in files if "jaxtyping" not in file and "beartype" not in file]
        places.append(own[-stacklevel])

    monkeypatch.setattr(warnings, "warn", warn)
    system, one, many = Kinked(jnp.arange(5.0)), jnp.ones(1), jnp.ones((1, 3))
    mission, ts = Mission([Phase(system, 1.0)]), jnp.array([0.0, 1.0])
    calls = (
        lambda y: jaxspace.simulate(system, one * y, ts).final,
        lambda y: jaxspace.simulate_mission(mission, one * y).final,
        lambda y: jaxspace.simulate_batch(system, many * y, ts).final,
        lambda y: jaxspace.simulate_mission_batch(mission, many * y).final,
    )
    for call in calls:
        # Traced and not compiled: what warns comes before.
        jax.eval_shape(call, 1.0)
    assert places == 4 * [__file__]
