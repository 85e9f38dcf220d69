"""State of a search by an optimiser of optax (`_descent.py`): its fields, its start and its end."""

from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PyTree

from ._free_numbers import FreeNumbers
from ._gradient_check import GRADIENT_TOLERANCE, PROBES
from ._lagrangian import FIRST_WEIGHT, Multipliers
from ._result import End
from ._scaling import ScaledProblem
from ._sqp_state import Limits, Values, probes_of
from .optimiser import Stepper

# Steps that change nothing, after which a search ends: an optimiser with a line search begins again
# after each of them, one with a schedule may begin with small steps.
STILL_LINES, STILL_STEPS = 3, 25
# A rate this part of the greatest one has decayed to nothing. Schedules of optax end there, and not
# at zero, because they are computed in single precision.
LEAST_RATE = 1e-6
# A step that is not finite even with this share of its length has no finite neighbour.
LEAST_SHARE = 1e-12


class Place(NamedTuple):
    """A point of the search: the scaled unknowns z, values and derivatives there, multipliers of c
    and d, and the scaled gradient and violation that are compared with the tolerance."""

    z: Float[Array, " n"]
    at: Values
    y: Float[Array, " equal"]
    nu: Float[Array, " inequal"]
    gradient: Float[Array, ""]
    violation: Float[Array, ""]


class DescentState(NamedTuple):
    """State of the search between two steps.

    - `q`, `here`: unconstrained variables (`_free_numbers.py`), and the values there.
    - `best`: the point of the least exact penalty.
    - `step`: the last update, of which `trial` uses a `share`.
    - `multipliers`: of the augmented Lagrangian; `missed`: its violation at the start of the round
      and of the last one; `round_steps`: steps of this round.
    - `optimiser`: the state of optax.
    - `still`: consecutive steps without change; `stopped`: whether none will; `fastest`: the
      greatest ratio of a step and its gradient.
    - `left_out`: steps that were not finite; `refused`: the report of the last of them.
    - `averaging`: 1 where `trial` is the average of a schedule-free optimiser, 2 after it.
    - `start`: z at the start; `judged`, `judgements`: as in `SqpState`; `displaced`: 1 where
      `trial` is the displaced z by which a place is judged, 2 where a place is evaluated again.
    - `weight`, `size`, `rows`, `calls`, `probed`, `level`, `unclear`, `wrong`,
      `worst`, `taken`, `steps`: as in
      `SqpState`."""

    q: Float[Array, " n"]
    here: Place
    best: Place
    step: Float[Array, " n"]
    share: Float[Array, ""]
    trial: Float[Array, " n"]
    multipliers: Multipliers
    missed: tuple[Float[Array, ""], Float[Array, ""]]
    round_steps: Int[Array, ""]
    optimiser: Any
    still: Int[Array, ""]
    stopped: Bool[Array, ""]
    fastest: Float[Array, ""]
    left_out: Int[Array, ""]
    refused: Any
    averaging: Int[Array, ""]
    start: Float[Array, " n"]
    judged: Bool[Array, ""]
    displaced: Int[Array, ""]
    judgements: Int[Array, ""]
    weight: Float[Array, " all"]
    size: Float[Array, " n"]
    rows: Float[Array, "steps 3"]
    calls: Int[Array, ""]
    probed: Float[Array, "4 all"]
    level: Int[Array, ""]
    unclear: Bool[Array, ""]
    wrong: Float[Array, ""]
    worst: Int[Array, ""]
    taken: Int[Array, ""]
    steps: Int[Array, ""]

    @property
    def at(self) -> Values:
        """The values at the point of the result."""
        return self.best.at

    def resumed(self, rows: Array) -> "DescentState":
        """The state from which the search continues, with space for further `rows`."""
        zero = jnp.asarray(0)
        return self._replace(
            rows=rows,
            taken=zero,
            still=zero,
            stopped=jnp.asarray(False),
            averaging=zero,
            trial=self.q + self.share * self.step,
        )


