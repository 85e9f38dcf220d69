"""The shape of a thrust: its level over the burn time, linear between the points of a table.

    F(t) = F_mean f(x)        x = (t - t_0) / t_b

    symbol    meaning                              unit
    F_mean    mean thrust over the burn time       N
    f         level: thrust over its mean          1
    t_0, t_b  ignition, burn time                  s

The mean of f over 0 <= x <= 1 is one, so that the mean thrust has the same meaning for every shape.
"""

from collections.abc import Sequence
from typing import final

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import AbstractParameters, InputError, Scalar, argument, check, constructor, quantity
from ..core.checks import is_concrete
from ..core.tables import polygon
from ..core.types import as_float

RAMP = 1e-6
"""Share of the burn time over which a thrust jumps: in single precision, too, its ends differ."""


@final
class ThrustProfile(AbstractParameters):
    """Thrust in units of its mean against time in units of the burn time, linear between its
    points.

    Raises `InputError` unless the fractions ascend from 0 to 1 and the levels have the mean 1."""

    fraction: Float[Array, "points *#runs"] = quantity(
        "", low=0.0, high=1.0, doc="of the burn time, ascending from 0 to 1"
    )
    level: Float[Array, "points *#runs"] = quantity(
        "", non_negative=True, doc="thrust over mean thrust"
    )

    @classmethod
    def constant(cls) -> "ThrustProfile":
        """Constant thrust from ignition to burnout."""
        return cls(as_float([0.0, 1.0]), as_float([1.0, 1.0]))

    @classmethod
    @constructor(
        sets=("fraction", "level"),
        times=argument("s", shape=(None,), fixed=True, doc="ascending; only their ratios matter"),
        thrusts=argument(
            "N",
            shape=(None,),
            non_negative=True,
            fixed=True,
            doc="at these times; only their ratios matter",
        ),
    )
    def of_table(
        cls,
        times: Sequence[float] | np.ndarray | Array,
        thrusts: Sequence[float] | np.ndarray | Array,
    ) -> "ThrustProfile":
        """The profile of a table of thrust against time, in any units: only ratios matter."""
        return cls.tabulated(times, thrusts)[0]

    @classmethod
    def tabulated(
        cls,
        times: Sequence[float] | np.ndarray | Array,
        thrusts: Sequence[float] | np.ndarray | Array,
    ) -> tuple["ThrustProfile", Scalar, Scalar]:
        """The profile of a table of thrust against time, and its burn time and mean thrust.

        **Arguments**

        - `times`: ascending, in any unit; a repeated time is a jump of the thrust, which
          becomes a ramp over a millionth of the burn time.
        - `thrusts`: at these times, in any unit.

        **Returns** the profile, the burn time and the mean thrust, in the units of the table.

        **Raises** `InputError` for times that do not ascend, or a table without thrust.
        """
        t, f = as_float(times), as_float(thrusts)
        if jnp.shape(t) != jnp.shape(f):
            raise InputError(
                f"ThrustProfile has {jnp.size(t)} times and {jnp.size(f)} thrusts: it must have "
                "the same number of each."
            )
        xp = jnp
        jumps = np.empty(0, int)
        if is_concrete(t) and is_concrete(f):
            # In NumPy, because `jax.numpy` traces what is known, too, within `jit`.
            xp = np
            t = np.array(times, float)
            f = np.asarray(thrusts, float)
            steps = np.diff(t)
            jumps = np.flatnonzero(steps == 0.0)
            # Within the burn, and of two points each.
            inside = (jumps > 0) & (jumps < steps.size - 1) & np.all(np.diff(jumps) > 1)
            allowed = "ascending; a repeated time within the burn is a jump of the thrust"
            check(np.all(steps >= 0.0) & np.all(inside), "ThrustProfile.times", t, allowed)
            check(np.any(f > 0.0), "ThrustProfile.thrusts", f, "above zero somewhere")
        # By trapezoids, which are exact for the polygon that `at` evaluates.
        burn_time = t[-1] - t[0]
        mean = xp.sum(0.5 * (f[1:] + f[:-1]) * xp.diff(t)) / burn_time
        for k in jumps:
            t[k + 1] = t[k] + min(RAMP * burn_time, 0.5 * (t[k + 2] - t[k]))
        # Its mean is one with the ramps.
        level = f / (xp.sum(0.5 * (f[1:] + f[:-1]) * xp.diff(t)) / burn_time)
        profile = cls(as_float((t - t[0]) / burn_time), as_float(level))
        return profile, burn_time, mean

    # A check beyond the declarations of the fields: the consistency of the two tables.
    def __check_init__(self):
        if is_concrete(self.fraction) and is_concrete(self.level):
            x = np.asarray(self.fraction)
            f = np.asarray(self.level)
            if x.shape != f.shape or x.shape[0] < 2:
                raise InputError(
                    f"ThrustProfile has {x.shape} fractions and {f.shape} levels: "
                    "it must have the same number of each, at least two."
                )
            check(
                (x[0] == 0.0) & (x[-1] == 1.0) & np.all(np.diff(x, axis=0) > 0.0),
                "ThrustProfile.fraction",
                x,
                "ascending from 0 to 1",
            )
            # Looser than rounding, for tables that are given with six digits.
            mean = np.sum(0.5 * (f[1:] + f[:-1]) * np.diff(x, axis=0), axis=0)
            check(
                np.abs(mean - 1.0) < 1e-5,
                "ThrustProfile.level",
                f,
                f"of mean 1 (it is {np.max(mean):.6g})",
            )

    def at(self, x: Scalar) -> Scalar:
        """The level at the fraction `x` of the burn time; zero before ignition, after burnout."""
        result = polygon(x, self.fraction, self.level)
        # A polygon continues beyond its ends, a motor does not.
        return jnp.where((x >= 0.0) & (x <= 1.0), result, 0.0)
