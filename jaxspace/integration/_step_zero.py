"""The first zero of the condition of an event within a part of a step, by samples of the dense
output, or within a part of a run by those of its closed form.

The part is sampled evenly. The first interval in which the condition changes its sign, or dips so
that it might do so twice, is sampled again: densely about the place where the condition is expected
to be zero, so that the next interval is about as wide as that place was wrong, or evenly where this
gains too little. The program contains the condition once.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..core import AbstractSystem, Scalar, State
from ..core.barrier import barrier
from ..core.safe import safe_divide
from ..core.status import Status
from ..solvers.dense_output import AbstractDenseOutput
from ._event_bracket import NARROW, zero_share
from ._in_turn import in_turn
from .event_zero import RESOLVED_ROUNDINGS, ROUNDINGS, Root, candidates, dips, pick
from .events import Event
from .normalised_time import StepTimes

# Number of parts of a step that are sampled at once.
PARTS = 16
# Most samplings of a part. Three are enough for a simple zero.
SAMPLINGS = 256
# Places of samples, as shares of the way to the guess of a zero: dense there, so that the next
# bracket is about as wide as the guess was wrong; or even, over all of the bracket.
NEAR = np.append(1.0 - 16.0 ** -np.arange(PARTS // 2), 1.0)
EVEN = np.linspace(0.0, 1.0, PARTS // 2 + 1)


class StepCondition(NamedTuple):
    """The condition of an event within a step, by its polynomial."""

    event: Event
    segment: StepTimes
    step: AbstractDenseOutput
    runs: tuple[int, ...]

    def condition(self, t: Scalar) -> Scalar:
        """The condition at the normalised time `t`."""
        y = self.step.evaluate(t)
        # One time for each run, also where all share it.
        time = jnp.broadcast_to(self.segment.time(t), self.runs)
        return self.event.condition(time.astype(jax.tree.leaves(y)[0].dtype), y)

    def value(self, t: Scalar) -> Scalar:
        """The function that is zero at the event: the condition, or its rate for a touch."""
        if self.event.touch is None:
            return self.condition(t)
        rate = jax.jvp(self.condition, (t,), (jnp.ones_like(t),))[1]
        duration = self.segment.rate.astype(rate.dtype)
        # In no time nothing is touched.
        lasting = duration != 0.0
        return jnp.where(lasting, rate / jnp.where(lasting, duration, 1.0), 1.0)

    def at(self, nodes: Scalar) -> tuple[Scalar, Scalar]:
        """The `value` and its rate in normalised time, at nodes on the first axis."""

        def each(t: Scalar) -> tuple[Scalar, Scalar]:
            return jax.jvp(self.value, (t,), (jnp.ones_like(t),))

        # Many operations read them, with each of which the compiler would evaluate them again.
        return barrier(jax.vmap(each)(nodes))


class FlowCondition(NamedTuple):
    """The condition of an event along a run in closed form, of which the `segment` is one step."""

    event: Event
    segment: StepTimes
    system: AbstractSystem
    y0: State
    runs: tuple[int, ...]

    def _at(self, t: Scalar) -> tuple[Scalar, State]:
        """The time, s, of each run at the normalised time `t`, and the state there."""
        flow = self.system.closed_form()
        assert flow is not None
        time = jnp.broadcast_to(self.segment.time(t), self.runs)
        return time, flow.flow(time - self.segment.start, self.y0)

    def condition(self, t: Scalar) -> Scalar:
        """The condition at the normalised time `t`."""
        return self.event.condition(*self._at(t))

    def at(self, nodes: Scalar) -> tuple[Scalar, Scalar]:
        """As in `StepCondition`."""

        def each(t: Scalar) -> tuple[Scalar, Scalar]:
            value, slope = self.event.slope(self.system, *barrier(self._at(t)))
            return value, slope * self.segment.rate

        # One after the other, because the solution is a longer program than a polynomial.
        return barrier(in_turn(each, nodes))


class BracketEnds(NamedTuple):
    """The conditions at the start and at the end of the sampled interval, and their slopes."""

    first: Scalar
    first_slope: Scalar
    value: Scalar
    slope: Scalar


class _BracketSearch(NamedTuple):
    """The search of each run for the first zero of an event in a part of a step.

    - `low`, `high`: between them the next samples are taken, densely about the `guess`, or `even`.
    - `inside`: whether they are in one interval of the samples of the whole part, and the first of
      those that are still to be examined; `dip`: whether the condition has a single sign so far.
    - `hit`, `at_zero`: whether the zero is found, at the `guess`; whether the run starts at one.
    - `ill`: the first sample where the condition was not finite; infinite without one.
    - `active`, `left`: whether the search continues; the number of further samplings allowed.
    - `size`, `ends`: the largest value of the condition; what it was at the ends of the part."""

    low: Scalar
    high: Scalar
    guess: Scalar
    even: Bool[Array, "*runs"]
    inside: Bool[Array, "*runs"]
    first: Int[Array, "*runs"]
    dip: Bool[Array, "*runs"]
    hit: Bool[Array, "*runs"]
    at_zero: Bool[Array, "*runs"]
    ill: Scalar
    active: Bool[Array, "*runs"]
    left: Int[Array, ""]
    size: Scalar
    ends: BracketEnds

    def nodes(self) -> Float[Array, "nodes *#runs"]:
        """The places of the next samples."""
        missing = (1,) * self.even.ndim
        near, even = (jnp.asarray(x, self.low.dtype).reshape(-1, *missing) for x in (NEAR, EVEN))
        shares = jnp.where(self.even, even, near)
        before = self.low + (self.guess - self.low) * shares
        behind = self.high - (self.high - self.guess) * shares
        return jnp.concatenate([before, behind[-2::-1]])


class Bracket(NamedTuple):
    """A part of the step of each run, from `begin` to `end` in the time of a step from 0 to 1, that
    is searched for an event.

    `at_start`: whether the run starts with it; `rounding`: of the condition, as in
    `TerminalEvents`; `start`, `duration`: of the run, s."""

    condition: StepCondition | FlowCondition
    begin: Float[Array, "*runs"]
    end: Float[Array, "*runs"]
    at_start: Bool[Array, "*runs"]
    rounding: Scalar
    start: Scalar
    duration: Scalar

    def first_zero(
        self, size: Scalar, sought: Bool[Array, "*runs"], going: Bool[Array, "*runs"]
    ) -> tuple[Root, BracketEnds]:
        """The first zero for the runs that have one `sought`, and the condition at both ends of the
        part. For a run that is not `going` on, one sampling is sufficient.

        `size`: of the condition so far."""
        runs = self.condition.runs
        no = jnp.zeros(runs, bool)
        zero = jnp.zeros(runs, self.begin.dtype)
        none = jnp.zeros(runs, size.dtype)
        search = _BracketSearch(
            low=zero + self.begin,
            high=zero + self.end,
            guess=zero + 0.5 * (self.begin + self.end),
            even=~no,
            inside=no,
            first=jnp.zeros(runs, int),
            dip=no,
            hit=no,
            at_zero=no,
            ill=zero + jnp.inf,
            active=sought,
            left=jnp.asarray(SAMPLINGS),
            size=none + size,
            ends=BracketEnds(none, none, none, none),
        )
        search = jax.lax.while_loop(
            lambda search: (search.left > 0) & jnp.any(search.active),
            lambda search: self._sampled(search, going),
            search,
        )
        when, hit = search.guess, search.hit
        time = self.condition.segment.time(when)
        after = jnp.abs(time - self.start)
        eps = float(jnp.finfo(none.dtype).eps)
        resolved = RESOLVED_ROUNDINGS * eps * jnp.maximum(jnp.abs(self.start), jnp.abs(time))
        piled = search.at_zero & hit & (after <= resolved) & ~self._counts_at_start()
        status = jnp.where(piled, Status.EVENTS_PILE_UP, Status.EVENT_UNRESOLVED)
        failed = jnp.where(piled | search.active, when, jnp.inf)
        status = jnp.where(search.ill <= failed, Status.CONDITION_NOT_FINITE, status)
        failed = jnp.minimum(search.ill, failed)
        return Root(when, hit, search.size, status.astype(jnp.int32), failed), search.ends

    def _sampled(self, search: _BracketSearch, going: Bool[Array, "*runs"]) -> _BracketSearch:
        """The search after one more sampling of the condition."""
        event, runs = self.condition.event, self.condition.runs
        nodes = search.nodes()
        g, slopes = self.condition.at(nodes)
        size = jnp.maximum(search.size, jnp.max(jnp.abs(g), axis=0))
        at_zero = self._starts_at_zero(nodes[0], g[0], slopes[0], size)
        ends = BracketEnds(g[0], slopes[0], g[-1], slopes[-1])
        ill = jnp.min(jnp.where(jnp.isfinite(g), jnp.inf, nodes), axis=0)
        # A change of sign is not examined for dips again.
        dip = dips(nodes, g, slopes) & (~search.inside | search.dip)
        g, candidate = candidates(g, dip, at_zero, slopes[0], event.direction)
        numbers = jnp.arange(PARTS).reshape(-1, *(1,) * len(runs))
        candidate = candidate & (search.inside | (numbers >= search.first))
        present = jnp.any(candidate, axis=0)
        index = jnp.argmax(candidate, axis=0)
        interval = barrier(_interval((nodes, g, slopes), index, len(runs)))
        guess, dip, close = self._expected(*interval)
        hit = present & ~dip & close
        if event.touch is not None:
            hit = hit & (jnp.abs(self.condition.condition(guess)) <= event.touch)
        # Whether the search continues inside the interval, or after the previous one.
        inside = present & ~close
        first = jnp.where(search.inside, search.first, jnp.where(present, index, PARTS))
        if event.at_start:
            now = at_zero & (event.direction * slopes[0] >= 0.0) & self._counts_at_start()
            guess = jnp.where(now, self.begin, guess)
            hit = hit | now
        active = (present | search.inside) & ~hit & going
        (a, *_), (b, *_) = interval
        even = ~inside | search.inside & (b - a > (search.high - search.low) / PARTS)
        low, high = jnp.where(inside, a, self.begin), jnp.where(inside, b, self.end)
        new = _BracketSearch(
            low,
            high,
            guess=jnp.where(even & active, 0.5 * (low + high), guess),
            even=even,
            inside=inside,
            first=jnp.where(inside, first, first + 1),
            dip=dip,
            hit=hit,
            at_zero=search.at_zero | at_zero,
            ill=jnp.minimum(search.ill, ill),
            active=active,
            left=search.left,
            size=size,
            ends=ends,
        )
        if runs:
            # A run whose search has ended stays there while the others continue.
            going_on, new = barrier((search.active, new))
            new = jax.tree.map(lambda a, b: jnp.where(going_on, a, b), new, search)
        return new._replace(left=search.left - 1)

    def _counts_at_start(self) -> Bool[Array, "*runs"]:
        """Whether a zero at the start is an event: not where an event has acted at this zero."""
        return self.condition.event.at_start & (self.rounding < jnp.inf)

    def _starts_at_zero(
        self, node: Scalar, g: Scalar, slope: Scalar, size: Scalar
    ) -> Bool[Array, "*runs"]:
        """Whether the condition is zero, to rounding, where the run starts, if it does at `node`.

        `g`, `slope`: the condition there; `size`: the largest so far."""
        # The rounding of the time, from the rate per second and the largest time of the run.
        second = self.condition.segment.rate.astype(g.dtype)
        longest = jnp.maximum(jnp.abs(self.start), jnp.abs(self.duration))
        change = self.rounding + size + jnp.abs(safe_divide(slope, second)) * longest
        small = jnp.abs(g) <= ROUNDINGS * float(jnp.finfo(g.dtype).eps) * change
        return self.at_start & (node == self.begin) & small

    def _expected(
        self, low: tuple[Scalar, Scalar, Scalar], high: tuple[Scalar, Scalar, Scalar]
    ) -> tuple[Scalar, Bool[Array, "*runs"], Bool[Array, "*runs"]]:
        """Expected zero of the condition between two samples, in a dip its closest point to zero;
        whether it dips; and whether the samples are so close that this is it.

        Of each sample the place, the condition and its slope."""
        (a, ga, sa), (b, gb, sb) = low, high
        dip = ga * gb > 0.0
        share = jnp.where(dip, safe_divide(sa, sa - sb), zero_share((ga, gb), (sa, sb), b - a))
        share = jnp.where((share >= 0.0) & (share <= 1.0), share, 0.5)
        guess = a + share.astype(a.dtype) * (b - a)
        length = self.end - self.begin
        rounding = 16.0 * float(jnp.finfo(a.dtype).eps) * jnp.maximum(jnp.abs(guess), length)
        return guess, dip, b - a <= jnp.where(dip, NARROW / PARTS * length, rounding)


def _interval(samples: tuple[Array, ...], index: Array, run_axes: int) -> list[tuple[Array, ...]]:
    """The samples at both ends of interval number `index` of each run."""
    if run_axes:
        return [pick(samples, index + k, run_axes) for k in (0, 1)]
    rows = jax.lax.dynamic_slice_in_dim(jnp.stack(samples, 1), index, 2)
    return [tuple(row) for row in rows]
