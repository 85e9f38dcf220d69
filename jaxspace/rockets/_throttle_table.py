"""The throttle of an engine over its burn, linear between the points of a table.

    s = s_k + (s_{k+1} - s_k) (t - t_0 - t_k)/(t_{k+1} - t_k)

    symbol    meaning                              unit
    s         throttle                             1
    t_0, t_k  ignition, times of the table         s

Before the first of the times and after the last one it is constant. Unlike a `ThrustProfile`, whose
mean is one, every number of it is free: a search for a landing moves each.
"""

from typing import final

import numpy as np
from jaxtyping import Array, Float

from ..core import AbstractParameters, InputError, Scalar, check, quantity
from ..core.checks import is_concrete
from ..core.tables import polygon


@final
class ThrottleTable(AbstractParameters):
    """A throttle against the time since the ignition.

    Raises `InputError` for times that do not ascend, or another number of throttles."""

    times: Float[Array, "nodes *#runs"] = quantity("s", doc="since the ignition, ascending")
    throttles: Float[Array, "nodes *#runs"] = quantity(
        "", low=0.0, high=1.0, doc="fraction of the full thrust at these times"
    )

    # A check beyond the declarations of the fields: the consistency of the two tables.
    def __check_init__(self):
        times, throttles = (np.shape(x)[:1] for x in (self.times, self.throttles))
        if times != throttles or times < (2,):
            raise InputError(
                f"ThrottleTable has {times[0]} times and {throttles[0]} throttles: it must have "
                "the same number of each, at least two."
            )
        if is_concrete(self.times):
            # The difference of two infinite times is NaN, which is rejected as well.
            with np.errstate(invalid="ignore"):
                steps = np.diff(np.asarray(self.times), axis=0)
            check(steps > 0.0, "ThrottleTable.times", self.times, "ascending")

    def at(self, tau: Scalar) -> Scalar:
        """The throttle at the time `tau`, s, since the ignition."""
        return polygon(tau, self.times, self.throttles)
