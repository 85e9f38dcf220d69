"""Mass, centre of mass and inertia of a body put together from parts.

    m = sum m_i,   m c = sum m_i c_i
    J = sum [J_i + m_i (d_i^2 1 - d_i d_i^T)],   d_i = c_i - c          parallel axes
    J' = C J C^T                                                        turned axes
    I_l = l . J l,   rho_l = 1 / sqrt(I_l)                              about the direction l
    J_P w = J_c w_0 + m r x v,   v' = w x r                             caught at the pivot P

    symbol   meaning                                                          unit
    m, c     mass; centre of mass                                             kg, m
    J        inertia about the centre of mass                                 kg m^2
    C        turns components in a part's axes into those of the whole        1
    rho_l    radius of the ellipsoid of inertia along l                       kg^-1/2 m^-1
    r        from the pivot to the centre of mass                             m
    v, v'    velocity of the centre of mass before and after the impact       m/s
    w_0, w   angular velocity before and after                                rad/s

Source: Thomson 5.3 (tensor), 5.4 (turned axes), 5.5 (ellipsoid, parallel axes) and Problem 5.5-10
(impact), whose printed signs apply to a v_x along -x.
"""

__all__ = [
    "PivotImpact",
    "combined",
    "inertia_ellipsoid",
    "moment_along",
    "pivot_impact",
    "turned_tensor",
]

from functools import partial, reduce
from typing import NamedTuple, final

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import Matrix, Scalar, Vector
from ..core.formula import POSITIVE, formula
from ..core.printing import printed
from ..core.shapes import check_components, with_rank
from ..core.square_roots import inverse_sqrt
from ..core.structure import HashedModule
from ..core.vectors import cross, dot, matvec, scale
from ..rotations import Quaternion
from .inertia import (
    AbstractInertia,
    InertiaTensor,
    PrincipalInertia,
    kinetic_energy,
    parallel_axes,
    particle_inertia,
)
from .principal_axes import principal_axes


@final
@printed(mass="kg", centre="m", tensor="kg m^2")
class MassProperties(HashedModule):
    """Mass, centre of mass and inertia of a part or of a whole body, in one set of axes.

    - `mass`: kg, (*runs,); negative for a hole, as is its tensor.
    - `centre`: of mass, from the origin of the axes, m, (3, *runs).
    - `tensor`: about the centre of mass, kg m^2, (3, 3, *runs). A rod or a particle, whose tensor
      is singular, may be a part too."""

    mass: Float[Array, "*#runs"]
    centre: Vector
    tensor: Matrix

    @property
    def inertia(self) -> InertiaTensor:
        """The inertia about the centre of mass. Raises `InputError` where no body that can turn
        about every axis has it."""
        return InertiaTensor(self.tensor)

    def about(self, point: Vector) -> Matrix:
        """The tensor about `point`, m, (3, *runs), kg m^2, (3, 3, *runs) (Thomson 5.5)."""
        return _sum(self.tensor, particle_inertia(self.mass, _sum(self.centre, -point)), axes=2)

    def moment_about(self, direction: Vector, point: Vector) -> Scalar:
        """The moment of inertia about the line along `direction`, of non-zero length, through
        `point`, m; kg m^2, (*runs,)."""
        return moment_along(self.about(point), direction)

    def moved(self, offset: Vector) -> "MassProperties":
        """The same part, displaced by `offset`, m, (3, *runs)."""
        return MassProperties(self.mass, _sum(self.centre, offset), self.tensor)

    def turned(self, attitude: Quaternion) -> "MassProperties":
        """The same part, rotated about the origin; `attitude` maps the part's axes to the new
        ones."""
        tensor = turned_tensor(self.tensor, attitude)
        return MassProperties(self.mass, attitude.rotate(self.centre), tensor)

    def hole(self) -> "MassProperties":
        """This part as one to be removed."""
        return MassProperties(-self.mass, self.centre, -self.tensor)


def combined(*parts: MassProperties) -> MassProperties:
    """The body composed of `parts`, one or more in the same axes (Thomson 5.5).

    The runs of the parts broadcast. Not finite where the masses add up to zero."""
    total = reduce(jnp.add, [part.mass for part in parts])
    moment = reduce(_sum, [scale(part.mass, part.centre) for part in parts])
    centre = scale(1.0 / total, moment)
    tensor = reduce(partial(_sum, axes=2), [part.about(centre) for part in parts])
    return MassProperties(total, centre, tensor)


@formula
def turned_tensor(tensor: Matrix, attitude: Quaternion) -> Matrix:
    """C J C^T: the tensor in the axes to which `attitude` maps the original axes (Thomson 5.4).

    **Arguments**

    - `tensor`: a symmetric tensor such as J, (3, 3, *runs).
    - `attitude`: from the axes of `tensor` to the new ones; its inverse gives the components in
      axes that are turned by `attitude` against the body.

    **Returns** the tensor, (3, 3, *runs), in the same unit.
    """
    check_components("turned_tensor: tensor", tensor, 3, axes=2)
    turn = attitude.matrix()
    half = [matvec(turn, tensor[:, i]) for i in range(3)]
    rows = jnp.stack(half, axis=1)
    return jnp.stack([matvec(turn, rows[i]) for i in range(3)], axis=0)


