"""Variational integrator: a motion that makes a discrete action stationary.

    L_d(q_0, q_1) = h L(t + h/2, (q_0 + q_1)/2, (q_1 - q_0)/h)
    p_0 = -D_1 L_d - h/2 Q - A_0^T lambda,    g(q_1) = 0
    p_1 =  D_2 L_d + h/2 Q - A_1^T mu,        A_1 v_1 = 0          Q at the middle of the step

    symbol      meaning                                          unit
    q, p        coordinates and momenta, before 0 and after 1
    h           length of a step                                 s
    D_1, D_2    derivatives in the first and the second state
    lambda, mu  multipliers of holonomic constraints, A = dg/dq

The step is symplectic, and reversible in time: without friction the energy swings about its value
and does not drift, and the momenta of cyclic coordinates and the constraints stay to rounding. A
composition of such steps forwards and backwards has a higher order and the same properties.

Source: Marsden and West (2001), Discrete mechanics and variational integrators, Acta Numerica 10,
357, 2.3 and 3.5; Kahan and Li (1997), Composition constants for raising the orders of
unconventional schemes, Mathematics of Computation 66, 1089 (orders 4 and 6).
"""

__all__ = ["variational_motion"]

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree

from ..core import InputError, Scalar
from ..core.formula import formula
from ..core.jit import quick_jit
from ..core.types import as_float
from ._description import AbstractDescription, GeneralisedState
from ._equations import columns, mass_matrix, matmul, momenta, solve
from .constraints import applied_force, check_independent, constraints_of, together

# The lengths of the steps of a composition, up to the middle one.
COMPOSITIONS = {
    2: (1.0,),
    4: (0.41449077179437573714, 0.41449077179437573714, -0.65796308717750294857),
    6: (
        0.39216144400731413928,
        0.33259913678935943860,
        -0.70624617255763935981,
        0.08221359629355080023,
        0.79854399093482996340,
    ),
}
# Newton's steps double the digits; two more carry the derivatives.
NEWTON = 4


class _Canonical(NamedTuple):
    q: Array
    p: Array


@formula
def variational_motion(
    system: AbstractDescription,
    y: GeneralisedState,
    ts: Float[Array, " times"],
    *,
    steps: int,
    order: int = 4,
) -> GeneralisedState:
    """The motion by a variational integrator, for long times.

    **Arguments**

    - `system`: with holonomic constraints or none; forces and friction may act.
    - `y`: the state at the first time; one that meets the constraints, see `consistent`.
    - `ts`: the times to save, s.
    - `steps`: equal steps from each time to the next: for order 2, 20 steps in a period are few.
    - `order`: 2, 4 or 6; a step of order 4 costs five of order 2, of order 6 nine.

    **Returns** the states, (n, times, *runs).

    **Raises** `InputError` for nonholonomic constraints, which no action yields, for another order,
    and where known constraints depend on each other."""
    if order not in COMPOSITIONS:
        raise InputError(f"order is {order!r}: it must be one of 2, 4 and 6.")
    ts = as_float(ts)
    q, v = together(system, ts[0], y.coordinates, y.rates)
    if system.nonholonomic(ts[0], q, v) is not None:
        raise InputError(
            f"{type(system).__name__} has nonholonomic constraints, which do not follow from a "
            "stationary action: use `simulate`."
        )
    check_independent(system, ts[0], q, v)
    return _motion(system, q, v, ts, steps, order)


@quick_jit
def _motion(
    system: AbstractDescription, q: Array, v: Array, ts: Array, steps: int, order: int
) -> GeneralisedState:
    """`variational_motion`, compiled."""
    half = COMPOSITIONS[order][:-1]
    parts = jnp.asarray([*half, COMPOSITIONS[order][-1], *reversed(half)], q.dtype)

    def step(carry: tuple[Array, _Canonical], h: Array) -> tuple[PyTree, None]:
        t, y = carry
        return (t + h, _step(system, t, h, y)), None

    def whole(y: _Canonical, times: tuple[Array, Array]) -> tuple[_Canonical, GeneralisedState]:
        start = times[0]
        h = (times[1] - times[0]) / steps

        def one(y: _Canonical, k: Array) -> tuple[_Canonical, None]:
            # From the start of the interval, because a running sum of steps would accumulate
            # rounding.
            return jax.lax.scan(step, (start + k * h, y), parts * h)[0][1], None

        y, _ = jax.lax.scan(one, y, jnp.arange(steps, dtype=q.dtype))
        return y, GeneralisedState(y.q, _rates(system, times[1], y))

    y0 = _Canonical(q, momenta(system.lagrangian, ts[0], q, v))
    _, states = jax.lax.scan(whole, y0, (ts[:-1], ts[1:]))
    return jax.tree.map(
        lambda x, first: jnp.moveaxis(jnp.concatenate([first[None], x]), 0, 1),
        states,
        GeneralisedState(q, v),
    )


