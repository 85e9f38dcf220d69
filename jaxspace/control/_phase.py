"""A loop as a phase of a mission: the samples are known before it starts; its end need not be."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from ..core import InputError, Scalar, State, is_concrete
from ..integration._accuracy import state_dtype
from ..integration._config import IntegrationConfig
from ..integration._events import Event
from ..integration._layout import runs_of
from ..simulation._runs import RunResult
from ._program import Known, Static, alone, as_events, as_key, parts_of
from ._repeats import repeated


def fly_phase(
    loop: Any,
    until: Scalar | Event,
    y0: State,
    t0: Scalar,
    num_saved: int,
    config: IntegrationConfig,
    run_axes: int,
) -> RunResult:
    """A loop as the phase of a mission: `AbstractFlight.fly`."""
    event = isinstance(until, Event)
    span = until.within if event else until
    if is_concrete(span):
        longest = float(np.max(np.asarray(span)))
    elif loop.longest is None:
        raise InputError(
            "ClosedLoop.longest is not given, and the duration of its phase is traced: give the "
            "longest time that the phase may take, in s."
        )
    else:
        longest = loop.longest
    ts = np.linspace(0.0, longest, num_saved)
    dtype, runs = state_dtype(y0), runs_of(y0, run_axes)
    start = jnp.broadcast_to(jnp.asarray(t0, dtype), runs)
    # Of a phase whose end is known nothing has to be cut.
    end = None if is_concrete(span) and jnp.ndim(span) == 0 else jnp.asarray(span, dtype)
    key = as_key(loop.key)
    if key is not None and key.shape != runs:
        raise InputError(
            f"ClosedLoop.key has the shape {key.shape}: for {runs} runs of a mission it must be a "
            f"key of each, such as jax.random.split(key, runs)."
        )
    events = as_events((until,)) if event else ()
    known = Known(parts_of(loop), y0, start, key, None, events, end)
    return repeated(alone, known, config, Static.of(loop, ts, run_axes))[0]
