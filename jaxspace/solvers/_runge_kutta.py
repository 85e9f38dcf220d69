"""Explicit Runge-Kutta methods with unrolled stages, as diffrax solvers.

    k_i = f(t + c_i h, y + h sum_j a_ij k_j)            y_1 = y + h sum_i b_i k_i

Two measured facts shape the code. The compiler for CPUs recomputes a right-hand side once for each
of its outputs unless a barrier holds every stage together (1.8 times faster with it); on other
devices the barrier is left out. And a method written out stage by stage costs nothing over a
hand-made loop, so that everything stays a diffrax solver.

The stages look at a step from inside: the last one is evaluated just before the end of the step, so
that a right-hand side that jumps there is seen from the side to which the step belongs.
"""

import functools
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, final

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from ..core import barrier
from . import _tableaus as tableau
from ._protocol import AbstractDeclaredSolver, SolverTraits

Weights = tuple[tuple[int, Any], ...]
VectorField = Callable[[Any, Any], Any]


def weighted(weights: Weights, ks: Sequence[Array]) -> Array:
    """sum_i w_i k_i. By the operations of `lax`: a step holds hundreds of them, and those of
    `jax.numpy` take four times as long to trace."""
    terms = [jax.lax.mul(ks[i], ks[i].dtype.type(w)) for i, w in weights]
    return functools.reduce(jax.lax.add, terms)


def combine(y: PyTree, h: Any, weights: Weights, ks: list[PyTree]) -> PyTree:
    """y + h sum_i w_i k_i, leaf by leaf; a `y` of None stands for zero."""

    change = jax.tree.map(lambda *kl: h.astype(kl[0].dtype) * weighted(weights, kl), *ks)
    return change if y is None else jax.tree.map(jnp.add, y, change)


@eqx.filter_jit
def slope(terms: Any, t: Any, y: PyTree, args: Any) -> PyTree:
    """The vector field at one stage, held together; all stages of a step share one tracing of
    it."""
    return barrier(terms.vf(t, barrier(y), args))


def stages(
    f: VectorField,
    t0: Any,
    h: Any,
    y0: PyTree,
    c: tuple[float, ...],
    a: tuple[Weights, ...],
    ks: list[PyTree],
) -> list[PyTree]:
    """The stage derivatives that follow those in `ks`, for the rows `a` with the nodes `c`."""
    end = jnp.maximum(t0, t0 + h - 4.0 * jnp.finfo(t0.dtype).eps * (jnp.abs(t0) + h))
    for ci, row in zip(c, a, strict=True):
        y = combine(y0, h, row, ks) if row else y0
        ks = [*ks, f(jnp.minimum(t0 + h * ci, end), y)]
    return ks


class _HornerPair(diffrax.AbstractLocalInterpolation):
    """Dense output of DOP853: nested products of x and 1 - x."""

    t0: Any
    t1: Any
    y0: PyTree
    coefficients: list[PyTree]

    def evaluate(self, t0: Any, t1: Any | None = None, left: bool = True) -> PyTree:
        del left
        if t1 is not None:
            return jax.tree.map(jnp.subtract, self.evaluate(t1), self.evaluate(t0))
        x = (t0 - self.t0) / jnp.where(self.t1 == self.t0, 1.0, self.t1 - self.t0)

        def leaf(y0, *fs):
            total = jnp.zeros_like(y0)
            for i, f in enumerate(reversed(fs)):
                total = (total + f) * (x if i % 2 == 0 else 1.0 - x).astype(y0.dtype)
            return y0 + total

        return jax.tree.map(leaf, self.y0, *self.coefficients)


class _Polynomial(diffrax.AbstractLocalInterpolation):
    """Dense output of Tsit5: every stage weighted by a polynomial of order four."""

    t0: Any
    t1: Any
    y0: PyTree
    ks: list[PyTree]

    def evaluate(self, t0: Any, t1: Any | None = None, left: bool = True) -> PyTree:
        del left
        if t1 is not None:
            return jax.tree.map(jnp.subtract, self.evaluate(t1), self.evaluate(t0))
        h = self.t1 - self.t0
        x = (t0 - self.t0) / jnp.where(h == 0.0, 1.0, h)
        weights = [h * x * (a + x * (b + x * (c + x * d))) for a, b, c, d in tableau.TSIT5_DENSE]

        def change(*ks):
            return sum(w.astype(k.dtype) * k for w, k in zip(weights, ks, strict=True))

        return jax.tree.map(lambda y, *ks: y + change(*ks), self.y0, *self.ks)