def _rates(system: AbstractDescription, t: Scalar, y: _Canonical) -> Array:
    """The rates of momenta, of a Lagrangian with rates up to their squares."""
    # At rest: with squares of the rates at most, the matrix does not depend on them.
    rest = jnp.zeros_like(y.p)
    m = mass_matrix(system.lagrangian, t, y.q, rest)
    free = momenta(system.lagrangian, t, y.q, rest)
    return solve(m, (y.p - free)[:, None])[:, 0]


def _slopes(
    system: AbstractDescription, t: Array, h: Array, q0: Array, change: Array
) -> tuple[Array, Array]:
    """-D_1 L_d and D_2 L_d, each with the impulse of its half of the step."""
    # By the change: a difference of coordinates would lose digits in a short step.
    middle = t + 0.5 * h
    mean = q0 + 0.5 * change
    rate = change / h
    turn = jax.grad(lambda q: jnp.sum(jnp.asarray(system.lagrangian(middle, q, rate))))(mean)
    p = momenta(system.lagrangian, middle, mean, rate)
    half = 0.5 * h * (turn + applied_force(system, middle, mean, rate))
    return p - half, p + half


def _step(system: AbstractDescription, t: Array, h: Array, y: _Canonical) -> _Canonical:
    """The canonical state a step `h`, s, after `y`."""
    n = y.q.shape[0]
    matrix = _matrix(system, t, y.q)

    def residual(x: Array, y: _Canonical, matrix: Array | None) -> Array:
        first, _ = _slopes(system, t, h, y.q, x[:n])
        if matrix is None:
            return first - y.p
        pull = matmul(jnp.swapaxes(matrix, 0, 1), x[n:, None])[:, 0]
        q1 = y.q + x[:n]
        g = constraints_of(system, t + h, q1, jnp.zeros_like(q1))
        assert g is not None
        return jnp.concatenate([first + pull - y.p, g.positions])

    def newton(x: Array, y: _Canonical, matrix: Array | None, slope: Array | None = None) -> Array:
        if slope is None:
            slope = columns(lambda x: residual(x, y, matrix), x)
        return x - solve(slope, residual(x, y, matrix)[:, None])[:, 0]

    fixed = jax.lax.stop_gradient((y, matrix))
    # The step without forces, from which Newton's method converges.
    guess = h * _rates(system, t, fixed[0])
    if matrix is not None:
        guess = jnp.concatenate([guess, jnp.zeros_like(matrix[:, 0])])
    x = jax.lax.fori_loop(0, NEWTON, lambda _, x: newton(x, *fixed), jax.lax.stop_gradient(guess))
    x = jax.lax.stop_gradient(x)
    # At the root, where the derivative of the matrix is multiplied by zero. The first step carries
    # the first derivatives, the second one those of second order.
    slope = jax.lax.stop_gradient(columns(lambda x: residual(x, *fixed), x))
    for _ in range(2):
        x = newton(x, y, matrix, slope)
    _, p1 = _slopes(system, t, h, y.q, x[:n])
    # The residual puts the coordinates onto the constraints, but not the momenta.
    return _onto_constraints(system, t + h, _Canonical(y.q + x[:n], p1))


def _matrix(system: AbstractDescription, t: Array, q: Array) -> Array | None:
    result = constraints_of(system, t, q, jnp.zeros_like(q))
    return None if result is None else result.matrix


def _onto_constraints(system: AbstractDescription, t: Array, y: _Canonical) -> _Canonical:
    """The state with the nearest momenta whose rates meet the constraints."""
    v = _rates(system, t, y)
    result = constraints_of(system, t, y.q, v)
    if result is None:
        return y
    m = mass_matrix(system.lagrangian, t, y.q, v)
    transposed = jnp.swapaxes(result.matrix, 0, 1)
    s = matmul(result.matrix, solve(m, transposed))
    pull = matmul(transposed, solve(s, result.errors[:, None]))
    return _Canonical(y.q, y.p - pull[:, 0])
