"""A system defined by its Lagrangian: a scalar function of time, coordinates and rates, whose
derivatives give the equations of motion.

    d/dt dL/dv = dL/dq + Q - dD/dv + A^T lambda            v = q'
    g(t, q) = 0          holonomic constraints,     A = dg/dq
    c(t, q, v) = 0       nonholonomic constraints, linear in v,  A = dc/dv
    h = v . dL/dv - L    is constant if L and the constraints do not depend on t
    p_i = dL/dv_i        is constant if L does not depend on q_i

    symbol   meaning                                            unit
    q, v     generalised coordinates, their rates               that of the system
    L, D     Lagrangian, Rayleigh's dissipation function        J, W
    Q        generalised forces                                 J per unit of q
    lambda   multipliers, one for each constraint
    k        rate at which an error of a constraint decays      1/s

The index of a constrained system is reduced: constraints are imposed on the accelerations, and each
integration step ends at the nearest state that satisfies g and c, in the metric of M. Within a
step, and under integrators that do not project, an error decays as e^(-k t), by terms that are zero
where there is none:

    A v' = (...) - k c,      q' = v - k M^-1 A^T S^-1 g,     S = A M^-1 A^T
    q -> q - M^-1 A^T S^-1 g,     v -> v - M^-1 A^T S^-1 c

Source: Thomson 9.2 to 9.9; Ascher, Chin, Reich (1994), Stabilization of DAEs and invariant
manifolds, Numerische Mathematik 67, 131.
Valid for a positive definite mass matrix d^2 L/dv^2 and independent constraints; redundant ones are
solved by least squares on request, and rejected with an error otherwise.
"""

from collections.abc import Callable
from typing import Any, final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree

from ..core import InputError, NumberField, Scalar, quantity
from ..core.listed import no_method
from ..core.types import as_float
from ._description import AbstractDescription, GeneralisedState
from ._equations import mass_matrix, momenta
from ._symmetry import symmetries
from .constraints import Accelerations, accelerations, consistent, projected, together


class AbstractLagrangian(AbstractDescription):
    """A system defined by its Lagrangian.

    A final class names its coordinates in `names` and defines `lagrangian`; further forces and
    constraints are given by `force`, `dissipation`, `holonomic` and `nonholonomic`. All of them act
    on components first: q and v are (n, *runs), and parameters are scalars or (*runs,)."""

    def vector_field(self, t: Scalar, y: GeneralisedState) -> GeneralisedState:
        result = accelerations(self, t, y.coordinates, y.rates)
        return GeneralisedState(result.coordinate_rates, result.accelerations)

    def invariants(self, t: Scalar, y: GeneralisedState) -> dict[str, Array]:
        """The energy h and the momenta of cyclic coordinates, where the Lagrangian makes them
        constant."""
        symmetry = symmetries(self)
        result = {"energy": self.energy(t, y)} if symmetry.time else {}
        p = self.momenta(t, y)
        return result | {
            f"momentum_{name}": p[i] for i, name in enumerate(self.names) if symmetry.cyclic[i]
        }

    def projected(self, t: Scalar, y: GeneralisedState) -> GeneralisedState | None:
        result = projected(self, t, y.coordinates, y.rates)
        return None if result is None else GeneralisedState(*result)

    def momenta(self, t: Scalar, y: GeneralisedState) -> Float[Array, "n *#runs"]:
        """The generalised momenta dL/dv."""
        return momenta(self.lagrangian, t, *together(self, t, y.coordinates, y.rates))

    def energy(self, t: Scalar, y: GeneralisedState) -> Scalar:
        """Jacobi's integral h = v . dL/dv - L, J: T + U in coordinates at rest."""
        q, v = together(self, t, y.coordinates, y.rates)
        return jnp.sum(v * momenta(self.lagrangian, t, q, v), axis=0) - self.lagrangian(t, q, v)

    def mass_matrix(self, t: Scalar, y: GeneralisedState) -> Float[Array, "n n *#runs"]:
        """The mass matrix d^2 L/dv^2."""
        return mass_matrix(self.lagrangian, t, *together(self, t, y.coordinates, y.rates))

    def reactions(self, t: Scalar, y: GeneralisedState) -> Accelerations:
        """Accelerations, multipliers and the generalised reaction forces A^T lambda."""
        return accelerations(self, t, y.coordinates, y.rates)

    def consistent(self, y: GeneralisedState, t: Scalar = 0.0) -> GeneralisedState:
        """The state nearest to `y`, in the metric of the mass matrix, that meets the constraints.

        **Raises** `InputError` where concrete constraints are dependent or have zero gradient."""
        return GeneralisedState(*consistent(self, t, y.coordinates, y.rates))

    @property
    @no_method
    def cyclic(self) -> tuple[str, ...]:
        """The names of the coordinates whose momenta are constant."""
        cyclic = symmetries(self).cyclic
        return tuple(name for name, is_cyclic in zip(self.names, cyclic, strict=True) if is_cyclic)


