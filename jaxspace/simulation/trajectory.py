"""Result of a run: times, states, status, cost and error estimate."""

import dataclasses
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, TypeVar, final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PyTree

from ..core import AbstractSystem, InputError, Scalar, State
from ..core.jit import quick_jit
from ..core.layout import run_axes_of
from ..core.listed import no_method
from ..core.status import Status
from ..core.structure import HashedModule
from ..integration.accuracy import Accuracy
from ..integration.config import IntegrationConfig
from ..integration.crossings import Crossings
from ..integration.event_zero import pick
from ..integration.integrate import take_step
from ..integration.layout import state_at, times_first
from ..integration.result import DenseOutput, IntegrationResult
from ._dataset import dataset_of
from ._integrator import of_each_run
from ._rerun import final_state_again, last_finite, starts_of_parts, with_stored_steps
from ._summary import summary_of_run
from .run_call import RunCall

if TYPE_CHECKING:
    import os
    from pathlib import Path

    import xarray
    from matplotlib.figure import Figure

T = TypeVar("T")


@final
class Trajectory(HashedModule):
    """Result of a run or of a batch of runs. The axes are components, times, runs.

    - `ts`: save times, s, (times,) or (times, runs). If an event stopped a run, its later times
      are the time of the event.
    - `states`: the states at these times: a position is (3, times) or (3, times, runs).
    - `status`: a `Status` for each run, (*runs,). In a failed run, states that were not reached
      within the tolerance are NaN.
    - `event`: index of the event that stopped the run, -1 for none.
    - `happened`: whether each event happened at that time, (events, *runs): several conditions can
      be zero simultaneously.
    - `stats`: steps, evaluations of the vector field, largest local error in units of the
      tolerance.
    - `run_axes`: number of batch axes, 0 for a single run.
    - `dense`: the steps of the run, if `dense=True`; they do not contain the exact part of the
      motion (`AbstractSystem.decoupled`).
    - `crossings`: every zero of each event that is not terminal, as `Crossings`; in a failed run,
      those before the failure.
    - `control`: in a phase that is a closed loop, its `commands` and `readings`, with the shapes of
      the states, and the `memory` of the controller at the end; otherwise `None`.
    - `call`: system and settings of the run; `None` within `Campaign.outputs`, whose functions have
      access to the numbers only.

    It can also be used like the result of a mission with one phase: `phases`, `end`, `branches`,
    `evaluations`."""

    ts: Float[Array, "times *#runs"]
    states: State
    status: Int[Array, "*runs"]
    event: Int[Array, "*runs"]
    happened: Bool[Array, "events *#runs"]
    stats: dict[str, Array]
    run_axes: int = eqx.field(static=True)
    dense: DenseOutput | None = None
    crossings: tuple[Crossings, ...] = ()
    control: dict[str, PyTree] | None = None
    call: RunCall | None = None

    @property
    def system(self) -> AbstractSystem:
        """The system, as passed by the caller. Raises `InputError` within `Campaign.outputs`."""
        return self._known_call.system

    @property
    def accuracy(self) -> Accuracy:
        """The accuracy, as passed by the caller. Raises as `system` does."""
        return self._known_call.accuracy

    @property
    def config(self) -> IntegrationConfig:
        """The method and the tolerances, resolved from the accuracy. Raises as `system` does."""
        return self._known_call.config

    @property
    def _known_call(self) -> RunCall:
        if self.call is None:
            raise InputError(
                "Inside Campaign.outputs a phase has times, states and status only, without its "
                "system: replay the run instead, campaign.replay(number, seed)."
            )
        return self.call

    @property
    def final(self) -> State:
        """The state at the last time: a position is (3, *runs)."""
        return _program_state_at(self.states, -1, self.run_axes)

    @property
    def initial(self) -> State:
        """The state at the first time."""
        return _program_state_at(self.states, 0, self.run_axes)

    @property
    @no_method
    def phases(self) -> "tuple[Trajectory, ...]":
        """The run itself, as a mission with one phase."""
        return (self,)

    @property
    def end(self) -> Float[Array, "*runs"]:
        """The last time, s."""
        return self.ts[-1]

    @property
    @no_method
    def branches(self) -> tuple[()]:
        """Empty: a system has no branches."""
        return ()

    @property
    def evaluations(self) -> Array:
        """Evaluations of the vector field."""
        return self.stats["evaluations"]

    # Its own class, for callers that take either result: `Self` cannot be checked at run time.
    def with_phases(self, phases: "Iterable[Trajectory]", status: Array) -> Any:
        """The result with another phase and another status."""
        (run,) = phases
        return dataclasses.replace(run, status=status)

    @property
    def undisturbed(self) -> bool:
        """Whether only the system changed the state, without jumps at events or a controller."""
        return self.control is None and not self._jumps

    def __getitem__(self, k: int) -> State:
        """The state at the k-th time."""
        times = self.ts.shape[0]
        if not -times <= k < times:
            raise IndexError(f"Index {k} is out of range: the run has {times} saved times.")
        return state_at(self.states, k, self.run_axes)

    def __len__(self) -> int:
        return self.ts.shape[0]

    def of(self, i: int) -> "Trajectory":
        """The i-th run of a batch, as a trajectory of one run.

        Raises `InputError` if this is one run already."""
        if self.run_axes == 0:
            raise InputError("This trajectory is a single run and cannot be indexed by run number.")
        runs = self.status.shape[-1]
        if not -runs <= i < runs:
            raise InputError(f"Run number {i} is out of range: the batch has {runs} runs.")
        # All runs may share one count.
        stats = {name: x[..., i] if x.ndim else x for name, x in self.stats.items()}
        names = ("ts", "states", "status", "event", "happened", "dense", "crossings", "control")
        parts = jax.tree.map(lambda x: x[..., i], {name: getattr(self, name) for name in names})
        call = self.call
        if call is not None:
            call = RunCall(run_of(call.system, i), run_of(call.accuracy, i), run_of(call.config, i))
        return Trajectory(**parts, stats=stats, run_axes=0, call=call)

    def at(self, t: Scalar) -> State:
        """The state at the time `t`, s, between the save times, as accurate as the steps.

        It performs one step of the method from the last step end before `t`. For several times,
        vectorise it: `jax.vmap(run.at, out_axes=-1)(ts)`. The state is NaN outside of the run, and
        at times not reached by a failed run.

        **Raises** `InputError` for a run without `dense=True`, unless it is a closed form, and for
        a run with in-place jumps (`Event.then`)."""
        if self._jumps:
            raise InputError(
                "The run contains jumps (Event.then) and stores no states between its saved times: "
                "the requested times must be among ts."
            )
        if not self.has_steps:
            raise InputError(
                "The run stores no states between its saved times: simulate it with dense=True."
            )
        return self._at(jnp.asarray(t, self.ts.dtype))

    @property
    def has_steps(self) -> bool:
        """Whether `at` gives the states between the save times: of a closed form, or of a run with
        `dense=True`, and without jumps."""
        exact = self.call is not None and self.config.method == "closed_form"
        return not self._jumps and (exact or self.dense is not None)

    @property
    def _jumps(self) -> bool:
        """Whether the run has in-place jumps, at events with `then`."""
        return any(result.after is not None for result in self.crossings)

    def with_steps(self) -> "tuple[Trajectory, ...]":
        """The run with its steps, so that `at` gives the state at any time, in consecutive parts:
        from each in-place jump (`Event.then`) to the next.

        It is the run itself if it `has_steps`. Otherwise it is repeated from its first state, with
        the same method and tolerances, up to its last finite state.

        **Raises** `InputError` for a batch (use `run.of(i)`) and for a closed loop."""
        if self.control is not None:
            raise InputError(
                "The run is a closed loop, which cannot be repeated without its controller: "
                "simulate it with more save times (ts, or num_saved for a mission)."
            )
        if self.run_axes:
            raise InputError("with_steps applies to a single run: use run.of(0) of a batch.")
        if self.has_steps:
            return (self,)
        starts = starts_of_parts(float(self.ts[0]), self.initial, self.crossings)
        ends = [t for t, _ in starts[1:]] + [float(self.ts[last_finite(self.states)])]
        parts = [(y, t0, t1) for (t0, y), t1 in zip(starts, ends, strict=True)]
        # Jumps at one time are parts without a duration.
        return tuple(self._part(y, t0, t1) for y, t0, t1 in parts if t0 != t1)

    def _part(self, y0: State, t0: float, t1: float) -> "Trajectory":
        """The part of the run from the state `y0` at `t0` to `t1`, s, with its steps."""
        ts = jax.device_put(np.asarray([t0, t1], self.ts.dtype))
        # The program takes far longer to compile than to run.
        config = self.config.rolled_stages()
        result = with_stored_steps(self.system, y0, ts, config)
        # As the run itself, of which these states were finite.
        part = without_events(ts, result._replace(status=jnp.zeros_like(result.status)), 0)
        return dataclasses.replace(part, call=RunCall(self.system, self.accuracy, config))

    # One program, because a step has hundreds of operations.
    @quick_jit
    def _at(self, t: Array) -> State:
        # One time for each run, because the steps differ between runs.
        t = jnp.broadcast_to(t, self.ts.shape[1:])
        closed_form = self.system.closed_form() if self.config.method == "closed_form" else None
        if closed_form is not None:
            state = closed_form.flow(t - self.ts[0], self.initial)
        else:
            state = self._one_step(t)
        first, last = self.ts[0], self.ts[-1]
        inside = (t - first) * (t - last) <= 0.0
        inside = inside & (self._valid_at(t) | (t == first))
        return jax.tree.map(lambda x: jnp.where(inside, x, jnp.nan), state)

    def _sign(self) -> Array:
        """1 for a run forwards in time, -1 for one backwards."""
        return jnp.where(self.ts[-1] < self.ts[0], -1.0, 1.0).astype(self.ts.dtype)

    def _valid_at(self, t: Array) -> Array:
        """Whether the run reached the time `t`, s, within its tolerance."""
        good = self.status <= Status.EVENT
        if self.dense is None:
            return good
        # A run whose steps ran out is valid up to its last step.
        sign = self._sign()
        steps = self.dense.ts
        last = jnp.max(jnp.where(jnp.isfinite(steps), sign * steps, -jnp.inf), axis=0)
        return good | ((self.status == Status.MAX_STEPS) & (sign * t <= last))

    def _one_step(self, t: Array) -> State:
        assert self.dense is not None
        steps = self.dense.ts
        sign = self._sign()
        # The number of the last step end at or before t; the ends ascend in the direction of time.
        passed = jnp.sum(sign * steps <= sign * t, axis=0) - 1
        # A time before the start gets the first step, and becomes NaN later.
        index = jnp.clip(passed, 0, steps.shape[0] - 1)

        rows = times_first(self.dense.states, self.run_axes), steps
        y, start = pick(rows, index, self.run_axes)
        decoupled = self.system.decoupled() if self.config.decoupled else None
        system = self.system if decoupled is None else decoupled.rest
        y = take_step(system, y, start, t, self.config, self.run_axes)
        return y if decoupled is None else decoupled.joined(t - self.ts[0], self.initial, y)

    def along(self, function: Callable[[AbstractSystem, Scalar, State], PyTree]) -> PyTree:
        """`function(system, t, y)` of one time and one state, at every time of every run.

        Times and runs are the last axes of the result. Formulas of the library do not need `along`:
        they apply to `states` directly."""
        times = jax.vmap(function, in_axes=(None, -1, -1), out_axes=-1)
        if self.run_axes == 0:
            return times(self.system, self.ts, self.states)
        # Arrays of a system without a declaration are shared.
        axes = run_axes_of(self.system, lambda x: 0)
        axes = jax.tree.map(lambda n: -1 if n else None, axes)
        # `jax.vmap` takes arrays alone; other leaves of the system are passed around it.
        arrays, static = eqx.partition(self.system, eqx.is_array)
        axes, _ = eqx.partition(axes, jax.tree.map(eqx.is_array, self.system))

        def one(arrays: PyTree, ts: Array, states: State) -> PyTree:
            return times(eqx.combine(arrays, static), ts, states)

        return jax.vmap(one, in_axes=(axes, -1, -1), out_axes=-1)(arrays, self.ts, self.states)

    def drift(self) -> dict[str, Float[Array, "times *#runs"]]:
        """Change of every invariant since the first time, relative to its size.

        Absolute for an invariant that is zero at the first time."""
        return _program_drift(self)

    def error(self) -> State:
        """Estimate of the global error of the final state, component by component.

        The change of the state when the run is repeated with a hundredth of the tolerance (and half
        the `max_step`, or twice as many fixed steps); for a closed form, when the duration is
        divided into two parts. NaN if the repetition reaches the maximum number of steps. A pulse
        missed by both runs goes unnoticed (`Accuracy.max_step`).

        **Raises** `InputError` for a run with in-place jumps or with a controller."""
        self.check_repeatable("error")
        again = final_state_again(
            self.system, self.initial, self.ts, self.config.tightened(0.01), self.run_axes
        )
        return jax.tree.map(lambda a, b: jnp.abs(a - b), self.final, again)

    def check_repeatable(self, what: str) -> None:
        """Raise `InputError` for a run that cannot be reproduced from its system only: a run with
        in-place jumps (`Event.then`), or a closed loop."""
        if self.control is not None:
            raise InputError(
                f"{what} repeats a run without its controller and is not available for a closed "
                "loop: it requires the run of a system alone."
            )
        if self._jumps:
            raise InputError(
                f"{what} repeats a run and is not available for one with jumps (Event.then): "
                "simulate it again with its events."
            )

    def to_xarray(self) -> "xarray.Dataset":
        """The run as a data set with named axes and units: (component, time, run)."""
        return dataset_of(self.ts, self.states, self.status, self.run_axes)

    def plot(self) -> "Figure":
        """A figure of the run: its path, orbit or axis, depending on the states."""
        # Imported here, because matplotlib is an extra, and slow to import.
        from ..plots import trajectory_figure

        return trajectory_figure(self)

    def show(self, path: "str | os.PathLike[str] | None" = None) -> "Path":
        """Open an animated 3-D view of the run in the browser (`jaxspace.plots.view_page`)."""
        from ..plots import show_run

        return show_run(self, path)

    def __repr__(self) -> str:
        return summary_of_run(self).text()

    def _repr_html_(self) -> str:
        return summary_of_run(self).html()


