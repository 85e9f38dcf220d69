"""The method of Nystrom of order 12 with an embedded error of order 10, for a(t, r) and tight tolerances.

Between the ends of a step (r0, v0, a0), (r1, v1, a1) and its middle, which a step of half the length reaches,

    r(x) = r0 + h (x v0 + q(x)),    v(x) = v0 + q'(x)          q: the polynomial of degree 8 that fits all of these

    symbol  meaning                      unit
    h       length of the step           s
    x       fraction of the step         1

Source: Dormand, El-Mikkawy, Prince (1987), High-order embedded Runge-Kutta-Nystrom formulae, IMA Journal of Numerical
Analysis 7, 423. The states between are our own.
"""

import dataclasses
from typing import Any, ClassVar, final

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array

from . import _tableaus as tableau
from ._nystrom import RKN12, nystrom_step, weighted
from ._runge_kutta import Weights
from ._second_order import SecondOrder, second_order

# Of the powers 2 to 8 of x in q, by what is known: q at 1/2 and 1, q' there, and h a at 0, 1/2 and 1.
POWERS = (
    (0.0, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0),
    (256.0, -58.0, -32.0, 10.0, -4.5, 8.0, -0.5),
    (-1536.0, 453.0, 160.0, -79.0, 16.5, -56.0, 4.0),
    (3840.0, -1374.0, -288.0, 243.0, -31.5, 152.0, -12.5),
    (-4864.0, 2012.0, 224.0, -362.0, 33.0, -200.0, 19.0),
    (3072.0, -1416.0, -64.0, 260.0, -18.0, 128.0, -14.0),
    (-768.0, 384.0, 0.0, -72.0, 4.0, -32.0, 4.0),
)


def _less(first: Weights, second: Weights) -> Weights:
    """The difference of two rows."""
    a, b = dict(first), dict(second)
    return tuple((i, a.get(i, 0.0) - b.get(i, 0.0)) for i in sorted(a.keys() | b.keys()))


POSITION_ERROR = _less(tableau.RKN1210_POSITION, tableau.RKN1210_POSITION_10)
VELOCITY_ERROR = _less(tableau.RKN1210_VELOCITY, tableau.RKN1210_VELOCITY_10)


class _Fitted(diffrax.AbstractLocalInterpolation):
    """States within a step: the coefficients of q, and r' h for a velocity of ones."""

    t0: Any
    t1: Any
    y0: Any
    q: Array
    pace: Array

    def evaluate(self, t0: Any, t1: Any | None = None, left: bool = True) -> Any:
        del left
        if t1 is not None:
            return jax.tree.map(jnp.subtract, self.evaluate(t1), self.evaluate(t0))
        x = ((t0 - self.t0) / jnp.where(self.t1 == self.t0, 1.0, self.t1 - self.t0)).astype(self.q.dtype)
        q, slope = jnp.zeros_like(self.q[0]), jnp.zeros_like(self.q[0])
        for power in range(8, 1, -1):
            q, slope = self.q[power - 2] + x * q, power * self.q[power - 2] + x * slope
        r, v = self.y0.position, self.y0.velocity
        return dataclasses.replace(self.y0, position=r + self.pace * (x * (v + x * q)), velocity=v + x * slope)


@final
class RKN1210(diffrax.AbstractAdaptiveSolver):
    """Dormand, El-Mikkawy and Prince's method of Nystrom, of order 12 with an embedded error of order 10.

    Seventeen evaluations a step; for states of a position and a velocity whose acceleration does not depend on the velocity: a
    run where it does leaves the finite numbers at once. Where states between the steps are asked for, each step costs nineteen
    evaluations more, and these states are of order 8. Raises `InputError` for a state with further parts."""

    term_structure: ClassVar = diffrax.ODETerm
    interpolation_cls: ClassVar = _Fitted
    evaluations: ClassVar[int] = 17

    def order(self, terms: Any) -> int:
        return 12

    def init(self, terms: Any, t0: Any, t1: Any, y0: Any, args: Any) -> Array:
        return second_order(terms, t0, t1, y0, args, "RKN1210").velocity_matters()

    def func(self, terms: Any, t0: Any, y0: Any, args: Any) -> Any:
        return terms.vf(t0, y0, args)

    def step(self, terms: Any, t0: Any, t1: Any, y0: Any, args: Any, solver_state: Array, made_jump: Any):
        del made_jump
        system = second_order(terms, t0, t1, y0, args, "RKN1210")
        h = t1 - t0
        r1, v1, mean, ks = nystrom_step(system, RKN12, t0, h, y0.position, y0.velocity)
        y1 = system.state(r1, jnp.where(solver_state, jnp.nan, v1))
        step = h.astype(r1.dtype)
        by_position = step * system.travel(step * weighted(POSITION_ERROR, ks))
        error = system.state(by_position, step * weighted(VELOCITY_ERROR, ks))
        dense = dict(y0=y0, q=_q(system, t0, h, r1, v1 - y0.velocity, mean - y0.velocity, ks[0]))
        dense["pace"] = step * system.travel(jnp.ones_like(v1))
        return y1, error, dense, solver_state, diffrax.RESULTS.successful


def _q(system: SecondOrder, t0: Any, h: Any, r1: Array, change: Array, way: Array, a0: Array) -> Array:
    """The coefficients of q from the step's end, its change of velocity, and its way beyond h v0; dropped by the compiler
    where nothing reads them."""
    v0, half = system.y0.velocity, 0.5 * h
    r, v, mean, _ = nystrom_step(system, RKN12, t0, half, system.y0.position, v0)
    middle, end = system.acceleration(t0 + half, r), system.acceleration(t0 + h, r1)
    step = h.astype(r1.dtype)
    known = (0.5 * (mean - v0), way, v - v0, change, step * a0, step * middle, step * end)
    return jnp.tensordot(jnp.asarray(POWERS, r1.dtype), jnp.stack(known), 1)
