"""The method of Nystrom of order 12 with an embedded error of order 10, for a(t, r) and tight
tolerances.

Between the ends of a step, two shorter steps from its start reach a third and two thirds of it, and

    r(x) = r0 + h (x v0 + q(x)),    v(x) = v0 + q'(x),    q = sum_i H_i0 q_i + H_i1 q_i' + H_i2 q_i''

with Hermite's polynomials of degree 11 that fit position, velocity and acceleration at the four
places.

    symbol  meaning                                                       unit
    h       length of the step                                            s
    x, x_i  fraction of the step; 0, 1/3, 2/3, 1                          1
    q_i     (r_i - r0)/h - x_i v0; q_i' = v_i - v0, q_i'' = h a_i         m/s
    H_ik    polynomial whose k-th derivative at x_i is 1, all others 0    1

Source: Dormand, El-Mikkawy, Prince (1987), High-order embedded Runge-Kutta-Nystrom formulae, IMA
Journal of Numerical Analysis 7, 423. The states between are our own.
"""

import dataclasses
from typing import Any, ClassVar, final

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from . import _tableaus as tableau
from ._nystrom import RKN12, nystrom_step
from ._protocol import AbstractDeclaredSolver, SolverTraits
from ._runge_kutta import Weights, weighted
from ._second_order import SecondOrder, second_order
from ._step_control import Tolerance

NODES = (0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0)


def _less(first: Weights, second: Weights) -> Weights:
    """The difference of two rows."""
    a, b = dict(first), dict(second)
    return tuple((i, a.get(i, 0.0) - b.get(i, 0.0)) for i in sorted(a.keys() | b.keys()))


POSITION_ERROR = _less(tableau.RKN1210_POSITION, tableau.RKN1210_POSITION_10)
VELOCITY_ERROR = _less(tableau.RKN1210_VELOCITY, tableau.RKN1210_VELOCITY_10)


def _hermite(x: Any) -> Array:
    """H_ik at x: those of the first node but for its acceleration left out, because q and q' are
    zero there."""
    found = []
    for i, node in enumerate(NODES):
        others = [other for other in NODES if other != node]
        d, lagrange = x - node, 1.0
        for other in others:
            lagrange = lagrange * (x - other) / (node - other)
        s1, s2 = (sum((node - other) ** -n for other in others) for n in (1, 2))
        a, b = -3.0 * s1, 4.5 * s1 * s1 + 1.5 * s2
        basis = (1.0 + d * (a + b * d), d * (1.0 + a * d), 0.5 * d * d)
        found += [lagrange * lagrange * lagrange * f for f in (basis if i else basis[2:])]
    return jnp.stack(found)


class _Fitted(diffrax.AbstractLocalInterpolation):
    """States within a step: `q` holds q_i, q_i' and q_i'' in the order of `_hermite`, `pace` r' h
    for a velocity of ones."""

    t0: Any
    t1: Any
    y0: Any
    q: Array
    pace: Array

    def evaluate(self, t0: Any, t1: Any | None = None, left: bool = True) -> Any:
        del left
        if t1 is not None:
            return jax.tree.map(jnp.subtract, self.evaluate(t1), self.evaluate(t0))
        x = ((t0 - self.t0) / jnp.where(self.t1 == self.t0, 1.0, self.t1 - self.t0)).astype(
            self.q.dtype
        )
        weights, slopes = jax.jvp(_hermite, (x,), (jnp.ones_like(x),))
        q, slope = jnp.tensordot(weights, self.q, 1), jnp.tensordot(slopes, self.q, 1)
        r, v = self.y0.position, self.y0.velocity
        return dataclasses.replace(
            self.y0, position=r + self.pace * (x * v + q), velocity=v + slope
        )


@final
class RKN1210(AbstractDeclaredSolver, diffrax.AbstractAdaptiveSolver):
    """Dormand, El-Mikkawy and Prince's method of Nystrom, of order 12 with an embedded error of
    order 10.

    Seventeen evaluations a step; for states of a position and a velocity whose acceleration does
    not depend on the velocity: a run where it does leaves the finite numbers at once. A step within
    which states are saved costs 37 evaluations more, and these states are as exact as the
    steps. `save_ts` are the times of these states where they are known beforehand (`simulate` fills
    them in); without it every step pays. Raises `InputError` for a state with further parts."""

    save_ts: Float[Array, " times"] | None = None
    term_structure: ClassVar = diffrax.ODETerm
    interpolation_cls: ClassVar = _Fitted

    @property
    def traits(self) -> SolverTraits:
        return SolverTraits(
            replayable=True,
            lands_on_save_times=False,
            fixed_step=False,
            needs="",
            evaluations=17,
            steps=1,
        )

    def bind(
        self, *, tolerance: Tolerance, save_ts: Float[Array, " times"] | None, run_axes: int
    ) -> "RKN1210":
        del tolerance, run_axes
        return RKN1210(jnp.zeros((0,)) if save_ts is None else save_ts)

    def order(self, terms: Any) -> int:
        return 12

    def init(self, terms: Any, t0: Any, t1: Any, y0: Any, args: Any) -> Array:
        return second_order(terms, t0, t1, y0, args, "RKN1210").velocity_matters()

    def func(self, terms: Any, t0: Any, y0: Any, args: Any) -> Any:
        return terms.vf(t0, y0, args)

    def step(
        self, terms: Any, t0: Any, t1: Any, y0: Any, args: Any, solver_state: Array, made_jump: Any
    ):
        del made_jump
        system = second_order(terms, t0, t1, y0, args, "RKN1210")
        h = t1 - t0
        r1, v1, mean, ks = nystrom_step(system, RKN12, t0, h, y0.position, y0.velocity)
        y1 = system.state(r1, jnp.where(solver_state, jnp.nan, v1))
        step = h.astype(r1.dtype)
        by_position = step * system.travel(step * weighted(POSITION_ERROR, ks))
        error = system.state(by_position, step * weighted(VELOCITY_ERROR, ks))

        def between():
            return _between(system, t0, h, r1, v1, mean, ks[0])

        def nothing():
            return jnp.zeros((10, *r1.shape), r1.dtype)

        if self.save_ts is None:
            q = between()
        elif self.save_ts.shape[0] == 0:
            q = nothing()
        else:
            q = jax.lax.cond(jnp.any((self.save_ts >= t0) & (self.save_ts <= t1)), between, nothing)
        dense = dict(y0=y0, q=q, pace=step * system.pace)
        return y1, error, dense, solver_state, diffrax.RESULTS.successful


def _between(
    system: SecondOrder, t0: Any, h: Any, r1: Array, v1: Array, mean: Array, a0: Array
) -> Array:
    """q_i, q_i' and q_i'' in the order of `_hermite`; dropped by the compiler where nothing reads
    them."""
    v0, step = system.y0.velocity, h.astype(r1.dtype)

    def inner(_: None, x: Array) -> tuple[None, Array]:
        r, v, mean, _ks = nystrom_step(
            system, RKN12, t0, x.astype(h.dtype) * h, system.y0.position, v0
        )
        a = system.acceleration(t0 + x.astype(h.dtype) * h, r)
        return None, jnp.stack([x * (mean - v0), v - v0, step * a])

    _, places = jax.lax.scan(inner, None, jnp.asarray(NODES[1:3], r1.dtype))
    end = jnp.stack([mean - v0, v1 - v0, step * system.acceleration(t0 + h, r1)])
    return jnp.concatenate([step * a0[None], *places, end])
