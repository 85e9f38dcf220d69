"""Sensors: readings with noise, bias and drift, at individual rates.

    z_k = round_q( x(t_k) + b + d_k + s e_k )        d_{k+1} = d_k + w sqrt(T) e'_k
    q_k = q(t_k) exp(b + s e_k)                      an attitude

    symbol   meaning                                              unit
    x, z     true value, reading                                  any
    b, d     bias, drift: a random walk                           that of x
    s, w     standard deviation of the noise; of the drift after  that of x,
             one second                                           that over sqrt(s)
    e, e'    standard normal numbers                              1
    q        step between readings; T: time between them          that of x; s

Source: Hughes, Spacecraft Attitude Dynamics, 6; Markley and Crassidis, Fundamentals of Spacecraft
Attitude Determination and Control, 4.7 (gyros), 4.2 (star trackers).
"""

from abc import abstractmethod
from collections.abc import Callable
from typing import Any, TypeAlias, final

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.core import Tracer
from jaxtyping import Array, Float, Key, PyTree

from ..core import AbstractParameters, InputError, Scalar, State, Vector, quantity
from ..core.shapes import with_rank
from ..core.user_functions import user_function
from ..rotations import Quaternion
from .commands import clipped, rounded

# One key, or one of each run.
Keys: TypeAlias = Key[Array, "..."]
Draw: TypeAlias = Callable[[int, Array], Array]


def known_seconds(name: str, optional: bool = False) -> Callable[[object], Any]:
    """A converter of a field of this `name` to a known number, s, or, if it is `optional`, `None`.

    It raises `InputError` for a traced number, because a program has a fixed number of samples."""

    def known(x: object) -> float | None:
        if optional and x is None:
            return None
        if isinstance(x, Tracer):
            raise InputError(
                f"{name} is traced: it must be a concrete number in s, because it determines the "
                "number of samples."
            )
        try:
            return float(x)  # pyright: ignore[reportArgumentType]
        except (TypeError, ValueError):
            raise InputError(f"{name} is {x!r}: it must be a number, in s.") from None

    return known


class AbstractSensor(AbstractParameters):
    """A sensor. `period`, s: the time between its readings; that of the controller by default."""

    period: eqx.AbstractVar[float | None]

    @abstractmethod
    def drift(self, t: Scalar, y: State) -> PyTree:
        """The drift before the first reading; `None` for a sensor that has none."""

    @abstractmethod
    def read(
        self,
        t: Scalar,
        y: State,
        drift: PyTree,
        elapsed: float,
        draw: Draw,
    ) -> tuple[PyTree, PyTree]:
        """The reading, and the drift after it.

        **Arguments**

        - `t`: s; `y`: the state.
        - `drift`: that before it.
        - `elapsed`: time between readings, s.
        - `draw`: normal numbers of the shape of an array; each number makes others."""


