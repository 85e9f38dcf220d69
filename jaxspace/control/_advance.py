"""A fixed interval of an integration: from a state to the state a known time later."""

import functools

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from ..core import AbstractSystem, InputError, Scalar, State
from ..core.tables import breaks_of
from ..integration.methods import HIGH_ORDER, LOW_ORDER
from ..integration.normalised_time import ScaledVectorField, Segments
from ..solvers import FixedSteps
from ..solvers.protocol import solver_traits
from ..solvers.vector_field import TERM


def advance(
    system: AbstractSystem, y: State, t: Scalar, dt: Scalar, method: FixedSteps
) -> tuple[State, State]:
    """The state `dt`, s, after the state `y` at the time `t`, s, and an estimate of its error.

    `t` and `dt` are scalars or (*runs,)."""
    dtype = jnp.result_type(*jax.tree.leaves(y))
    t, dt = jnp.asarray(t, dtype), jnp.asarray(dt, dtype)
    u = jnp.array([0.0, 1.0], dtype)
    # The field may jump at both ends of the interval, and is evaluated inside of it.
    field = ScaledVectorField(system, Segments(u, t, dt, breaks_of(system) is not None))
    y1, error, *_ = method.step(TERM, u[0], u[1], y, field, None, False)
    assert error is not None
    return y1, error


def as_fixed(method: object, rtol: float, steps: int) -> FixedSteps:
    """The method of a loop: its fixed steps, or `steps` of a solver; "auto" selects by the
    tolerance.

    Raises `InputError` for a method of other fixed steps, or of steps of each run."""
    if isinstance(method, FixedSteps):
        return method
    if method == "auto":
        # Samples are short: where both reach the tolerance in one step, the cheaper one is used.
        return FixedSteps(LOW_ORDER if rtol >= 1e-8 else HIGH_ORDER, steps)
    if not isinstance(method, diffrax.AbstractSolver) or solver_traits(method).needs:
        raise InputError(
            f"Accuracy.method is {method!r}: for a closed loop it must be an explicit one-step "
            "solver, such as Tsit5()."
        )
    return FixedSteps(method, steps)


def select(flag: Array, yes: PyTree, no: PyTree) -> PyTree:
    """`yes` where the flag of a run is true, else `no`; runs are on the last axes of each leaf."""
    return jax.tree.map(functools.partial(jnp.where, flag), yes, no)
