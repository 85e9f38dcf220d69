"""A solver that tracks the largest local error of each run."""

from typing import ClassVar, final

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PyTree

from ..core import State
from ..core.jit import quick_jit
from .protocol import field_of_step
from .tolerances import Tolerance


@final
class ErrorTrackingSolver(diffrax.AbstractAdaptiveSolver, diffrax.AbstractWrappedSolver):
    """A solver that tracks the largest local error of the accepted steps, for each run and in units
    of the tolerance.

    Its state is that of the `solver` and the `max_local_error`."""

    solver: diffrax.AbstractSolver
    tolerance: Tolerance
    term_structure: ClassVar = diffrax.ODETerm

    @property
    def interpolation_cls(self):  # pyright: ignore[reportIncompatibleVariableOverride]
        return self.solver.interpolation_cls

    @property
    def root_finder(self):
        """The root finder of an implicit solver, which diffrax reads."""
        return self.solver.root_finder  # pyright: ignore[reportAttributeAccessIssue]

    @property
    def scan_kind(self):
        """The kind of loop over the stages of a Runge-Kutta method of diffrax.

        The adjoints of diffrax that allow forward mode set it."""
        return self.solver.scan_kind  # pyright: ignore[reportAttributeAccessIssue]

    def order(self, terms: diffrax.AbstractTerm | None) -> int | None:
        return self.solver.order(terms)

    def init(
        self,
        terms: diffrax.AbstractTerm,
        t0: Float[Array, ""],
        t1: Float[Array, ""],
        y0: State,
        args: PyTree,
    ) -> tuple[PyTree, Float[Array, "*runs"]]:
        inner = self.solver.init(terms, t0, t1, y0, args)
        # A run that starts with numbers that are not finite has no accuracy.
        max_local_error = jnp.where(self.tolerance.alive(y0), 0.0, jnp.inf)
        return inner, max_local_error.astype(jax.tree.leaves(y0)[0].dtype)

    def func(
        self, terms: diffrax.AbstractTerm, t0: Float[Array, ""], y0: State, args: PyTree
    ) -> State:
        return self.solver.func(terms, t0, y0, args)

    def step(
        self,
        terms: diffrax.AbstractTerm,
        t0: Float[Array, ""],
        t1: Float[Array, ""],
        y0: State,
        args: PyTree,
        solver_state: tuple[PyTree, Float[Array, "*runs"]],
        made_jump: Bool[Array, "*runs"] | bool,
    ) -> tuple[State, State, dict[str, PyTree], tuple[PyTree, Array], diffrax.RESULTS]:
        inner, max_local_error = solver_state
        args = field_of_step(self.solver, args, t0, t1)
        y1, error, dense, inner, result = _step(
            self.solver, terms, t0, t1, y0, args, inner, jnp.asarray(made_jump)
        )
        local_error = jax.lax.stop_gradient(self.tolerance.error(y0, y1, error))
        max_local_error = jnp.maximum(max_local_error, local_error.astype(max_local_error.dtype))
        return y1, error, dense, (inner, max_local_error), result


@quick_jit
def _step(solver: diffrax.AbstractSolver, *args: PyTree) -> tuple:
    """A step of the solver. diffrax traces it three times; the second and third time it is
    cached."""
    return solver.step(*args)
