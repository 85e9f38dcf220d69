"""Interface between the integration loop and a solver.

A solver of this package is an `AbstractDeclaredSolver`: it declares its traits and how it is bound
to a run. For the solvers of diffrax both follow from their classes. The loop thus names no concrete
solver, and a new one needs no change outside of its file.
"""

__all__ = [
    "AbstractDeclaredSolver",
    "AbstractFieldSolver",
    "AbstractFixedStep",
    "Advance",
    "SolverTraits",
    "bind",
    "field_of_step",
    "for_second_order",
    "forward_mode",
    "refine",
    "rolled_stages",
    "solver_traits",
]

from abc import abstractmethod
from collections.abc import Callable
from typing import Literal, NamedTuple, TypeAlias, final

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix
from equinox import AbstractVar
from jaxtyping import Array, Bool, Float, PyTree

from ..core import InputError, State
from ..core.suggestions import suggests
from .tolerances import Tolerance
from .vector_field import FieldOfStep, ScaledField, StepField, evaluate, just_before

Step: TypeAlias = tuple[State, State, dict[str, PyTree], PyTree, diffrax.RESULTS]
"""The result of the `step` of a solver: the state after it, its error, the data of the dense
output, the state of the solver, and whether the step succeeded."""


@suggests
class SolverTraits(NamedTuple):
    """Properties of a method that the integration loop uses.

    - `lands_on_save_times`: it has no dense output, so that a step ends at every save time.
    - `fixed_step`: it uses a given number of steps in each segment; their error is compared with
      the tolerance afterwards.
    - `needs`: the capability of the system by which it integrates, if any.
    - `evaluations`: evaluations of the vector field per step of the loop, which for a fixed-step
      method is a whole segment.
    - `individual_steps`: every run of a batch has individual steps, in variables of the method.
    - `steps`: number of steps counted per step of the loop: 1, or the fixed steps of a segment.
    - `linear`: its steps are linear combinations of derivatives, so that all blocks of a state can
      be packed into one vector.
    """

    lands_on_save_times: bool = False
    fixed_step: bool = False
    needs: Literal["", "split", "regularised"] = ""
    evaluations: int = 1
    steps: int = 1
    individual_steps: bool = False
    linear: bool = False


@suggests
class AbstractDeclaredSolver(diffrax.AbstractSolver):
    """A solver that declares its traits."""

    @property
    @abstractmethod
    def traits(self) -> SolverTraits:
        """Properties of the method that the integration loop uses."""

    def bind(
        self,
        *,
        tolerance: Tolerance,
        save_ts: Float[Array, "times *#runs"] | None,
        run_axes: int,
        searched: bool = False,
    ) -> diffrax.AbstractSolver:
        """The solver bound to a run; arguments as of the function `bind`."""
        del tolerance, save_ts, run_axes, searched
        return self

    def rolled_stages(self) -> diffrax.AbstractSolver:
        """The same method as a program that compiles faster and runs slower, if available."""
        return self

    def linear_errors(self) -> diffrax.AbstractSolver:
        """The same method with an error estimate that is linear in the step; as by default."""
        return self

    def for_second_order(self) -> diffrax.AbstractSolver:
        """The same method for a system that is known to be r' = v, v' = a(t, r), with less
        arithmetic, if it has such a form."""
        return self

    def longer(self, carried: PyTree, factor: Float[Array, "*runs"]) -> PyTree:
        """The carry of a step into the next one, which is longer by a `factor`, where each step is
        from 0 to 1."""
        del factor
        return carried

    def func(
        self, terms: diffrax.AbstractTerm, t0: Float[Array, ""], y0: State, args: PyTree
    ) -> State:
        """The vector field, from which diffrax's step control chooses the first step."""
        return evaluate(terms, t0, y0, args)

    def init(
        self,
        terms: diffrax.AbstractTerm,
        t0: Float[Array, ""],
        t1: Float[Array, ""],
        y0: State,
        args: PyTree,
    ) -> PyTree:
        """The carry into the first step: nothing, by default."""
        return self.start(StepField(terms, args, False), t0, t1, y0)

    def start(self, f: StepField, t0: Float[Array, ""], t1: Float[Array, ""], y0: State) -> PyTree:
        """`init` for a vector field f(t, y), without the terms of diffrax."""
        del f, t0, t1, y0


@suggests
@final
class Advance(NamedTuple):
    """Result of a step.

    - `y1`: the state after the step.
    - `error`: estimate of its error.
    - `dense`: the coefficients of the dense output.
    - `carried`: values that the next step uses.
    - `result`: whether the step succeeded.
    - `projected`: whether `y1` already satisfies the group and other constraints of the state;
      otherwise the loop projects it."""

    y1: State
    error: State
    dense: dict[str, PyTree]
    carried: PyTree = None
    result: diffrax.RESULTS = diffrax.RESULTS.successful
    projected: bool = False


