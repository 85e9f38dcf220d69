"""Limits of the range of validity of a model, by quantity: with a limit declared, a run that leaves
the range reports what left it, with its value and what is allowed."""

import functools
import math
import operator
from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from .printing import printed
from .types import Flag, Scalar

# A limit below it stands for a quantity that must be positive.
SMALLEST = 1e-30


@printed(value="", low="", high="", margin="")
class Limit(NamedTuple):
    """The range of one quantity within which a model is valid.

    - `quantity`: in words, as "the mass of the body"; `unit`: SI, empty for a pure number.
    - `value`: of each run, (*runs,).
    - `low`, `high`: the range.
    - `margin`: by which a value may be beyond it: the error of a state at an event that ends a run
      on the limit.
    - `where`: whether the limit applies, such as only in dense air."""

    quantity: str
    unit: str
    value: Scalar
    low: Scalar = -math.inf
    high: Scalar = math.inf
    margin: Scalar = 0.0
    where: Flag = True

    def passed(self) -> Flag:
        """Whether the value is outside the range, for each run; not where it is NaN."""
        flags = []
        # Only the comparisons that can be true, because every step of a run has them.
        if not _is(self.low, -math.inf):
            flags.append(self.value < self.low - self.margin)
        if not _is(self.high, math.inf):
            flags.append(self.value > self.high + self.margin)
        beyond = functools.reduce(operator.or_, flags) if flags else jnp.zeros((), bool)
        return beyond if self.where is True else beyond & self.where

    def sentence(self) -> str:
        """The value and what is allowed, in words, for concrete numbers of one run."""
        value, low, high = (float(np.asarray(x)) for x in (self.value, self.low, self.high))
        limit, side = (low, "at least") if value < low else (high, "at most")
        if 0.0 < limit < SMALLEST:
            limit, side = 0.0, "above"
        unit = f" {self.unit}" if self.unit else ""
        # With as many digits as tell both apart.
        digits = next((k for k in range(6, 17) if f"{value:.{k}g}" != f"{limit:.{k}g}"), 17)
        return (
            f"{self.quantity} is {value:.{digits}g}{unit}: it must be {side} {limit:.{digits}g}"
            f"{unit}"
        )


def _is(x: Scalar, end: float) -> bool:
    return isinstance(x, float) and x == end


def any_passed(limits: Sequence[Limit]) -> Flag | None:
    """Whether one of the limits is passed, for each run; `None` without limits."""
    return functools.reduce(operator.or_, [x.passed() for x in limits]) if limits else None


def beyond_of(limits: Sequence[Limit]) -> Limit | None:
    """The first of the limits that is passed, for concrete numbers of one run."""
    return next((x for x in limits if np.any(np.asarray(x.passed()))), None)
