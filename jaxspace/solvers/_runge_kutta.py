"""Explicit Runge-Kutta methods with unrolled stages, as diffrax solvers.

    k_i = f(t + c_i h, y + h sum_j a_ij k_j)            y_1 = y + h sum_i b_i k_i

Two measurements determine the code. The compiler for CPUs evaluates the vector field once for each
of its outputs unless each stage ends in a barrier (1.8 times faster with it); other devices need no
barrier. And a method with unrolled stages as a diffrax solver costs no more than a hand-written
loop.

Stages are evaluated inside of the step: the last one just before its end, so that a vector field
that jumps there has the value of this step.
"""

import dataclasses
import functools
from collections.abc import Callable
from typing import ClassVar, final

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree

from ..core import State
from ..core.barrier import barrier
from . import tableaus as tableau
from ._nystrom import (
    DOP853_DENSE_ROWS,
    DOP853_NYSTROM,
    DOP853_NYSTROM_DENSE,
    nystrom_step,
    stage_sum,
)
from .dense_output import AbstractDenseOutput
from .embedded_errors import EmbeddedErrors, whole_error
from .protocol import AbstractFieldSolver, Advance, SolverTraits
from .second_order import Parts, second_order
from .stages import Weights, combine, dense_rows, stages, weighted_rows
from .tolerances import Tolerance
from .vector_field import StepField


class _NestedProducts(AbstractDenseOutput):
    """Dense output that has the state and its derivative at both ends of the step,

        y(x) = y0 + x (d + (1 - x) (h k0 - d + x (2 d - h (k0 + k1) + (1 - x) (r_0 + x ...))))

    with d = y1 - y0 and the fraction x of the step: factors x and 1 - x alternate.

    - `y0`, `y1`, `k0`, `k1`: states and derivatives at both ends.
    - `rest`: the coefficients r_i; `None` where no state within the step is needed."""

    t0: Float[Array, ""]
    t1: Float[Array, ""]
    y0: State
    y1: State | None
    k0: State | None
    k1: State | None
    rest: list[State] | None

    def state(self, t: Float[Array, "*#runs"]) -> State:
        assert self.rest is not None, "the step stores no data for interior states"
        x, h = self.fraction(t), self.t1 - self.t0

        def nested(y0: Array, y1: Array, k0: Array, k1: Array, *rest: Array) -> Array:
            change = y1 - y0
            start = h.astype(y0.dtype) * k0 - change
            fs = [change, start, change - h.astype(y0.dtype) * k1 - start, *rest]
            total = jnp.zeros_like(y0)
            for i, f in reversed(list(enumerate(fs))):
                total = (total + f) * (x if i % 2 == 0 else 1.0 - x).astype(y0.dtype)
            return y0 + total

        return jax.tree.map(nested, self.y0, self.y1, self.k0, self.k1, *self.rest)


def dense_info_of(
    dense: bool,
    h: Array,
    ends: tuple[State, State],
    ks: list[State] | State,
    last: int,
    rows: tuple[Weights, ...],
) -> dict[str, object]:
    """The data of the dense output, from the states at both `ends` and all derivatives: that at the
    end is number `last`, and `rows` are the weights of the coefficients r_i."""
    y0, y1 = ends
    if not dense:
        return _start_alone(y0)
    if isinstance(ks, list):
        rest = [combine(None, h, row, ks) for row in rows]
        return dict(y0=y0, y1=y1, k0=ks[0], k1=ks[last], rest=rest)

    def leaf(k: Array) -> Array:
        hk = h.astype(k.dtype) * k
        weights = dense_rows(rows, k.shape[0]).astype(k.dtype)
        return jax.vmap(lambda w: weighted_rows(w, hk))(weights)

    def number(i: int, stacked: State) -> State:
        return jax.tree.map(lambda x: x[i], stacked)

    # One sum gives all coefficients. The polynomial is not one more sum with powers as weights: a
    # search for an event samples it at many times, which would take twice as long.
    sums = jax.tree.map(leaf, ks)
    rest = [number(i, sums) for i in range(len(rows))]
    return dict(y0=y0, y1=y1, k0=number(0, ks), k1=number(last, ks), rest=rest)


def _start_alone(y0: State) -> dict[str, object]:
    """The data of a step without interior states."""
    # Not left for the compiler to remove, because each first call would trace and lower it.
    return dict(y0=y0, y1=None, k0=None, k1=None, rest=None)


