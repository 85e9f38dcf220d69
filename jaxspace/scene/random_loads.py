"""Random accelerations and torques: coloured and white noise, the process noise of a run.

    a = sigma x(t)      in inertial axes                    M = sigma x(t)      in body axes

    symbol    meaning                                                           unit
    x         three independent signals of variance one                         1
    sigma     standard deviation of each component                              m/s^2, N m
    S         two-sided spectral density of white noise, sigma^2 times step     m^2/s^3, N^2 m^2 s

With white noise of the density S and no other force the velocity has the variance S t and the
position S t^3 / 3; with coloured noise the velocity has 2 sigma^2 tau (t - tau (1 - exp(-t/tau))).

Source: Gardiner, Handbook of Stochastic Methods, 4.4 (integrals of both processes).
"""

__all__ = ["RandomAcceleration", "RandomTorque"]

from collections.abc import Sequence
from typing import final

from jaxtyping import Array, Float

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load
from ..bodies.random_signals import (
    CORRELATION_TIME,
    DURATION,
    SEED,
    STEP,
    RandomSignal,
    deviation_of_white,
)
from ..core import Scalar, Vector, argument, constructor, quantity
from ..core.limits import Limit
from ..core.shapes import with_rank


def _load(signal: RandomSignal, deviation: Vector, t: Scalar) -> Vector:
    x = signal.at(t)
    rank = max(x.ndim, deviation.ndim) - 1
    return with_rank(deviation, rank) * with_rank(x, rank)


@final
class RandomAcceleration(AbstractEffect):
    """A random acceleration of the centre of mass, with independent components in inertial axes.

    - `signal`: x, of three components."""

    signal: RandomSignal
    deviation: Float[Array, "3 *#runs"] = quantity(
        "m/s^2", non_negative=True, doc="standard deviation of each inertial component"
    )

    @classmethod
    @constructor(seed=SEED, duration=DURATION, step=STEP, correlation_time=CORRELATION_TIME)
    def coloured(
        cls,
        deviation: Vector,
        correlation_time: Scalar,
        seed: Scalar,
        duration: float,
        step: float,
    ) -> "RandomAcceleration":
        """Coloured noise (Ornstein-Uhlenbeck).

        **Arguments**

        - `deviation`: m/s^2, (3, *runs).
        - `correlation_time`, `duration`, `step`: s; `seed`: of the signal
          (`bodies.random_signals`)."""
        return cls(RandomSignal(seed, duration, step, correlation_time, 3), deviation)

    @classmethod
    @constructor(
        sets=("deviation",),
        density=argument(
            "m^2/s^3",
            shape=(3,),
            non_negative=True,
            doc="two-sided spectral density of each inertial component",
        ),
        seed=SEED,
        duration=DURATION,
        step=STEP,
    )
    def white(
        cls, density: Vector, seed: Scalar, duration: float, step: float
    ) -> "RandomAcceleration":
        """White noise up to 1/(2 step), in Hz.

        **Arguments**

        - `density`: two-sided spectral density, m^2/s^3, (3, *runs).
        - `seed`, `duration`, `step`: as in `coloured`."""
        return cls(
            RandomSignal(seed, duration, step, components=3), deviation_of_white(density, step)
        )

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del y, body
        return Load(acceleration_N=_load(self.signal, self.deviation, t))

    def limits(self, t: Scalar, y: BodyState, body: AbstractBody) -> Sequence[Limit]:
        del y, body
        return self.signal.limits(t)


@final
class RandomTorque(AbstractEffect):
    """A random torque about the centre of mass, with independent components in body axes.

    - `signal`: x, of three components."""

    signal: RandomSignal
    deviation: Float[Array, "3 *#runs"] = quantity(
        "N m", non_negative=True, doc="standard deviation of each component, in body axes"
    )

    @classmethod
    @constructor(seed=SEED, duration=DURATION, step=STEP, correlation_time=CORRELATION_TIME)
    def coloured(
        cls,
        deviation: Vector,
        correlation_time: Scalar,
        seed: Scalar,
        duration: float,
        step: float,
    ) -> "RandomTorque":
        """Coloured noise (Ornstein-Uhlenbeck).

        **Arguments**

        - `deviation`: N m, (3, *runs); the others as in `RandomAcceleration.coloured`."""
        return cls(RandomSignal(seed, duration, step, correlation_time, 3), deviation)

    @classmethod
    @constructor(
        sets=("deviation",),
        density=argument(
            "N^2 m^2 s",
            shape=(3,),
            non_negative=True,
            doc="two-sided spectral density of each component, in body axes",
        ),
        seed=SEED,
        duration=DURATION,
        step=STEP,
    )
    def white(cls, density: Vector, seed: Scalar, duration: float, step: float) -> "RandomTorque":
        """White noise up to 1/(2 step), in Hz.

        **Arguments**

        - `density`: two-sided spectral density, N^2 m^2 s, (3, *runs); the others as in
          `RandomAcceleration.white`."""
        return cls(
            RandomSignal(seed, duration, step, components=3), deviation_of_white(density, step)
        )

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del y, body
        return Load(torque_B=_load(self.signal, self.deviation, t))

    def limits(self, t: Scalar, y: BodyState, body: AbstractBody) -> Sequence[Limit]:
        del y, body
        return self.signal.limits(t)
