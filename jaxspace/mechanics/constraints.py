"""Accelerations of a Lagrangian system, with multipliers where it is constrained.

    v' = M^-1 (f + A^T lambda),   S lambda = -(A M^-1 f + b),   S = A M^-1 A^T

A v' + b is the time derivative of the condition on the rates: dg/dt = A v + dg/dt|_q for a
holonomic constraint, c for a nonholonomic one.

Source: Thomson 9.9 (multipliers); see `AbstractLagrangian` for the decay of errors of constraints.
"""

__all__ = ["Accelerations", "degrees_of_freedom"]

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import InputError, Scalar
from ..core.checks import is_concrete
from ..core.formula import formula
from ..core.printing import printed
from ..core.shapes import with_rank
from ._description import AbstractDescription, GeneralisedState
from ._equations import columns, inertial_force, least_squares, mass_matrix, matmul, solve


@printed()
class Accelerations(NamedTuple):
    """Solution of the equations of motion.

    - `coordinate_rates`, `accelerations`: of the state, (n, *runs).
    - `multipliers`: (m, *runs), holonomic constraints first; empty without constraints.
    - `forces`: the generalised reaction forces A^T lambda, (n, *runs)."""

    coordinate_rates: Float[Array, "n *#runs"]
    accelerations: Float[Array, "n *#runs"]
    multipliers: Float[Array, "m *#runs"]
    forces: Float[Array, "n *#runs"]


class Constraints(NamedTuple):
    """Constraints at one state.

    - `matrix`: A, (m, n, *runs); `errors`: c, and dg/dt of holonomic ones, (m, *runs).
    - `bias`: b, (m, *runs).
    - `positions`: g, and zero for nonholonomic constraints, (m, *runs)."""

    matrix: Float[Array, "m n *#runs"]
    errors: Float[Array, "m *#runs"]
    bias: Float[Array, "m *#runs"]
    positions: Float[Array, "m *#runs"]


def together(
    system: AbstractDescription, t: Scalar, q: Array, v: Array
) -> tuple[Float[Array, "n *#runs"], Float[Array, "n *#runs"]]:
    """Coordinates and rates, broadcast to the runs of all parameters of the system.

    Raises `InputError` where their number is not that of the names."""
    n = len(system.names)
    for name, x in (("coordinates", q), ("rates", v)):
        if x.shape[:1] != (n,):
            raise InputError(
                f"GeneralisedState.{name} has the shape {x.shape}: its first axis must have the "
                f"{n} coordinates {', '.join(system.names)}."
            )
    # The gradient of a sum over runs requires separate rates for each run.
    # Not the bound method: older releases of JAX compare functions, and so traced parameters.
    runs = jax.eval_shape(lambda t, q, v: system.lagrangian(t, q, v), t, q, v).shape
    runs = jnp.broadcast_shapes(runs, q.shape[1:], v.shape[1:])
    q, v = with_rank(q, len(runs)), with_rank(v, len(runs))
    return jnp.broadcast_to(q, (n, *runs)), jnp.broadcast_to(v, (n, *runs))


def constraints_of(
    system: AbstractDescription, t: Scalar, q: Array, v: Array
) -> Constraints | None:
    """The constraints of a system at a state, or `None` where it has none."""
    t = jnp.asarray(t, q.dtype)
    parts = []
    if system.holonomic(t, q) is not None:
        # Differentiated twice along the motion: the part without accelerations is the bias.
        def rate(t: Array, q: Array) -> tuple[Array, Array]:
            g, g_rate = jax.jvp(_holonomic(system), (t, q), (jnp.ones_like(t), v))
            return g_rate, g

        errors, bias, g = jax.jvp(rate, (t, q), (jnp.ones_like(t), v), has_aux=True)
        matrix = columns(lambda q: _holonomic(system)(t, q), q)
        parts.append(Constraints(matrix, errors, bias, g))
    if system.nonholonomic(t, q, v) is not None:

        def demand(t: Array, q: Array, v: Array) -> Array:
            c = system.nonholonomic(t, q, v)
            assert c is not None
            return jnp.broadcast_to(c, (c.shape[0], *v.shape[1:]))

        # The rates are held constant: their change enters through the matrix.
        errors, bias = jax.jvp(lambda t, q: demand(t, q, v), (t, q), (jnp.ones_like(t), v))
        matrix = columns(lambda v: demand(t, q, v), v)
        parts.append(Constraints(matrix, errors, bias, jnp.zeros_like(errors)))
    return Constraints(*map(jnp.concatenate, zip(*parts, strict=True))) if parts else None


def _holonomic(system: AbstractDescription):
    def positions(t: Array, q: Array) -> Array:
        g = system.holonomic(t, q)
        assert g is not None
        return jnp.broadcast_to(g, (g.shape[0], *q.shape[1:]))

    return positions


def active_force(system: AbstractDescription, t: Scalar, q: Array, v: Array) -> Array:
    """All generalised forces but those of constraints, inertial ones included, (n, *runs)."""
    return inertial_force(system.lagrangian, t, q, v) + applied_force(system, t, q, v)


