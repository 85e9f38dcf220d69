"""Steps on a group: the Runge-Kutta-Munthe-Kaas method around any one-step method.

For each block of the state on a group,

    y(t) = y_0 moved(x(t))            x' = coordinate_rate(x, y')            x(t_0) = 0

Within a step the inner method integrates the coordinates x about the start of the step, which are
as smooth as the motion. The order is thus that of the inner method, and every block stays on its
group to rounding. Other blocks are integrated directly.

Source: Munthe-Kaas (1999), High order Runge-Kutta methods on manifolds, Applied Numerical
Mathematics 29, 115; Hairer, Lubich, Wanner, Geometric Numerical Integration, IV.8.
"""

from typing import ClassVar, final

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree

from ..core import AbstractGroupElement, State
from ..core.barrier import barrier
from ..core.groups import on_group
from ._runge_kutta import DOP853
from .dense_output import AbstractDenseOutput
from .embedded_errors import of_each_part
from .protocol import (
    AbstractFieldSolver,
    Advance,
    SolverTraits,
    bind,
    linear_errors,
    rolled_stages,
    solver_traits,
)
from .tolerances import Tolerance
from .vector_field import StepField

Block = AbstractGroupElement | Array


def _coordinates(y: State) -> State:
    """The coordinates of the state about itself."""
    return jax.tree.map(lambda x: x.coordinates() if on_group(x) else x, y, is_leaf=on_group)


def _moved(y0: State, local: State) -> State:
    """The state at the coordinates `local` about `y0`."""

    def block(y: Block, x: Array) -> Block:
        return y.moved(x) if on_group(y) else x

    return jax.tree.map(block, y0, local, is_leaf=on_group)


def _coordinate_rate(
    s: Float[Array, ""], local: State, args: tuple[diffrax.AbstractTerm, State, PyTree]
) -> State:
    """The derivative of the coordinates; `args` contains the terms, the state at the start of the
    step, and the arguments of the terms."""
    terms, y0, inner = args
    # Behind a barrier, because the vector field and the rate of the coordinates read the state.
    y = barrier(_moved(y0, local))
    rate = barrier(terms.vf(s, y, inner))

    def block(y: Block, x: Array, k: Block) -> Block:
        return y.coordinate_rate(x, k) if on_group(y) else k

    return jax.tree.map(block, y, local, rate, is_leaf=on_group)


_TERM = diffrax.ODETerm(_coordinate_rate)  # pyright: ignore[reportArgumentType]


class _MovedOutput(AbstractDenseOutput):
    """Dense output: that of the coordinates, moved from the start of the step."""

    t0: Float[Array, ""]
    t1: Float[Array, ""]
    y0: State
    inner: diffrax.AbstractLocalInterpolation

    def state(self, t: Float[Array, "*#runs"]) -> State:
        return _moved(self.y0, self.inner.evaluate(t))


@final
class MuntheKaas(AbstractFieldSolver, diffrax.AbstractAdaptiveSolver):
    """A one-step method on the group: a `Quaternion` has unit length to rounding at the stages,
    within and at the end of every step. Other methods of this package normalise it at the end of a
    step.

    - `solver`: the inner one-step method.

    Order, steps and dense output are those of the inner method, which starts again in every step:
    Tsit5 requires seven evaluations instead of six. Errors are raised as by the inner method."""

    solver: diffrax.AbstractSolver = DOP853()
    term_structure: ClassVar = diffrax.ODETerm
    interpolation_cls: ClassVar = _MovedOutput

    @property
    def traits(self) -> SolverTraits:
        # The steps stay on the group of each block.
        return solver_traits(self.solver)._replace(linear=False)

    def bind(
        self,
        *,
        tolerance: Tolerance,
        save_ts: Float[Array, "times *#runs"] | None,
        run_axes: int,
        searched: bool = False,
    ) -> "MuntheKaas":
        inner = bind(
            self.solver, tolerance=tolerance, save_ts=save_ts, run_axes=run_axes, searched=searched
        )
        return MuntheKaas(inner)

    def rolled_stages(self) -> "MuntheKaas":
        return MuntheKaas(rolled_stages(self.solver))

    def linear_errors(self) -> "MuntheKaas":
        return MuntheKaas(linear_errors(self.solver))

    def order(self, terms: diffrax.AbstractTerm | None) -> int | None:
        return self.solver.order(terms)

    def advance(
        self, f: StepField, t0: Float[Array, ""], t1: Float[Array, ""], y0: State, carried: None
    ) -> Advance:
        del carried
        local = _coordinates(y0)
        inner_args = (f.terms, y0, f.args)
        # The next step has other coordinates, so that nothing of this one is carried over.
        inner_state = self.solver.init(_TERM, t0, t1, local, inner_args)
        x1, x_error, dense, _, result = self.solver.step(
            _TERM, t0, t1, local, inner_args, inner_state, jnp.array(False)
        )
        y1 = barrier(_moved(y0, x1))

        # By blocks of the state, because the step control measures errors so.
        def in_blocks(x_error: State) -> State:
            embedded = _moved(y0, jax.tree.map(jnp.subtract, x1, x_error))
            return jax.tree.map(jnp.subtract, y1, embedded)

        error = of_each_part(in_blocks, x_error)
        inner = self.solver.interpolation_cls(t0=t0, t1=t1, **dense)
        return Advance(y1, error, dict(y0=y0, inner=inner), result=result)