@final
class Lagrangian(AbstractLagrangian):
    """A system from functions: `Lagrangian(L, ("x", "theta"), parameters)`.

    State: `GeneralisedState`, preferably created with `state`, and brought onto constraints by
    `consistent`.

    - `function`: L(t, q, v, parameters), J; q and v are (n, *runs), the result (*runs,).
    - `names`: of the coordinates.
    - `parameters`: any tree of numbers, each a scalar or (*runs,).
    - `forces`: generalised forces Q(t, q, v, parameters), (n, *runs).
    - `rayleigh`: dissipation function D(t, q, v, parameters), W, whose force is -dD/dv.
    - `fixed`: g(t, q, parameters), (m, *runs), holonomic constraints, kept at zero.
    - `rolling`: c(t, q, v, parameters), (m, *runs), linear in v, nonholonomic constraints.
    - `decay`: k, 1/s, decay rate of constraint errors: about the rate of the motion.
    - `redundant`: whether constraints may be dependent; the multipliers then have minimum norm.

    The invariants list the energy and the momenta of cyclic coordinates, which follow from L."""

    function: Callable[..., Scalar]
    names: tuple[str, ...] = eqx.field(static=True, converter=tuple)  # pyright: ignore
    # Arrays, so that they can be differentiated and differ between runs.
    parameters: Any = eqx.field(default=None, converter=lambda tree: jax.tree.map(as_float, tree))
    forces: Callable[..., Array] | None = None
    rayleigh: Callable[..., Scalar] | None = None
    fixed: Callable[..., Array] | None = None
    rolling: Callable[..., Array] | None = None
    decay: NumberField = quantity(
        "1/s", non_negative=True, default=1.0, doc="k, of an error of a constraint"
    )
    redundant: bool = eqx.field(static=True, default=False)

    def lagrangian(self, t: Scalar, q: Array, v: Array) -> Scalar:
        return self.function(t, q, v, self.parameters)

    def force(self, t: Scalar, q: Array, v: Array) -> Array | None:
        return None if self.forces is None else self.forces(t, q, v, self.parameters)

    def dissipation(self, t: Scalar, q: Array, v: Array) -> Scalar | None:
        return None if self.rayleigh is None else self.rayleigh(t, q, v, self.parameters)

    def holonomic(self, t: Scalar, q: Array) -> Array | None:
        return None if self.fixed is None else self.fixed(t, q, self.parameters)

    def nonholonomic(self, t: Scalar, q: Array, v: Array) -> Array | None:
        return None if self.rolling is None else self.rolling(t, q, v, self.parameters)

    def stabilisation(self) -> tuple[Scalar, bool]:
        return self.decay, self.redundant

    def state(self, coordinates: object, rates: object = None) -> GeneralisedState:
        """The state of coordinates and rates, each (n, *runs) or a sequence of scalars; at rest
        without rates."""
        q = _as_coordinates(coordinates, len(self.names), "coordinates")
        v = jnp.zeros_like(q) if rates is None else rates
        return GeneralisedState(q, _as_coordinates(v, len(self.names), "rates"))


def _as_coordinates(x: PyTree, count: int, name: str) -> Array:
    if isinstance(x, list | tuple):
        x = jnp.stack(jnp.broadcast_arrays(*(as_float(v) for v in x)))
    x = as_float(x)
    if x.ndim == 0 or x.shape[0] != count:
        raise InputError(
            f"Lagrangian.state: {name} has the shape {x.shape}: it must be ({count},)."
        )
    return x
