"""Interception and rendezvous between any two orbits: the impulses, and tables of them.

    dv1 = v1 - V_1(t1),  dv2 = V_2(t2) - v2,  with (v1, v2) = lambert(R_1(t1), R_2(t2), t2 - t1)

    symbol     meaning                                                     unit
    R_1, V_1   position and velocity of the chaser, at t = 0 as given      m, m/s
    R_2, V_2   of the target                                               m, m/s
    t1, t2     departure from the one orbit, arrival on the other          s
    v1, v2     velocities on the transfer at its ends                      m/s

Source: Thomson 4.16: coplanar, elliptic and non-coplanar orbits are the same problem here.

Both bodies move on their conics, in either direction of time. Singular as `lambert` is.
"""

__all__ = ["OrbitState", "Porkchop", "interception", "porkchop", "position_and_velocity"]

from typing import NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..bodies import BodyState
from ..core import InputError, Scalar, Vector
from ..core.field_types import is_real, shown
from ..core.formula import FINITE, POSITIVE, formula
from ..core.printing import printed
from ..core.shapes import check_components, with_rank
from ..core.types import as_float
from ..core.vectors import cross, dot, norm
from .kepler import conic_flow
from .lambert import lambert

OrbitState: TypeAlias = tuple[Vector, Vector] | BodyState
"""Position, m, and velocity, m/s, (3, *runs), or a `BodyState` that has both."""


def position_and_velocity(name: str, state: OrbitState) -> tuple[Vector, Vector]:
    """The position, m, and the velocity, m/s, of a state, (3, *runs).

    **Arguments**

    - `name`: of the argument, for the message.
    - `state`: both in this order, or a `BodyState`.

    **Raises** `InputError` for an object of another kind, a state without one of them, and a wrong
    first axis."""
    found = (state.position, state.velocity) if isinstance(state, BodyState) else state
    if not isinstance(found, tuple | list) or len(found) != 2 or any(x is None for x in found):
        raise InputError(
            f"{name} is {shown(state)}: it must be a position and a velocity, each (3, *runs), "
            "or a BodyState that has both."
        )
    position, velocity = (as_float(x) for x in found)
    for part, x in (("position", position), ("velocity", velocity)):
        if not is_real(x):
            raise InputError(
                f"The {part} of {name} is {shown(x)}: it must be an array of numbers, (3, *runs)."
            )
        check_components(f"The {part} of {name}", x, 3)
    return position, velocity


@printed(departure="m/s", arrival="m/s", start="m", end="m", velocity="m/s")
class Interception(NamedTuple):
    """A transfer from one orbit to another, (3, *runs).

    - `departure`, `arrival`: the impulses, m/s: that at the departure intercepts, both make a
      rendezvous.
    - `start`, `end`: the places, m; `velocity`: on the transfer at its start, m/s."""

    departure: Vector
    arrival: Vector
    start: Vector
    end: Vector
    velocity: Vector

    @property
    def total(self) -> Scalar:
        """Sum of the sizes of both impulses, m/s, (*runs,)."""
        return norm(self.departure) + norm(self.arrival)


@formula(departure=FINITE, arrival=FINITE, mu=POSITIVE)
def interception(
    chaser: OrbitState,
    target: OrbitState,
    departure: Scalar,
    arrival: Scalar,
    mu: Scalar,
    *,
    normal: Vector | None = None,
    revolutions: int = 0,
    low: bool = True,
) -> Interception:
    """Transfer that leaves the chaser's orbit at one time and reaches the target at another.

    **Arguments**

    - `chaser`, `target`: position, m, and velocity, m/s, of both at t = 0, (3, *runs): a pair, or a
      `BodyState`.
    - `departure`, `arrival`: s, (*runs,); they broadcast.
    - `mu`: gravitational parameter, m^3/s^2.
    - `normal`, `revolutions`, `low`: as in `lambert`; the transfer turns in the sense of the
      chaser by default, and goes the short way where the chaser moves on a line.

    **Returns** an `Interception`; NaN in a batch and under a transformation where there is none.

    **Raises** `InputError` as `lambert` does, and for a `chaser` or `target` of another kind.
    """
    chaser = position_and_velocity("chaser", chaser)
    target = position_and_velocity("target", target)
    departure, arrival = jnp.asarray(departure), jnp.asarray(arrival)
    states = (*conic_flow(*chaser, departure, mu), *conic_flow(*target, arrival, mu))
    rank = max(x.ndim - 1 for x in states)
    start, before, end, after = (with_rank(x, rank) for x in states)
    normal = _sense(chaser, start, end) if normal is None else normal
    duration = arrival - departure
    v1, v2 = lambert(start, end, duration, mu, normal=normal, revolutions=revolutions, low=low)
    return Interception(v1 - before, after - v2, start, end, v1)


@printed(departure="m/s", arrival="m/s")
class Porkchop(NamedTuple):
    """Sizes of both impulses, m/s, (departures, arrivals); NaN where there is no transfer."""

    departure: Float[Array, "departures arrivals"]
    arrival: Float[Array, "departures arrivals"]

    @property
    def total(self) -> Float[Array, "departures arrivals"]:
        """Sum of both impulses, m/s."""
        return self.departure + self.arrival


@formula(mu=POSITIVE)
def porkchop(
    chaser: OrbitState,
    target: OrbitState,
    departures: Float[Array, " departures"],
    arrivals: Float[Array, " arrivals"],
    mu: Scalar,
    *,
    revolutions: int = 0,
    low: bool = True,
) -> Porkchop:
    """The impulses for every pair of a departure and an arrival.

    **Arguments**

    - `chaser`, `target`: of one run, as in `interception`, (3,).
    - `departures`, `arrivals`: times, s.
    - `mu`, `revolutions`, `low`: as in `interception`.

    **Returns** a `Porkchop`, for `plots.porkchop_figure` and as a start of
    `optimization.least_rendezvous`.

    **Raises** `InputError` for a `chaser` or `target` of another kind.
    """
    pairs = position_and_velocity("chaser", chaser), position_and_velocity("target", target)
    return _porkchop(*pairs, departures, arrivals, mu, revolutions=revolutions, low=low)


@jax.jit(static_argnames=("revolutions", "low"))
def _porkchop(
    chaser: tuple[Vector, Vector],
    target: tuple[Vector, Vector],
    departures: Float[Array, " departures"],
    arrivals: Float[Array, " arrivals"],
    mu: Scalar,
    *,
    revolutions: int,
    low: bool,
) -> Porkchop:
    """`porkchop` of pairs."""
    # Each orbit is followed once, and not again for every pair.
    starts, befores = conic_flow(*chaser, departures, mu)
    ends, afters = conic_flow(*target, arrivals, mu)

    # Row by row, so that the data of a row stay in the cache.
    def row(leaving: tuple[Vector, Vector, Scalar]) -> Porkchop:
        start, before, departure = leaving
        v1, v2 = lambert(
            start[:, None],
            ends,
            arrivals - departure,
            mu,
            normal=_sense(chaser, start[:, None], ends),
            revolutions=revolutions,
            low=low,
        )
        return Porkchop(norm(v1 - before[:, None]), norm(afters - v2))

    return jax.lax.map(row, (starts.T, befores.T, departures))


def _sense(chaser: tuple[Vector, Vector], start: Vector, end: Vector) -> Vector:
    """The normal of the chaser's plane, constant until the departure; for a chaser on a line
    through the centre, the normal of the short way from `start` to `end`."""
    way = cross(start, end)
    sense = with_rank(cross(*chaser), way.ndim - 1)
    return jnp.where(dot(sense, sense) > 0.0, sense, way)
