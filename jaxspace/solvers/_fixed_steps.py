"""A fixed number of equal steps of any method.

The sample of a controller, or the step of an environment, then always costs the same, has no loop
whose length depends on the state, and is differentiated like any formula.
"""

from typing import ClassVar, final

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PyTree

from ..core import InputError, State
from .protocol import (
    AbstractFixedStep,
    SolverTraits,
    Step,
    bind,
    check_steps,
    for_second_order,
    rolled_stages,
    solver_traits,
)
from .tolerances import Tolerance

# More steps than this are a loop: unrolled, they would take longer to compile than they save.
UNROLLED = 2


@final
class FixedSteps(AbstractFixedStep):
    """`steps` equal steps of `solver` in each segment; its error is the sum of theirs.

    **Arguments**

    - `solver`: with an error estimate, such as `Tsit5()`.
    - `steps`: in each segment, at least 1.

    **Raises** `InputError` for fewer steps, and for a solver that has fixed steps already."""

    solver: diffrax.AbstractSolver
    steps: int = eqx.field(static=True)
    term_structure: ClassVar = diffrax.AbstractTerm
    interpolation_cls: ClassVar = diffrax.LocalLinearInterpolation

    def __init__(self, solver: diffrax.AbstractSolver, steps: int = 1):
        self.solver = solver
        self.steps = steps

    def __check_init__(self):
        check_steps("FixedSteps.steps", self.steps, 1, "at least 1")
        if isinstance(self.solver, diffrax.AbstractSolver):
            traits = solver_traits(self.solver)
            if traits.fixed_step or traits.individual_steps:
                name = type(self.solver).__name__
                raise InputError(
                    f"FixedSteps.solver is {name}: it must be a one-step method, such as Tsit5."
                )

    @property
    def traits(self) -> SolverTraits:
        inner = solver_traits(self.solver)
        return SolverTraits(
            lands_on_save_times=True,
            fixed_step=True,
            needs=inner.needs,
            evaluations=self.steps * inner.evaluations,
            steps=self.steps,
        )

    @property
    def name(self) -> str:
        """Name of the method in tables."""
        return type(self.solver).__name__

    def rolled_stages(self) -> "FixedSteps":
        return FixedSteps(rolled_stages(self.solver), self.steps)

    def for_second_order(self) -> "FixedSteps":
        return FixedSteps(for_second_order(self.solver), self.steps)

    def refined(self, factor: int) -> "FixedSteps":
        return FixedSteps(self.solver, factor * self.steps)

    def bind(
        self,
        *,
        tolerance: Tolerance,
        save_ts: Float[Array, "times *#runs"] | None,
        run_axes: int,
        searched: bool = False,
    ) -> "FixedSteps":
        inner = bind(
            self.solver, tolerance=tolerance, save_ts=save_ts, run_axes=run_axes, searched=searched
        )
        return FixedSteps(inner, self.steps)

    def order(self, terms: diffrax.AbstractTerm | None) -> int | None:
        return self.solver.order(terms)  # pyright: ignore[reportArgumentType]

    def step(
        self,
        terms: diffrax.AbstractTerm,
        t0: Float[Array, ""],
        t1: Float[Array, ""],
        y0: State,
        args: PyTree,
        solver_state: PyTree,
        made_jump: Bool[Array, "*runs"] | bool,
    ) -> Step:
        # The vector field may jump where the segment begins, so that nothing is carried into it.
        del solver_state, made_jump
        h = (t1 - t0) / self.steps

        def one(carry: tuple[State, PyTree], k: Float[Array, ""]) -> tuple:
            y, inner = carry
            y1, error, _, inner, _ = self.solver.step(
                terms, t0 + k * h, t0 + (k + 1.0) * h, y, args, inner, False
            )
            return (y1, inner), jax.tree.map(jnp.abs, error)

        carry = (y0, self.solver.init(terms, t0, t0 + h, y0, args))
        if self.steps <= UNROLLED:
            errors = []
            for k in range(self.steps):
                carry, error = one(carry, jnp.asarray(k, h.dtype))
                errors.append(error)
            total = jax.tree.map(lambda *e: sum(e[1:], e[0]), *errors)
        else:
            numbers = jnp.arange(self.steps, dtype=h.dtype)
            carry, error = jax.lax.scan(jax.checkpoint(one), carry, numbers)
            total = jax.tree.map(lambda e: jnp.sum(e, axis=0), error)
        dense = dict(y0=y0, y1=carry[0])
        return carry[0], total, dense, None, diffrax.RESULTS.successful
