"""Step control for one run or many that share their steps, and the account of the error that every
run has made.

    e_run = max over the blocks of the state of  |error| / (atol + rtol max(|y0|, |y1|))          | |: length of the block

A block is a vector (a position, a quaternion) or a scalar (a mass), and its length is taken: the
control does not depend on the axes, and a component that passes through zero asks for no digits of
its own. A shared step is right when the worst run is right. A run that has left the finite numbers
no longer counts: it marks itself and harms no other.

The clock of an integration runs from 0 to the number of its segments; a step never crosses a whole
number, so that what happens there (a burnout, a kink of a table) is never stepped over.

Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, II.4 (starting step,
control).
"""

import functools
from typing import Any, ClassVar, final

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree

from ..core import Scalar, safe_sqrt

SAFETY, SHRINK, GROW = 0.8, 0.2, 8.0
# of a segment; such a step is taken whatever its error, and the account of the errors tells of it
SMALLEST_STEP = 1e-10
# of a segment: too long a first step costs a rejection or two, too short a one many steps to grow
FIRST_STEP = 1e-2


@final
class Tolerance(eqx.Module):
    """What error is allowed in a step: `rtol` of the length of each block of the state plus `atol`;
    `run_axes` counts the trailing axes that carry runs."""

    rtol: Scalar
    atol: Scalar
    run_axes: int = eqx.field(static=True)

    def length(self, block: Array) -> Array:
        """The length of a block for each run."""
        return (
            safe_sqrt(self._over(jnp.sum, jnp.add, block * block))
            if block.ndim > self.run_axes
            else jnp.abs(block)
        )

    def _over(self, whole: Any, pair: Any, block: Array) -> Array:
        """A reduction over all axes but those of the runs: of vectors side by side component by
        component, because the compiler for CPUs takes one run after the other in a reduction."""
        if self.run_axes and block.ndim - self.run_axes == 1 and 0 < block.shape[0] <= 4:
            return functools.reduce(pair, block)
        return whole(block, axis=tuple(range(block.ndim - self.run_axes)))

    def largest(self, blocks: PyTree, scale: PyTree) -> Scalar:
        """The largest of the blocks' lengths in units of the tolerance that belongs to `scale`, for
        each run."""

        def ratio(b, s):
            return self.length(b) / (self.atol + self.rtol * s)

        return functools.reduce(jnp.maximum, jax.tree.leaves(jax.tree.map(ratio, blocks, scale)))

    def error(self, y0: PyTree, y1: PyTree, error: PyTree) -> Scalar:
        """The local error of each run in units of the tolerance: up to 1 is within it; infinite
        where it is not finite."""
        scale = jax.tree.map(lambda a, b: jnp.maximum(self.length(a), self.length(b)), y0, y1)
        e = self.largest(error, scale)
        return jnp.where(jnp.isfinite(e), e, jnp.inf)

    def alive(self, y: PyTree) -> Array:
        """Which runs have nothing but finite numbers in their state."""
        flags = [self._over(jnp.all, jnp.logical_and, jnp.isfinite(b)) for b in jax.tree.leaves(y)]
        return functools.reduce(jnp.logical_and, flags)


