"""A system, a sampled controller, and the sensors between them.

    u(t) = K(z_k)                                    t_k <= t < t_k + T         zero-order hold
    u(t) = u_k + (u_k - u_{k-1}) (t - t_k) / T                                  first-order hold

    symbol     meaning                                            unit
    t_k, T     samples, period                                    s
    z_k, u_k   measurement and command at the sample k            any
    K          controller, which may have a memory

Source: Franklin, Powell and Workman, Digital Control of Dynamic Systems, 4.3, 6.3 (holds), 10
(quantisation).
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Key, PRNGKeyArray, PyTree

from ..core import AbstractSystem, InputError, Scalar, State
from ..core.checks import check_positive, is_concrete
from ..core.field_types import check_types
from ..core.types import as_optional_float
from ..integration.accuracy import Accuracy
from ..integration.config import IntegrationConfig
from ..integration.events import Event
from ..integration.initial_state import state_dtype
from ..integration.layout import broadcast_state, runs_of
from ..simulation.trajectory import Trajectory
from ._controller import AbstractController, as_controller
from ._loop_run import LoopOptions, LoopRun, run_loop
from ._program import LoopInputs, Static, alone, as_events, as_key
from ._repeats import config_of, repeated
from ._sampled_loop import AbstractSampledLoop
from ._sensors import AbstractSensor, check_period, known_seconds
from .commands import Actuate, with_command

HOLDS = ("zero", "first")


def _as_sensors(x: object) -> Any:
    if x is None or not isinstance(x, Mapping):
        return x
    return dict(x)


@final
class ClosedLoop(AbstractSampledLoop):
    """A system with a sampled controller: `ClosedLoop(scene, law, period=0.1)`.

    - `system`: a scene or any system with actuators, such as `CommandedTorque`.
    - `controller`: an `AbstractController`, or a function `(measured) -> command` or
      `(t, measured) -> command`, such as an `equinox` network.
    - `sensors`: by name; the controller receives their readings by name, or the state without
      sensors.
    - `period`: between two samples, s; the first one is at the start of the run.
    - `hold`: "zero" keeps a command until the next one, "first" extrapolates linearly from the last
      two.
    - `delay`, s: until a command reaches the actuators; before the first, the command is zero.
    - `limit`, `quantum`: largest command, and quantisation step of commands, per component or for
      all.
    - `actuate`: a function (system, command) -> system, instead of the fields `command`.
    - `steps`: fixed steps between two samples.
    - `key`: of the noise, for runs without a key; for a batch of missions one for each run.
    - `longest`: the longest duration of the loop as a phase whose duration is traced, s.

    As the `system` of a `Phase` a loop can be used in a mission, and therefore in a campaign.

    Raises `InputError` for a period, a delay or a `longest` that is not a concrete time, and for an
    unknown hold."""

    system: AbstractSystem
    controller: AbstractController = eqx.field(converter=as_controller)
    sensors: dict[str, AbstractSensor] | None = eqx.field(converter=_as_sensors, default=None)
    period: float = eqx.field(
        static=True, converter=known_seconds("ClosedLoop.period"), kw_only=True
    )
    hold: str = eqx.field(static=True, default="zero", kw_only=True)
    delay: float = eqx.field(
        static=True, converter=known_seconds("ClosedLoop.delay"), default=0.0, kw_only=True
    )
    limit: Float[Array, "..."] | None = eqx.field(
        converter=as_optional_float, default=None, kw_only=True
    )
    quantum: Float[Array, "..."] | None = eqx.field(
        converter=as_optional_float, default=None, kw_only=True
    )
    actuate: Actuate = eqx.field(static=True, default=with_command, kw_only=True)
    steps: int = eqx.field(static=True, default=1, kw_only=True)
    key: Key[Array, "*#runs"] | None = eqx.field(default=None, kw_only=True)
    longest: float | None = eqx.field(
        static=True,
        converter=known_seconds("ClosedLoop.longest", optional=True),
        default=None,
        kw_only=True,
    )

    def __check_init__(self):
        check_types(self)
        check_period("ClosedLoop.period", self.period)
        if not 0.0 <= self.delay < float("inf"):
            raise InputError(
                f"ClosedLoop.delay is {self.delay}: it must be zero or positive, and finite, in s."
            )
        if self.hold not in HOLDS:
            raise InputError(f'ClosedLoop.hold is "{self.hold}": it must be "zero" or "first".')
        check_positive("ClosedLoop.limit", self.limit)
        check_positive("ClosedLoop.quantum", self.quantum)

    def lasting(self, longest: float) -> "ClosedLoop":
        return dataclasses.replace(self, longest=longest)

    def config(self, y0: PyTree, accuracy: Accuracy) -> IntegrationConfig:
        return config_of(self, y0, accuracy)

    def run(
        self,
        until: Scalar | Event,
        y0: State,
        t0: Scalar,
        num_saved: int,
        config: IntegrationConfig,
        run_axes: int,
    ) -> Trajectory:
        # The samples are known before the phase starts; its end need not be.
        duration = until.within if isinstance(until, Event) else until
        assert duration is not None  # of the event that ends a phase
        if is_concrete(duration):
            longest = float(np.max(np.asarray(duration)))
        elif self.longest is None:
            raise InputError(
                "ClosedLoop.longest is required when the duration of the phase is traced: give the "
                "longest possible duration of the phase, in s."
            )
        else:
            longest = self.longest
        ts = np.linspace(0.0, longest, num_saved)
        y0 = broadcast_state(self.system, t0, y0)
        dtype = state_dtype(y0)
        runs = runs_of(y0, run_axes)
        start = jnp.broadcast_to(jnp.asarray(t0, dtype), runs)
        # With a known end of the phase, the nodes end there already.
        end = (
            None
            if is_concrete(duration) and jnp.ndim(duration) == 0
            else jnp.asarray(duration, dtype)
        )
        key = as_key(self.key)
        if key is not None and key.shape != runs:
            raise InputError(
                f"ClosedLoop.key has the shape {key.shape}: for {runs} runs of a mission it must "
                "contain a key for each run, such as jax.random.split(key, runs)."
            )
        events = as_events((until,)) if isinstance(until, Event) else ()
        inputs = LoopInputs(self.numbers, y0, start, key, None, events, end)
        return repeated(alone, inputs, config, Static.of(self, ts, run_axes))[0]

    def simulate(
        self,
        y0: State,
        ts: ArrayLike | Sequence[float],
        *,
        key: PRNGKeyArray | None = None,
        accuracy: Accuracy | Float[ArrayLike, ""] | None = None,
        steps: int | None = None,
        events: Event | Sequence[Event] = (),
        start: Float[ArrayLike, ""] | None = None,
        memory: PyTree = None,
        throw: bool = True,
    ) -> LoopRun:
        """Simulate the loop from the state `y0`.

        **Arguments**

        - `y0`: the initial state. `ts`: save times, s, concrete and ascending; the first is that of
          `y0`, and of the first sample.
        - `key`: of the noise.
        - `accuracy`: the relative tolerance of the motion between two samples, or an `Accuracy`;
          1e-9 by default. Its method uses fixed steps.
        - `steps`: their number between two samples, overriding that of the loop. Outside of `jit` a
          run that misses the tolerance is repeated with more.
        - `events`: the run stops at the first zero of one of these; one with `within` must occur.
        - `start`: the time of `y0`, instead of the first of `ts`; it may be traced, so that a loop
          can continue where an event has ended another one.
        - `memory`: of the controller, as at the end of an earlier run.
        - `throw`: whether to raise `SimulationError` for a failed run; otherwise read its `status`.

        **Returns** a `LoopRun`, differentiable forwards and backwards with respect to every number
        in the loop and `y0`. **Raises** `InputError`, before anything is compiled, for an invalid
        loop."""
        options = LoopOptions(key, accuracy, steps, events, start, memory)
        return run_loop(self, y0, ts, options, 0, throw=throw)

    def simulate_batch(
        self,
        y0s: State,
        ts: ArrayLike | Sequence[float],
        *,
        key: PRNGKeyArray | None = None,
        accuracy: Accuracy | Float[ArrayLike, ""] | None = None,
        steps: int | None = None,
        events: Event | Sequence[Event] = (),
        start: Float[ArrayLike, "*runs"] | None = None,
        memory: PyTree = None,
        throw: bool = False,
    ) -> LoopRun:
        """A batch of runs: the batch axis is the last one of the states, and of parameters of the
        system, the controller or a sensor annotated with it.

        Arguments, results and errors as in `simulate`; unless `throw`, a failed run is only marked
        in its status. `start` is a number, or (runs,). The noise of run j has the key
        `jax.random.split(key, runs)[j]`, which reproduces this run individually."""
        options = LoopOptions(key, accuracy, steps, events, start, memory)
        return run_loop(self, y0s, ts, options, 1, throw=throw)
