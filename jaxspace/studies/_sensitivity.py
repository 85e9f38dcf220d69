"""State-transition matrices: derivatives of a run with respect to its initial state and parameters.

    Phi(t)   = d y(t) / d p            first order      (rows, columns, times, *runs)
    Psi(t)   = d^2 y(t) / d p^2        second order     (rows, columns, columns, times, *runs)
    y(t; p + x) = y + Phi x + x^T Psi x / 2 + ...

    symbol  meaning
    y       state, in the coordinates of `rows`
    p       selection by `wrt` of initial state and system, in those of `columns`

The derivatives are those of the run itself, along its own steps, in forward mode: the run is
computed once, and every column adds a tangent. They include the shift of event times and its
consequences (the saltation matrix), the durations of phases, jumps and breaks.

A quaternion counts with three coordinates, the small rotation in body axes, rad.

Source: Battin, An Introduction to the Mathematics and Methods of Astrodynamics, 9.5; Park and
Scheeres (J. Guid. Control Dyn. 29, 2006) for the second order.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, final, overload

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float, PyTree

from ..core import AbstractSystem, InputError, State
from ..core.jit import quick_jit
from ..core.printing import printed
from ..core.structure import HashedModule
from ..integration.accuracy import as_accuracy
from ..simulation import Accuracy, Event, Mission, MissionTrajectory, Trajectory
from ..simulation.batch_layout import InAxes, split_batch
from ..simulation.dispatch import simulate_any
from ._factors import Factors, factors_of
from .coordinates import Coordinates, name_of

Selection = Callable[[Any, Any], PyTree]


def initial_state(system: AbstractSystem | Mission, y0: PyTree) -> PyTree:
    """The default of `wrt` in `sensitivity`: every component of the initial state."""
    del system
    return y0


@final
@printed()
class Sensitivity(HashedModule):
    """The derivatives of the states of a run, or of one phase of a mission.

    - `rows`, `columns`: names of the components of the state, and of the varied quantities.
    - `first`: Phi, (rows, columns, times, *runs), in units of the row per unit of the column.
    - `second`: Psi, (rows, columns, columns, times, *runs), or `None`.
    - `times`: d(ts)/dp, s per unit, (columns, times, *runs): non-zero if an event ends the run.
    """

    rows: tuple[str, ...] = eqx.field(static=True)
    columns: tuple[str, ...] = eqx.field(static=True)
    first: Float[Array, "rows columns times *runs"]
    second: Float[Array, "rows columns columns times *runs"] | None
    times: Float[Array, "columns times *runs"]

    @property
    def final(self) -> Float[Array, "rows columns *runs"]:
        """Phi at the last time."""
        return self.first[:, :, -1]

    def change(self, x: Float[ArrayLike, "columns *#runs"]) -> Float[Array, "rows times *runs"]:
        """Change of the states for a change `x` of the varied quantities, to the computed order."""
        x = jnp.asarray(x)
        lead = jnp.expand_dims(x, 1)
        result = jnp.einsum("rct...,c...->rt...", self.first, x)
        if self.second is not None:
            result += 0.5 * jnp.einsum("rcdt...,ct...,dt...->rt...", self.second, lead, lead)
        return result

    def covariance(
        self, initial: Float[ArrayLike, "columns columns *#runs"]
    ) -> Float[Array, "rows rows times *runs"]:
        """Phi P Phi^T: the covariance of the states from that of the varied quantities, to first
        order."""
        known = factors_of(jnp.asarray(initial, self.first.dtype))
        columns = jnp.einsum("act...,ck...->akt...", self.first, known.columns)
        # Behind the axis of the columns, where `first` has its times.
        return Factors(columns, jnp.expand_dims(known.weights, 1)).product


@final
@printed()
class MissionSensitivity(eqx.Module):
    """The derivatives of a mission: of its `phases` by index or name, and of its end.

    - `phases`: a `Sensitivity` for each phase; its rows are those of the state in that phase.
    - `names`: of the phases.
    - `end`: of the state after the last jump and of its time, as a `Sensitivity` with one time."""

    phases: tuple[Sensitivity, ...]
    names: tuple[str, ...] = eqx.field(static=True)
    end: Sensitivity

    def __getitem__(self, phase: int | str) -> Sensitivity:
        return self.phases[self.names.index(phase) if isinstance(phase, str) else phase]


@overload
def sensitivity(
    system: AbstractSystem,
    y0: State,
    ts: Float[ArrayLike, "times *#runs"],
    *,
    wrt: Selection = initial_state,
    order: int = 1,
    batch: bool = False,
    in_axes: InAxes = None,
    accuracy: Accuracy | Float[ArrayLike, ""] | None = None,
    events: Sequence[Event] = (),
    dense: bool = False,
    throw: bool | None = None,
) -> tuple[Trajectory, Sensitivity]:
    """The derivatives along a run of a system."""
    ...


@overload
def sensitivity(
    system: Mission,
    y0: State,
    ts: Float[ArrayLike, "*runs"] = 0.0,
    *,
    wrt: Selection = initial_state,
    order: int = 1,
    batch: bool = False,
    in_axes: InAxes = None,
    accuracy: Accuracy | Float[ArrayLike, ""] | None = None,
    num_saved: int = 2,
    throw: bool | None = None,
) -> tuple[MissionTrajectory, MissionSensitivity]:
    """The derivatives along the phases of a mission."""
    ...


def sensitivity(
    system: AbstractSystem | Mission,
    y0: State,
    ts: Float[ArrayLike, "*times"] = 0.0,
    *,
    wrt: Selection = initial_state,
    order: int = 1,
    batch: bool = False,
    in_axes: InAxes = None,
    accuracy: Accuracy | Float[ArrayLike, ""] | None = None,
    events: Sequence[Event] = (),
    dense: bool = False,
    num_saved: int | None = None,
    throw: bool | None = None,
) -> tuple[Trajectory, Sensitivity] | tuple[MissionTrajectory, MissionSensitivity]:
    """A run, and the derivatives of its states with respect to its initial state and its
    parameters.

    **Arguments**

    - `system`, `y0`, `ts`: a system and its save times, as in `simulate`, or a mission and the time
      of its start, as in `simulate_mission`.
    - `wrt`: a function (system, y0) -> pytree of the arrays that are varied, such as
      `lambda scene, y0: (y0, scene.effects[0].mu)`; by default the initial state.
    - `order`: 1, or 2 to include second derivatives.
    - `batch`: whether the last axis is the batch axis, as in `simulate_batch`; `in_axes` as there.
      An array shared by the runs has one common column.
    - `accuracy`: as in `simulate`.
    - `events`, `dense`: as in `simulate`, for a system.
    - `num_saved`: as in `simulate_mission`, for a mission.
    - `throw`: whether to raise `SimulationError` for a failed run; by default for a single run, not
      for a batch.

    **Returns** the run, and its `Sensitivity`, or `MissionSensitivity` for a mission.

    **Raises** `InputError` as `simulate` does, and for an order other than 1 or 2 or a selection
    without real numbers."""
    if order not in (1, 2):
        raise InputError(f"order is {order!r}: it must be 1 or 2.")
    options = {
        "accuracy": as_accuracy(accuracy),
        "events": events,
        "dense": dense,
        "num_saved": num_saved,
        "batch": batch,
        "in_axes": in_axes,
        "throw": throw,
    }
    leaves, structure = jax.tree.flatten((system, y0))
    # Numbers in place of the arrays, so that the compiled program depends on the selected arrays,
    # and not on the function that selects them.
    picked = wrt(*jax.tree.unflatten(structure, range(len(leaves))))
    numbers, shape = jax.tree.flatten(picked)
    if not numbers or not all(isinstance(n, int) for n in numbers):
        raise InputError(
            "wrt must return a pytree of arrays of the system or of the initial state."
        )
    # What is shared by the runs is one column for all of them, and not one for each.
    carried = _carried(system, y0, ts, in_axes) if batch else [0] * len(leaves)
    choice = _Choice(tuple(numbers), shape, tuple(carried[n] for n in numbers))
    return _derivatives(system, y0, ts, choice, order, options)


class _Choice(NamedTuple):
    """The varied quantities: the numbers of the leaves, the structure of the pytree returned by
    `wrt`, and whether each is batched."""

    numbers: tuple[int, ...]
    structure: jax.tree_util.PyTreeDef
    run_axes: tuple[int, ...]

    def columns(self, system: AbstractSystem | Mission, y0: State) -> Coordinates:
        paths, leaves = zip(*jax.tree_util.tree_flatten_with_path((system, y0))[0], strict=True)
        tree = jax.tree.unflatten(self.structure, [jnp.asarray(leaves[n]) for n in self.numbers])
        # Without the number that distinguishes the system from the state.
        names = [name_of(paths[n][1:]) for n in self.numbers]
        return Coordinates.of(tree, self.run_axes, names)


def _carried(
    system: AbstractSystem | Mission, y0: State, ts: ArrayLike, in_axes: InAxes
) -> list[int]:
    """For every leaf of the system and of the initial state, whether it is batched."""
    times_axes = 0 if isinstance(system, Mission) else 1
    batched, _, _ = split_batch(system, y0, ts, in_axes, times_axes)
    every, own = (
        jax.tree.leaves(tree, is_leaf=lambda x: x is None) for tree in ((system, y0), batched[:2])
    )
    return [int(b is not None) for a, b in zip(every, own, strict=True) if a is not None]


@quick_jit
def _derivatives(
    system: AbstractSystem | Mission,
    y0: State,
    ts: ArrayLike,
    choice: _Choice,
    order: int,
    options: dict[str, Any],
) -> tuple[Trajectory, Sensitivity] | tuple[MissionTrajectory, MissionSensitivity]:
    leaves, structure = jax.tree.flatten((system, y0))
    columns = choice.columns(system, y0)
    held = []

    def parts_at(x: Array) -> tuple[PyTree, PyTree]:
        moved = list(leaves)
        for n, leaf in zip(choice.numbers, jax.tree.leaves(columns.moved(x)), strict=True):
            moved[n] = leaf
        near, start = jax.tree.unflatten(structure, moved)
        run = simulate_any(near, start, ts, **options)
        # Leaves other than arrays bypass the transformations.
        arrays, static = eqx.partition(run, eqx.is_array)
        held.append(static)
        return _parts(run), arrays

    units = jnp.eye(columns.count, dtype=columns.dtype)

    def first(x: Array) -> tuple[PyTree, PyTree]:
        """The tangents of every column, and the run."""

        def column(e: Array) -> tuple[PyTree, PyTree]:
            _, tangent, arrays = jax.jvp(parts_at, (x,), (e,), has_aux=True)
            return tangent, arrays

        # `None`: the run depends on no column, and is computed once for all of them.
        return jax.vmap(column, out_axes=(0, None))(units)

    x = jnp.zeros(columns.count, columns.dtype)
    tangents = None
    arrays = None
    seconds = None
    if order == 1:
        tangents, arrays = first(x)
    else:

        def column(e: Array) -> tuple[PyTree, PyTree, PyTree]:
            # Forward over forward: the first tangents are there already, and reverse mode would
            # store every step.
            tangents, change, arrays = jax.jvp(first, (x,), (e,), has_aux=True)
            return tangents, change, arrays

        tangents, seconds, arrays = jax.vmap(column, out_axes=(None, 0, None))(units)
    run = eqx.combine(arrays, held[-1])
    result = []
    for k, (states, _) in enumerate(_parts(run)):
        second = None if seconds is None else seconds[k][0]
        result.append(_of_part(states, tangents[k], second, columns.labels, int(options["batch"])))
    if isinstance(run, Trajectory):
        return run, result[0]
    return run, MissionSensitivity(tuple(result[:-1]), run.names, result[-1])


def _parts(run: Trajectory | MissionTrajectory) -> list[tuple[State, Array]]:
    """States and times, the last with an axis of one time for the end of a mission."""
    if isinstance(run, Trajectory):
        return [(run.states, run.ts)]
    runs = run.end.ndim
    final = jax.tree.map(lambda x: jnp.expand_dims(x, x.ndim - runs), run.final)
    return [*((phase.states, phase.ts) for phase in run.phases), (final, run.end[None])]


def _of_part(
    states: State,
    tangents: tuple[State, Array],
    second: State | None,
    names: tuple[str, ...],
    runs: int,
) -> Sensitivity:
    rows = Coordinates.of(states, 1 + runs)
    along, times = tangents
    matrix = jax.vmap(rows.components, out_axes=1)(along)
    psi = None
    if second is not None:
        psi = jax.vmap(jax.vmap(rows.components, out_axes=1), out_axes=1)(second)
    times = jnp.broadcast_to(
        times.reshape(*times.shape, *(1,) * (matrix.ndim - 1 - times.ndim)),
        (times.shape[0], *matrix.shape[2:]),
    )
    return Sensitivity(rows.labels, names, matrix, psi, times)
