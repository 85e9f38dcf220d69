"""A nutation damper: a mass on a spring and a dashpot that slides along a line fixed in the body.

    r = r0 + z u
    J(z) = J + m0 z [2 (r0 . u) 1 - r0 u^T - u r0^T] + mu z^2 (1 - u u^T),    mu = m0 (1 - m0/m)
    p = mu z' + b . omega,      b = m0 r0 x u
    p' = omega . J'(z) omega / 2 - k z - c z'
    H = J* omega + b p/mu,      J* = J(z) - b b^T/mu
    J* omega' = M - z' J'(z) omega - b p'/mu - omega x H
    under a thrust F:   p' - (m0/m) F . u,   M - (m0/m) z u x F

    symbol    meaning                                                             unit
    m, m0     mass of all, of the damper                                          kg
    r0, u     place of the damper at rest from the mass centre; its direction     m, 1
    z, z'     displacement, its rate                                              m, m/s
    p         momentum of the damper along the line                               kg m/s
    k, c      stiffness of the spring, of the dashpot                             N/m, N s/m
    J, J(z)   inertia of all about the mass centre: at rest, displaced            kg m^2
    F         thrust, fixed in the body, through the mass centre at z = 0         N

Source: Thomson 7.11, Problem 12 (r0 along x, u along z; with the signs corrected), in the momenta
of Lagrange's equations: the state contains p instead of z', so that its rate contains no
acceleration of the body, and the momentum of all is conserved to the rounding of the run. A thrust
pushes the body and not the damper: the damper falls back by m0 F/(m k) and moves the mass centre
off the line of F. Gravity pushes both alike.
"""

__all__ = ["DamperMotion"]

from typing import ClassVar, NamedTuple, final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load, PrincipalInertia, RigidBody
from ..bodies.newton_euler import angular_acceleration
from ..core import NumberField, Scalar, State, Vector, quantity
from ..core.printing import printed
from ..core.shapes import with_rank
from ..core.types import precision_of
from ..core.vectors import axis, cross, dot, identity, scale, unit
from ..rotations import Quaternion


@printed(displacement="m", rate="m/s", momentum_rate="N")
class DamperMotion(NamedTuple):
    """The motion of a damper in a body: displacement z, m, rate z', m/s, p', N, each (*runs,)."""

    displacement: Scalar
    rate: Scalar
    momentum_rate: Scalar


