"""A body that comes apart: the state of each part from that of the whole.

    r_i = r + C d_i,   v_i = v + C (w x d_i + u_i),   C_i = C,   w_i = w
    sum m_i d_i = 0,   sum m_i u_i = 0
    u = sqrt(2 E (1/m_1 + 1/m_2))                        speed of two parts that a spring drives

    symbol     meaning                                                          unit
    r, v, m    position and velocity of the centre of mass, mass                m, m/s, kg
    C, w       attitude, angular velocity in body axes                          1, rad/s
    d_i        centre of mass of part i from that of the whole, in body axes    m
    u_i        velocity that springs give it, in body axes                      m/s
    E          energy of the springs                                            J

Momentum is conserved. The kinetic energy, that of rotation included, grows by sum m_i u_i^2 / 2,
the energy of the springs. The angular momentum is conserved where sum m_i d_i x u_i = 0, as for two
parts driven along the line of their centres. Otherwise a spring would also turn the parts, which is
neglected.

Source: momentum and angular momentum of rigid parts (Thomson 5.5, 5.6); two masses and a spring.
"""

__all__ = ["come_apart", "release", "spring_speed"]

import dataclasses
import functools
import operator
from collections.abc import Callable, Sequence
from typing import ClassVar, final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import InputError, NumberField, Scalar, Vector, quantity
from ..core.formula import NOT_NEGATIVE, POSITIVE, formula
from ..core.safe import end_sqrt
from ..core.shapes import with_rank
from ..core.types import as_float
from ..core.vectors import axis, cross, scale
from ._jump import AbstractJump
from .mass_properties import MassProperties, combined
from .state import BodyState


@final
class Detached(AbstractJump):
    """The state of one part of a body that comes apart, from the state of the whole: the `start` of
    a branch of a mission."""

    needs: ClassVar[frozenset[str]] = frozenset({"position", "velocity"})

    mass: NumberField = quantity("kg", positive=True, doc="m_i, which a mass in the state becomes")
    offset: Float[Array, "3 *#runs"] = quantity(
        "m", doc="d_i, of its centre of mass from that of the whole, in body axes"
    )
    kick: Float[Array, "3 *#runs"] = quantity(
        "m/s", default=(0.0, 0.0, 0.0), doc="u_i, separation velocity, in body axes"
    )

    def __call__(self, t: Scalar, y: BodyState) -> BodyState:
        """The state of the part. A state without an attitude is taken in the axes of the body; one
        without omega does not turn."""
        del t
        rank = y.position.ndim - 1
        offset, kick = with_rank(self.offset, rank), with_rank(self.kick, rank)
        if y.omega is not None:
            kick = kick + cross(y.omega, offset)
        if y.attitude is not None:
            offset, kick = y.attitude.rotate(offset), y.attitude.rotate(kick)
        mass = y.mass if y.mass is None else self.mass * jnp.ones_like(y.mass)
        return dataclasses.replace(
            y, position=y.position + offset, velocity=y.velocity + kick, mass=mass
        )

    def as_point(self) -> Callable[[Scalar, BodyState], BodyState]:
        """The same part as a point, whose state has no rotation."""
        return _AsPoint(self)


@final
class _Released(eqx.Module):
    """One of the `parts` that a body releases, by its `number`, or the remaining body (`None`): its
    state from that of the whole (`release`)."""

    parts: tuple[Detached, ...]
    number: int | None = eqx.field(static=True, default=None)

    def __call__(self, t: Scalar, y: BodyState) -> BodyState:
        """The state of the part, or of the remaining body. Raises `InputError` for a state without
        a mass."""
        if y.mass is None:
            raise InputError("A body that releases parts must have a mass: BodyState(mass=...).")
        rank = jnp.ndim(y.mass)
        offsets = [with_rank(part.offset, rank) for part in self.parts]
        kicks = [with_rank(part.kick, rank) for part in self.parts]
        masses = [part.mass for part in self.parts]
        mass = y.mass - sum(masses)
        offset = kick = 0.0 * axis(0, y.mass)
        if self.number is not None:
            mass = masses[self.number]
            offset, kick = offsets[self.number], kicks[self.number]
        # Both are relative to what is left: taken from their means, by which that one moves.
        offset = offset - _mean(masses, offsets, y.mass)
        kick = kick - _mean(masses, kicks, y.mass)
        return Detached(mass, offset, kick)(t, y)

    def as_point(self) -> Callable[[Scalar, BodyState], BodyState]:
        """The same part as a point, whose state has no rotation."""
        return _AsPoint(self)