class AbstractFieldSolver(AbstractDeclaredSolver):
    """A solver whose step is written for a vector field f(t, y), without the terms of diffrax."""

    @abstractmethod
    def advance(
        self, f: StepField, t0: Float[Array, ""], t1: Float[Array, ""], y0: State, carried: PyTree
    ) -> Advance:
        """A step.

        **Arguments**

        - `f`: the vector field, called as f(t, y).
        - `t0`, `t1`: start and end of the step, in normalised time.
        - `y0`: the state at `t0`.
        - `carried`: the values that the previous step carries, or those of `start`."""

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
        f = StepField(terms, args, made_jump)
        advance = self.advance(f, t0, t1, y0, solver_state)
        y1 = advance.y1 if advance.projected else f.projected(t1, advance.y1)
        return y1, advance.error, advance.dense, advance.carried, advance.result


class AbstractFixedStep(AbstractDeclaredSolver):
    """A method with `steps` equal steps in each segment of normalised time.

    For diffrax all of them are one step, from one state to one state. Nothing is thus carried over
    a place where the vector field jumps, and a segment can be repeated for derivatives."""

    steps: AbstractVar[int]

    @abstractmethod
    def refined(self, factor: int) -> "AbstractFixedStep":
        """The method with `factor` times as many steps."""


# Most steps of a segment: more take hours, and exceed every memory.
MAX_STEPS = 10**8


def check_steps(name: str, steps: object, least: int, allowed: str) -> None:
    """Raise `InputError` unless the steps are a whole number from `least` to `MAX_STEPS`.

    **Arguments**

    - `name`: of the field.
    - `allowed`: the least number in words."""
    # For Python, `True` is a whole number.
    whole = None if isinstance(steps, bool) or not isinstance(steps, int | np.integer) else steps
    if whole is None or not least <= whole <= MAX_STEPS:
        raise InputError(
            f"{name} is {steps!r}: it must be {allowed}, and a whole number up to {MAX_STEPS:.0e}."
        )


def solver_traits(solver: diffrax.AbstractSolver) -> SolverTraits:
    """Properties of a method that the integration loop uses, of this package or of diffrax."""
    # First of all, because a wrapper of diffrax is an instance of the class that it wraps.
    if isinstance(solver, diffrax.AbstractWrappedSolver):
        inner = solver_traits(solver.solver)
        # A step and its two halves. No other wrapper of diffrax takes more than one step.
        calls = 3 if type(solver) is diffrax.HalfSolver else 1
        return inner._replace(evaluations=calls * inner.evaluations)
    if isinstance(solver, AbstractDeclaredSolver):
        return solver.traits
    return SolverTraits(evaluations=_evaluations(solver))


def carries_steps(solver: diffrax.AbstractSolver, field: Callable[..., State], y0: PyTree) -> bool:
    """Whether a step of the solver depends on the steps before it, and not on the state alone.

    **Arguments**

    - `field`: the vector field (t, y). `y0`: an initial state, or its shapes."""
    if isinstance(solver, diffrax.AbstractWrappedSolver):
        return carries_steps(solver.solver, field, y0)
    # A Runge-Kutta method of diffrax carries the derivative at the end of the step, which `init`
    # can evaluate again.
    if isinstance(solver, AbstractDeclaredSolver | diffrax.AbstractRungeKutta):
        return False
    t, term = jnp.zeros(()), diffrax.ODETerm(lambda t, y, args: field(t, y))
    carried = eqx.filter_eval_shape(lambda y: solver.init(term, t, t, y, None), y0)
    return bool(jax.tree.leaves(carried))


def _evaluations(solver: diffrax.AbstractSolver) -> int:
    """Stages of a Runge-Kutta method of diffrax; one for other methods, where they are unknown.

    An implicit stage counts once, independent of the iterations of its root finder."""
    tableau = getattr(solver, "tableau", None)
    if not isinstance(tableau, diffrax.ButcherTableau):
        return 1
    # Where the first stage is the last one of the previous step, it is not evaluated again.
    return tableau.num_stages - int(tableau.fsal)


def bind(
    solver: diffrax.AbstractSolver,
    *,
    tolerance: Tolerance,
    save_ts: Float[Array, "times *#runs"] | None,
    run_axes: int,
    searched: bool = False,
) -> diffrax.AbstractSolver:
    """The solver bound to a run.

    **Arguments**

    - `solver`: one of this package or one of diffrax's.
    - `tolerance`: for the root finder of an implicit solver of diffrax, unless that has one.
    - `save_ts`: the normalised times at which states are saved; `None` if only the last state is.
    - `run_axes`: number of trailing axes of each block of the state carry runs.
    - `searched`: whether states within every step are needed, as by a search for events.

    **Returns** a solver of the same class.
    """
    if isinstance(solver, diffrax.AbstractWrappedSolver):
        inner = bind(
            solver.solver,
            tolerance=tolerance,
            save_ts=save_ts,
            run_axes=run_axes,
            searched=searched,
        )
        return _wrapping(solver, inner)
    if isinstance(solver, AbstractDeclaredSolver):
        return solver.bind(
            tolerance=tolerance, save_ts=save_ts, run_axes=run_axes, searched=searched
        )
    if isinstance(solver, diffrax.AbstractImplicitSolver):
        return _with_root_tolerance(solver, tolerance)
    return solver