def without_events(ts: Array, result: IntegrationResult, run_axes: int) -> Trajectory:
    """The run through `ts`, (times,) or (times, *runs), of an integration."""
    runs = result.status.shape
    which = -jnp.ones(runs, jnp.int32)
    happened = jnp.zeros((0, *runs), bool)
    run = of_each_run(ts, runs), result.states, result.status, which, happened, result.stats
    return Trajectory(*run, run_axes, result.dense)


def relative_change(values: Array, run_axes: int) -> Float[Array, "times *#runs"]:
    """Change of (components, times, *runs) since the first time, relative to the size there.

    Absolute where that is zero."""
    components = tuple(range(values.ndim - 1 - run_axes))
    rows = jnp.moveaxis(values, len(components), 0)
    axes = tuple(range(1, 1 + len(components)))
    size = jnp.sqrt(jnp.sum(rows[:1] ** 2, axis=axes))
    change = jnp.sqrt(jnp.sum((rows - rows[:1]) ** 2, axis=axes))
    return change / jnp.where(size > 0.0, size, 1.0)


# One program, because outside of `jit` each operation on the invariants would be compiled by
# itself.
@quick_jit
def _program_drift(run: Trajectory) -> dict[str, Float[Array, "times *#runs"]]:
    invariants = run.along(lambda system, t, y: system.invariants(t, y))
    return {name: relative_change(values, run.run_axes) for name, values in invariants.items()}


# One program, because outside of `jit` each array of the state would be a separate call.
_program_state_at = jax.jit(state_at, static_argnums=(1, 2))


def run_of(tree: T, i: int, undeclared: int = 0) -> T:
    """The i-th run of a tree, whose arrays carry runs as their fields declare.

    `undeclared`: the most axes of runs of an array whose field declares nothing."""
    axes = run_axes_of(tree, lambda x: min(x.ndim, undeclared))
    return jax.tree.map(lambda x, n: x[..., i] if n else x, tree, axes)