class Setting(NamedTuple):
    """The constants of a search.

    - `scaled`: the problem; `ratio`: see `ScaledProblem.derivatives`.
    - `free`: the map from unconstrained variables to z, or `None` without bounds.
    - `stepper`: the optimiser; `check`: whether the gradient at the start is probed."""

    scaled: ScaledProblem
    ratio: float
    free: FreeNumbers | None
    stepper: Stepper
    limits: Limits
    check: bool

    def point(self, q: Float[Array, " n"]) -> Float[Array, " n"]:
        """The z of unconstrained variables."""
        return q if self.free is None else self.free.inside(q)

    @property
    def me(self) -> int:
        """The number of equalities."""
        return self.scaled.me

    @property
    def constrained(self) -> bool:
        """Whether there are constraints."""
        return self.scaled.me + self.scaled.mi > 0


def begin(
    q: Float[Array, " n"],
    z: Float[Array, " n"],
    size: Float[Array, " n"],
    counts: tuple[int, int],
    report: PyTree,
    max_steps: int,
    check: bool,
    stepper: Stepper,
    limits: Limits,
) -> DescentState:
    """The state before the first evaluation; `counts`: of equalities and inequalities, the others
    as in `_sqp_state.begin`."""
    me, mi = counts
    rows = 1 + me + mi
    none = jnp.zeros((), q.dtype)
    y, nu, n = jnp.zeros(me, q.dtype), jnp.zeros(mi, q.dtype), q.size
    J, K = jnp.zeros((me, n), q.dtype), jnp.zeros((mi, n), q.dtype)
    at = Values(none, y, nu, jnp.zeros_like(q), J, K, report)
    place = Place(z, at, y, nu, jnp.inf + none, jnp.inf + none)
    probed = probes_of(z, limits)
    zero = jnp.asarray(0)
    return DescentState(
        q, place, place, jnp.zeros_like(q), none + 1.0,
        z + probed.shares[0] * probed.direction if check else q,
        Multipliers(y, nu, none + FIRST_WEIGHT), (none + jnp.inf, none + jnp.inf), zero,
        stepper.begin(q), zero, jnp.asarray(False), none, zero, report, zero,
        z, jnp.asarray(False), zero, zero, jnp.ones(rows, q.dtype), size,
        jnp.full((max_steps, 3), jnp.nan, q.dtype), jnp.asarray(-PROBES if check else 0),
        jnp.zeros((PROBES, rows), q.dtype), zero, jnp.asarray(False), none, zero, zero, zero,
    )  # fmt: skip


def converged(place: Place, limits: Limits) -> Bool[Array, ""]:
    """Whether a place meets the tolerance."""
    met = (place.gradient <= limits.tolerance) & (place.violation <= limits.tolerance)
    return met & place.at.sound()


def over(s: DescentState, limits: Limits) -> Bool[Array, ""]:
    """Whether the optimiser is finished."""
    ended = (converged(s.here, limits) & s.judged) | s.stopped | (s.taken >= s.rows.shape[0])
    ended = ended | ~(s.wrong <= GRADIENT_TOLERANCE) | ~s.here.at.sound()
    return (s.calls > 0) & (ended | diverged(s, limits))


def unfinished(s: DescentState, limits: Limits) -> Bool[Array, ""]:
    """Whether the search needs another evaluation."""
    return (s.averaging == 1) | (s.displaced > 0) | ~over(s, limits)


def diverged(s: DescentState, limits: Limits) -> Bool[Array, ""]:
    """Whether the unknowns are beyond `farthest`."""
    return jnp.max(jnp.abs(s.here.z)) > limits.farthest


def end(s: DescentState, limits: Limits) -> End:
    """The place of the result: the best one."""
    best = s.best
    # Where the search came from a better place, it did not fall without bound.
    falling = jnp.all(best.z == s.here.z)
    return End(
        best.z,
        best.at,
        best.y,
        best.nu,
        best.y,
        best.nu,
        diverged(s, limits) & falling,
        jnp.asarray(False),
        # The average of a schedule-free optimiser is the last evaluation.
        s.judged | (s.averaging == 2),
    )
