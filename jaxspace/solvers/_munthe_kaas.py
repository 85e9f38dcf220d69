"""Steps on a group: the method of Runge, Kutta and Munthe-Kaas around any one-step method.

    y(t) = y_0 moved(x(t)),    x' = coordinate_rate(x, y'),    x(t_0) = 0       for each block that lies on a group

Within a step the inner method integrates the coordinates x about the start of the step, where they
are as smooth as the motion: its order stays, and every block stays on its group to rounding. Other
blocks are integrated as they are.

Source: Munthe-Kaas (1999), High order Runge-Kutta methods on manifolds, Applied Numerical
Mathematics 29, 115; Hairer, Lubich, Wanner, Geometric Numerical Integration, IV.8.
"""

from typing import Any, ClassVar, final

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree

from ..core import AbstractGroupElement, barrier
from ._protocol import AbstractDeclaredSolver, SolverTraits, bind, solver_traits
from ._runge_kutta import DOP853
from ._step_control import Tolerance


def _on_group(x: Any) -> bool:
    return isinstance(x, AbstractGroupElement)


def _local(y: PyTree) -> PyTree:
    """The state in coordinates about itself."""
    return jax.tree.map(lambda x: x.coordinates() if _on_group(x) else x, y, is_leaf=_on_group)


def _moved(y0: PyTree, local: PyTree) -> PyTree:
    """The state at coordinates about `y0`."""
    return jax.tree.map(
        lambda y, x: y.moved(x) if _on_group(y) else x, y0, local, is_leaf=_on_group
    )


def _rate(s: Any, local: PyTree, args: Any) -> PyTree:
    """The rate of the coordinates."""
    terms, y0, inner = args
    y = barrier(_moved(y0, local))
    rate = barrier(terms.vf(s, y, inner))

    def one(y, x, k):
        return y.coordinate_rate(x, k) if _on_group(y) else k

    return jax.tree.map(one, y, local, rate, is_leaf=_on_group)


_TERM: Any = diffrax.ODETerm(_rate)  # pyright: ignore[reportArgumentType]


class _Moved(diffrax.AbstractLocalInterpolation):
    """Dense output: that of the coordinates, moved."""

    t0: Any
    t1: Any
    y0: PyTree
    inner: Any

    def evaluate(self, t0: Any, t1: Any | None = None, left: bool = True) -> PyTree:
        if t1 is not None:
            return jax.tree.map(jnp.subtract, self.evaluate(t1), self.evaluate(t0))
        return _moved(self.y0, self.inner.evaluate(t0, left=left))


@final
class MuntheKaas(AbstractDeclaredSolver, diffrax.AbstractAdaptiveSolver):
    """The one-step method `solver` on the group: a `Quaternion` keeps its unit length to rounding,
    however long the run.

    Order, steps and dense output are those of the inner method, which starts anew in every step.
    Raises what it raises."""

    solver: diffrax.AbstractSolver = DOP853()
    term_structure: ClassVar = diffrax.ODETerm
    interpolation_cls: ClassVar = _Moved

    @property
    def traits(self) -> SolverTraits:
        return solver_traits(self.solver)

    def bind(
        self, *, tolerance: Tolerance, save_ts: Float[Array, " times"] | None, run_axes: int
    ) -> "MuntheKaas":
        return MuntheKaas(
            bind(self.solver, tolerance=tolerance, save_ts=save_ts, run_axes=run_axes)
        )

    def order(self, terms: Any) -> int | None:
        return self.solver.order(terms)

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
        local, given = _local(y0), (terms, y0, args)
        begun = self.solver.init(_TERM, t0, t1, local, given)
        x1, error, dense, _, result = self.solver.step(
            _TERM, t0, t1, local, given, begun, jnp.array(False)
        )
        y1 = barrier(_moved(y0, x1))
        below = _moved(y0, jax.tree.map(jnp.subtract, x1, error))
        inner = self.solver.interpolation_cls(t0=t0, t1=t1, **dense)
        return y1, jax.tree.map(jnp.subtract, y1, below), dict(y0=y0, inner=inner), None, result
