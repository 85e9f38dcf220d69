"""Momentum of a body that gains and loses mass: rockets, jet engines, accretion.

    m v' = F + sum_k m'_k (c_k - v)            m' = sum_k m'_k
    F = m v' + (v - c) m'                      one stream (7.7-3)

A stream that enters with the velocity c_k pulls the body towards that velocity; one that leaves
(m'_k < 0) pushes it away. A rocket's exhaust leaves with c = v + u, u backwards; the air of a jet
engine enters with the velocity of the air and leaves with the fuel.

Closed forms for constant rates, with s = m' t/m_0:

    v = v_0 + a t/m                            a = F + m' (c - v_0)
    x = v_0 t + a t^2/m_0 [s - ln(1 + s)]/s^2

    symbol  meaning                                                         unit
    m, v    mass and velocity of the body                                   kg, m/s
    m'_k    rate of the stream k, positive when mass enters                 kg/s
    c_k     velocity of the stream where it meets the body, inertial axes   m/s
    F       sum of the other forces                                         N

Source: Thomson 7.7 (7.7-3, 7.7-4).
"""

__all__ = ["jet_engine_thrust", "swept_motion", "variable_mass_acceleration"]

from typing import final

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load
from ..core import NumberField, Scalar, Vector, quantity
from ..core.formula import NOT_NEGATIVE, POSITIVE, formula
from ..core.shapes import with_rank
from ..core.types import as_float


@formula(mass=POSITIVE)
def variable_mass_acceleration(
    mass: Scalar,
    velocity: Vector,
    force: Vector,
    rates: Float[Array, "streams *#runs"],
    stream_velocities: Float[Array, "3 streams *#runs"],
) -> Vector:
    """Acceleration of a body under forces and streams of mass (Thomson 7.7-3).

    **Arguments**

    - `mass`: kg; `velocity`: m/s, (3, *runs); `force`: N, (3, *runs).
    - `rates`: of the streams, kg/s, positive when mass enters.
    - `stream_velocities`: in inertial axes, m/s.

    **Returns** v', m/s^2, (3, *runs).
    """
    push = jnp.sum(rates * (stream_velocities - velocity[:, None]), axis=1)
    return (force + push) / mass


@formula(mass=POSITIVE)
def swept_motion(
    time: Scalar,
    mass: Scalar,
    rate: Scalar,
    speed: Scalar,
    stream_speed: Scalar = 0.0,
    force: Scalar = 0.0,
) -> tuple[Scalar, Scalar]:
    """Speed and distance along a line of a body with one constant stream (Thomson 7.7-3).

    **Arguments**

    - `time`: t, s.
    - `mass`: m_0 at the start, kg; `rate`: m', kg/s, positive when mass enters, zero allowed.
    - `speed`: v_0 at the start; `stream_speed`: c, of the stream in inertial axes, m/s.
    - `force`: N, constant.

    **Returns** v, m/s, and x, m.
    """
    s = rate * as_float(time) / mass
    gain = (force + rate * (stream_speed - speed)) * time
    # The distance of a rate near zero is a difference of equal terms: with this share it is
    # accurate.
    share = _log_rest(s)
    return speed + gain / (mass * (1.0 + s)), speed * time + gain * time / mass * share


def _log_rest(s: Scalar) -> Scalar:
    """[s - ln(1 + s)]/s^2, with its series about s = 0."""
    small = jnp.abs(s) < 0.25
    x = jnp.where(small, s, 0.0)
    # ln(1 + x) = 2 artanh(q), q = x/(2 + x): s - ln(1 + s) = x q - 2 (q^3/3 + q^5/5 + ...), where
    # q^3 = x^2 q/(2 + x)^2 takes the square out. The 22nd power of q is below rounding.
    q = x / (2.0 + x)
    series = 0.0
    for n in range(21, 1, -2):
        series = 1.0 / n + q * q * series
    near = (1.0 - 2.0 * q * series / (2.0 + x)) / (2.0 + x)
    far = jnp.where(small, 1.0, s)
    return jnp.where(small, near, (far - jnp.log1p(jnp.where(small, 0.0, s))) / (far * far))


@formula(air_rate=NOT_NEGATIVE, fuel_rate=NOT_NEGATIVE, exit_area=NOT_NEGATIVE)
def jet_engine_thrust(
    air_rate: Scalar,
    fuel_rate: Scalar,
    jet_speed: Scalar,
    flight_speed: Scalar,
    pressure_excess: Scalar = 0.0,
    exit_area: Scalar = 0.0,
) -> Scalar:
    """Thrust of an engine that breathes air, N: momentum of the jet less that of the inflow, and
    the pressure over the exit.

    **Arguments**

    - `air_rate`, `fuel_rate`: kg/s, positive. Without air it is a rocket.
    - `jet_speed`: of the jet relative to the engine; `flight_speed`: relative to the air, m/s.
    - `pressure_excess`: of the jet over the air at the exit, Pa; `exit_area`: m^2.
    """
    momentum = (air_rate + fuel_rate) * jet_speed - air_rate * flight_speed
    return momentum + pressure_excess * exit_area


@final
class MassStream(AbstractEffect):
    """A stream of mass that enters the body, or leaves it, with a given velocity in inertial axes:
    dust that is swept up, water that is scooped, ballast that is dropped."""

    rate: NumberField = quantity("kg/s", doc="positive when mass enters")
    stream_velocity: Float[Array, "3 *#runs"] = quantity(
        "m/s", default=(0.0, 0.0, 0.0), doc="of the mass that enters or leaves, in inertial axes"
    )

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del t, body
        c = with_rank(self.stream_velocity, y.velocity.ndim - 1)
        # The zero brings the runs and the precision of the mass.
        return Load(force_N=self.rate * (c - y.velocity), mass_rate=self.rate + 0.0 * y.mass)