@final
class NutationDamper(AbstractEffect):
    """A mass on a spring and a dashpot in the body.

    The inertia and the mass of the body are those of all, with the damper at rest. `Scene.start`
    adds the part `damper` to a state: its displacement, m, and its momentum p, kg m/s; `motion`
    gives the rate."""

    keeps: ClassVar[frozenset[str]] = frozenset(
        {"angular_momentum", "axial_angular_momentum", "rotational_momentum"}
    )

    mass: NumberField = quantity("kg", positive=True, doc="m0, of the damper")
    position: Float[Array, "3 *#runs"] = quantity(
        "m", doc="r0, of the damper at rest, from the mass centre in body axes"
    )
    direction: Float[Array, "3 *#runs"] = quantity(
        "", direction=True, doc="u, in which it slides, in body axes; of non-zero length"
    )
    stiffness: NumberField = quantity("N/m", non_negative=True, doc="k, of the spring")
    damping: NumberField = quantity("N s/m", non_negative=True, doc="c, of the dashpot")
    displacement: NumberField = quantity("m", default=0.0, doc="z at the start")
    rate: NumberField = quantity("m/s", default=0.0, doc="z' at the start")
    thrust: Float[Array, "3 *#runs"] | None = quantity(
        "N", optional=True, doc="F, that pushes the body, in body axes"
    )
    part: str = eqx.field(
        static=True, default="damper", metadata={"doc": "name of its part of the state"}
    )

    def start(self, y: BodyState, body: AbstractBody) -> dict[str, State]:
        _, _, b = self._lines(y.omega.ndim - 1)
        along = dot(b, y.omega)
        momentum = self.reduced_mass(_mass_of(y, body)) * self.rate + along
        return {self.part: {"displacement": self.displacement + 0.0 * along, "momentum": momentum}}

    def reduced_mass(self, mass: Scalar) -> Scalar:
        """mu, kg, in a body of the `mass`, kg, of all."""
        return self.mass * (1.0 - self.mass / mass)

    def motion(self, y: BodyState, body: AbstractBody) -> DamperMotion:
        """Motion of the damper in the state `y` of the `body`, also along a trajectory."""
        _, _, b = self._lines(y.omega.ndim - 1)
        z, p = (y.part(self.part)[name] for name in ("displacement", "momentum"))
        rate = (p - dot(b, y.omega)) / self.reduced_mass(_mass_of(y, body))
        # The tensor is symmetric: half of omega . J' omega is the centrifugal force.
        outwards = 0.5 * dot(y.omega, self._inertia_rate(y, body))
        push = outwards - self.stiffness * z - self.damping * rate
        if self.thrust is not None:
            push = push - dot(self._thrust_share(y, body), self._lines(y.omega.ndim - 1)[1])
        return DamperMotion(z, rate, push)

    def energy(self, y: BodyState, body: AbstractBody) -> Scalar:
        """Energy, J, (*runs,), of the rotation of all about the mass centre, of the motion of the
        damper and of its spring."""
        load = self.load(0.0, y, body)
        mu = self.reduced_mass(_mass_of(y, body))
        z, p = (y.part(self.part)[name] for name in ("displacement", "momentum"))
        spin = body.inertia(y.mass).times(y.omega) + _times(load.inertia_B, y.omega)
        # 2 T = omega . J* omega + p^2/mu, for H = J* omega + b p/mu and mu z' = p - b . omega.
        return 0.5 * (dot(y.omega, spin) + p * p / mu + self.stiffness * z * z)

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del t
        rank = y.omega.ndim - 1
        r0, u, b = self._lines(rank)
        mu = self.reduced_mass(_mass_of(y, body))
        z, rate, momentum_rate = self.motion(y, body)
        p = y.part(self.part)["momentum"]
        one = identity(rank)
        first = 2.0 * dot(r0, u) * one - _outer(r0, u) - _outer(u, r0)
        second = one - _outer(u, u)
        torque = -scale(rate, self._inertia_rate(y, body)) - scale(momentum_rate / mu, b)
        if self.thrust is not None:
            torque = torque - scale(z, cross(u, self._thrust_share(y, body)))
        return Load(
            torque_B=torque,
            parts_rate={self.part: {"displacement": rate, "momentum": momentum_rate}},
            inertia_B=self.mass * z * first + mu * z * z * second - _outer(b, b) / mu,
            momentum_B=scale(p / mu, b),
        )

    def eigenvalues(
        self, moments: Vector, mass: Scalar, spin: Scalar
    ) -> tuple[Float[Array, " 5"], Float[Array, " 5"]]:
        """Eigenvalues of small motions about a pure spin about z, with the damper at rest.

        **Arguments**, of one body

        - `moments`: principal moments of all, kg m^2, (3,).
        - `mass`: of all, kg.
        - `spin`: rad/s.

        **Returns** the real parts (growth rates), 1/s, and the imaginary ones (frequencies),
        rad/s, each (5,), in arbitrary order; one pair is zero, because the spin rate is arbitrary.
        With a positive real part the nutation grows: with a damper, where z is not the axis of
        the greatest moment. The spin is steady where r0 is perpendicular to z or u parallel to it,
        and r0 . u = r0_z u_z; not available on a GPU.
        """
        body = RigidBody(mass, PrincipalInertia(moments))
        spin = jnp.asarray(spin, precision_of(self, moments, mass, spin))

        def field(x: Array) -> Array:
            part = {"displacement": x[3], "momentum": x[4]}
            y = BodyState(attitude=Quaternion.identity(), omega=x[:3], parts={self.part: part})
            load = self.load(0.0, y, body)
            turned = angular_acceleration(
                body.inertia(None), x[:3], load.torque_B, load.inertia_B, load.momentum_B
            )
            rates = (load.parts_rate or {})[self.part]
            return jnp.stack([*turned, rates["displacement"], rates["momentum"]])

        _, _, b = self._lines(0)
        omega = spin * axis(2, spin)
        at = jnp.stack([*omega, 0.0 * spin, dot(b, omega)])
        # From the equations that are integrated, so that the modes cannot disagree with the motion.
        result = jnp.linalg.eigvals(jax.jacfwd(field)(at))
        return jnp.real(result), jnp.imag(result)

    def _lines(self, rank: int) -> tuple[Vector, Vector, Vector]:
        """r0, u and b, with `rank` axes of times and runs."""
        r0, u = with_rank(self.position, rank), with_rank(unit(self.direction), rank)
        return r0, u, scale(self.mass, cross(r0, u))

    def _thrust_share(self, y: BodyState, body: AbstractBody) -> Vector:
        """(m0/m) F, N."""
        assert self.thrust is not None
        thrust = with_rank(self.thrust, y.omega.ndim - 1)
        return scale(self.mass / _mass_of(y, body), thrust)

    def _inertia_rate(self, y: BodyState, body: AbstractBody) -> Vector:
        """J'(z) omega, kg m^2/s per m."""
        r0, u, _ = self._lines(y.omega.ndim - 1)
        z = y.part(self.part)["displacement"]
        w = y.omega
        along = dot(u, y.omega)
        out = dot(r0, y.omega)
        first = 2.0 * dot(r0, u) * w - along * r0 - out * u
        mu = self.reduced_mass(_mass_of(y, body))
        return scale(self.mass, first) + scale(2.0 * mu * z, w - along * u)


def _mass_of(y: BodyState, body: AbstractBody) -> Scalar:
    """The mass of all, kg."""
    mass = body.constant_mass()
    return y.mass if mass is None else mass


def _outer(a: Vector, b: Vector) -> Array:
    return a[:, None] * b[None, :]


def _times(tensor: Array | None, omega: Vector) -> Vector:
    assert tensor is not None
    return jnp.sum(tensor * omega[None, :], axis=1)
