"""One integration as a primitive of JAX: both modes of differentiation, and mapped runs.

The number of steps depends on the input, so that JAX cannot transpose the loop over them. Instead,
the rule for derivatives records the steps, and the tangent is a separate primitive, `tangent`: it
is linear in the tangents, computed forwards along the record, and backwards when transposed
(`cotangent`).

    solve      (field, y0)                  -> outcome
    record     (field, y0)                  -> outcome, record
    tangent    (field, y0), record, (dp)    -> dy             linear in dp
    cotangent  (field, y0), record, (y*)    -> p*             the transpose of tangent

All further derivatives are JAX's: it differentiates the loops of `tangent` and `cotangent`
forwards. The transpose of a second derivative follows from its symmetry.

A mapped integration (`jax.vmap`) does not use JAX's batching of the loop, in which every run would
use the steps of the slowest and the components would be innermost. Its batching rule adds an axis
of runs to the layout and calls the batch path, in blocks. It recomputes the record there, so that
no residual depends on how the runs were grouped. Runs that cannot be a batch become one
`MappedIntegration`, whose primitives have the same rules.

The programs are in `_integration.py`, the primitives and their derivatives in `_primitives.py`,
the rules for mapped runs in `_mapped_rules.py`.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from ..core import AbstractRegularised, State
from ..solvers.regularised_step import regularised_start

# Imported to register its rules.
from . import _mapped_rules as _mapped_rules
from ._individual_state import IndividualState
from ._integration import Integration
from ._loop_settings import LoopSettings
from ._primitives import bind, solve_p, traced
from .result import Outcome


def solve(field: PyTree, y0: State, settings: LoopSettings) -> Outcome:
    """Integrate `field` from `y0`, differentiable in both modes with respect to either.

    **Arguments**

    - `field`: a `ScaledVectorField`, or its hoisted form.
    - `y0`: the initial state, components first and runs last.
    - `settings`: method, step control, save times; without derivatives.

    **Returns** the `Outcome`."""
    settings = jax.tree.map(
        lambda x: jax.lax.stop_gradient(x) if eqx.is_inexact_array(x) else x, settings
    )
    # Not weakly typed, as the states after a step are not: the step would be traced twice.
    y0 = jax.tree.map(lambda x: jax.lax.convert_element_type(x, x.dtype), y0)
    run = Integration(field, y0, settings)
    # A function may close over an array of NumPy, like the constants of traces.
    run = jax.tree.map(lambda x: jnp.asarray(x) if eqx.is_array(x) else x, run)
    return bind(solve_p, run, traced(run))


def solve_individual_steps(
    field: PyTree, y0: State, settings: LoopSettings
) -> tuple[Outcome, AbstractRegularised]:
    """`solve` with steps that every run chooses for itself, in regularised variables.

    **Arguments** as of `solve`. **Returns** the `Outcome`, and the variables."""
    form, z0 = regularised_start(field, y0)
    # A zero that depends on the run, because the rules for derivatives expect a traced number.
    number = jnp.floor(0.5 * jnp.isfinite(z0[0]).astype(z0.dtype))
    outcome = solve(field, IndividualState(z0, number), settings)

    def states(own: IndividualState | None) -> State | None:
        return None if own is None else jax.vmap(form.from_regularised)(own.z)

    outcome = outcome._replace(
        states=states(outcome.states), step_states=states(outcome.step_states)
    )
    return outcome, form