@final
class BatchStepController(diffrax.AbstractStepSizeController):
    """Steps as long as the worst of the runs allows, landing on every whole number of the clock.

    `lengths` are the relative lengths of the segments between the whole numbers, so that a step
    keeps its size across them; `longest`, if given, the longest step that is allowed in each, on
    the clock."""

    tolerance: Tolerance
    lengths: Float[Array, " segments"]
    longest: Float[Array, " segments"] | None = None

    def wrap(self, direction: Any) -> "BatchStepController":
        del direction
        return self

    def _clip(self, s: Scalar, ds: Scalar) -> Scalar:
        """The end of the step from `s`: at most at the next whole number, and not so that a sliver
        is left before it."""
        node = jnp.floor(s) + 1.0
        left = node - s
        if self.longest is not None:
            count = jnp.ceil(left / self._of_segment(self.longest, s) - 1e-6)
            ds = jnp.minimum(ds, left / jnp.maximum(count, 1.0))
        return jnp.where(ds >= 0.999 * left, node, s + jnp.where(ds > 0.5 * left, 0.5 * left, ds))

    def init(
        self,
        terms: Any,
        t0: Any,
        t1: Any,
        y0: PyTree,
        dt0: Any,
        args: Any,
        func: Any,
        error_order: Any,
    ):
        del t1, dt0
        ds = self._starting_step(lambda s, y: func(terms, s, y, args), t0, y0, error_order)
        return self._clip(t0, ds), ds

    def _starting_step(self, f: Any, s: Scalar, y0: PyTree, order: Any) -> Scalar:
        tol = self.tolerance
        scale = jax.tree.map(tol.length, y0)
        f0 = f(s, y0)
        d0, d1 = tol.largest(y0, scale), tol.largest(f0, scale)
        h0 = jnp.where((d0 < 1e-5) | (d1 < 1e-5), 1e-6, 0.01 * d0 / jnp.where(d1 > 0.0, d1, 1.0))
        h0 = jnp.where(d1 == 0.0, 1.0, h0)  # at rest, or a segment of no length
        h0 = jnp.minimum(self._least(h0, y0), 1.0)
        f1 = f(s + h0, jax.tree.map(lambda y, k: y + h0.astype(y.dtype) * k, y0, f0))
        d2 = tol.largest(jax.tree.map(jnp.subtract, f1, f0), scale) / h0
        d = jnp.maximum(d1, d2)
        # The root of the worst run's alone: one for each run would cost as much as a stage.
        worst = jnp.max(jnp.where(jnp.isfinite(d) & tol.alive(y0), d, 0.0))
        h1 = jnp.where(
            worst <= 1e-15,
            jnp.maximum(1e-6, h0),
            (0.01 / jnp.where(worst > 0.0, worst, 1.0)) ** (1.0 / order),
        )
        return jax.lax.stop_gradient(
            jnp.clip(jnp.minimum(100.0 * h0, h1), SMALLEST_STEP, 1.0)
        ).astype(s.dtype)

    def _least(self, h: Scalar, y: PyTree) -> Scalar:
        return jnp.min(jnp.where(jnp.isfinite(h) & self.tolerance.alive(y), h, 1.0))

    def adapt_step_size(
        self,
        t0: Any,
        t1: Any,
        y0: PyTree,
        y1_candidate: PyTree,
        args: Any,
        y_error: PyTree,
        error_order: Any,
        controller_state: Any,
    ):
        del args
        ds = t1 - t0
        every = self.tolerance.error(y0, y1_candidate, y_error)
        worst = jax.lax.stop_gradient(jnp.max(jnp.where(self.tolerance.alive(y0), every, 0.0)))
        smallest = jnp.maximum(SMALLEST_STEP, 16.0 * jnp.finfo(t0.dtype).eps * (1.0 + t0)).astype(
            t0.dtype
        )
        tiny = ds <= 1.5 * smallest
        keep = (worst <= 1.0) | tiny
        factor = SAFETY * jnp.clip(worst, 1e-12, 1e12) ** (-1.0 / error_order)
        factor = jnp.where(
            keep, jnp.clip(factor, SHRINK, GROW), jnp.clip(factor, SHRINK, SAFETY)
        ).astype(ds.dtype)
        shortened = keep & (ds < controller_state)
        proposal = jnp.where(shortened, jnp.maximum(controller_state, ds * factor), ds * factor)
        here, there = (
            self._of_segment(self.lengths, t0),
            self._of_segment(self.lengths, jnp.where(keep, t1, t0)),
        )
        landed = keep & (t1 == jnp.round(t1))
        proposal = jnp.where(
            landed,
            jnp.maximum(proposal * here / there, FIRST_STEP),
            jnp.maximum(proposal, smallest),
        )
        start = jnp.where(keep, t1, t0)
        return (
            keep,
            start,
            self._clip(start, proposal),
            landed,
            proposal,
            diffrax.RESULTS.successful,
        )

    @staticmethod
    def _of_segment(values: Array, s: Scalar) -> Scalar:
        """The one of the `values` that belongs to the segment which begins at or contains `s`; the
        last one beyond the end."""
        if values.shape[0] == 1:
            return values[0]
        return values[jnp.clip(jnp.floor(s).astype(int), 0, values.shape[0] - 1)]


@final
class StepTo(diffrax.AbstractStepSizeController):
    """Steps that were fixed beforehand: the nodes `plan` of the clock, with every whole number
    among them."""

    plan: Float[Array, " nodes"]

    def wrap(self, direction: Any) -> "StepTo":
        del direction
        return self

    def init(
        self,
        terms: Any,
        t0: Any,
        t1: Any,
        y0: PyTree,
        dt0: Any,
        args: Any,
        func: Any,
        error_order: Any,
    ):
        del terms, t0, t1, y0, dt0, args, func, error_order
        return self.plan[1], jnp.asarray(2)

    def adapt_step_size(
        self,
        t0: Any,
        t1: Any,
        y0: PyTree,
        y1_candidate: PyTree,
        args: Any,
        y_error: PyTree,
        error_order: Any,
        controller_state: Any,
    ):
        del t0, y0, y1_candidate, args, y_error, error_order
        landed = t1 == jnp.round(t1)
        return (
            True,
            t1,
            self.plan[controller_state],
            landed,
            controller_state + 1,
            diffrax.RESULTS.successful,
        )


@final
class ErrorTrackingSolver(diffrax.AbstractAdaptiveSolver, diffrax.AbstractWrappedSolver):
    """A solver that keeps for every run the largest local error of the steps taken, in units of the
    tolerance.

    The account is the second part of the solver's state."""

    solver: diffrax.AbstractSolver
    tolerance: Tolerance
    term_structure: ClassVar = diffrax.ODETerm

    @property
    def interpolation_cls(self):  # pyright: ignore[reportIncompatibleVariableOverride]
        return self.solver.interpolation_cls

    @property
    def root_finder(self) -> Any:
        """That of an implicit solver, for which diffrax asks."""
        return self.solver.root_finder  # pyright: ignore[reportAttributeAccessIssue]

    def order(self, terms: Any) -> int | None:
        return self.solver.order(terms)

    def init(self, terms: Any, t0: Any, t1: Any, y0: PyTree, args: Any):
        alive = self.tolerance.alive(y0)
        dtype = jax.tree.leaves(y0)[0].dtype
        return self.solver.init(terms, t0, t1, y0, args), jnp.where(alive, 0.0, jnp.inf).astype(
            dtype
        )

    def func(self, terms: Any, t0: Any, y0: PyTree, args: Any) -> PyTree:
        return self.solver.func(terms, t0, y0, args)

    def step(
        self, terms: Any, t0: Any, t1: Any, y0: PyTree, args: Any, solver_state: Any, made_jump: Any
    ):
        inner, account = solver_state
        y1, error, dense, inner, result = _step(
            self.solver, terms, t0, t1, y0, args, inner, jnp.asarray(made_jump)
        )
        made = jax.lax.stop_gradient(self.tolerance.error(y0, y1, error))
        return y1, error, dense, (inner, jnp.maximum(account, made.astype(account.dtype))), result


@eqx.filter_jit
def _step(solver: Any, *step: Any) -> Any:
    """A step of the solver, which diffrax traces three times: the second and third time it is at
    hand."""
    return solver.step(*step)
