"""An exponential Rosenbrock method: exact for the linear part of the vector field about the state,
of order 5 for the rest.

    y' = f(t, y),   J = df/dy,   f_t = df/dt at the start of each step,   Z = h J

    G_i = y + c_i h phi_1(c_i Z) f + (c_i h)^2 phi_2(c_i Z) f_t
    U_2 = G_2                                                c_2 = 1/2
    U_i = G_i + h 8 c_i^3 phi_3(c_i Z) D_2                   c_i = 1/4, 1/2, 1 for i = 3, 4, 5
    D_i = f(t + c_i h, U_i) - f - J (U_i - y) - c_i h f_t

    y_1 = y + h phi_1 f + h^2 phi_2 f_t                      all phi_k of Z
            + h (64 phi_3 - 384 phi_4) D_3 + h (96 phi_4 - 8 phi_3) D_4 + e
    e   = 2/3 h (phi_3 - 18 phi_4 + 96 phi_5) (32 D_3 - 12 D_4 + D_5)

Without e the method is of order 4, so that e is the estimate of its error. The weights are those of
the polynomial through D at its nodes, and 8 c^3 phi_3 D_2 corrects the stages: all conditions of
order 5 hold for every J, however fast its motion. The lower formula omits D_5, because two formulas
that use it would agree on every fast motion, right or wrong.

    symbol  meaning                                                       unit
    h       step                                                          s
    J       Jacobian of the vector field                                  1/s
    G_i     linear motion from the start of the step                      state
    D_i     vector field without its linear part                          state/s
    phi_k   functions of `_phi.py`                                        1

Sources: Hochbruck, Ostermann, Schweitzer (2009), Exponential Rosenbrock-type methods, SIAM J.
Numer. Anal. 47, 786 (the form, and the pair of order 4); Luan, Ostermann (2014), Exponential
Rosenbrock methods of order five, J. Comput. Appl. Math. 255, 417 (the conditions of order 5, which
these nodes and weights fulfil).
"""

from typing import ClassVar, NamedTuple, final

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import State
from ..core.barrier import barrier
from ._phi import Square, phi_functions
from .protocol import AbstractFieldSolver, Advance, SolverTraits
from .tolerances import Tolerance
from .vector_field import StepField, just_before

Flat = Float[Array, "*runs n"]


class _Layout(NamedTuple):
    """Layout of a state in a vector: runs first, then the components, block after block."""

    like: State
    run_axes: int

    def flat(self, y: State) -> Flat:
        """The state as a vector."""
        blocks = [x.reshape(-1, *x.shape[x.ndim - self.run_axes :]) for x in jax.tree.leaves(y)]
        return jnp.moveaxis(jnp.concatenate(blocks), 0, -1)

    def state(self, v: Flat) -> State:
        """The vector as a state."""
        leaves, tree = jax.tree.flatten(self.like)
        sizes = [int(np.prod(x.shape[: x.ndim - self.run_axes])) for x in leaves]
        parts = jnp.split(jnp.moveaxis(v, -1, 0), np.cumsum(sizes)[:-1].tolist())
        blocks = [part.reshape(x.shape) for part, x in zip(parts, leaves, strict=True)]
        return jax.tree.unflatten(tree, blocks)


class _Linearisation(NamedTuple):
    """f, f_t and J at the start of the step, separate for each run."""

    f: Flat
    f_t: Flat
    jacobian: Square


def _linearise(f: StepField, s: Float[Array, ""], y: State, layout: _Layout) -> _Linearisation:
    # Not by `evaluate`, whose barriers would separate the derivatives.
    rate, derivative = jax.linearize(lambda s, y: f.terms.vf(s, y, f.args), s, y)
    v = layout.flat(y)
    n = v.shape[-1]
    # One directional derivative for each component of a run. The runs are independent of each
    # other, and share the directions.
    directions = jnp.eye(n, dtype=v.dtype).reshape(n, *(1,) * layout.run_axes, n)

    def column(direction: Array) -> Flat:
        dy = layout.state(jnp.broadcast_to(direction, v.shape))
        return layout.flat(derivative(jnp.zeros_like(s), dy))

    columns = jax.vmap(column)(directions)
    f_t = layout.flat(derivative(jnp.ones_like(s), jax.tree.map(jnp.zeros_like, y)))
    return _Linearisation(layout.flat(rate), f_t, jnp.moveaxis(columns, 0, -1))