def applied_force(system: AbstractDescription, t: Scalar, q: Array, v: Array) -> Array:
    """The given generalised forces Q and those of friction, (n, *runs)."""
    force = system.force(t, q, v)
    f = jnp.zeros_like(v) if force is None else force
    if system.dissipation(t, q, v) is not None:
        # Friction is minus the slope of Rayleigh's function in the rates.
        f = f - jax.grad(lambda v: jnp.sum(jnp.asarray(system.dissipation(t, q, v))))(v)
    return f


def accelerations(system: AbstractDescription, t: Scalar, q: Array, v: Array) -> Accelerations:
    """Accelerations and reactions of a system, as its vector field needs them."""
    q, v = together(system, t, q, v)
    f = active_force(system, t, q, v)
    m = mass_matrix(system.lagrangian, t, q, v)
    result = constraints_of(system, t, q, v)
    if result is None:
        return Accelerations(v, solve(m, f[:, None])[:, 0], f[:0], jnp.zeros_like(f))
    decay, _ = system.stabilisation()
    transposed = jnp.swapaxes(result.matrix, 0, 1)
    # One elimination for the free accelerations and for those of unit multipliers.
    both = solve(m, jnp.concatenate([f[:, None], transposed], axis=1))
    free, mobility = both[:, 0], both[:, 1:]
    demand = -(matmul(result.matrix, free[:, None])[:, 0] + result.bias + decay * result.errors)
    right = jnp.stack([demand, -decay * result.positions], axis=1)
    answer = schur_solve(system, result.matrix, mobility, right)
    moved = matmul(mobility, answer)
    multipliers = answer[:, 0]
    return Accelerations(
        v + moved[:, 1],
        free + moved[:, 0],
        multipliers,
        matmul(transposed, multipliers[:, None])[:, 0],
    )


def schur_solve(system: AbstractDescription, matrix: Array, mobility: Array, right: Array) -> Array:
    """The multipliers of given right sides, (m, k, *runs)."""
    s = matmul(matrix, mobility)
    if system.stabilisation()[1]:
        return least_squares(s, right)
    return solve(s, right)


def consistent(system: AbstractDescription, t: Scalar, q: Array, v: Array) -> tuple[Array, Array]:
    """The coordinates and rates nearest to the given ones that meet all constraints, in the metric
    of the mass matrix."""
    q, v = together(system, t, q, v)
    check_independent(system, t, q, v)
    for _ in range(NEWTON if constraints_of(system, t, q, v) is not None else 0):
        q = q - _correction(system, t, q, v, positions=True)
    return q, v - _correction(system, t, q, v, positions=False)


# Numbers of Newton's steps, each of which doubles the digits: from any start, and from the error of
# a step.
NEWTON = 5
NEWTON_NEAR = 2


def projected(
    system: AbstractDescription, t: Scalar, q: Array, v: Array
) -> tuple[Array, Array] | None:
    """`consistent` of a state that meets the constraints up to the error of a step; `None` without
    constraints."""
    q, v = together(system, t, q, v)
    if constraints_of(system, t, q, v) is None:
        return None
    if system.holonomic(t, q) is not None:
        for _ in range(NEWTON_NEAR):
            q = q - _correction(system, t, q, v, positions=True)
    return q, v - _correction(system, t, q, v, positions=False)


def _correction(
    system: AbstractDescription, t: Scalar, q: Array, v: Array, positions: bool
) -> Array:
    result = constraints_of(system, t, q, v)
    if result is None:
        return jnp.zeros_like(v)
    errors = result.positions if positions else result.errors
    m = mass_matrix(system.lagrangian, t, q, v)
    mobility = solve(m, jnp.swapaxes(result.matrix, 0, 1))
    answer = schur_solve(system, result.matrix, mobility, errors[:, None])
    return matmul(mobility, answer)[:, 0]


@formula
def degrees_of_freedom(system: AbstractDescription, y: GeneralisedState, t: Scalar = 0.0) -> int:
    """Number of coordinates minus that of independent constraints, at a known state of one run
    (Thomson 9.2).

    **Arguments**

    - `system`: with its constraints.
    - `y`: a state of one run, which must be known.
    - `t`: s."""
    q, v = together(system, t, y.coordinates, y.rates)
    result = constraints_of(system, t, q, v)
    rank = 0 if result is None else int(np.linalg.matrix_rank(np.asarray(result.matrix)))
    return len(system.names) - rank


def check_independent(system: AbstractDescription, t: Scalar, q: Array, v: Array) -> None:
    """Raise `InputError` where concrete constraints are dependent, or one has no gradient."""
    result = constraints_of(system, t, q, v)
    if result is None or system.stabilisation()[1] or not is_concrete(result.matrix):
        return
    a = np.moveaxis(np.asarray(result.matrix), (0, 1), (-2, -1))
    rows = np.linalg.norm(a, axis=-1, keepdims=True)
    count = a.shape[-2]
    if np.any(rows == 0.0):
        raise InputError(
            "a constraint has no gradient here and so exerts no force: write it such that it "
            "crosses zero with a non-zero slope."
        )
    # With rows scaled to length one, so that the rank does not depend on the units of the
    # constraints.
    rank = int(np.min(np.linalg.matrix_rank(a / rows, tol=1e-10)))
    if rank < count:
        raise InputError(
            f"{rank} of the {count} constraints are independent here: remove the others, or "
            "request the minimum-norm multipliers with redundant=True."
        )