class _AbstractStages(AbstractFieldSolver):
    """A method of which the user of a run does not choose the form: whether states within a step
    can be computed, and whether the stages are a loop of the program."""

    dense: eqx.AbstractVar[bool]
    rolled: eqx.AbstractVar[bool]

    def bind(
        self,
        *,
        tolerance: Tolerance,
        save_ts: Float[Array, "times *#runs"] | None,
        run_axes: int,
        searched: bool = False,
    ) -> AbstractFieldSolver:
        del tolerance, run_axes
        return dataclasses.replace(self, dense=searched or save_ts is not None)

    def rolled_stages(self) -> AbstractFieldSolver:
        return dataclasses.replace(self, rolled=True)


@final
class DOP853(_AbstractStages, diffrax.AbstractAdaptiveSolver):
    """The method of Dormand and Prince of order 8, with embedded errors of orders 5 and 3 and dense
    output of order 7.

    A step requires twelve evaluations, and four more if interior states are saved.

    **Arguments**

    - `dense`: whether states within a step can be computed. `simulate` sets it.
    - `rolled`: whether the stages are a loop of the program, which compiles sooner and runs
      slower. Set for derivatives of single runs.
    - `in_parts`: whether the error of a step is returned as its `EmbeddedErrors`. Set for the
      errors of tangents.
    - `second_order`: whether the system is known to be r' = v, v' = a(t, r). A step then sums only
      the accelerations at its stages, which is faster and gives the same numbers up to rounding.
      `simulate` sets it."""

    dense: bool = eqx.field(static=True, default=True)
    rolled: bool = eqx.field(static=True, default=False)
    in_parts: bool = eqx.field(static=True, default=False)
    second_order: bool = eqx.field(static=True, default=False)
    term_structure: ClassVar = diffrax.ODETerm
    interpolation_cls: ClassVar = _NestedProducts

    def linear_errors(self) -> "DOP853":
        return dataclasses.replace(self, in_parts=True)

    def for_second_order(self) -> "DOP853":
        return dataclasses.replace(self, second_order=True)

    @property
    def traits(self) -> SolverTraits:
        return SolverTraits(evaluations=12, linear=True)

    def order(self, terms: diffrax.AbstractTerm | None) -> int:
        return 8

    def advance(
        self, f: StepField, t0: Float[Array, ""], t1: Float[Array, ""], y0: State, carried: None
    ) -> Advance:
        del carried
        # With rolled stages the state may be packed into one vector.
        if self.second_order and Parts.of(y0) is not None:
            return self._second_order(f, t0, t1, y0)
        h = t1 - t0
        c, a = tableau.DOP853_C, tableau.DOP853_A
        if self.dense and self.rolled:
            # The loop includes the stages of the dense output, the first of which is at the end.
            c = (*c, 1.0, *tableau.DOP853_DENSE_C)
            a = (*a, tableau.DOP853_B, *tableau.DOP853_DENSE_A)
        ks = stages(f, t0, h, y0, c, a, [], self.rolled)
        # Behind a barrier, because the dense output and the error read it too.
        y1 = barrier(combine(y0, h, tableau.DOP853_B, ks))
        error = self._error(lambda row: combine(None, h, row, ks))
        if self.dense and isinstance(ks, list):
            # Four evaluations in every step, also if few states are saved.
            last = stages(f, t0, h, y1, (1.0,), ((),), [])
            rest = tableau.DOP853_DENSE_C, tableau.DOP853_DENSE_A
            ks = stages(f, t0, h, y0, *rest, [*ks, *last])
        dense_info = dense_info_of(self.dense, h, (y0, y1), ks, 12, tableau.DOP853_DENSE)
        return Advance(y1, error, dense_info)

    def _error(self, sums: Callable[[Weights], State]) -> PyTree:
        """The estimate of the error, by the `sums` of the derivatives at the stages."""
        # Behind a barrier: in one loop with the length of the error, all sums at once would need
        # several times as many registers as there are.
        fifth, third = barrier((sums(tableau.DOP853_ERROR_5), sums(tableau.DOP853_ERROR_3)))
        error = jax.tree.map(EmbeddedErrors, fifth, third)
        return error if self.in_parts else whole_error(error)

    def _second_order(
        self, f: StepField, t0: Float[Array, ""], t1: Float[Array, ""], y0: State
    ) -> Advance:
        """The step of a system r' = v, v' = a(t, r), whose stages have no velocity."""
        system = second_order(f.terms, t0, t1, y0, f.args, "DOP853")
        h = t1 - t0
        method, a = DOP853_NYSTROM, tableau.DOP853_A
        if self.dense:
            method, a = DOP853_NYSTROM_DENSE, DOP853_DENSE_ROWS
        step = nystrom_step(system, method, t0, h, system.r, system.v, self.rolled)
        sums = functools.partial(stage_sum, system, a, h, step.ks)
        error = self._error(sums)
        y1 = system.state(step.r, step.v)
        if not self.dense:
            return Advance(y1, error, _start_alone(y0))
        k0, k1 = (
            system.state(system.position_rate(v), step.ks[i])
            for v, i in ((system.v, 0), (step.v, 12))
        )
        rest = [sums(row) for row in tableau.DOP853_DENSE]
        return Advance(y1, error, dict(y0=y0, y1=y1, k0=k0, k1=k1, rest=rest))


