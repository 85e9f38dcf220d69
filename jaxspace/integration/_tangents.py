"""The tangents of a differentiated run, integrated together with its motion, for the control of its
steps.

    d_j        tangent of the state along a direction of the inputs, j = 1, 2, ...

Each differentiated array of the field has a separate direction, so that a large tangent does not
hide a small one; with more than `MOST_DIRECTIONS` arrays several share one. The blocks of the
initial state share one, because each block of the tangents has its own error. The direction is
fixed and pseudo-random, with each number changing by its own size, or by one where it is zero.

The controlled quantities: `_sensitivity_control.py`.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple, TypeAlias, final

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PyTree

from ..core import State
from ..solvers.embedded_errors import is_in_parts
from ..solvers.protocol import field_of_step
from ..solvers.tolerances import Tolerance
from ..solvers.vector_field import ScaledField
from .normalised_time import field_of_part

MOST_DIRECTIONS = 8
"""Largest number of directions."""

# The length of each block of the state, for each direction and run.
Lengths: TypeAlias = PyTree[Float[Array, "directions ..."]]


class TangentState(NamedTuple):
    """The tangents along the directions at one place of a run.

    - `tangents`: of the state, with the directions on the first axis.
    - `sizes`, `errors`: the largest of the tangents and of their errors so far.
    - `resolved`, `longest`: the longest accepted step known to be resolved, and of all, s.
    - `monitored`, `time`: the time in accepted steps that were monitored, and in all, s.
    - `steep`: the largest error in those that were short, and in the step to the event, in units
      of the allowed error; `ended`: whether the latter was monitored.
    - `controlled`: whether every step is monitored, and controlled by the tangents."""

    tangents: State
    sizes: Lengths
    errors: Lengths
    resolved: Float[Array, "*runs"]
    longest: Float[Array, "*runs"]
    monitored: Float[Array, "*runs"]
    time: Float[Array, "*runs"]
    steep: Float[Array, "*runs"]
    ended: Bool[Array, "*runs"]
    controlled: Bool[Array, "*runs"]


@final
class Directions(eqx.Module):
    """The directions of the inputs along which the tangents of a run are followed.

    - `numbers`: of the arrays of the field that are differentiated.
    - `of_field`: of these arrays, with the directions on the first axis.
    - `start`: of the initial state, likewise."""

    numbers: tuple[int, ...] = eqx.field(static=True)
    of_field: list[Array]
    start: State

    @classmethod
    def of(
        cls, field: PyTree, y0: State, moving: tuple[PyTree[bool], PyTree[bool]], run_axes: int
    ) -> "Directions | None":
        """The directions of a run that is differentiated by what is `moving` in its field and its
        initial state; `None` where there is none with a number."""
        leaves = zip(*map(jax.tree.leaves, ((field, y0), moving)), strict=True)
        inputs, flags = zip(*((x, m) for x, m in leaves if eqx.is_array(x)), strict=True)
        blocks, structure = jax.tree.flatten(y0)
        num_field = len(inputs) - len(blocks)
        numbers = [k for k, x in enumerate(inputs) if flags[k] and x.size]
        if not numbers:
            return None
        # One number for all blocks of the state.
        names = [min(k, num_field) for k in numbers]
        number = {name: i % MOST_DIRECTIONS for i, name in enumerate(dict.fromkeys(names))}
        direction = {k: number[name] for k, name in zip(numbers, names, strict=True)}
        count = min(len(number), MOST_DIRECTIONS)

        def rows(k: int) -> Array:
            x = inputs[k]
            every = jnp.zeros((count, *x.shape), x.dtype)
            if k not in direction:
                return every
            axes = x.ndim - (run_axes if k >= num_field else 0)
            return every.at[direction[k]].set(_direction(x, axes, k))

        numbers = tuple(k for k in numbers if k < num_field)
        start = [rows(num_field + k) for k in range(len(blocks))]
        return cls(numbers, [rows(k) for k in numbers], jax.tree.unflatten(structure, start))

    def packed(self, vector: Callable[[State], Array]) -> "Directions":
        """The directions of a run whose state is a vector."""
        return Directions(self.numbers, self.of_field, jax.vmap(vector)(self.start))

    def begin(self, tolerance: Tolerance) -> TangentState:
        """The tangents before the first step."""
        sizes = lengths(tolerance, self.start)
        none = jax.tree.map(jnp.zeros_like, sizes)
        controlled = jnp.zeros_like(jax.vmap(tolerance.alive)(self.start)[0])
        time = jnp.zeros(controlled.shape)
        return TangentState(
            self.start,
            sizes,
            none,
            resolved=time,
            longest=time,
            monitored=time,
            time=time,
            steep=time,
            ended=controlled,
            controlled=controlled,
        )

    def after(
        self,
        method: diffrax.AbstractSolver,
        term: diffrax.AbstractTerm,
        field: ScaledField,
        step: "StepTaken",
        tangents: State,
    ) -> tuple[State, PyTree]:
        """The tangents after a step, and the estimates of their errors."""
        arrays, static = eqx.partition(field, eqx.is_array)
        leaves, structure = jax.tree.flatten(arrays)
        t0, t1 = jnp.zeros_like(step.s, shape=()), jnp.ones_like(step.s, shape=())

        def of(moving: list[Array], y: State) -> tuple[State, PyTree]:
            every = list(leaves)
            for k, x in zip(self.numbers, moving, strict=True):
                every[k] = x
            field = eqx.combine(jax.tree.unflatten(structure, every), static)
            field, _ = field_of_part(field, step.s, step.length)
            seen = field_of_step(method, field, t0, t1)
            state = method.init(term, t0, t1, y, seen)
            y1, error, *_ = method.step(term, t0, t1, y, seen, state, jnp.array(False))
            return y1, error

        moving = [leaves[k] for k in self.numbers]

        def tangent(direction: tuple[list[Array], State]) -> tuple[State, PyTree]:
            return jax.jvp(of, (moving, step.y0), direction)[1]

        # Along a single run together, which takes little more than one of them does. For many runs,
        # whose axis has to be the last one, that would take several times as long as one after the
        # other, in the layout of the motion.
        every = jax.vmap(tangent) if step.motion.ndim == 0 else partial(jax.lax.map, tangent)
        return every((self.of_field, tangents))


class StepTaken(NamedTuple):
    """A step of each run: its start and its length in normalised time, the states at its ends, its
    error in units of the tolerance, the number of the steps before it, and whether the last of them
    was rejected."""

    s: Float[Array, "*#runs"]
    length: Float[Array, "*#runs"]
    y0: State
    y1: State
    motion: Float[Array, "*runs"]
    number: Int[Array, "*#runs"]
    retried: Bool[Array, "*#runs"]


def lengths(tolerance: Tolerance, tangents: PyTree) -> Lengths:
    """The length of each block of tangents, or of their errors."""
    # One after the other: of blocks in a vector all of them would be a product of matrices, by a
    # library, and a loop with such a call is not compiled as one kernel.
    each = partial(jax.lax.map, tolerance.length)
    return jax.tree.map(each, tangents, is_leaf=is_in_parts)


def _direction(x: Array, axes: int, seed: int) -> Array:
    """A pseudo-random change of each number by about its size.

    A number that is zero changes as the largest one along the first `axes`, and where all are zero
    by about one."""
    size = jnp.where(jnp.isfinite(x), jnp.abs(x), 0.0)
    largest = jnp.max(size, axis=tuple(range(axes)), keepdims=True)
    size = jnp.where(size > 0.0, size, jnp.where(largest > 0.0, largest, 1.0))
    random, shape = np.random.default_rng(seed), x.shape[:axes]
    parts = np.asarray(random.uniform(0.5, 1.0, shape) * random.choice([-1.0, 1.0], shape))
    return size * parts.reshape((*shape, *(1,) * (x.ndim - axes))).astype(x.dtype)
