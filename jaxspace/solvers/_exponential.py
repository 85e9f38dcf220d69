"""An exponential Rosenbrock method: exact for what is linear about the state, of order 5 for the
rest.

    y' = f(t, y),   J = df/dy,   f_t = df/dt at the start of each step,   Z = h J
    U_2 = y + c_2 h phi_1(c_2 Z) f + (c_2 h)^2 phi_2(c_2 Z) f_t                                  c_2 = 1/2
    U_i = y + c_i h phi_1(c_i Z) f + (c_i h)^2 phi_2(c_i Z) f_t + h 8 c_i^3 phi_3(c_i Z) D_2     c_i = 1/4, 1/2, 1
    D_i = f(t + c_i h, U_i) - f - J (U_i - y) - c_i h f_t
    y_1 = y + h phi_1 f + h^2 phi_2 f_t + h (64 phi_3 - 384 phi_4) D_3 + h (96 phi_4 - 8 phi_3) D_4 + e         phi_k of Z
    e   = 2/3 h (phi_3 - 18 phi_4 + 96 phi_5) (32 D_3 - 12 D_4 + D_5)

Without e the method is of order 4: e is the estimate of its error. The weights are those of the
polynomial through D at its nodes, and 8 c^3 phi_3 D_2 makes good the stages: all conditions of
order 5 hold for every J, however fast its motion. Two formulas that both use D_5 would agree on
every fast motion, right or wrong: so the lower one leaves it out.

    symbol  meaning                                                       unit
    h       step                                                          s
    J       Jacobian of the vector field                                  1/s
    D_i     what the linear motion leaves out of the vector field         state/s
    phi_k   (_phi.py)                                                     1

Sources: Hochbruck, Ostermann, Schweitzer (2009), Exponential Rosenbrock-type methods, SIAM J.
Numer. Anal. 47, 786 (the form, and the pair of order 4); Luan, Ostermann (2014), Exponential
Rosenbrock methods of order five, J. Comput. Appl. Math. 255, 417 (the conditions of order 5, which
these nodes and weights fulfil).
"""

from typing import Any, ClassVar, NamedTuple, final

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from ..core import barrier
from ._phi import Square, phis
from ._protocol import AbstractDeclaredSolver, SolverTraits
from ._runge_kutta import slope
from ._step_control import Tolerance

Flat = Float[Array, "*runs n"]


class _Layout(NamedTuple):
    """How a state lies in a vector: the runs first, then its components one block after the
    other."""

    like: PyTree
    run_axes: int

    def flat(self, y: PyTree) -> Flat:
        """The state as a vector."""
        blocks = [x.reshape(-1, *x.shape[x.ndim - self.run_axes :]) for x in jax.tree.leaves(y)]
        return jnp.moveaxis(jnp.concatenate(blocks), 0, -1)

    def state(self, v: Flat) -> PyTree:
        """The vector as a state."""
        leaves, tree = jax.tree.flatten(self.like)
        sizes = [int(np.prod(x.shape[: x.ndim - self.run_axes])) for x in leaves]
        parts = jnp.split(jnp.moveaxis(v, -1, 0), np.cumsum(sizes)[:-1].tolist())
        return jax.tree.unflatten(
            tree, [part.reshape(x.shape) for part, x in zip(parts, leaves, strict=True)]
        )


def _linearised(f: Any, s: Any, y: PyTree, layout: _Layout) -> tuple[Flat, Flat, Square]:
    """f, f_t and J: each run with its own, by as many directional derivatives as a run has
    components, and one."""
    rate, along = jax.linearize(f, s, y)
    v = layout.flat(y)
    tangents = jnp.eye(v.shape[-1], dtype=v.dtype).reshape(-1, *(1,) * layout.run_axes, v.shape[-1])

    def one(tangent):
        return layout.flat(
            along(jnp.zeros_like(s), layout.state(jnp.broadcast_to(tangent, v.shape)))
        )

    columns = jax.vmap(one)(tangents)
    in_time = layout.flat(along(jnp.ones_like(s), jax.tree.map(jnp.zeros_like, y)))
    return layout.flat(rate), in_time, jnp.moveaxis(columns, 0, -1)


