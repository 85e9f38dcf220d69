"""The verb that carries a covariance along a run or through a mission."""

from collections.abc import Callable, Sequence
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float, PyTree

from ..core import InputError, State
from ..integration._layout import broadcast_state
from ..simulation import Mission, MissionTrajectory, Trajectory, simulate, simulate_batch
from ..simulation._flight import AbstractFlight
from ._coordinates import Coordinates
from ._covariance import MeanCovariance, Noise, Uncertain
from ._mission_covariance import MissionCovariance, covariance_of, uncertain_mission


def propagate_covariance(
    system: Any,
    y0: State,
    ts: Any = 0.0,
    covariance: Float[ArrayLike, "n n *#runs"] | None = None,
    *,
    noise: Noise | Sequence[Noise] = None,
    batch: bool = False,
    **options: Any,
) -> tuple[Trajectory | MissionTrajectory, Float[Array, "n n times *runs"] | MissionCovariance]:
    """The run of the mean with the covariance of its state under white noise, to first order.

    **Arguments**

    - `system`, `y0`, `ts`: as in `simulate`: a system and its save times, or a mission and the time
      of its start.
    - `covariance`: that of the initial state, (n, n), in the coordinates of `Sensitivity.rows`;
      zero by default.
    - `noise`: the spectral density Q of the process noise, (n, n), per s, or a function of the time
      and the state; of a mission that of every phase, or a list with one for each.
    - `batch`: whether `simulate_batch` runs it, with the runs on the last axis.
    - `options`: further arguments of `simulate` or `simulate_batch`; an event here reads
      a `MeanCovariance`.

    **Returns** the run, whose states are `MeanCovariance`, and its covariance, (n, n, times,
    *runs); of a mission a `MissionCovariance`, mapped through its events and jumps. Without noise,
    `Sensitivity.covariance` is the cheaper way.

    **Raises** `InputError` as `simulate` does, for a covariance or a noise of another size, and for
    a phase that is a closed loop, whose commands are no part of the state."""
    verb: Callable[..., PyTree] = simulate_batch if batch else simulate
    if not isinstance(system, Mission):
        t0 = jnp.asarray(ts)[0]
        y0 = broadcast_state(system, t0, y0)
        size = Coordinates.of(y0, int(batch))
        start = MeanCovariance(y0, _initial(covariance, size, 0))
        run = verb(Uncertain(system, _density(noise, size)), start, ts, **options)
        return run, run.states.covariance
    if any(isinstance(phase.system, AbstractFlight) for phase in system.phases):
        raise InputError(
            "A phase of the mission is a closed loop: its covariance is that of a campaign, or "
            "without noise Sensitivity.covariance."
        )
    y0 = broadcast_state(system.phases[0].moving, jnp.asarray(ts), y0)
    size = Coordinates.of(y0, int(batch))
    each = noise if isinstance(noise, list | tuple) else [noise] * len(system.phases)
    if len(each) != len(system.phases):
        raise InputError(
            f"noise has {len(each)} entries: it must have one for each of the "
            f"{len(system.phases)} phases, or be one for all."
        )
    # A jump may change what the state holds: the size is checked where the first phase starts.
    first, *others = each
    mission = uncertain_mission(system, (_density(first, size), *others))
    run = verb(mission, MeanCovariance(y0, _initial(covariance, size, 1)), ts, **options)
    return run, covariance_of(run)


def _initial(covariance: ArrayLike | None, size: Coordinates, more: int) -> Array:
    """The covariance of the initial state, (n, n, *runs), and of `more` that is known exactly."""
    n, runs = size.count, size.trailing[0]
    P = jnp.zeros((n, n), size.dtype) if covariance is None else jnp.asarray(covariance, size.dtype)
    _check("covariance", P.shape, size)
    P = jnp.broadcast_to(P.reshape(P.shape + (1,) * (2 + len(runs) - P.ndim)), (n, n, *runs))
    return jnp.pad(P, ((0, more), (0, more), *((0, 0),) * len(runs)))


def _density(noise: Any, size: Coordinates) -> Any:
    """The process noise in the precision of the state."""
    if noise is None or callable(noise):
        return noise
    Q = jnp.asarray(noise, size.dtype)
    _check("noise", Q.shape, size)
    return Q


def _check(name: str, shape: tuple[int, ...], size: Coordinates) -> None:
    if shape[:2] != (size.count,) * 2:
        raise InputError(
            f"{name} has the shape {shape}: it must be ({size.count}, {size.count}) for "
            f"{', '.join(size.labels)}."
        )
