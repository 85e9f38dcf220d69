"""The parts that effects read and add, from traces of their loads, once for each structure.

A load is traced in the smallest sufficient state: without parts, with a position and its velocity,
an attitude and its rate, or a mass, then with two of these, then with all. It reads the parts on
which its result depends, and adds the parts that its result contains.
"""

import dataclasses
import functools
import itertools
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import Literal
from jaxtyping import Array, PyTree

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load, RigidBody
from ..bodies.state import PARTS, sample_state
from ..core import InputError, Scalar
from ..core.layout import run_axes_of
from ..core.structure import once_per_structure
from ..core.tracing import depending_on
from ..core.user_functions import user_function

TRANSLATION = frozenset({"position", "velocity"})
ROTATION = frozenset({"attitude", "omega"})
MASS = frozenset({"mass"})

# The contributions of a load: word, field, and the parts of the state that it changes.
CONTRIBUTIONS = {
    "acceleration": ("acceleration_N", TRANSLATION),
    "force": ("force_N", TRANSLATION),
    "torque": ("torque_B", ROTATION),
    "mass_rate": ("mass_rate", MASS),
    "parts": ("parts_rate", frozenset({"parts"})),
    "inertia": ("inertia_B", ROTATION),
    "momentum": ("momentum_B", ROTATION),
}
# Contribution of a guide that changes the rate of a part.
GUIDED = {"velocity": "acceleration", "omega": "torque", "mass": "mass_rate", "parts": "parts"}


class Reading(NamedTuple):
    """The parts of the state that an effect reads and adds.

    - `needs`: the parts from which its load is computed, out of "position", "velocity", "attitude",
      "omega", "mass".
    - `adds`: the contributions of its load, out of "acceleration", "force", "torque", "mass_rate",
      "parts", "inertia", "momentum"."""

    needs: frozenset[str]
    adds: frozenset[str]


class SceneReading(NamedTuple):
    """A `Reading` for each effect of a scene, and the `parts` of a state of the scene, in the order
    of `BodyState`."""

    effects: tuple[Reading, ...]
    parts: tuple[str, ...]


def read_effects(
    effects: Iterable[AbstractEffect], body: AbstractBody, present: Iterable[str] = ()
) -> SceneReading:
    """The parts that effects read and add that act together on a body.

    **Arguments**

    - `effects`, `body`: of a scene; their arrays may be traced.
    - `present`: parts that the state always contains.

    **Raises** the error of a load that cannot be traced in any state."""
    return _read((tuple(effects), body), frozenset(present))


def _is_shape(x: object) -> bool:
    return isinstance(x, jax.ShapeDtypeStruct)


# The parts read do not depend on numbers.
@once_per_structure
def _read(
    scene: tuple[tuple[AbstractEffect, ...], AbstractBody], present: frozenset[str]
) -> SceneReading:
    failure: Exception | None = None
    for runs in _runs(scene):
        try:
            return _traced(scene, present, runs)
        # Any error of arrays whose numbers of runs differ.
        except Exception as error:
            failure = failure or error
    assert failure is not None
    raise failure


def _runs(scene: PyTree) -> list[tuple[int, ...]]:
    """The batch shapes that a state may have with these parameters, the most likely one first."""
    arrays = eqx.filter(scene, _is_shape)
    axes = jax.tree.leaves(run_axes_of(arrays, lambda x: -1))
    pairs = list(zip(jax.tree.leaves(arrays), axes, strict=True))
    declared = [x.shape[x.ndim - k :] for x, k in pairs if k >= 0]
    shared: tuple[int, ...] = np.broadcast_shapes(*declared)
    # A function of the user declares no axes: the last one of its arrays may be that of the runs.
    return list(dict.fromkeys([shared, *(x.shape[-1:] for x, k in pairs if k < 0)]))


def _traced(
    scene: tuple[tuple[AbstractEffect, ...], AbstractBody],
    present: frozenset[str],
    runs: tuple[int, ...],
) -> SceneReading:
    arrays, rest = eqx.partition(scene, _is_shape)
    dtypes = [x.dtype for x in jax.tree.leaves(arrays) if jnp.issubdtype(x.dtype, jnp.floating)]
    dtype = dtypes[0] if dtypes else jnp.zeros(()).dtype
    traces: list[_Trace] = []
    parts: set[str] = set()

    def act(y: BodyState, arrays: PyTree, t: Scalar) -> list[list[Array]]:
        effects, body = eqx.combine(arrays, rest)
        # The scene reports a torque on a body without inertia by name: here it may turn.
        if not body.has_inertia():
            body = RigidBody(body.constant_mass(), jnp.ones(3, dtype))
        result, held = _together(effects, t, y, body, present)
        traces.extend(result)
        parts.update(held)
        return [trace.results for trace in traces]

    y = jax.tree.map(lambda x: jax.ShapeDtypeStruct((*x.shape, *runs), dtype), _sample())
    time = jax.ShapeDtypeStruct((), dtype)
    jaxpr = jax.make_jaxpr(act)(y, arrays, time).jaxpr
    moved = {
        part: depending_on(jaxpr, [x])
        for part, x in zip(y.present, jaxpr.invars[: len(y.present)], strict=True)
    }
    outputs = iter(jaxpr.outvars)
    readings = []
    for trace in traces:
        results = {
            x for x in itertools.islice(outputs, len(trace.results)) if not isinstance(x, Literal)
        }
        needs = frozenset(part for part, variables in moved.items() if results & variables)
        readings.append(Reading(needs, trace.adds))
    return SceneReading(tuple(readings), tuple(part for part in PARTS if part in parts))