def _apply(matrix: Square, v: Flat) -> Flat:
    # The default precision of an accelerator would leave three digits of the linear motion.
    return jnp.einsum("...ij,...j->...i", matrix, v, precision="highest")


@final
class ExponentialRosenbrock(AbstractFieldSolver, diffrax.AbstractAdaptiveSolver):
    """An exponential method of order 5 with an embedded error of order 4, for stiff systems and
    those with two time scales.

    In every step the linear part of the motion about the state is exact, however fast it oscillates
    or decays. Only the rest, the change of the Jacobian along the step, limits the step. Steps may
    therefore be long compared with fast linear motion, whose states are accurate at their ends.
    Fast motion that is not linear makes the error large and the steps short.

    Five evaluations a step, and a Jacobian of n + 1 directional derivatives for a state of n
    components: for states of some twenty components at most. Steps land on every save time.

    **Arguments**

    - `run_axes`: number of trailing axes of the state carry runs; `simulate` sets it.
    """

    run_axes: int = eqx.field(static=True, default=0)
    term_structure: ClassVar = diffrax.ODETerm
    interpolation_cls: ClassVar = diffrax.LocalLinearInterpolation

    @property
    def traits(self) -> SolverTraits:
        return SolverTraits(lands_on_save_times=True, evaluations=5)

    def bind(
        self,
        *,
        tolerance: Tolerance,
        save_ts: Float[Array, "times *#runs"] | None,
        run_axes: int,
        searched: bool = False,
    ) -> "ExponentialRosenbrock":
        del tolerance, save_ts, searched
        return ExponentialRosenbrock(run_axes)

    def order(self, terms: diffrax.AbstractTerm | None) -> int:
        return 5

    def advance(
        self, f: StepField, t0: Float[Array, ""], t1: Float[Array, ""], y0: State, carried: None
    ) -> Advance:
        del carried
        layout = _Layout(y0, self.run_axes)
        end = just_before(t0, t1)
        v = layout.flat(y0)
        h = (t1 - t0).astype(v.dtype)
        # Behind a barrier, because each of the five stages reads them.
        rate0, rate0_t, jacobian = barrier(_linearise(f, t0, y0, layout))
        quarter, half, whole = barrier(phi_functions(h * jacobian))

        def linear(c: float, phi: Array) -> Flat:
            """G_i - y."""
            return c * h * (_apply(phi[1], rate0) + c * h * _apply(phi[2], rate0_t))

        def left_out(c: float, change: Flat) -> Flat:
            """D_i, for `change` = U_i - y."""
            t = jnp.minimum(t0 + c * (t1 - t0), end)
            rate = layout.flat(f(t, layout.state(v + change)))
            return rate - rate0 - _apply(jacobian, change) - c * h * rate0_t

        # The stages 3 to 5 depend on D_2, and not on each other.
        d2 = left_out(0.5, linear(0.5, half))
        d3, d4, d5 = (
            left_out(c, linear(c, phi) + 8.0 * c**3 * h * _apply(phi[3], d2))
            for c, phi in ((0.25, quarter), (0.5, half), (1.0, whole))
        )
        _, _, _, p3, p4, p5 = whole
        error = 2.0 / 3.0 * h * _apply(p3 - 18.0 * p4 + 96.0 * p5, 32.0 * d3 - 12.0 * d4 + d5)
        rest = _apply(64.0 * p3 - 384.0 * p4, d3) + _apply(96.0 * p4 - 8.0 * p3, d4)
        y1 = barrier(layout.state(v + (linear(1.0, whole) + h * rest + error)))
        return Advance(y1, layout.state(error), dict(y0=y0, y1=y1))
