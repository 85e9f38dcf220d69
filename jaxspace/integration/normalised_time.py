"""A system in normalised time, which counts segments and has no jumps within them.

The break times of the system cut the duration of a run into segments. Segment i covers s from i to
i + 1, and every run maps s to its time,

    t = t0 + T (u_i + (s - i)(u_{i+1} - u_i))
    dy/ds = T (u_{i+1} - u_i) f(t, y)

so that runs of different duration, with different break times, share one integration, and
differentiation gives the derivatives with respect to the duration and to the break times.

    symbol  meaning                                                unit
    s       normalised time: number of the segment plus fraction   1
    T       duration of the run, t1 - t0 (negative: backwards)     s
    u_i     ends of the segments as fractions of T, ascending      1
    f       vector field of the system                             state/s
"""

from typing import Generic, Literal, TypeVar, cast, final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import AbstractRegularised, AbstractSplit, AbstractSystem, Flag, Scalar, State
from ..core.barrier import barrier
from ..core.groups import project
from ..core.safe import safe_divide
from ..core.tables import breaks_of
from ..solvers.vector_field import ScaledField, just_before
from ._closures import closures_as_leaves
from .field_trace import field_trace
from .layout import runs_of


@final
class Segments(eqx.Module):
    """The map from normalised time to time: ends `u` of the segments, start and total duration.

    `jumps`: whether the vector field may jump where one segment ends and the next begins."""

    u: Float[Array, "ends *#runs"]
    t0: Float[Array, "*#runs"]
    total: Float[Array, "*#runs"]
    jumps: bool = eqx.field(static=True, default=False)

    def __len__(self) -> int:
        return self.u.shape[0] - 1

    def _segment(self, s: Scalar) -> tuple[Scalar, Scalar, Scalar]:
        """Normalised time at which the segment of `s` starts, its u there, and its width in u."""
        start = jnp.clip(jnp.floor(s), 0.0, len(self) - 1.0)
        i = start.astype(jnp.int32)
        if i.ndim and self.u.ndim > 1:
            # Runs with different segments may each be in another one.
            u, end = (
                jnp.take_along_axis(self.u, k[None], axis=0, mode="promise_in_bounds")[0]
                for k in (i, i + 1)
            )
            return start, u, end - u
        return start, self.u[i], self.u[i + 1] - self.u[i]

    def time(self, s: Scalar) -> Scalar:
        """The time, s, at the normalised time `s`."""
        if len(self) == 1:
            # From 0 to 1, without a search: every stage of a step evaluates it, and each would
            # search the ends in a separate loop, which first calls would compile.
            return self.t0 + self.total * s
        start, u, width = self._segment(s)
        return self.t0 + self.total * (u + (s - start) * width)

    def normalised(self, fractions: Float[Array, " times"]) -> Float[Array, " times"]:
        """The normalised times at these fractions of the run; of segments that all runs share."""
        if len(self) == 1:
            return fractions
        # Segments that are passed, and the share of the one in which a fraction lies. Without a
        # search, whose program is several times as long.
        x = fractions[:, None]
        share = jnp.clip(safe_divide(x - self.u[:-1], jnp.diff(self.u)), 0.0, 1.0)
        return jnp.sum(jnp.where(x >= self.u[1:], 1.0, share), axis=1)

    def time_inside(self, s: Scalar) -> Scalar:
        """The time, s, at the normalised time `s`, a few roundings inside where a segment begins or
        ends: a vector field that jumps there has the value of this segment."""
        if not self.jumps:
            return self.time(s)
        x = s if len(self) == 1 else s - self._segment(s)[0]
        return self.time(s) + jax.lax.stop_gradient((1.0 - 2.0 * x) * self._edge())

    def duration(self, s: Scalar, ds: Scalar) -> Scalar:
        """The duration, s, of a normalised time `ds` from `s` on, within one segment."""
        return ds * (self.total if len(self) == 1 else self.total * self._segment(s)[2])

    def step(self, s: Scalar, length: Scalar, begin: Scalar, end: Scalar) -> "StepTimes":
        """The times of a step of all runs from `begin` to `end`; in each run it starts at `s` and
        has its `length`."""
        duration = self.duration(s, length)
        edge = jnp.zeros_like(duration) + (self._edge() if self.jumps else 0.0)
        # Every stage and every number of the search reads them.
        return StepTimes(
            *barrier((begin, end - begin, self.time(s), duration / (end - begin), edge))
        )

    def _edge(self) -> Scalar:
        """Some roundings of a time, s, in the direction of the run."""
        # Rounding of the time, of the fraction, and of the numbers from which an effect computes
        # its break times.
        rounding = 4.0 * jnp.finfo(self.total.dtype).eps
        return rounding * jnp.copysign(jnp.abs(self.t0) + jnp.abs(self.total), self.total)

    def lengths(self) -> Float[Array, "segments *#runs"]:
        """The length of each segment, as a fraction of the run."""
        if len(self) == 1:
            return jnp.ones(1, self.u.dtype)
        # A segment of no length gets a small one, because step control divides by it.
        return jnp.maximum(jnp.diff(self.u, axis=0), 1e-6)

    def reach(self) -> tuple[Float[Array, "*#runs"], Float[Array, "*#runs"]]:
        """The normalised times that bound all segments of non-zero length."""
        filled = jnp.diff(self.u, axis=0) > 0.0
        last = len(self) - jnp.argmax(filled[::-1], axis=0)
        first = jnp.where(jnp.any(filled, axis=0), jnp.argmax(filled, axis=0), last)
        return first.astype(self.u.dtype), last.astype(self.u.dtype)

    def longest_steps(self, max_step: Scalar) -> Float[Array, "segments *#runs"]:
        """The normalised length that `max_step`, s, allows in each segment."""
        widths = jnp.diff(self.u, axis=0)
        shape = (*widths.shape, *(1,) * (self.total.ndim + 1 - widths.ndim))
        durations = jnp.abs(widths.reshape(shape) * self.total)
        moving = durations > 0.0
        return jnp.where(moving, max_step / jnp.where(moving, durations, 1.0), jnp.inf)