@functools.cache
def _sample() -> BodyState:
    return jax.eval_shape(lambda: sample_state(set(PARTS) - {"parts"}))


class _Trace(NamedTuple):
    """Result of the trace of an effect.

    - `held`: the parts of the state that it was in, and the names of those of effects.
    - `results`: the arrays that it returned.
    - `adds`: what it added.
    - `parts`: those of the state that it was in, and those that it changes.
    - `own`: the initial values of its own parts of the state."""

    held: tuple[frozenset[str], frozenset[str]]
    results: list[Array]
    adds: frozenset[str]
    parts: frozenset[str]
    own: dict[str, PyTree]


def _together(
    effects: tuple[AbstractEffect, ...],
    t: Scalar,
    y: BodyState,
    body: AbstractBody,
    present: frozenset[str],
) -> tuple[list[_Trace], frozenset[str]]:
    """The readings of the effects in the smallest state sufficient for all of them, and its parts.

    Arguments as of `_alone`."""
    parts = _in_pairs(present)
    own = {}
    last: dict[int, _Trace] = {}
    while True:
        before = (parts, frozenset(own))
        traces = []
        failure = None
        for k, effect in enumerate(effects):
            trace = last.get(k)
            if trace is not None and trace.held == (parts, frozenset(own)):
                traces.append(trace)
                continue
            try:
                trace = last[k] = _alone(effect, t, y, body, parts, own)
            # It may read a part of an effect that comes after it, which is there the next time.
            except Exception as error:
                failure = failure or error
                continue
            traces.append(trace)
            parts = _in_pairs(parts | trace.parts)
            own = {**own, **trace.own}
        # Repeated until all agree, because an effect may use a part that another one brings.
        if (parts, frozenset(own)) == before:
            if failure is not None:
                raise failure
            return traces, parts


def _alone(
    effect: AbstractEffect,
    t: Scalar,
    y: BodyState,
    body: AbstractBody,
    present: frozenset[str],
    own: dict[str, PyTree],
) -> _Trace:
    """The reading of an effect in the smallest sufficient state with the parts `present`.

    **Arguments**

    - `effect`, `t`, `body`: as of its load.
    - `y`: a state with every part but those of effects, to choose from.
    - `own`: the parts of other effects, by name."""
    failure: Exception | None = None
    for parts in _states(present):
        state = BodyState(**{part: getattr(y, part) for part in parts - {"parts"}})
        try:
            started = effect.start(state, body) or {}
            # Distinct numbers: the initial value of a part differs from the value read by a load.
            started = jax.tree.map(lambda x: jnp.zeros(jnp.shape(x), jnp.result_type(x)), started)
            state = dataclasses.replace(state, parts={**own, **started} or None)
            with user_function(f"{type(effect).__name__}.load"):
                load = effect.load(t, state, body)
            # A rate is of the same kind as the state itself.
            rate = effect.constrained(t, state, state)
        # Any error for a part that is absent.
        except Exception as error:
            failure = error
            continue
        if not isinstance(load, Load):
            name, kind = type(effect).__name__, type(load).__name__
            raise InputError(f"{name}.load returns {kind}: it must return a Load.")
        guided = [part for part in PARTS if getattr(rate, part) is not getattr(state, part)]
        words = {word for word, (f, _) in CONTRIBUTIONS.items() if getattr(load, f) is not None}
        words |= {GUIDED[part] for part in guided if part in GUIDED}
        changed = frozenset().union(*(CONTRIBUTIONS[word][1] for word in words))
        results = [load, *(getattr(rate, part) for part in guided)]
        held = (parts, frozenset(own) | frozenset(started))
        return _Trace(held, jax.tree.leaves(results), frozenset(words), parts | changed, started)
    assert failure is not None
    raise failure


def _states(present: frozenset[str]) -> Iterator[frozenset[str]]:
    """Sets of parts with those `present`, small ones first."""
    groups = [group for group in (TRANSLATION, ROTATION, MASS) if not group <= present]
    for count in range(len(groups) + 1):
        for chosen in itertools.combinations(groups, count):
            yield present.union(*chosen)


def _in_pairs(parts: frozenset[str]) -> frozenset[str]:
    """Complete pairs that are integrated together: position, velocity; attitude, angular rate."""
    for pair in (TRANSLATION, ROTATION):
        parts |= pair if parts & pair else frozenset()
    return parts