@final
class Sensor(AbstractSensor):
    """Reads a part of the state, or any function (t, y) of it.

    - `period`: time between two readings, s; by default the period of the controller.

    **Raises** `InputError` for a period that is not positive."""

    reads: str | Callable[[Scalar, State], Array] = eqx.field(
        metadata={"doc": "name of a part of the state, or a function (t, y)"}
    )
    noise: Float[Array, "..."] | None = quantity(
        "", non_negative=True, optional=True, doc="standard deviation, in the unit of the reading"
    )
    bias: Float[Array, "..."] | None = quantity("", optional=True, doc="constant error")
    walk: Float[Array, "..."] | None = quantity(
        "", non_negative=True, optional=True, doc="standard deviation of the drift after one second"
    )
    quantum: Float[Array, "..."] | None = quantity(
        "", positive=True, optional=True, doc="step between readings"
    )
    limit: Float[Array, "..."] | None = quantity(
        "", positive=True, optional=True, doc="largest reading"
    )
    period: float | None = eqx.field(
        static=True, default=None, converter=known_seconds("Sensor.period", optional=True)
    )

    def __check_init__(self):
        check_period("Sensor.period", self.period)

    def truth(self, t: Scalar, y: State) -> Array:
        """The true value of the measured quantity."""
        if callable(self.reads):
            with user_function("Sensor.reads"):
                return self.reads(t, y)
        part = getattr(y, self.reads, None)
        part = y.part(self.reads) if part is None else part
        return part.wxyz if isinstance(part, Quaternion) else part

    def drift(self, t: Scalar, y: State) -> PyTree:
        return None if self.walk is None else jnp.zeros_like(self.truth(t, y))

    def read(
        self,
        t: Scalar,
        y: State,
        drift: PyTree,
        elapsed: float,
        draw: Draw,
    ) -> tuple[PyTree, PyTree]:
        z = self.truth(t, y)
        # Only errors that are given, so that absent ones cost nothing and draw nothing.
        if self.bias is not None:
            z = z + _meeting(self.bias, z)
        if self.noise is not None:
            z = z + _meeting(self.noise, z) * draw(0, z)
        if self.walk is not None:
            z = z + drift
            # The variance of a random walk grows with the time, its deviation with the root.
            drift = drift + _meeting(self.walk, z) * elapsed**0.5 * draw(1, z)
        # The electronics limit and round what the sensor has measured, errors included.
        return rounded(clipped(z, self.limit), self.quantum), drift


@final
class StarTracker(AbstractSensor):
    """Reads the attitude, turned by a small error about the axes of the body.

    - `period`: time between two readings, s; by default the period of the controller."""

    noise: Float[Array, "..."] = quantity(
        "rad", non_negative=True, default=0.0, doc="standard deviation about each axis"
    )
    bias: Float[Array, "3 *#runs"] | None = quantity(
        "rad", optional=True, doc="constant misalignment of the sensor in the body"
    )
    period: float | None = eqx.field(
        static=True, default=None, converter=known_seconds("StarTracker.period", optional=True)
    )

    def __check_init__(self):
        check_period("StarTracker.period", self.period)

    def drift(self, t: Scalar, y: State) -> PyTree:
        del t, y

    def read(
        self,
        t: Scalar,
        y: State,
        drift: PyTree,
        elapsed: float,
        draw: Draw,
    ) -> tuple[PyTree, PyTree]:
        del t, elapsed
        like: Vector = y.attitude.wxyz[1:]
        turn = self.noise * draw(0, like)
        if self.bias is not None:
            turn = turn + with_rank(self.bias, like.ndim - 1)
        # After the attitude: the error is about the axes of the body.
        return y.attitude.then(Quaternion.from_rotation_vector(turn)), drift


def check_period(name: str, period: float | None) -> None:
    """Raise `InputError` for a period that is not positive and finite."""
    if period is not None and not 0.0 < period < float("inf"):
        raise InputError(f"{name} is {period}: it must be positive and finite, in s.")


def _meeting(error: Array, like: Array) -> Array:
    """An error of each component, of each run, or one for all, in a form that broadcasts with the
    reading."""
    components, runs = like.shape[: error.ndim], like.shape[like.ndim - error.ndim :]
    # A reading of three components in three runs: components come first.
    of_runs = error.ndim < like.ndim and error.shape == runs and error.shape != components
    return error if of_runs or error.ndim == 0 else with_rank(error, like.ndim - 1)


def drawing(keys: Keys | None, number: int, count: Array, run_axes: int, name: str) -> Draw:
    """The function that draws for the reading `count` of the sensor `number`, with one key for each
    run.

    Raises `InputError` without a key."""

    def draw(purpose: int, like: Array) -> Array:
        if keys is None:
            raise InputError(f"The sensor {name} has noise: give key=jax.random.key(...).")

        def one(key: Keys) -> Array:
            # Two streams for each sensor, noise and drift, and a number for each reading.
            for fold in (2 * number + purpose, count):
                key = jax.random.fold_in(key, fold)
            components = like.shape[: like.ndim - run_axes]
            return jax.random.normal(key, components, like.dtype)

        return one(keys) if run_axes == 0 else jax.vmap(one, out_axes=-1)(keys)

    return draw