@final
class StepTimes(eqx.Module):
    """The times of a step with an individual interval for every run; used like `Segments`.

    No segment ends within a step, so that time is linear in it: from `start` on, `rate` seconds to
    a unit of the time of the steps, in which it begins at `begin` and is `length` long."""

    begin: Float[Array, ""]
    length: Float[Array, ""]
    start: Float[Array, "*#runs"]
    rate: Float[Array, "*#runs"]
    edge: Float[Array, "*#runs"]

    def time(self, s: Scalar) -> Scalar:
        """The time, s, at the time `s` of the step."""
        return self.start + (s - self.begin) * self.rate

    def time_inside(self, s: Scalar) -> Scalar:
        """The time, s, a few roundings inside where the step begins or ends."""
        return self.time(s) + (1.0 - 2.0 * (s - self.begin) / self.length) * self.edge

    def duration(self, s: Scalar, ds: Scalar) -> Scalar:
        """The duration, s, of a time `ds` of the step."""
        del s
        return ds * self.rate


def segments_of(
    system: AbstractSystem, t0: Scalar, t1: Scalar, landings: Float[Array, "times *#runs"] | None
) -> Segments:
    """The segments of a run from `t0` to `t1`, s, between breaks of the system and `landings`.

    `landings` are further ends of steps, as fractions of all runs or of each run."""
    total = t1 - t0
    inner = []
    breaks = breaks_of(system)
    if breaks is not None and breaks.shape[0] > 0:
        breaks = breaks.astype(total.dtype)
        missing = (1,) * (total.ndim - breaks.ndim + 1)
        breaks = breaks.reshape(breaks.shape[0], *missing, *breaks.shape[1:])
        inner.append(jnp.clip(safe_divide(breaks - t0, total), 0.0, 1.0))
    if landings is not None:
        # Landings that all runs share get the axes of the breaks, or of landings of each run.
        rank = max(inner[0].ndim if inner else 1, landings.ndim)
        inner.append(landings)
        inner = [x.reshape(x.shape + (1,) * (rank - x.ndim)) for x in inner]
    runs = jnp.broadcast_shapes(*(x.shape[1:] for x in inner)) if inner else ()
    zero = jnp.zeros((1, *runs), total.dtype)
    one = jnp.ones((1, *runs), total.dtype)
    # Every run has the same number of segments; where its breaks are outside of the run, some of
    # them have zero length.
    cuts = [jnp.broadcast_to(x, (x.shape[0], *runs)).astype(total.dtype) for x in inner]
    u = jnp.concatenate([zero, *cuts, one])
    return Segments(jnp.sort(u, axis=0) if inner else u, t0, total, breaks is not None)


Clock = TypeVar("Clock", Segments, StepTimes)


