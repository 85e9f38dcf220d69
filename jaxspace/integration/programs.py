"""Criterion for rolled stages: the stages of a step are a loop of the program, which compiles
faster and runs slower.

Unrolled, the stages of a step contain the vector field 12 or 17 times. The time of the compiler
grows faster than the operations of the field, that of a run as they do, so that the stages are
rolled from some size of the field on. Frequently executed programs justify longer compilation.

Measured by `python -m benchmarks first_answers` and `kick_stage`, each program in both forms.
"""

import enum
import math
from typing import NamedTuple


class Runs(enum.StrEnum):
    """The purpose of a program."""

    DERIVATIVE_OF_ONE = "tangent and adjoint of a single run"
    ONE_CLOSED_LOOP = "single closed loop"
    ONE_RECORDED = "single run that records its steps for a derivative"
    ONE = "single run"
    DERIVATIVES = "derivatives of a batch"
    CLOSED_LOOPS = "batch of closed loops"
    MANY = "batch of runs"
    CAMPAIGN = "small campaign"
    LARGE_CAMPAIGN = "large campaign"


class Limit(NamedTuple):
    """The number of `operations` of a vector field from which the stages are rolled, and the
    benefit."""

    operations: int
    evidence: str


ROLLED_FROM = {
    Runs.DERIVATIVE_OF_ONE: Limit(
        0,
        "the first call is mostly compilation: the program contains the step three times (in the "
        "run, in its monitored tangents and in its recomputation)",
    ),
    Runs.ONE_CLOSED_LOOP: Limit(0, "compiling unrolled stages takes longer than a run"),
    Runs.ONE_RECORDED: Limit(
        70,
        "with fewer operations, rolling saves little compilation time, and makes the run and its "
        "backward pass slower",
    ),
    Runs.ONE: Limit(160, "a third of the compilation time, up to 1.5 times the run time"),
    Runs.DERIVATIVES: Limit(160, "a third of the compilation time, up to 1.7 times the run time"),
    Runs.CLOSED_LOOPS: Limit(
        160,
        "10 s of compilation instead of more than one minute, at 650 operations",
    ),
    Runs.MANY: Limit(500, "a sixth of the compilation time, up to 1.3 times the run time"),
    Runs.CAMPAIGN: Limit(250, "a third of the compilation time, 1.8 times the run time"),
    Runs.LARGE_CAMPAIGN: Limit(600, "1.1 times the run time"),
}
"""The rule, with its evidence; `accuracy_and_derivatives.md` has the same table."""

FEW, POWER = 2.5, 1.5
"""A campaign of a field with n operations has few runs below `FEW` n^`POWER`. Written-out stages
are worth their compilation from 30,000 runs of a kick stage on (500 operations), from 90,000 of a
stage that comes back under a parachute (900), and from a million of a rocket on its way to the
ground (3,600)."""


def rolls_stages(runs: Runs, operations: int, count: float = math.inf) -> bool:
    """Whether the stages of these `runs` of a field with so many `operations` are rolled.

    `count`: of the runs that a campaign plans; by default as many as may come."""
    if runs is Runs.CAMPAIGN and not count < FEW * operations**POWER:
        runs = Runs.LARGE_CAMPAIGN
    return operations >= ROLLED_FROM[runs].operations