@formula
def moment_along(tensor: Matrix, direction: Vector) -> Scalar:
    """The moment of inertia l . J l about a direction (Thomson 5.4-8), kg m^2, (*runs,).

    **Arguments**

    - `tensor`: about a point of the axis, kg m^2, (3, 3, *runs).
    - `direction`: of the axis, of non-zero length, (3, *runs).
    """
    return dot(direction, matvec(tensor, direction)) / dot(direction, direction)


def inertia_ellipsoid(inertia: AbstractInertia) -> tuple[Vector, Matrix]:
    """The ellipsoid of inertia r . J r = 1 (Thomson 5.5-2).

    **Returns** its semi-axes 1/sqrt(I_i), kg^-1/2 m^-1, (3, *runs), the longest first, and its
    axes, the principal ones, as the columns of a matrix, (3, 3, *runs); derivatives as in
    `principal_axes`. Poinsot's ellipsoid of omega is sqrt(2T) times as large. Along any direction
    its radius is 1/sqrt(`moment_along`). The ellipsoid of a rod is a cylinder: its first semi-axis
    is infinite, with derivatives of zero."""
    moments, axes = principal_axes(inertia)
    endless = moments <= 0.0
    return jnp.where(endless, jnp.inf, inverse_sqrt(jnp.where(endless, 1.0, moments))), axes


@printed(omega="rad/s", velocity="m/s", impulse="N s", energy_loss="J")
class PivotImpact(NamedTuple):
    """Result of an impact in which a moving body is caught at a point.

    - `omega`: angular velocity after the impact, rad/s, (3, *runs).
    - `velocity`: of the centre of mass after it, m/s, (3, *runs).
    - `impulse`: on the body at the pivot, N s, (3, *runs).
    - `energy_loss`: kinetic energy dissipated, J, (*runs,)."""

    omega: Vector
    velocity: Vector
    impulse: Vector
    energy_loss: Scalar


@formula(mass=POSITIVE)
def pivot_impact(
    inertia: AbstractInertia, mass: Scalar, arm: Vector, velocity: Vector, omega: Vector
) -> PivotImpact:
    """The motion after one point of the body is stopped and held as a pivot (Thomson 5.5-P10).

    The impulse acts at the pivot, so that the angular momentum about it is conserved. All vectors
    are in the axes of `inertia`, and velocities are relative to the pivot where that moves
    steadily.

    **Arguments**

    - `inertia`: about the centre of mass, kg m^2.
    - `mass`: kg, (*runs,).
    - `arm`: from the pivot to the centre of mass, m, (3, *runs).
    - `velocity`: of the centre of mass before the impact, m/s, (3, *runs).
    - `omega`: before the impact, rad/s, (3, *runs).

    **Returns** omega, velocity, impulse and the loss of energy. Where the pivot is the centre of
    mass omega does not change, and where the body already turned about the pivot nothing changes. A
    rod that is caught at a point of its axis keeps its rate about that axis.

    **Raises** `InputError` for a tensor that is not positive definite.
    """
    ranks = [x.ndim - 1 for x in (inertia.matrix()[0], arm, velocity, omega)]
    rank = max(*ranks, jnp.ndim(mass))
    arm, velocity, omega = (with_rank(x, rank) for x in (arm, velocity, omega))
    about_pivot = parallel_axes(_able_to_turn(inertia, arm), mass, arm)
    # The impulse removes the velocity of the pivot. The unknown is the change, which is zero to
    # rounding where the body already turns about the pivot.
    surplus = velocity - cross(omega, arm)
    change = about_pivot.solve(mass * cross(arm, surplus))
    gain = cross(change, arm) - surplus
    # velocity + gain, without the digits that cancel where the pivot is close to the centre.
    after = cross(omega + change, arm)
    # T - T' as a sum of squares: the energy lost is that of the change of motion.
    loss = kinetic_energy(inertia, change) + 0.5 * mass * dot(gain, gain)
    return PivotImpact(omega + change, after, mass * gain, loss)


def _able_to_turn(inertia: AbstractInertia, arm: Vector) -> AbstractInertia:
    """The inertia with a moment about the axis of a rod where the `arm` is along that axis.

    Without it the tensor about the pivot is singular. Its value is arbitrary: an impulse at a point
    of the axis has no torque about it."""
    if not isinstance(inertia, PrincipalInertia):
        return inertia
    rank = max(inertia.moments.ndim, arm.ndim) - 1
    moments, arm = with_rank(inertia.moments, rank), with_rank(arm, rank)
    beside = jnp.stack([(arm[i - 2] == 0.0) & (arm[i - 1] == 0.0) for i in range(3)])
    rod = (moments == 0.0) & beside
    return inertia.plus_diagonal(jnp.where(rod, jnp.max(moments, axis=0), 0.0))


def _sum(a: Array, b: Array, axes: int = 1) -> Array:
    """a + b, of vectors or matrices with any numbers of runs."""
    rank = max(a.ndim, b.ndim) - axes
    return with_rank(a, rank, axes) + with_rank(b, rank, axes)
