"""Errors of an inertial navigator: how errors of gyros and accelerometers become errors of
position.

    r'' + 2 W x r' + W x (W x r) = phi x A + b + w0^2 (-x, -y, 2 z) - (0, 0, k_1 z' + k_2 z)
    phi' = e - W x phi

in axes that turn with W, z upwards, constant W and A.

    symbol   meaning                                                     unit
    r, phi   error of position; tilt of the table                        m, rad
    W        angular velocity of the table's axes in inertial space      rad/s
    A        specific force that the accelerometers measure              m/s^2
    b, e     bias of the accelerometers, drift of the gyros              m/s^2, rad/s
    w0       Schuler's frequency sqrt(g / r)                             rad/s
    k_1,k_2  gains of an altimeter in the vertical channel               1/s, 1/s^2

The level channels oscillate with Schuler's period, modulated by W_z (Foucault); the tilt follows
W, once a day at rest; the vertical channel grows as e^(sqrt(2) w0 t) without an altimeter.

Source: Thomson 6.10, 6.11-4 to -13 (in 6.11-6 the coefficient of dz is 2 w_y d/dt + w_y' +
w_x w_z).
"""

__all__ = ["NavigationErrorState", "NavigationErrors", "coupled_rates", "table_rates"]

from typing import final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import AbstractSystem, NumberField, Scalar, quantity
from ..core.formula import NOT_NEGATIVE, POSITIVE, formula
from ..core.printing import printed
from ..core.squares import difference_of_squares
from ..core.types import follow_precision
from ._linear import LinearFlow, linear_rate
from .gyropendulum import schuler_frequency


@final
@printed()
class NavigationErrorState(eqx.Module):
    """Errors of position and velocity, and the tilt of the table; also the rates of all."""

    position: Float[Array, "3 *#runs"] = quantity("m", doc="error r, z upwards")
    velocity: Float[Array, "3 *#runs"] = quantity("m/s", doc="rate r' in the turning axes")
    tilt: Float[Array, "3 *#runs"] = quantity("rad", doc="phi, of the table")


@final
class NavigationErrors(AbstractSystem):
    """The linear error equations, exact at every time. State: `NavigationErrorState`, made by
    `errors` where some are zero."""

    radius: NumberField = quantity("m", positive=True, doc="r, from the earth's centre")
    gravity: NumberField = quantity("m/s^2", positive=True, doc="g, at this place")
    rate: Float[Array, "3 *#runs"] = quantity("rad/s", default=(0.0, 0.0, 0.0), doc="W")
    specific_force: Float[Array, "3 *#runs"] = quantity("m/s^2", default=(0.0, 0.0, 0.0), doc="A")
    accelerometer_bias: Float[Array, "3 *#runs"] = quantity(
        "m/s^2", default=(0.0, 0.0, 0.0), doc="b"
    )
    gyro_drift: Float[Array, "3 *#runs"] = quantity("rad/s", default=(0.0, 0.0, 0.0), doc="e")
    altitude_rate_gain: NumberField = quantity(
        "1/s", default=0.0, doc="k_1, gain of the altimeter on the vertical speed"
    )
    altitude_gain: NumberField = quantity(
        "1/s^2", default=0.0, doc="k_2, gain of the altimeter on the height"
    )

    def vector_field(self, t: Scalar, y: NavigationErrorState) -> NavigationErrorState:
        del t
        return linear_rate(*follow_precision(self, y)._matrices(), y)

    def invariants(self, t: Scalar, y: NavigationErrorState) -> dict[str, Array]:
        """Nothing is conserved with faults of the instruments."""
        del t, y
        return {}

    def closed_form(self) -> LinearFlow:
        return LinearFlow(*self._matrices())

    @staticmethod
    def errors(
        position: Array | None = None, velocity: Array | None = None, tilt: Array | None = None
    ) -> NavigationErrorState:
        """The state of the given errors, (3, *runs) each; the others are zero."""
        given = [x for x in (position, velocity, tilt) if x is not None]
        zero = jnp.zeros_like(given[0]) if given else jnp.zeros(3)
        return NavigationErrorState(*(zero if x is None else x for x in (position, velocity, tilt)))

    def _matrices(self) -> tuple[Array, Array]:
        w2 = schuler_frequency(self.gravity, self.radius) ** 2
        runs = np.broadcast_shapes(
            w2.shape,
            *(x.shape[1:] for x in (self.rate, self.specific_force, self.gyro_drift)),
            *(x.shape for x in (self.altitude_rate_gain, self.altitude_gain)),
            self.accelerometer_bias.shape[1:],
        )

        turn = _cross_matrix(self.rate)
        axes = jnp.eye(3, dtype=w2.dtype).reshape(3, 3, *(1,) * len(runs))
        up = axes[2] * axes[2][:, None]
        # The gradient of a point's attraction: restoring horizontally, repelling vertically.
        attraction = w2 * (3.0 * up - axes)
        of_position = attraction - self.altitude_gain * up
        of_position = of_position - jnp.einsum("ij...,jk...->ik...", turn, turn)
        of_velocity = -2.0 * turn - self.altitude_rate_gain * up
        of_tilt = -_cross_matrix(self.specific_force)
        shape = (3, 3, *runs)
        zero = jnp.zeros(shape, w2.dtype)
        one = jnp.broadcast_to(axes, shape)
        blocks = (
            (zero, one, zero),
            (of_position, of_velocity, of_tilt),
            (zero, zero, -turn),
        )
        matrix = jnp.concatenate(
            [
                jnp.concatenate([jnp.broadcast_to(_fit(x, shape), shape) for x in row], axis=1)
                for row in blocks
            ]
        )
        parts = (zero[:, 0], self.accelerometer_bias, self.gyro_drift)
        drive = [jnp.broadcast_to(_fit(x, (3, *runs)), (3, *runs)) for x in parts]
        return matrix, jnp.concatenate(drive)


