"""Particles that move in a body: the general equations of moment and force, and masses on given
paths as an effect.

    M0 = m r_c x R0'' + J omega' + omega x J omega + sum r x m_i r''
         + 2 sum r x (omega x m_i r') - sum r x m_i' u                 of [r'], [r''] in body axes
    F  = m (R0'' + omega' x r_c + omega x (omega x r_c)) + sum m_i r'' + 2 omega x sum m_i r'
         - sum m_i' u

    J_c = J + sum m_i (r^2 1 - r r^T) - (S^2 1 - S S^T)/m              masses on given paths
    h   = sum m_i r x r' - S x S'/m,       S = sum m_i r
    J_c omega' = M - [J_c'] omega - h' - omega x (J_c omega + h)

    symbol    meaning                                                            unit
    r         place of a particle in body axes, from the origin                  m
    R0''      acceleration of the origin, in body axes                           m/s^2
    m, m r_c  mass of all, sum m_i r                                             kg, kg m
    m_i', u   mass that a particle gains (negative: loses); velocity at which    kg/s, m/s
              the lost mass leaves it
    M0, F     moment about the origin, force                                     N m, N
    h         angular momentum of the masses in body axes                        kg m^2/s

Source: Thomson 7.11-9 to 7.11-14, with -R0'' x m r_c first and two dots on the relative
acceleration. The paths are prescribed: the drives of the masses are inside the body.
"""

__all__ = ["ParticleEquations", "particle_equations"]

from collections.abc import Callable
from typing import ClassVar, NamedTuple, final

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load
from ..core import Scalar, Vector, quantity
from ..core.formula import formula
from ..core.printing import printed
from ..core.shapes import with_rank
from ..core.vectors import cross, dot, identity


@printed(
    moment="N m",
    force="N",
    origin="N m",
    acceleration="N m",
    gyroscopic="N m",
    relative="N m",
    coriolis="N m",
    thrust="N m",
    inertia_rate="N m",
    jet_damping="N m",
)
class ParticleEquations(NamedTuple):
    """The terms of the moment about the origin, N m, and the force, N, each (3, *runs).

    `inertia_rate`, [J'] omega, and `jet_damping`, its part by the masses with the opposite sign,
    are not terms of the sum: they belong to the form 7.11-12."""

    moment: Vector
    force: Vector
    origin: Vector
    acceleration: Vector
    gyroscopic: Vector
    relative: Vector
    coriolis: Vector
    thrust: Vector
    inertia_rate: Vector
    jet_damping: Vector


@formula
def particle_equations(
    mass: Array,
    places: Array,
    velocities: Array,
    accelerations: Array,
    mass_rates: Array,
    exhaust: Array,
    omega: Vector,
    omega_rate: Vector,
    origin_acceleration: Vector,
) -> ParticleEquations:
    """Moment and force required for a motion of particles, term by term (Thomson 7.11-11, 7.11-14).

    **Arguments**, all in body axes

    - `mass`: of each particle, kg, (particles, *runs).
    - `places`, m, `velocities`, m/s, `accelerations`, m/s^2: relative to the axes, from the origin,
      (3, particles, *runs).
    - `mass_rates`: kg/s, (particles, *runs), negative where mass leaves.
    - `exhaust`: velocity of the leaving mass relative to its particle, m/s, (3, particles, *runs).
    - `omega`, rad/s, `omega_rate`, rad/s^2: of the axes, (3, *runs).
    - `origin_acceleration`: R0'', m/s^2, (3, *runs).

    **Returns** moment and force, and the terms of the moment.
    """
    w, w1 = omega[:, None], omega_rate[:, None]

    def total(x: Array) -> Vector:
        return jnp.sum(x, axis=1)

    def around(x: Vector) -> Vector:
        """J x."""
        spread = x[:, None] + jnp.zeros_like(places)
        return total(mass * cross(places, cross(spread, places)))

    first = total(mass * places)
    origin = cross(first, origin_acceleration)
    terms = (
        origin,
        around(omega_rate),
        cross(omega, around(omega)),
        total(mass * cross(places, accelerations)),
        2.0 * total(mass * cross(places, cross(w + 0.0 * places, velocities))),
        -total(mass_rates * cross(places, exhaust)),
    )
    reach = dot(places, w + 0.0 * places)
    change = 2.0 * dot(places, velocities) * w - velocities * reach
    change = change - places * dot(velocities, w + 0.0 * places)
    lost = dot(places, places) * w - places * reach
    turned = cross(w1 + 0.0 * places, places) + cross(
        w + 0.0 * places, cross(w + 0.0 * places, places)
    )
    push = mass * (origin_acceleration[:, None] + turned + accelerations)
    push = push + 2.0 * mass * cross(w + 0.0 * places, velocities) - mass_rates * exhaust
    return ParticleEquations(
        sum(terms[1:], terms[0]),
        total(push),
        *terms,
        total(mass * change) + total(mass_rates * lost),
        -total(mass_rates * lost),
    )


@final
class MovingMasses(AbstractEffect):
    """Point masses that move in a body on given paths.

    The body's mass includes the moving masses. Its inertia is that of the remaining body, without
    them, about its mass centre, which is also the origin of the paths.

    - `path`: a function of the time, s, that returns the positions r of the masses, m, (3, masses)
      or (3, masses, *runs); it must be twice differentiable."""

    keeps: ClassVar[frozenset[str]] = frozenset(
        {"angular_momentum", "axial_angular_momentum", "rotational_momentum"}
    )

    path: Callable[[Scalar], Array]
    mass: Float[Array, "masses *#runs"] = quantity("kg", positive=True, doc="of each particle")

    def moments(
        self, t: Scalar, all_mass: Scalar, rank: int
    ) -> tuple[Float[Array, "3 3 *#runs"], Vector]:
        """Contributions of the masses to the inertia, kg m^2, and h, kg m^2/s, at the time `t`, s,
        in a body of the mass `all_mass`, kg, with `rank` axes of runs."""
        t = jnp.asarray(t, float) if not isinstance(t, jax.Array) else t
        # Velocities are derivatives of the path, so that they cannot disagree with the places.
        places, velocities = jax.jvp(self.path, (t,), (jnp.ones_like(t),))
        places, velocities = (with_rank(x, rank, axes=2) for x in (places, velocities))
        mass = with_rank(self.mass, rank)
        first, flow = jnp.sum(mass * places, axis=1), jnp.sum(mass * velocities, axis=1)
        one = identity(rank)
        # Minus the part of the common mass centre, which moves with the masses.
        square = jnp.sum(mass * dot(places, places), axis=0) - dot(first, first) / all_mass
        outer = jnp.sum(mass * places[:, None] * places[None, :], axis=2)
        outer = outer - first[:, None] * first[None, :] / all_mass
        momentum = jnp.sum(mass * cross(places, velocities), axis=1)
        return square * one - outer, momentum - cross(first, flow) / all_mass

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        mass = body.constant_mass()
        mass = y.mass if mass is None else mass
        t = jnp.asarray(t, y.omega.dtype)

        def moments(t):
            return self.moments(t, mass, y.omega.ndim - 1)

        # The changes of both by one derivative in time, exact for any path.
        (inertia, momentum), (change, torque) = jax.jvp(moments, (t,), (jnp.ones_like(t),))
        return Load(
            torque_B=-torque - jnp.sum(change * y.omega[None, :], axis=1),
            inertia_B=inertia,
            momentum_B=momentum,
        )
