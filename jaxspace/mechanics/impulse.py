"""Impulsive motion: rates that jump while coordinates stay.

    M (v+ - v-) = Q^ + A^T lambda^,   A (v+ - v-) = 0          impulses Q^ on a constrained system
    M (v+ - v-) = B^T J,   B v+ = -e B v-,   J >= 0             impact, B = d(gap)/dq

    symbol   meaning                                    unit
    Q^       generalised impulses                       J s per unit of q
    B, J     directions of contacts, their impulses     -, N s
    e        coefficient of restitution                 1

Source: Thomson 9.10 (9.10-3), 4.2 (restitution).
Contacts without friction. Each of several simultaneous contacts obeys Newton's law of restitution;
one that would pull is left out.
"""

__all__ = ["apply_impact", "apply_impulse"]

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import Scalar
from ..core.formula import UP_TO_ONE, formula
from ._description import GeneralisedState
from ._equations import columns, mass_matrix, matmul, solve
from ._lagrangian import AbstractLagrangian
from .constraints import constraints_of, schur_solve, together


@formula
def apply_impulse(
    system: AbstractLagrangian, t: Scalar, y: GeneralisedState, impulse: Float[Array, "n *#runs"]
) -> GeneralisedState:
    """The state after generalised impulses (Thomson 9.10-3), which still satisfies the constraints.

    **Arguments**

    - `system`, `t`, `y`: the system, the time, s, and the state before.
    - `impulse`: Q^, one for each coordinate, (n, *runs).

    **Returns** the state after, with the same coordinates.
    """
    q, v = together(system, t, y.coordinates, y.rates)
    impulse = jnp.broadcast_to(
        impulse.reshape(impulse.shape + (1,) * (q.ndim - 1)) if impulse.ndim == 1 else impulse,
        q.shape,
    )
    m = mass_matrix(system.lagrangian, t, q, v)
    result = constraints_of(system, t, q, v)
    if result is None:
        return GeneralisedState(q, v + solve(m, impulse[:, None])[:, 0])
    transposed = jnp.swapaxes(result.matrix, 0, 1)
    # One elimination for the free change and for those of unit impulses of the constraints.
    both = solve(m, jnp.concatenate([impulse[:, None], transposed], axis=1))
    free, mobility = both[:, :1], both[:, 1:]
    answer = schur_solve(system, result.matrix, mobility, -matmul(result.matrix, free))
    return GeneralisedState(q, v + (free + matmul(mobility, answer))[:, 0])


@formula(restitution=UP_TO_ONE)
def apply_impact(
    system: AbstractLagrangian,
    t: Scalar,
    y: GeneralisedState,
    gaps: Callable[[Array], Array],
    restitution: Scalar,
) -> tuple[GeneralisedState, Float[Array, "k *#runs"]]:
    """The state after contacts without friction have closed, several simultaneously.

    **Arguments**

    - `system`, `t`, `y`: the system, without constraints, the time, s, and the state before.
    - `gaps`: of the coordinates, (n, *runs), the widths of the gaps that are closed now, m,
      (k, *runs): positive when open.
    - `restitution`: e, from 0 to 1.

    **Returns** the state after, and the impulses of the contacts, N s, (k, *runs): zero for
    contacts that open without an impulse.
    """
    q, v = together(system, t, y.coordinates, y.rates)
    m = mass_matrix(system.lagrangian, t, q, v)
    directions = columns(gaps, q)
    mobility = solve(m, jnp.swapaxes(directions, 0, 1))
    # How fast each gap opens by a unit impulse in each of the contacts.
    stiffness = matmul(directions, mobility)
    speed = matmul(directions, v[:, None])[:, 0]
    count = speed.shape[0]
    one = jnp.eye(count, dtype=q.dtype).reshape(count, count, *(1,) * (q.ndim - 1))
    active = speed < 0.0
    impulses = jnp.zeros_like(speed)
    # A contact that pulls is dropped, and may change the sign of another one.
    for _ in range(count):
        # A row of the identity keeps an omitted contact at zero: shapes must not depend on
        # numbers.
        coupled = jnp.where(active[:, None] & active[None], stiffness, one)
        right = jnp.where(active, -(1.0 + restitution) * speed, 0.0)
        impulses = solve(coupled, right[:, None])[:, 0]
        active = active & jax.lax.stop_gradient(impulses >= 0.0)
    impulses = jnp.where(active, impulses, 0.0)
    after = v + matmul(mobility, impulses[:, None])[:, 0]
    return GeneralisedState(q, after), impulses