@final
class DOP853(AbstractDeclaredSolver, diffrax.AbstractAdaptiveSolver):
    """Dormand and Prince's method of order 8 with embedded errors of orders 5 and 3 and dense
    output of order 7.

    Twelve evaluations a step; four more where states between the steps are asked for."""

    term_structure: ClassVar = diffrax.ODETerm
    interpolation_cls: ClassVar = _HornerPair

    @property
    def traits(self) -> SolverTraits:
        return SolverTraits(
            replayable=True,
            lands_on_save_times=False,
            fixed_step=False,
            needs="",
            evaluations=12,
            steps=1,
        )

    def order(self, terms: Any) -> int:
        return 8

    def init(self, terms: Any, t0: Any, t1: Any, y0: PyTree, args: Any) -> None:
        return None

    def func(self, terms: Any, t0: Any, y0: PyTree, args: Any) -> PyTree:
        return slope(terms, t0, y0, args)

    def step(
        self,
        terms: Any,
        t0: Any,
        t1: Any,
        y0: PyTree,
        args: Any,
        solver_state: None,
        made_jump: Any,
    ):
        del solver_state, made_jump
        h = t1 - t0

        def f(t, y):
            return slope(terms, t, y, args)

        ks = stages(f, t0, h, y0, tableau.DOP853_C, tableau.DOP853_A, [])
        y1 = barrier(combine(y0, h, tableau.DOP853_B, ks))
        error = jax.tree.map(
            _blend,
            combine(None, h, tableau.DOP853_ERROR_5, ks),
            combine(None, h, tableau.DOP853_ERROR_3, ks),
        )
        dense = dict(y0=y0, coefficients=_dense_coefficients(f, t0, h, y0, y1, ks))
        return y1, error, dense, None, diffrax.RESULTS.successful


def _blend(e5: jax.Array, e3: jax.Array) -> jax.Array:
    """The error estimate e5^2 / sqrt(e5^2 + e3^2 / 100) (Hairer, Norsett, Wanner II.10), by
    component."""
    bottom = e5 * e5 + 0.01 * e3 * e3
    positive = bottom > 0.0
    return jnp.where(positive, e5 * e5 / jnp.sqrt(jnp.where(positive, bottom, 1.0)), 0.0)


def _dense_coefficients(
    f: VectorField, t0: Any, h: Any, y0: PyTree, y1: PyTree, ks: list[PyTree]
) -> list[PyTree]:
    """The seven coefficients of DOP853's dense output; dropped by the compiler where nothing reads
    them."""
    last = stages(f, t0, h, y1, (1.0,), ((),), [])[0]
    ks = stages(f, t0, h, y0, tableau.DOP853_DENSE_C, tableau.DOP853_DENSE_A, [*ks, last])
    change = jax.tree.map(jnp.subtract, y1, y0)
    start = jax.tree.map(lambda k, d: h.astype(d.dtype) * k - d, ks[0], change)
    end = jax.tree.map(
        lambda d, k0, k1: 2.0 * d - h.astype(d.dtype) * (k0 + k1), change, ks[0], last
    )
    return [change, start, end, *(combine(None, h, row, ks) for row in tableau.DOP853_DENSE)]


@final
class Tsit5(AbstractDeclaredSolver, diffrax.AbstractAdaptiveSolver):
    """Tsitouras' method of order 5 with an embedded error of order 4 and dense output of order 4.

    Six evaluations a step: the last stage of a step is the first one of the next, unless a jump
    lies between."""

    term_structure: ClassVar = diffrax.ODETerm
    interpolation_cls: ClassVar = _Polynomial

    @property
    def traits(self) -> SolverTraits:
        return SolverTraits(
            replayable=True,
            lands_on_save_times=False,
            fixed_step=False,
            needs="",
            evaluations=6,
            steps=1,
        )

    def order(self, terms: Any) -> int:
        return 5

    def init(self, terms: Any, t0: Any, t1: Any, y0: PyTree, args: Any) -> PyTree:
        return terms.vf(t0, y0, args)

    def func(self, terms: Any, t0: Any, y0: PyTree, args: Any) -> PyTree:
        return slope(terms, t0, y0, args)

    def step(
        self,
        terms: Any,
        t0: Any,
        t1: Any,
        y0: PyTree,
        args: Any,
        solver_state: PyTree,
        made_jump: Any,
    ):
        h = t1 - t0

        def f(t, y):
            return slope(terms, t, y, args)

        first = jax.lax.cond(made_jump, lambda: f(t0, y0), lambda: solver_state)
        ks = stages(f, t0, h, y0, tableau.TSIT5_C[1:], tableau.TSIT5_A[1:], [first])
        y1 = barrier(combine(y0, h, tableau.TSIT5_B, ks))
        error = combine(None, h, tableau.TSIT5_ERROR, ks)
        return y1, error, dict(y0=y0, ks=ks), ks[-1], diffrax.RESULTS.successful