@final
class _AsPoint(eqx.Module):
    """The state of a part that moves as a point (`Detached.as_point`)."""

    part: Detached | _Released

    def __call__(self, t: Scalar, y: BodyState) -> BodyState:
        return dataclasses.replace(self.part(t, y), attitude=None, omega=None)


def come_apart(
    *parts: MassProperties, kicks: Sequence[Vector] | None = None
) -> tuple[Detached, ...]:
    """The parts into which a body separates, with its momentum conserved.

    **Arguments**

    - `parts`: two or more, in the same axes; together they are the whole (`combined`).
    - `kicks`: velocities, m/s, (3, *runs) each, that springs give the parts relative to each other;
      their common part is removed. Without kicks the parts separate at zero speed.

    **Returns** a `Detached` for each part.

    **Raises** `InputError` for fewer than two parts, and for another number of kicks."""
    if len(parts) < 2:
        raise InputError(f"come_apart got {len(parts)} parts: it requires at least two.")
    whole = combined(*parts)
    rank = whole.mass.ndim
    offsets = [with_rank(part.centre, rank) - whole.centre for part in parts]
    if kicks is None:
        kicks = [jnp.zeros(3)] * len(parts)
    if len(kicks) != len(parts):
        raise InputError(
            f"come_apart got {len(kicks)} kicks for {len(parts)} parts: it requires one for each "
            "part."
        )
    speeds = [with_rank(as_float(kick), rank) for kick in kicks]
    common = _mean([part.mass for part in parts], speeds, whole.mass)
    return tuple(
        Detached(part.mass, offset, u - common)
        for part, offset, u in zip(parts, offsets, speeds, strict=True)
    )


def release(*parts: Detached) -> tuple[_Released, tuple[_Released, ...]]:
    """The remaining body after a release of parts, and these parts, with conservation of momentum.

    The mass of the whole is that of its state, so that the remaining propellant is arbitrary.

    **Arguments**

    - `parts`: one or more; their `offset` and `kick` are relative to the remaining body.

    **Returns** the jump of the remaining body, `Phase.then`, and the `Mission.start` of each part.

    **Raises** `InputError` without a part."""
    if not parts:
        raise InputError("release got no parts: it requires at least one.")
    return _Released(parts), tuple(_Released(parts, number) for number in range(len(parts)))


def _mean(masses: Sequence[Scalar], vectors: Sequence[Vector], whole: Scalar) -> Vector:
    """sum m_i v_i / m."""
    terms = [scale(mass / whole, v) for mass, v in zip(masses, vectors, strict=True)]
    return functools.reduce(operator.add, terms)


@formula(energy=NOT_NEGATIVE, mass=POSITIVE, other=POSITIVE)
def spring_speed(energy: Scalar, mass: Scalar, other: Scalar) -> Scalar:
    """Relative speed of two masses, m/s, after springs between them have released their energy.

    At zero energy the derivative with respect to the energy is infinite (endpoint derivative
    convention of `core/safe.py`), those with respect to the masses are zero.

    **Arguments**, each (*runs,)

    - `energy`: of the springs, J.
    - `mass`, `other`: kg."""

    def radicand(energy: Scalar, mass: Scalar, other: Scalar) -> Scalar:
        return 2.0 * energy * (1.0 / mass + 1.0 / other)

    return end_sqrt(radicand, *(as_float(x) for x in (energy, mass, other)))
