"""Gusts by the spectra of Dryden: a frozen field of turbulence, one for each seed.

    Phi_u = sigma_u^2 (2 L/pi)/(1 + (L W)^2)                               along the path
    Phi_v = sigma_v^2 (L/pi)(1 + 3 (L W)^2)/(1 + (L W)^2)^2                across it, twice

    below 1000 ft       L_w = h,  L_u = h/(0.177 + 0.000823 h)^1.2         h in ft, from 10 ft on
                        sigma_w = 0.1 W_20,  sigma_u = sigma_w/(0.177 + 0.000823 h)^0.4
    above 2000 ft       L = 1750 ft,  sigma by height and probability      (figure 7)
    between             linear in the height

    symbol        meaning                                                            unit
    W             spatial frequency, from zero on                                    rad/m
    L, sigma      scale and root mean square: w upwards, u horizontal                m, m/s
    h             height above the ground                                            m
    W_20          mean wind 20 ft above the ground                                   m/s

The spectra are those of the air along a straight path, which a vehicle passes while the field does
not change (Taylor). Here the path is the vertical: rockets and parachutes climb and descend
through the field. So the vertical component is the one along the path, and the horizontal ones are
those across it. MIL-HDBK-1797 is equivalent with L/2 instead of L. In level flight the field is
constant: it is not a model for cruise.

The field is sampled once, when it is made, and not filtered as a part of the state. White noise in
a state has no derivative: an adaptive method of high order could not resolve it, and the path would
depend on the accuracy. A sampled field is a smooth function of the height. It is the same for a
booster and its parachute, during ascent and descent, for every accuracy, in both modes of
differentiation and for any steps of a batch. Its nodes follow the exact discrete form of Dryden's
filters (`random_paths.py`) over the distance in units of L, so that scale and strength may
change with the height. Between them it is cubic with a continuous slope (`hermite.py`): no
time is a break. Frequencies above those of the nodes are cut off, which removes a few hundredths of
the variance with 16 nodes per length.

Source: MIL-F-8785C, 3.7.1 and 3.7.2; MIL-HDBK-1797, 4.9; Beal, Digital Simulation of Atmospheric
Turbulence for Dryden and von Karman Models, J. Guidance 16, 1993, 132.
"""

from typing import final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import numpy.typing as npt
from jaxtyping import Array, Float

from ..core import (
    AbstractParameters,
    Choice,
    InputError,
    NumberField,
    Scalar,
    argument,
    check,
    constructor,
    quantity,
)
from ..core.hermite import cubic, stacked
from ..core.quantities import check_declared
from ..core.random_paths import longitudinal, normal_numbers, transverse
from ..core.shapes import with_rank
from ..core.types import as_float

FOOT = 0.3048
LOWEST = 10.0 * FOOT
LOW = 1000.0 * FOOT
HIGH = 2000.0 * FOOT
LENGTH_ALOFT = 1750.0 * FOOT
# Figure 7 of MIL-F-8785C: root mean square, ft/s, by the height, ft, of a turbulence that is
# exceeded with the probability 1e-2, 1e-3 and 1e-5.
RMS_HEIGHTS = FOOT * 1e3 * np.array([0.5, 1.75, 3.75, 7.5, 15, 25, 35, 45, 55, 65, 75, 80])
RMS = {
    "light": (6.6, 6.9, 7.4, 6.7, 4.6, 2.7, 0.4, 0.0, 0.0, 0.0, 0.0, 0.0),
    "moderate": (8.6, 9.6, 10.6, 10.1, 8.0, 6.6, 5.0, 4.2, 2.7, 0.0, 0.0, 0.0),
    "severe": (15.6, 17.6, 23.0, 23.6, 22.1, 20.0, 16.0, 15.1, 12.1, 7.9, 6.2, 5.1),
}
# The mean wind at 20 ft for these severities: 15, 30 and 45 knots.
WINDS = {name: k * 15.0 * 1852.0 / 3600.0 for k, name in enumerate(RMS, 1)}


