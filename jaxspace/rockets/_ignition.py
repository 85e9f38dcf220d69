"""Ignition of a motor: at a time of the mission, or with a delay after the start of a phase.

A phase that starts at an event starts at another time in every run, which is not known before it: a
motor that is to burn in it has a `delay`.
"""

import dataclasses
from typing import Any, TypeVar

import numpy as np
from jaxtyping import PyTree

from ..core import Scalar, check, quantity
from ..core.checks import is_concrete

Motor = TypeVar("Motor")


def delay_field() -> Any:
    """The field `delay` of a motor."""
    return quantity(
        "s",
        non_negative=True,
        optional=True,
        doc="from the start of the phase of a mission to the ignition, in place of `ignition`; "
        "without a mission, from the time zero",
    )


def check_ignition(motor: PyTree) -> None:
    """Raise `InputError` for a motor with both a time of ignition and a delay."""
    # A traced time cannot be compared with its default.
    if motor.delay is not None and is_concrete(motor.ignition):
        name = f"{type(motor).__name__}.ignition"
        check(
            np.asarray(motor.ignition) == 0.0, name, motor.ignition, "omitted when a delay is given"
        )


def ignition_of(motor: PyTree) -> Scalar:
    """The time, s, at which a motor ignites."""
    # A mission has replaced a delay (`ignited`): here it counts from the time zero.
    return motor.ignition if motor.delay is None else motor.delay


def ignited(motor: Motor, t0: Scalar) -> Motor:
    """The motor of a phase that starts at the time `t0`, s, without a delay."""
    motor_delay = motor.delay  # type: ignore[attr-defined]
    if motor_delay is None:
        return motor
    lit = {"ignition": t0 + motor_delay, "delay": None}
    return dataclasses.replace(motor, **lit)  # type: ignore[type-var]