def _of(matrix: Square, v: Flat) -> Flat:
    return jnp.einsum("...ij,...j->...i", matrix, v, precision="highest")


@final
class ExponentialRosenbrock(AbstractDeclaredSolver, diffrax.AbstractAdaptiveSolver):
    """An exponential method of order 5 with an embedded error of order 4, for stiff and
    two-time-scale systems.

    The linear part of the motion about the state is exact in every step, however fast it oscillates
    or decays; only what is left (how the Jacobian changes along the step) limits the step. It
    resolves no fast motion that is linear, and says so by the length of its steps; fast motion that
    is not linear makes the estimate large and the steps short, as long as it matters.

    Five evaluations a step, and a Jacobian of n + 1 directional derivatives for n components of the
    state: for states of some twenty components at most. Every state asked for is landed on.
    `run_axes`, the trailing axes of the state that carry runs, is set by the runner."""

    run_axes: int = eqx.field(static=True, default=0)
    term_structure: ClassVar = diffrax.ODETerm
    interpolation_cls: ClassVar = diffrax.LocalLinearInterpolation

    @property
    def traits(self) -> SolverTraits:
        return SolverTraits(
            replayable=True,
            lands_on_save_times=True,
            fixed_step=False,
            needs="",
            evaluations=5,
            steps=1,
        )

    def bind(
        self, *, tolerance: Tolerance, save_ts: Float[Array, " times"] | None, run_axes: int
    ) -> "ExponentialRosenbrock":
        del tolerance, save_ts
        return ExponentialRosenbrock(run_axes)

    def order(self, terms: Any) -> int:
        return 5

    def init(self, terms: Any, t0: Any, t1: Any, y0: PyTree, args: Any) -> None:
        return None

    def func(self, terms: Any, t0: Any, y0: PyTree, args: Any) -> PyTree:
        return terms.vf(t0, y0, args)

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
        layout, end = (
            _Layout(y0, self.run_axes),
            t1 - 4.0 * jnp.finfo(t1.dtype).eps * jnp.maximum(jnp.abs(t1), t1 - t0),
        )
        v = layout.flat(y0)
        h = (t1 - t0).astype(v.dtype)
        f, in_time, jacobian = barrier(
            _linearised(lambda s, y: terms.vf(s, y, args), t0, y0, layout)
        )
        quarter, half, whole = barrier(phis(h * jacobian))

        def way(c: float, phi: Array) -> Flat:
            return c * h * (_of(phi[1], f) + c * h * _of(phi[2], in_time))

        def left_out(c: float, change: Flat) -> Flat:
            rate = slope(
                terms, jnp.minimum(t0 + c * (t1 - t0), end), layout.state(v + change), args
            )
            return layout.flat(rate) - f - _of(jacobian, change) - c * h * in_time

        second = left_out(0.5, way(0.5, half))
        d3, d4, d5 = (
            left_out(c, way(c, phi) + 8.0 * c**3 * h * _of(phi[3], second))
            for c, phi in ((0.25, quarter), (0.5, half), (1.0, whole))
        )
        _, _, _, p3, p4, p5 = whole
        error = 2.0 / 3.0 * h * _of(p3 - 18.0 * p4 + 96.0 * p5, 32.0 * d3 - 12.0 * d4 + d5)
        change = (
            way(1.0, whole)
            + h * (_of(64.0 * p3 - 384.0 * p4, d3) + _of(96.0 * p4 - 8.0 * p3, d4))
            + error
        )
        y1 = barrier(layout.state(v + change))
        return y1, layout.state(error), dict(y0=y0, y1=y1), None, diffrax.RESULTS.successful