def field_of_step(
    solver: diffrax.AbstractSolver,
    field: ScaledField,
    t0: Float[Array, ""],
    t1: Float[Array, ""],
) -> ScaledField:
    """The vector field for a solver within one step. Solvers that are not of this package do not
    know that the field may jump at the end of a step.

    **Arguments**

    - `solver`: of this package or of diffrax.
    - `field`: the vector field.
    - `t0`, `t1`: start and end of the step, in normalised time.

    **Returns** the field itself for a solver of this package; for another, one that takes `t1` for
    the time just before it."""
    while isinstance(solver, diffrax.AbstractWrappedSolver):
        solver = solver.solver
    if isinstance(solver, AbstractDeclaredSolver):
        return field
    # Not before the start: a step may be as short as a rounding.
    return FieldOfStep(field, jnp.maximum(t0, just_before(t0, t1)), t1)


def refine(solver: diffrax.AbstractSolver, factor: int) -> diffrax.AbstractSolver:
    """The solver with more steps, by this factor, if it is a fixed-step method, else itself.

    **Arguments**

    - `solver`: of this package or of diffrax.
    - `factor`: a whole number."""
    if isinstance(solver, diffrax.AbstractWrappedSolver):
        return _wrapping(solver, refine(solver.solver, factor))
    return solver.refined(factor) if isinstance(solver, AbstractFixedStep) else solver


def rolled_stages(solver: diffrax.AbstractSolver) -> diffrax.AbstractSolver:
    """The same method as a program that compiles faster and runs slower, if available."""
    if isinstance(solver, diffrax.AbstractWrappedSolver):
        return _wrapping(solver, rolled_stages(solver.solver))
    return solver.rolled_stages() if isinstance(solver, AbstractDeclaredSolver) else solver


def linear_errors(solver: diffrax.AbstractSolver) -> diffrax.AbstractSolver:
    """The same method with an error in parts that are linear in the step, so that their tangents
    are the errors of a tangent; `Tolerance` and `whole_error` put them together."""
    if isinstance(solver, diffrax.AbstractWrappedSolver):
        return _wrapping(solver, linear_errors(solver.solver))
    return solver.linear_errors() if isinstance(solver, AbstractDeclaredSolver) else solver


def for_second_order(solver: diffrax.AbstractSolver) -> diffrax.AbstractSolver:
    """The same method for a system that is known to be r' = v, v' = a(t, r), with less arithmetic,
    if it has such a form."""
    if isinstance(solver, diffrax.AbstractWrappedSolver):
        return _wrapping(solver, for_second_order(solver.solver))
    return solver.for_second_order() if isinstance(solver, AbstractDeclaredSolver) else solver


def forward_mode(solver: diffrax.AbstractSolver) -> diffrax.AbstractSolver:
    """The same method with stages that forward mode can differentiate: by default those of diffrax
    support reverse mode only."""
    if isinstance(solver, diffrax.AbstractWrappedSolver):
        return _wrapping(solver, forward_mode(solver.solver))
    if getattr(solver, "scan_kind", "") is not None:
        return solver
    return eqx.tree_at(
        lambda s: s.scan_kind,
        solver,
        "lax",
        is_leaf=lambda x: x is None,
    )


def _wrapping(
    solver: diffrax.AbstractWrappedSolver, inner: diffrax.AbstractSolver
) -> diffrax.AbstractSolver:
    """The wrapper with another solver inside."""
    return eqx.tree_at(lambda s: s.solver, solver, inner)


def _with_root_tolerance(
    solver: diffrax.AbstractImplicitSolver, tolerance: Tolerance
) -> diffrax.AbstractSolver:
    """The implicit solver whose root finder uses the tolerance of the steps."""
    given = {"rtol": tolerance.rtol, "atol": tolerance.atol, "norm": optimistix.max_norm}
    # diffrax marks with a special object the values that it takes from its own step size
    # controller, which is not used here. Values set by the user are numbers or functions, and are
    # left.
    set_by_user = (float, type(optimistix.max_norm))
    marked = [name for name in given if type(getattr(solver.root_finder, name)) not in set_by_user]

    def fields(s: diffrax.AbstractImplicitSolver) -> list:
        return [getattr(s.root_finder, name) for name in marked]

    return eqx.tree_at(fields, solver, [given[name] for name in marked])
