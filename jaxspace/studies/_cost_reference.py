"""Reference of the errors of a study: a closed form, or the most accurate good run."""

import itertools
import math
from collections.abc import Callable
from typing import NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import numpy as np

from ..core import Scalar, State
from ..core.status import Status
from ..integration.accuracy import least_tolerance
from ..integration.methods import HIGH_ORDER, STIFF
from ..simulation import Mission
from ..simulation.mission_result import Simulated
from ..solvers.protocol import solver_traits
from ._cost_case import Case, Programs
from ._runs import Program, aot_compile, blocks, distance
from ._scene_effects import Runnable
from .cost_table import CLOSED_FORM, Method, method_name

# Fraction of the duration at which a closed form is divided: in no simple ratio to the rest, so
# that no whole number of revolutions hides an error.
FIRST_PART = 0.381966
# Of the tightest tolerance: rounding may prevent a run with the first of these.
TIGHTER = (1e-2, 1e-1, 1.0)
# Factors of the steps of a run, tried where they run out: a reference may take longer than the runs
# that are compared with it.
ROOM = (1, 8, 64)
# Number of methods that are tried with all of these factors, before any other one.
PREFERRED = type(HIGH_ORDER) | type(STIFF)


class Reference(NamedTuple):
    """Reference of the errors.

    - `name`: in words; empty where no run ends well.
    - `final`, `gradient`: the exact final state and gradient, as far as they are known.
    - `error`: an estimate of the error of `final`; NaN where there is none.
    - `output`: the number whose gradient is computed.
    - `problem`: a message if there is none.
    - `programs`: the programs compiled for it in double precision, by the name of the method: the
      run, and the gradient if it is measured."""

    name: str
    final: State | None
    error: float
    gradient: State | None
    output: Callable[[State], Scalar] | None
    problem: str
    programs: dict[str, Programs]


class _GoodRun(NamedTuple):
    """A run that ends well: its method, tolerance and `room` for steps, and its program."""

    name: str
    rtol: float
    room: int
    outcome: Simulated
    program: Program


def reference_of(
    system: Runnable,
    by_name: dict[str, Method],
    case: Case,
    tightest: float,
    gradient: bool,
    output: Callable[[State], Scalar] | None,
) -> Reference:
    """The reference: the closed form, or the tightest run that ends well.

    **Arguments**

    - `system`, `case`: the system, and the case in double precision.
    - `by_name`: the methods that are compared.
    - `tightest`: of the tolerances, relative.
    - `gradient`, `output`: as in `accuracy_cost`.

    **Returns** the reference with its error; if no run succeeds, one without a state and with the
    reason."""
    exact = not isinstance(system, Mission) and system.closed_form() is not None
    methods: dict[str, Method] = {CLOSED_FORM: CLOSED_FORM} if exact else _candidates(by_name)
    compiled: dict[str, Program] = {}
    failures: dict[str, str] = {}
    good = _first_good_run(methods, case, tightest, compiled, failures)
    if good is None:
        programs = {key: Programs(run, None) for key, run in compiled.items()}
        problem = (
            "The errors are unknown, because no reference run succeeds: "
            f"{' '.join(failures.values())}"
        )
        return Reference("", None, math.nan, None, output, problem, programs)
    name, rtol, room, outcome, program = good
    if exact:
        other = _in_two_parts(case)
    else:
        other = program.call(case.arrays, 10.0 * rtol).final
    # No number is known better than its last digit.
    error = float(np.maximum(distance(other, outcome.final), np.finfo(float).eps))
    output = _scaled_sum(outcome.final) if output is None else output
    programs = {key: Programs(run, None) for key, run in compiled.items()}
    exact_gradient = None
    if gradient:
        of_method = jax.jit(case.gradient(methods[name], output, room))
        exact_gradient = of_method(case.arrays, rtol)
        # The rows of the table have the room that every run has.
        if room == 1:
            programs[name] = Programs(program, of_method)
    words = "the closed form" if exact else f"{name} at {rtol:.0e} in float64"
    return Reference(words, outcome.final, error, exact_gradient, output, "", programs)


def _candidates(by_name: dict[str, Method]) -> dict[str, Method]:
    """The methods that can be used as the reference, by name, the preferred one first."""
    # The method for stiff runs completes those that an explicit method does not.
    stiff = {k: m for k, m in by_name.items() if isinstance(m, type(STIFF))}
    # Another method may complete a run that these do not, such as an orbit through the centre.
    # Fixed steps are excluded, because the tolerance does not change them.
    adaptive = {
        k: m
        for k, m in by_name.items()
        if isinstance(m, diffrax.AbstractSolver) and not solver_traits(m).fixed_step
    }
    return {method_name(HIGH_ORDER): HIGH_ORDER, **stiff, **adaptive}


def _first_good_run(
    methods: dict[str, Method],
    case: Case,
    tightest: float,
    compiled: dict[str, Program],
    failures: dict[str, str],
) -> _GoodRun | None:
    """The run of the first method that ends well, at the tightest tolerance at which it does.

    Adds the programs with the room of all runs to those `compiled`, and why methods failed to
    `failures`, both by the name of the method."""
    preferred = [name for name, m in methods.items() if isinstance(m, str | PREFERRED)]
    others = [name for name in methods if name not in preferred]
    tries = [*itertools.product(ROOM, preferred), *itertools.product(ROOM, others)]
    for room, name in tries:
        # More room helps a run whose steps ran out, and no other.
        if room > 1 and not failures[name].endswith(Status.MAX_STEPS.sentence):
            continue
        # Once for each method, because the tolerance is traced.
        program = aot_compile(case.run(methods[name], room), case.arrays, tightest)
        if room == 1:
            compiled[name] = program
        for factor in TIGHTER:
            rtol = max(factor * tightest, 2.0 * least_tolerance("float64"))
            outcome = program.call(case.arrays, rtol)
            status = Status(int(outcome.status))
            if status.good:
                return _GoodRun(name, rtol, room, outcome, program)
            failures[name] = f"{name} at {rtol:.0e}: {status.sentence}"
    return None


def _scaled_sum(final: State) -> Callable[[State], Scalar]:
    """The sum of a state's numbers, each over the length of its block in the state `final`."""
    sizes = [block.size for block in blocks(final)]

    def output(y: State) -> Scalar:
        terms = zip(jax.tree.leaves(y), sizes, strict=True)
        return sum((jnp.sum(x) / size for x, size in terms), 0.0)

    return output


def _in_two_parts(case: Case) -> State:
    """The final state of a closed form whose duration is passed in two parts."""
    system, y0, ts = case.restored(case.arrays)
    flow = jax.jit(lambda duration, y: system.closed_form().flow(duration, y))
    first = FIRST_PART * (ts[-1] - ts[0])
    return flow(ts[-1] - ts[0] - first, flow(first, y0))
