"""One step of an environment: from a state, a command and a duration to the next state; and a
choice of the method by its accuracy and cost."""

from collections.abc import Sequence
from typing import NamedTuple, final

import diffrax
import jax.numpy as jnp
from jaxtyping import PyTree

from ..core import AbstractSystem, Scalar, State
from ..core.checks import check_positive
from ..core.printing import printed
from ..integration.methods import HIGH_ORDER, LOW_ORDER
from ..solvers import FixedSteps
from ..studies import AccuracyCost, accuracy_cost
from ._advance import advance
from .commands import Actuate, with_command

ONE_STEP = FixedSteps(LOW_ORDER, 1)


def step(
    system: AbstractSystem,
    y: State,
    control: PyTree,
    dt: Scalar,
    *,
    t: Scalar = 0.0,
    method: FixedSteps = ONE_STEP,
    actuate: Actuate = with_command,
) -> State:
    """The state `dt` after the state `y`, under a control that is held.

    **Arguments**

    - `system`: a scene or a system; `y`: one state, or many with the runs last.
    - `control`: the command that `actuate` passes to the system; `None` leaves it as it is.
    - `dt`: s, and `t`, the time of `y`, s: scalars or (*runs,).
    - `method`: fixed steps of a solver, such as those from `plan_step`.

    **Returns** the state, by a fixed formula without branches or error control, for `jit`, `vmap`,
    `grad` and `scan`. A break of the system within the step is ignored."""
    held = system if control is None else actuate(system, control)
    return advance(held, y, t, dt, method)[0]


@final
@printed()
class StepPlan(NamedTuple):
    """The cheapest fixed steps for a period.

    - `method`: for `step` and `ClosedLoop`; `error`, of one step, over the size of the state.
    - `table`: all measurements."""

    method: FixedSteps
    error: float
    table: AccuracyCost


def plan_step(
    system: AbstractSystem,
    y: State,
    control: PyTree,
    dt: Scalar,
    *,
    error: float = 1e-6,
    t: Scalar = 0.0,
    solvers: Sequence[diffrax.AbstractSolver] = (LOW_ORDER, HIGH_ORDER),
    counts: Sequence[int] = (1, 2, 4, 8),
    actuate: Actuate = with_command,
) -> StepPlan:
    """The fixed steps that reach a relative `error` over one period in the least time, as measured
    by `accuracy_cost` from a state that should be as difficult as any.

    **Arguments**

    - `system`, `y`, `control`, `dt`, `t`, `actuate`: as in `step`, of one run.
    - `error`: allowed after the period, over the size of the state.
    - `solvers`, `counts`: the candidates, solvers and numbers of steps.

    **Returns** a `StepPlan`. **Raises** `InputError` if no candidate reaches the error."""
    check_positive("error", error)
    held = system if control is None else actuate(system, control)
    methods = [FixedSteps(solver, count) for solver in solvers for count in counts]
    ts = jnp.stack([jnp.asarray(t, float), jnp.asarray(t + dt, float)])
    # A reference far more accurate than any candidate of a few steps.
    table = accuracy_cost(
        held, y, ts, tolerances=(1e-12,), methods=methods, precisions=("float64",)
    )
    row = table.cheapest_row(error, "float64")
    method = table.methods[row.method]
    assert isinstance(method, FixedSteps)
    # An error below that of the reference is not known.
    return StepPlan(method, max(row.error, table.reference_error), table)