@final
class Tsit5(_AbstractStages, diffrax.AbstractAdaptiveSolver):
    """The method of Tsitouras of order 5, with an embedded error of order 4 and dense output of
    order 4.

    A step requires six evaluations: its last stage is the first one of the next step, unless the
    vector field jumps between them.

    **Arguments**

    - `dense`: whether states within a step can be computed. `simulate` sets it.
    - `rolled`: whether the stages are a loop of the program, which compiles sooner and runs
      slower, with seven evaluations a step. Set for large vector fields."""

    dense: bool = eqx.field(static=True, default=True)
    rolled: bool = eqx.field(static=True, default=False)
    term_structure: ClassVar = diffrax.ODETerm
    interpolation_cls: ClassVar = _NestedProducts

    @property
    def traits(self) -> SolverTraits:
        return SolverTraits(evaluations=7 if self.rolled else 6, linear=True)

    def order(self, terms: diffrax.AbstractTerm | None) -> int:
        return 5

    def start(
        self, f: StepField, t0: Float[Array, ""], t1: Float[Array, ""], y0: State
    ) -> State | None:
        return None if self.rolled else f(t0, y0)

    def longer(self, carried: State | None, factor: Float[Array, "*runs"]) -> State | None:
        return jax.tree.map(lambda k: k * factor.astype(k.dtype), carried)

    def advance(
        self,
        f: StepField,
        t0: Float[Array, ""],
        t1: Float[Array, ""],
        y0: State,
        carried: State | None,
    ) -> Advance:
        h = t1 - t0
        if self.rolled:
            # The last row is the end of the step, and its stage the derivative there.
            ks = stages(f, t0, h, y0, tableau.TSIT5_C, tableau.TSIT5_A, [], rolled=True)
            y1 = barrier(combine(y0, h, tableau.TSIT5_B, ks))
            return Advance(
                y1, combine(None, h, tableau.TSIT5_ERROR, ks), self._dense_info(h, y0, y1, ks)
            )
        # After a jump the last stage of the step before belongs to another vector field.
        jumped = jnp.asarray(f.made_jump)
        first = jax.lax.cond(jnp.any(jumped), lambda: f(t0, y0), lambda: carried)
        if jumped.ndim:
            first = jax.tree.map(lambda a, b: jnp.where(jumped, a, b), first, carried)
        ks = stages(f, t0, h, y0, tableau.TSIT5_C[1:-1], tableau.TSIT5_A[1:-1], [first])
        # Projected before the last stage, which is the first one of the next step: a repetition of
        # that step for derivatives evaluates it at the state from which it starts.
        y1 = barrier(f.projected(t1, combine(y0, h, tableau.TSIT5_B, ks)))
        ks = [*ks, *stages(f, t0, h, y1, tableau.TSIT5_C[-1:], ((),), [])]
        error = combine(None, h, tableau.TSIT5_ERROR, ks)
        return Advance(y1, error, self._dense_info(h, y0, y1, ks), carried=ks[-1], projected=True)

    def _dense_info(
        self, h: Array, y0: State, y1: State, ks: list[State] | State
    ) -> dict[str, object]:
        """The data of the dense output."""
        return dense_info_of(self.dense, h, (y0, y1), ks, 6, (tableau.TSIT5_DENSE,))