@final
class ScaledVectorField(eqx.Module, Generic[Clock]):
    """dy/ds of a system as a function of s and y, with the capabilities that solvers need."""

    system: AbstractSystem
    segments: Clock

    def time(self, s: Scalar) -> Scalar:
        """The time, s, at the normalised time `s`, seen from within its segment."""
        return self.segments.time_inside(s)

    def duration(self, s: Scalar, ds: Scalar) -> Scalar:
        """The duration, s, of a normalised time `ds` from `s` on."""
        return self.segments.duration(s, ds)

    def __call__(self, s: Scalar, y: State) -> State:
        t, dt_ds = self.time(s), self.duration(s, 1.0)
        if isinstance(self.segments, Segments) and len(self.segments) > 1:
            # The compiler would look up the segment again in every kernel of the field.
            t, dt_ds = barrier((t, dt_ds))
        rate = self.system.vector_field(t, y)
        # A constant of double precision in a user's effect must not change the precision of the
        # run.
        return jax.tree.map(lambda k, x: jnp.asarray(k, x.dtype) * dt_ds, rate, y)

    def projected(self, s: Scalar, y: State) -> State:
        """The state nearest to `y` on its groups that meets the constraints of the system."""
        y = project(y)
        result = self.system.projected(self.time(s), y)
        return y if result is None else jax.tree.map(lambda a, b: a.astype(b.dtype), result, y)

    def outside(self, s: Scalar, y: State) -> Flag | None:
        """Whether the state `y` is outside the range of the system, or `None`."""
        return self.system.outside(self.time(s), y)

    def split(self) -> AbstractSplit:
        """Drift and kick of the system; only for a system that has them."""
        return cast(AbstractSplit, self.system.split())

    def regularised(self) -> AbstractRegularised:
        """The regularised variables of the system; only for a system that has them."""
        return cast(AbstractRegularised, self.system.regularised())


@final
class PartOfField(eqx.Module):
    """A vector field in the time of a step from 0 to 1, with an individual interval for each run:
    from `s` on, `length` long in normalised time."""

    field: ScaledField
    s: Float[Array, "*runs"]
    length: Float[Array, "*runs"]

    def _inside(self, x: Scalar) -> Scalar:
        # At the end of the step the next segment may begin, where time changes its unit.
        end = self.s + self.length
        s = jnp.minimum(self.s + x * self.length, just_before(self.s, end))
        return jnp.where(self.length > 0.0, s, self.s)

    def __call__(self, s: Scalar, y: State) -> State:
        rate = self.field(self._inside(s), y)
        return jax.tree.map(lambda k: k * self.length.astype(k.dtype), rate)

    def time(self, s: Scalar) -> Scalar:
        """The time, s, at the time `s` of the step."""
        return self.field.time(self._inside(s))

    def duration(self, s: Scalar, ds: Scalar) -> Scalar:
        """The duration, s, of a time `ds` of the step."""
        return self.field.duration(self._inside(s), ds * self.length)

    def projected(self, s: Scalar, y: State) -> State:
        """Delegates to the field."""
        return self.field.projected(self._inside(s), y)

    def split(self) -> AbstractSplit:
        """Delegates to the field."""
        return self.field.split()

    def regularised(self) -> AbstractRegularised:
        """Delegates to the field."""
        return self.field.regularised()


def field_of_part(
    field: ScaledField, s: Scalar, length: Scalar
) -> tuple[ScaledField, StepTimes | None]:
    """The vector field of a step from 0 to 1, with an individual interval for each run: from `s`
    on, `length` long in normalised time; and its times, if the field is not hoisted."""
    if not isinstance(field, ScaledVectorField):
        return PartOfField(field, s, length), None
    zero, one = jnp.zeros_like(s, shape=()), jnp.ones_like(s, shape=())
    segment = field.segments.step(s, length, zero, one)
    return ScaledVectorField(field.system, segment), segment


def hoist(
    field: ScaledVectorField,
    y0: State,
    needs: Literal["", "split", "regularised"],
    run_axes: int = 0,
) -> ScaledField:
    """The field with all that it depends on as leaves, so that it can be differentiated.

    **Arguments**

    - `field`, `y0`: the field and a state of it.
    - `needs`: the capability by which the solver integrates: "split", "regularised" or "".
    - `run_axes`: number of axes of the normalised times at which it is evaluated.

    **Returns** the field itself if no function of it closes over traced arrays: it then preserves
    the layout of its parameters, which the batching of mapped runs reads."""
    if not field_trace(field.system, field.segments.t0, y0).closes_over_tracers:
        return field
    s = jnp.zeros_like(field.segments.total, shape=runs_of(y0, run_axes))
    return closures_as_leaves(field, needs, s, y0)