def dryden_lengths(height: Array | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The scales L of the horizontal and of the vertical component, m, at known heights above the
    ground, m (MIL-F-8785C, 3.7.3)."""
    # The formulas of low altitude are held at both ends: on the ground the scales would vanish.
    h = np.clip(np.asarray(height, float), LOWEST, LOW)
    horizontal = h / (0.177 + 0.000823 * h / FOOT) ** 1.2
    # Both are 1000 ft there, to a thousandth.
    share = _share(np.asarray(height))
    return (
        horizontal + share * (LENGTH_ALOFT - horizontal),
        h + share * (LENGTH_ALOFT - h),
    )


def dryden_intensities(
    height: np.ndarray, wind_20_feet: Scalar, rms_aloft: Float[Array, "12 *#runs"]
) -> tuple[Scalar, Scalar]:
    """The root mean squares of the horizontal and of the vertical component, m/s, (heights, *runs).

    **Arguments**

    - `height`: above the ground, m, (heights,).
    - `wind_20_feet`: W_20, m/s; `rms_aloft`: m/s, at the heights of the standard's figure 7."""
    rank = max(jnp.ndim(wind_20_feet), rms_aloft.ndim - 1)

    def by_height(x: np.ndarray) -> np.ndarray:
        return x.reshape(-1, *(1,) * rank)

    known = with_rank(rms_aloft, rank)
    h = by_height(np.clip(height, LOWEST, LOW) / FOOT)
    # From 2000 ft on, where only the high-altitude model applies.
    high = np.clip(height, HIGH, RMS_HEIGHTS[-1])
    k = np.clip(np.searchsorted(RMS_HEIGHTS, high) - 1, 0, RMS_HEIGHTS.size - 2)
    at = by_height((high - RMS_HEIGHTS[k]) / (RMS_HEIGHTS[k + 1] - RMS_HEIGHTS[k]))
    aloft = known[k] + at * (known[k + 1] - known[k])
    vertical = 0.1 * wind_20_feet * np.ones_like(h)
    horizontal = vertical / (0.177 + 0.000823 * h) ** 0.4
    share = by_height(_share(height))
    return horizontal + share * (aloft - horizontal), vertical + share * (aloft - vertical)


def _share(height: np.ndarray) -> np.ndarray:
    """Weight of the high-altitude model relative to the low-altitude model, 0 to 1."""
    return np.clip((height - LOW) / (HIGH - LOW), 0.0, 1.0)


def _nodes(top: float, per_length: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Heights, m, a `per_length`-th of the smaller scale apart, and the distances between them in
    units of the horizontal and of the vertical scale."""
    # Geometric, because the scales grow with the height: near the ground they are a few metres.
    fine = np.concatenate([[0.0], np.geomspace(0.01, max(top, 1.0), 20_000)])
    # The midpoint rule, exact to the square of the spacing.
    middle = 0.5 * (fine[1:] + fine[:-1])
    lengths = np.stack(dryden_lengths(middle))
    passed = np.concatenate([[[0.0]] * 2, np.cumsum(np.diff(fine) / lengths, axis=1)], axis=1)
    nearest = np.append(0.0, np.cumsum(np.diff(fine) / lengths.min(axis=0)))
    count = int(np.ceil(nearest[-1] * per_length)) + 1
    heights = np.interp(np.linspace(0.0, nearest[-1], max(count, 2)), nearest, fine)
    horizontal, vertical = (np.diff(np.interp(heights, fine, row)) for row in passed)
    return heights, horizontal, vertical


@final
class DrydenGusts(AbstractParameters):
    """Turbulence by MIL-F-8785C, a field for each `seed`: `LocalAir(gusts=DrydenGusts(...))`.

    - `top`: to which height above the ground, m; above it and below the ground the field stays.
    - `per_length`: nodes for each length L.

    Raises `InputError` for a number outside of its range."""

    seed: NumberField = quantity(
        "", doc="any number: each one gives another field; in a campaign, one for each run"
    )
    wind_20_feet: NumberField = quantity(
        "m/s", non_negative=True, doc="mean wind 20 ft above the ground, which sets the low gusts"
    )
    rms_aloft: Float[Array, "12 *#runs"] = quantity(
        "m/s",
        non_negative=True,
        doc="root mean squares at the heights of the standard's figure 7, from 500 to 80000 ft",
    )
    # Static: they set how many nodes there are, and where.
    top: float = eqx.field(static=True, default=12e3)
    per_length: float = eqx.field(static=True, default=16.0)
    heights: Float[Array, "nodes *#runs"] = eqx.field(default=None)
    data: Float[Array, "nodes 6 *#runs"] = eqx.field(default=None)

    def __init__(
        self,
        seed: Scalar,
        wind_20_feet: Scalar,
        rms_aloft: npt.ArrayLike,
        top: float = 12e3,
        per_length: float = 16.0,
    ):
        self.seed, self.wind_20_feet = as_float(seed), as_float(wind_20_feet)
        self.rms_aloft = as_float(rms_aloft)
        self.top, self.per_length = top, per_length
        check_declared(self, "seed", "wind_20_feet", "rms_aloft", "top", "per_length")
        # After the check of their kind: they are static, and a program is chosen by their values.
        self.top, self.per_length = float(top), float(per_length)
        check(0.0 < self.top < np.inf, "DrydenGusts.top", top, "positive and finite, in m")
        few = 2.0 <= self.per_length <= 256.0
        check(few, "DrydenGusts.per_length", per_length, "from 2 to 256 nodes")
        heights, horizontal, vertical = _nodes(self.top, self.per_length)
        # Two for each horizontal component, whose spectrum is of second order, and one for the
        # vertical.
        z = normal_numbers(self.seed, (heights.size, 5))
        strong = dryden_intensities(heights, self.wind_20_feet, self.rms_aloft)
        rank = max(z.ndim - 2, strong[0].ndim - 1)
        across, along = (with_rank(x, rank) for x in strong)
        z = with_rank(z, rank, axes=2)
        east, north = (transverse(horizontal, z[:, k : k + 2]) for k in (0, 2))
        steps = jnp.asarray(vertical, z.dtype).reshape(-1, *(1,) * (z.ndim - 2))
        rising = longitudinal(steps, z[:, 4])
        self.heights = jnp.asarray(heights)
        self.data = stacked(self.heights, across * east, across * north, along * rising)

    @classmethod
    @constructor(
        sets=("wind_20_feet", "rms_aloft"),
        severity=Choice(tuple(RMS), doc="of the turbulence, by the standard"),
        top=argument(
            "m", positive=True, fixed=True, default=12e3, doc="to which height above the ground"
        ),
        per_length=argument(
            "",
            low=2.0,
            high=256.0,
            whole=True,
            fixed=True,
            default=16.0,
            doc="nodes for each length L",
        ),
    )
    def of_severity(
        cls, severity: str, seed: Scalar, top: float = 12e3, per_length: float = 16.0
    ) -> "DrydenGusts":
        """Light, moderate or severe turbulence: exceeded with the probability 1e-2, 1e-3 or 1e-5,
        with a mean wind of 15, 30 or 45 knots near the ground.

        **Arguments**

        - `severity`: "light", "moderate" or "severe"; `seed`: of the field.
        - `top`, `per_length`: as the fields."""
        if severity not in RMS:
            raise InputError(f"severity is {severity!r}: it must be one of {', '.join(RMS)}.")
        return cls(seed, WINDS[severity], FOOT * np.array(RMS[severity]), top, per_length)

    def at(self, above: Scalar) -> tuple[Scalar, Scalar, Scalar]:
        """The gust to the east, to the north and upwards, m/s, `above` the ground, m."""
        east, north, rising = cubic(self.heights, self.data, above)
        return east, north, rising
