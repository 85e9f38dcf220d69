"""Phases that differ in their numbers alone, by one program in a loop: a stone that falls through
layers of other gravity, whose ways are parabolas."""

import dataclasses
from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
from numpy.testing import assert_allclose

from jaxspace import Accuracy, Event, Mission, Phase
from jaxspace.core import AbstractSystem, Scalar
from jaxspace.core.jit import QUICK
from jaxspace.core.status import Status
from jaxspace.core.tracing import count_operations
from jaxspace.simulation.mission_runs import run_mission
from jaxspace.simulation.phases import resolve_phases
from jaxspace.solvers import Tsit5

ACCURACY = Accuracy(rtol=1e-9, method=Tsit5())


@final
class Layer(AbstractSystem):
    """z'' = -g."""

    g: Scalar

    def vector_field(self, t, y):
        return {"z": y["v"], "v": -self.g * jnp.ones_like(y["v"])}

    def invariants(self, t, y):
        return {}


@final
class Above(eqx.Module):
    """Height above a level."""

    level: Scalar

    def __call__(self, t, y):
        return y["z"] - self.level


def falling(gravity, levels, wait, within=20.0):
    """From rest through the levels, with a wait after the first one."""
    first, last = (Event(Above(level), -1, within) for level in levels)
    slow, fast = (Layer(g) for g in gravity)
    return Mission([Phase(slow, first, name="a"), Phase(slow, wait), Phase(fast, last, name="b")])


def traced(mission, y0, shared_program=True):
    configs = resolve_phases(mission, y0, ACCURACY, 1)
    return run_mission(mission, y0, 0.0, 2, configs, 1, shared_program=shared_program)


run = eqx.filter_jit(traced, **QUICK)


def test_a_loop_over_phases_of_one_structure():
    """Times and heights of parabolas; the wait is no event, and a run that does not reach the
    ground in time has missed it. The result has the form of that of the phases one by one."""
    g = jnp.array([2.0, 2.0]), jnp.array([8.0, 0.5])
    heights, wait = jnp.array([100.0, 100.0]), jnp.array([1.5, 1.0])
    y0 = {"z": heights, "v": jnp.zeros(2)}
    mission = falling(g, (jnp.array(51.0), jnp.array(0.0)), wait, 7.5)
    result = run(mission, y0)
    # Down to 51 in 7 s at 14 m/s.
    assert_allclose(result.phases[0].ts[-1], 7.0, rtol=1e-9)
    speed = 14.0 + 2.0 * wait
    above = 51.0 - 14.0 * wait - wait**2
    assert_allclose(result.phases[1].states["z"][-1], above, rtol=1e-9)
    assert_allclose(result.phases[1].ts[-1], 7.0 + wait, rtol=1e-12)
    ground = (jnp.sqrt(speed**2 + 2.0 * g[1] * above) - speed) / g[1]
    assert_allclose(result.phases[2].ts[-1], 7.0 + wait + ground, rtol=1e-9)
    assert_allclose(result.end, result.phases[2].ts[-1])
    assert result.status.tolist() == [Status.EVENT] * 2
    assert [phase.event.tolist() for phase in result.phases] == [[0, 0], [-1, -1], [0, 0]]
    assert result.phases[1].status.tolist() == [Status.COMPLETED] * 2
    form = eqx.filter_eval_shape(traced, mission, y0, False)
    assert jax.tree.structure(form) == jax.tree.structure(result)
    for a, b in zip(jax.tree.leaves(form), jax.tree.leaves(result), strict=True):
        assert (a.shape, a.dtype) == (b.shape, b.dtype)
    # The second run turns round, and is not on the ground after the longest wait.
    soft = falling((g[0], jnp.array([8.0, -8.0])), (jnp.array(51.0), jnp.array(0.0)), wait, 7.5)
    assert run(soft, y0).status.tolist() == [Status.EVENT, Status.EVENT_MISSED]


def test_touches_and_a_wait_between_them():
    """The top of a throw from below, of 25 m after 5 s; and with the gravity turned round, after a
    second of falling, the bottom of 23.75 m a quarter of a second later."""
    top, bottom = (Event(Above(jnp.array(z)), within=8.0, touch=1e-6) for z in (25.0, 23.75))
    slow, back = Layer(jnp.array(2.0)), Layer(jnp.array(-8.0))
    phases = Phase(slow, top, name="a"), Phase(slow, 1.0), Phase(back, bottom, name="b")
    mission = Mission(phases)
    y0 = {"z": jnp.zeros(2), "v": 10.0 * jnp.ones(2)}
    result = run(mission, y0)
    assert result.status.tolist() == [Status.EVENT] * 2
    ends = [float(phase.ts[-1, 0]) for phase in result.phases]
    assert_allclose(ends, [5.0, 6.0, 6.25], rtol=1e-9)
    assert_allclose(result.final["z"], 23.75, rtol=1e-9)


def test_a_loop_holds_a_phase_once():
    """Three phases have one integration, and those of which one jumps are left as they are."""
    mission = falling((jnp.array(2.0), jnp.array(8.0)), (jnp.array(51.0), jnp.array(0.0)), 1.5)
    y0 = {"z": 100.0 * jnp.ones(2), "v": jnp.zeros(2)}

    def operations(mission, shared_program):
        arrays, rest = eqx.partition((mission, y0), eqx.is_array)

        def plain(arrays):
            made, y = eqx.combine(arrays, rest)
            return traced(made, y, shared_program).final

        return count_operations(jax.make_jaxpr(plain)(arrays).jaxpr)

    assert operations(mission, True) < 0.7 * operations(mission, False)
    first, *others = mission.phases
    jumping = Mission([dataclasses.replace(first, then=lambda t, y: y), *others[1:]])
    assert operations(jumping, True) == operations(jumping, False)
