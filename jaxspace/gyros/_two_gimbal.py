"""A free rotor in two gimbals that have mass, the axis of the outer gimbal fixed in inertial space.

    (A + A_i) theta'' = (A + B_i - C_i) psi'^2 sin(theta) cos(theta) - H psi' sin(theta) + M_xi
    h_Z' = M_Z                           h_Z = I_Z psi' + H cos(theta)
    I_Z(theta) = (A + B_i) sin^2(theta) + C_i cos^2(theta) + C_0,    H = C n
    H' = K (n_0 - n + psi' cos(theta))   with a motor, else H is constant

    symbol         meaning                                                            unit
    theta          angle of the rotor's axis from the outer gimbal's axis Z           rad
    psi            angle of the outer gimbal about Z                                  rad
    A, C           moments of inertia of the rotor, across and along its axis         kg m^2
    n              spin of the rotor about its axis, relative to inertial space       rad/s
    A_i, B_i, C_i  inner gimbal: about its own axis xi, across, along the rotor axis  kg m^2
    C_0            outer gimbal, about Z                                              kg m^2
    M_xi, M_Z      moments about the inner and the outer axis: constant, and friction N m
    K, n_0         motor: torque per lack of speed; speed in the inner gimbal         N m s, rad/s
    h_Z            angular momentum of everything about Z                             kg m^2/s

Source: Thomson 6.2 (massless gimbals: 6.2-1), 6.3-1 to -14 (with mass), 6.3-22 (drift). In 6.3-5
the spin is phi' + psi' cos(theta); the expansion 6.3-16 omits -H cos(theta_0) (theta - theta_0)^2 /
2, which does not affect the drift. Change of attitude: problems 6.2-5 to -7, where atan(2M/Cn) is 2
atan(M/Cn). Valid for rigid gimbals with axes at right angles.

Gimbal lock: at theta = 0 the rotor's axis is along Z. With gimbals without mass I_Z is then zero,
so that psi, its rate and the vector field are undefined. With C_i + C_0 > 0 nothing is singular.
The event `near_gimbal_lock` reports it before.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..core import AbstractSystem, InputError, NumberField, Scalar, argument, constructor, quantity
from ..core.checks import is_concrete
from ..core.limits import Limit
from ..core.safe import end_sqrt
from ..core.special import stumpff
from ..core.square_roots import inverse_sqrt
from ..core.types import as_float
from .bearing import BearingFriction, RotorMotor
from .gimbal_state import GimbalState
from .gimbal_walk import GimbalWalk


@final
class TwoGimbalGyro(AbstractSystem):
    """A rotor in two gimbals, massless by default.

    State: `GimbalState`, preferably created with `TwoGimbalGyro.state`."""

    transverse_inertia: NumberField = quantity(
        "kg m^2", positive=True, doc="A, of the rotor across its axis"
    )
    axial_inertia: NumberField = quantity(
        "kg m^2", positive=True, doc="C, of the rotor about its axis"
    )
    spin_rate: NumberField = quantity(
        "rad/s", doc="n, of the rotor about its axis, relative to inertial space"
    )
    inner_xi: NumberField = quantity(
        "kg m^2", non_negative=True, default=0.0, doc="A_i, inner gimbal about its own axis"
    )
    inner_eta: NumberField = quantity(
        "kg m^2", non_negative=True, default=0.0, doc="B_i, inner gimbal across both axes"
    )
    inner_zeta: NumberField = quantity(
        "kg m^2", non_negative=True, default=0.0, doc="C_i, inner gimbal about the rotor's axis"
    )
    outer: NumberField = quantity(
        "kg m^2", non_negative=True, default=0.0, doc="C_0, outer gimbal about its own axis"
    )
    moment_inner: NumberField = quantity(
        "N m", default=0.0, doc="M_xi, constant moment about the inner axis"
    )
    moment_outer: NumberField = quantity(
        "N m", default=0.0, doc="M_Z, constant moment about the outer axis"
    )

    inner_bearing: BearingFriction | None = eqx.field(
        default=None, metadata={"doc": "friction of the inner bearing; none by default"}
    )
    outer_bearing: BearingFriction | None = eqx.field(
        default=None, metadata={"doc": "friction of the outer bearing; none by default"}
    )
    motor: RotorMotor | None = eqx.field(
        default=None, metadata={"doc": "of the rotor; by default its spin rate is constant"}
    )

    def vector_field(self, t: Scalar, y: GimbalState) -> GimbalState:
        del t
        # By the momentum, whose errors do not add to the drift of psi.
        psi_rate = self.outer_rate(y)
        spin = self._spin_moment(y, psi_rate)
        inner, outer = self._moments(y, psi_rate, spin)
        tilting = inner
        if self.inner_bearing is not None:
            tilting = inner + self.inner_bearing.moment(y.theta_rate, y.slip_inner)
        turning = self.moment_outer
        if self.outer_bearing is not None:
            turning = turning + self.outer_bearing.moment(psi_rate, y.slip_outer)
        if y.slip_inner is not None:
            tilting = jnp.where(y.slip_inner == 0.0, 0.0, tilting)
        if y.slip_outer is not None:
            # The momentum with which the outer gimbal stays at rest.
            turning = jnp.where(y.slip_outer == 0.0, self.moment_outer - outer, turning)
        return GimbalState(
            theta=y.theta_rate,
            psi=psi_rate,
            theta_rate=tilting / self.inner_inertia,
            # A moment shared by all runs is broadcast to the runs in a rate.
            angular_momentum=turning + jnp.zeros_like(y.angular_momentum),
            spin_momentum=spin,
            slip_inner=None if y.slip_inner is None else jnp.zeros_like(y.slip_inner),
            slip_outer=None if y.slip_outer is None else jnp.zeros_like(y.slip_outer),
        )

    def limits(self, t: Scalar, y: GimbalState) -> Sequence[Limit]:
        """A bearing with dry friction neither turns against its slip, nor sticks under a moment
        beyond the friction limit: beyond, the event of `friction_margin` is missing."""
        del t
        # With a margin above the error of a state at that event: in moments a part of the friction,
        # in rates of the precession that it makes.
        precession = 1.0 / jnp.abs(self.spin_momentum(y))
        return [
            Limit(
                f"friction_margin, of {name}",
                "",
                bearing.margin(rate, applied, slip),
                0.0,
                margin=1e-4 * bearing.dry * jnp.where(slip == 0.0, 1.0, precession),
            )
            for name, bearing, rate, applied, slip in self._slipping(y)
        ]

    def invariants(self, t: Scalar, y: GimbalState) -> dict[str, Array]:
        """The energy minus the work of the moments, J, and the momentum about Z minus the impulse
        of M_Z, kg m^2/s; only those that friction and motor conserve."""
        conserved = {}
        if self.inner_bearing is None and self.outer_bearing is None and self.motor is None:
            # Constant moments have potentials: the angles times the moments.
            work = self.moment_inner * y.theta + self.moment_outer * y.psi
            conserved["energy"] = self.energy(y) - work
        if self.outer_bearing is None:
            conserved["angular_momentum"] = y.angular_momentum - self.moment_outer * t
        return conserved

    def energy(self, y: GimbalState) -> Scalar:
        """Kinetic energy of rotor and gimbals, J."""
        turning = self.outer_inertia(y.theta) * self.outer_rate(y) ** 2
        spin = self.spin_momentum(y) ** 2 / self.axial_inertia
        return 0.5 * (self.inner_inertia * y.theta_rate**2 + turning + spin)

    @constructor(
        theta=argument(
            "rad", default=0.0, doc="angle of the rotor's axis from the outer gimbal's axis"
        ),
        psi=argument("rad", default=0.0, doc="angle of the outer gimbal about its axis"),
        theta_rate=argument("rad/s", default=0.0, doc="rate of theta"),
        psi_rate=argument("rad/s", default=0.0, doc="rate of psi"),
    )
    def state(
        self, theta: Scalar, psi: Scalar, theta_rate: Scalar, psi_rate: Scalar
    ) -> GimbalState:
        """The state from the angles, rad, and the rates, rad/s, of the gimbals.

        The state contains the momentum about the outer axis, which includes H cos(theta) of the
        spin: an outer rate far below H cos(theta)/A has the rounding error of the latter."""
        inertia = self.outer_inertia(theta)
        # In a batch only the run in gimbal lock is NaN.
        if is_concrete(inertia) and inertia.ndim == 0 and float(inertia) == 0.0:
            raise InputError(
                f"TwoGimbalGyro.state: theta is {float(np.asarray(theta)):.6g} rad, gimbal lock: "
                "the axis of the rotor is along that of the outer gimbal, whose rate is undefined "
                "without the mass of gimbals. Start at another angle, or give inner_zeta or outer."
            )
        h = inertia * psi_rate + self.spin_momentum() * jnp.cos(theta)
        y = GimbalState(theta, psi, theta_rate, h)
        if self.motor is not None:
            y = replace(y, spin_momentum=self.spin_momentum() + 0.0 * h)
        if self.inner_bearing is not None and self.inner_bearing.slips:
            y = replace(y, slip_inner=jnp.sign(theta_rate + 0.0 * h))
        if self.outer_bearing is not None and self.outer_bearing.slips:
            y = replace(y, slip_outer=jnp.sign(psi_rate + 0.0 * h))
        for name, bearing, _, applied, slip in self._slipping(y):
            y = replace(y, **{name: jnp.where(slip == 0.0, bearing.slip_at_rest(applied), slip)})
        return y

    def outer_rate(self, y: GimbalState) -> Scalar:
        """Rate psi' = (h_Z - H cos(theta)) / I_Z, rad/s (Thomson 6.3-14); not finite in gimbal
        lock, and zero where the outer bearing sticks."""
        momentum = y.angular_momentum - self.spin_momentum(y) * jnp.cos(y.theta)
        if y.slip_outer is not None:
            # Set to zero, because rounding in the momentum would turn a gimbal that sticks.
            momentum = jnp.where(y.slip_outer == 0.0, 0.0, momentum)
        return momentum / self.outer_inertia(y.theta)

    def spin_momentum(self, y: GimbalState | None = None) -> Scalar:
        """Spin momentum H, kg m^2/s: C n, or that of the state `y` of a rotor with a motor."""
        if y is not None and y.spin_momentum is not None:
            return y.spin_momentum
        return self.axial_inertia * self.spin_rate

    def friction_margin(self, t: Scalar, y: GimbalState) -> Scalar:
        """A margin that falls to zero where a bearing stops or begins to slip: the condition of an
        event with `direction=-1`, `terminal=False` and `then=gyro.stick_or_slip`."""
        del t
        margins = [b.margin(*motion) for _, b, *motion in self._slipping(y)]
        return jnp.min(jnp.stack(jnp.broadcast_arrays(*margins)), axis=0)

    def stick_or_slip(self, t: Scalar, y: GimbalState) -> GimbalState:
        """The state after a bearing has come to rest or has begun to slip; the other bearing is
        unchanged."""
        del t
        least = self.friction_margin(0.0, y)
        for name, bearing, rate, applied, slip in self._slipping(y):
            margin = bearing.margin(rate, applied, slip)
            # Two bearings at the same time are one event.
            now = (margin <= least) | (margin <= 0.0)
            y = self._at_rest(y, name, now)
            y = replace(y, **{name: jnp.where(now, bearing.slip_at_rest(applied), slip)})
        return y

    def struck(self, y: GimbalState, inner: Scalar, outer: Scalar = 0.0) -> GimbalState:
        """The state after impulses about the inner and about the outer axis, N m s."""
        rate = y.theta_rate + inner / self.inner_inertia
        return replace(y, theta_rate=rate, angular_momentum=y.angular_momentum + outer)

    def arrested(self, y: GimbalState) -> tuple[GimbalState, Scalar, Scalar]:
        """The state with both gimbals brought to rest, and the impulses about the inner and the
        outer axis, N m s, that do it."""
        outer = self.spin_momentum(y) * jnp.cos(y.theta) - y.angular_momentum
        inner = -self.inner_inertia * y.theta_rate
        still = self.spin_momentum(y) * jnp.cos(y.theta) + 0.0 * outer
        return replace(y, theta_rate=0.0 * inner, angular_momentum=still), inner, outer

    def attitude_change(self, turn: Scalar) -> tuple[Scalar, Scalar]:
        """Change of the attitude by two impulses across the axis (Thomson 6.2, problems 5 to 7).

        Valid for gimbals without mass. Half a nutation after the first impulse the axis has turned
        by 2 atan(M / H), and `arrested` stops it.

        **Arguments**

        - `turn`: by which the axis is to turn, rad, below pi.

        **Returns** the first impulse M, N m s, and the time between both, s.
        """
        impulse = self.spin_momentum() * jnp.tan(0.5 * turn)
        # pi A / h, with h^2 = H^2 + M^2.
        time = jnp.pi * self.transverse_inertia * jnp.cos(0.5 * turn) / self.spin_momentum()
        return impulse, time

    @property
    def inner_inertia(self) -> Scalar:
        """Inertia A + A_i of all parts that rotate about the inner axis, kg m^2."""
        return self.transverse_inertia + self.inner_xi

    def outer_inertia(self, theta: Scalar) -> Scalar:
        """Inertia I_Z of all parts that rotate about Z, without the spin, kg m^2, with the rotor's
        axis at `theta`, rad (Thomson 6.3-10)."""
        # Across the rotor's axis the inner gimbal turns with the rotor, along it alone.
        s = jnp.sin(theta)
        c = jnp.cos(theta)
        return (
            (self.transverse_inertia + self.inner_eta) * s * s
            + self.inner_zeta * c * c
            + self.outer
        )

    def nutation_frequency(self, theta: Scalar) -> Scalar:
        """Angular frequency, rad/s, of small oscillations about rest at `theta`, rad (Thomson
        6.3-17).

        It is w = H sin(theta) / sqrt(I_Z (A + A_i)), and C n / A for gimbals without mass."""
        return (
            self.spin_momentum()
            * jnp.sin(theta)
            * inverse_sqrt(self.outer_inertia(theta) * self.inner_inertia)
        )

    def walk(self, theta: Scalar, theta_rate: Scalar) -> GimbalWalk:
        """The free nutation from `theta`, rad, and `theta_rate`, rad/s, with the outer gimbal at
        rest."""
        return GimbalWalk(
            theta=as_float(theta),
            theta_rate=as_float(theta_rate),
            spin_momentum=self.spin_momentum(),
            inner_inertia=self.inner_inertia,
            outer_inertia_upright=self.inner_zeta + self.outer,
            outer_inertia_across=self.transverse_inertia + self.inner_eta + self.outer,
        )

    def impulse_response(self, t: Scalar, impulse: Scalar) -> tuple[Scalar, Scalar]:
        """Deviations of theta and psi after an impulse about the inner axis (Thomson 6.2-7, -8).

        Valid for gimbals without mass, at rest at theta = 90 deg, to first order in the impulse.

        **Arguments**

        - `t`: time since the impulse, s.
        - `impulse`: N m s.

        **Returns** both differences, rad.
        """
        p = self.spin_momentum() / self.transverse_inertia
        # Without mass of the gimbals the nutation is a circle of this size.
        size = impulse / self.spin_momentum()
        return size * jnp.sin(p * t), 2.0 * size * jnp.sin(0.5 * p * t) ** 2

    def step_response(self, t: Scalar) -> tuple[Scalar, Scalar]:
        """Deviations of theta and psi, rad, after `t`, s, under the moment M_xi (Thomson 6.2,
        problem 1).

        Valid for gimbals without mass, from rest at theta = 90 deg, to first order in the moment.
        """
        p = self.spin_momentum() / self.transverse_inertia
        # The nutation starts from rest, so that it is a cycloid about a steady precession.
        size = self.moment_inner / self.spin_momentum()
        return 2.0 * size / p * jnp.sin(0.5 * p * t) ** 2, size / p * _less_sine(p * t)

    def swing(self, t: Scalar, theta: Scalar) -> Scalar:
        """The angle theta under the moment M_Z (Thomson 6.2, problems 3 and 4).

        Valid for a momentum H so large that the nutation is negligible: H sin(theta) theta' = -M_Z.

        **Arguments**

        - `t`: time, s.
        - `theta`: the angle at t = 0, rad.

        **Returns** theta, rad; NaN once the axis has reached Z.
        """
        change = 0.5 * self.moment_outer * t / self.spin_momentum()
        # By half the angle, because the cosine has no digits of a small angle.
        sine = end_sqrt(lambda c, a: jnp.sin(0.5 * a) ** 2 - c, change, as_float(theta))
        cosine = end_sqrt(lambda c, a: jnp.cos(0.5 * a) ** 2 + c, change, as_float(theta))
        return 2.0 * jnp.arctan2(sine, cosine)

    def swing_time(self, theta: Scalar, theta_end: Scalar) -> Scalar:
        """Time, s, in which the moment M_Z swings the axis from `theta` to `theta_end`, rad."""
        # The inverse of `swing`; the difference of the cosines as a product.
        fall = 2.0 * jnp.sin(0.5 * (theta + theta_end)) * jnp.sin(0.5 * (theta - theta_end))
        return self.spin_momentum() * fall / self.moment_outer

    def _moments(
        self, y: GimbalState, psi_rate: Scalar, spin: Scalar | None
    ) -> tuple[Scalar, Scalar]:
        """The moments on the inner gimbal, and on the outer one at rest, without the friction, N
        m."""
        s = jnp.sin(y.theta)
        c = jnp.cos(y.theta)
        H = self.spin_momentum(y)
        # As one product, because both terms vanish where psi' vanishes.
        inner = (self._gimbal_difference() * psi_rate * c - H) * psi_rate * s + self.moment_inner
        outer = self.moment_outer + H * s * y.theta_rate
        return inner, outer if spin is None else outer - spin * c

    def _spin_moment(self, y: GimbalState, psi_rate: Scalar) -> Scalar | None:
        """H', N m, of a rotor with a motor."""
        if self.motor is None:
            return None
        spin = self.spin_momentum(y) / self.axial_inertia
        return self.motor.torque(spin - psi_rate * jnp.cos(y.theta))

    def _slipping(
        self, y: GimbalState
    ) -> Iterator[tuple[str, BearingFriction, Scalar, Scalar, Scalar]]:
        """Iterate over the bearings whose slip is a part of the state: the name of the slip in the
        state, the friction, the rate, the moment at rest, and the slip."""
        psi_rate = self.outer_rate(y)
        inner, outer = self._moments(y, psi_rate, self._spin_moment(y, psi_rate))
        if self.inner_bearing is not None and y.slip_inner is not None:
            yield "slip_inner", self.inner_bearing, y.theta_rate, inner, y.slip_inner
        if self.outer_bearing is not None and y.slip_outer is not None:
            yield "slip_outer", self.outer_bearing, psi_rate, outer, y.slip_outer

    def _at_rest(self, y: GimbalState, name: str, now: Array) -> GimbalState:
        """The state with the gimbal of the bearing `name` at rest where it is `now`."""
        if name == "slip_inner":
            return replace(y, theta_rate=jnp.where(now, 0.0, y.theta_rate))
        # The outer gimbal is stopped through its momentum, from which its rate follows.
        still = self.spin_momentum(y) * jnp.cos(y.theta)
        return replace(y, angular_momentum=jnp.where(now, still, y.angular_momentum))

    def _gimbal_difference(self) -> Scalar:
        """A + B_i - C_i, kg m^2."""
        return self.transverse_inertia + self.inner_eta - self.inner_zeta


def _less_sine(x: Scalar) -> Scalar:
    """x - sin(x), accurate to rounding for small x as well."""
    small = jnp.abs(x) < 1.0
    # Where the closed form is used, the series gets zero, because its powers may overflow.
    near = jnp.where(small, x, 0.0)
    return jnp.where(small, near**3 * stumpff(near * near)[1], x - jnp.sin(x))
