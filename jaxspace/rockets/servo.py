"""Servo of a surface, a nozzle or a valve: a first-order lag within a greatest rate and stops.

    x' = v tanh((clip(u, a, b) - x)/(tau v))

    symbol   meaning                          unit
    x, u     position, command                that of the part: rad, 1
    a, b     stops                            as x
    tau, v   time constant, greatest rate     s, as x per second

A small step of the command is met as 1 - e^(-t/tau), a large one at the rate v. The limit is
approached smoothly, so that steps of the integration and derivatives see no corner. A position
between the stops stays between them.

Source: Franklin, Powell and Emami-Naeini, Feedback Control of Dynamic Systems, 9.3 (saturation).
"""

__all__ = ["servo_rate"]

import jax.numpy as jnp

from ..core import Scalar
from ..core.formula import ABOVE_ZERO, POSITIVE, formula


@formula(rate_limit=ABOVE_ZERO, time_constant=POSITIVE)
def servo_rate(
    command: Scalar,
    position: Scalar,
    low: Scalar | float,
    high: Scalar | float,
    rate_limit: Scalar,
    time_constant: Scalar,
) -> Scalar:
    """The rate x' of a part that follows a `command`.

    **Arguments**, all of which may be arrays of parts and runs

    - `command`, `position`: in the unit of the part; `low`, `high`: its stops.
    - `rate_limit`: per second; `time_constant`: s.

    **Returns** the rate, in the unit of the part per second."""
    behind = jnp.clip(command, low, high) - position
    return rate_limit * jnp.tanh(behind / (time_constant * rate_limit))