def _fit(x: Array, shape: tuple[int, ...]) -> Array:
    """An array with axes of length one for the runs that it does not have."""
    return x.reshape(*x.shape, *(1,) * (len(shape) - x.ndim))


def _cross_matrix(a: Array) -> Array:
    """The matrix, (3, 3, *runs), of the product a x."""
    zero = jnp.zeros_like(a[0])
    return jnp.stack(
        [
            jnp.stack([zero, -a[2], a[1]]),
            jnp.stack([a[2], zero, -a[0]]),
            jnp.stack([-a[1], a[0], zero]),
        ]
    )


@formula(schuler=POSITIVE, rate=NOT_NEGATIVE)
def coupled_rates(schuler: Scalar, rate: Scalar) -> tuple[Scalar, Scalar]:
    """Oscillation and growth of the errors along the track and of the height of a fast vehicle.

    s^2 = [w0^2 - 2 w^2 +- w0 sqrt(9 w0^2 - 8 w^2)] / 2 (Thomson 6.11-10, -11 with their coupling).

    **Arguments**

    - `schuler`: w0, rad/s, at the height of the vehicle.
    - `rate`: w = v / r, rad/s, up to w0, where the growth ends in that of an orbit.

    **Returns** the angular frequency, rad/s, and the growth rate, 1/s."""
    w0, w = schuler, rate
    root = w0 * jnp.sqrt(9.0 * w0 * w0 - 8.0 * w * w)
    oscillation = 0.5 * (root - w0 * w0 + 2.0 * w * w)
    # By the product of both, because near the speed of an orbit their difference loses its digits.
    growth = (w * w + 2.0 * w0 * w0) * difference_of_squares(w0, w) / oscillation
    return jnp.sqrt(oscillation), jnp.sqrt(growth)


@formula(radius=POSITIVE)
def table_rates(
    latitude: Scalar, north_speed: Scalar, east_speed: Scalar, radius: Scalar, earth_rate: Scalar
) -> tuple[Scalar, Scalar, Scalar]:
    """Rates of a table that remains level over the earth (Thomson 6.11, problem 12).

    **Arguments**

    - `latitude`: rad; `radius`: from the centre of the earth, m.
    - `north_speed`, `east_speed`: over the ground, m/s.
    - `earth_rate`: rad/s.

    **Returns** the rate of latitude, that of longitude, and that about the polar axis in inertial
    space, rad/s; the last two are infinite at a pole."""
    longitude = east_speed / (radius * jnp.cos(latitude))
    return north_speed / radius, longitude, earth_rate + longitude
