"""Comparison of a flight log with a simulated run: residuals by channel and phase, extremes, and
whether the flight is a plausible run of a campaign.

    t = t_log + d,   r_i = y_i - x(t_i)                                 residuals
    d = argmin_d  sum over channels of mean((y_i - x(t_i + d))^2) / var(y)      aligned by a fit

    symbol   meaning                                                    unit
    y, x     the log and the run                                        that of the column
    d        offset of the clocks                                       s

An offset is known, or that of an event that both have, or fitted.
"""

__all__ = [
    "ChannelResiduals",
    "ExtremeRow",
    "LogComparison",
    "ResidualRow",
    "compare_log",
]

import os
import re
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from ..control import LoopRun
from ..core import InputError
from ..core.printing import printed
from ..core.status import Status
from ..core.suggestions import suggests
from ..core.text import aligned
from ..dispersion import Campaign
from ..dispersion.states import run_states
from ..simulation.mission_result import MissionTrajectory, Simulated
from ..statistics.curves import CurveTest, curve_test
from ._channels import Channels, Curve, known_channel, resolved
from ._log_alignment import Samples, clock_offset, no_common_time, peak
from ._scene_file import SceneFile
from .flight_logs import FlightLog, column_of, read_log
from .units import in_unit

LEAST_ACTIVE = 20
"""Runs of a campaign that a standard deviation requires."""


@printed(times="s", measured="", predicted="", deviation="", mean="")
class ChannelResiduals(NamedTuple):
    """One column of the log beside the run; numbers are in the unit of the column.

    - `name`, `unit`: of the column.
    - `times`: of the samples within the run, s, on its clock, (samples,).
    - `phase`: number of the phase at each of them.
    - `measured`, `predicted`: the log and the run there.
    - `mean`, `deviation`: of the runs of the campaign there, NaN where fewer than 20 of them are
      active; `None` without a campaign.
    - `test`: whether the column is plausible as one of these runs."""

    name: str
    unit: str
    times: np.ndarray
    phase: np.ndarray
    measured: np.ndarray
    predicted: np.ndarray
    mean: np.ndarray | None = None
    deviation: np.ndarray | None = None
    test: CurveTest | None = None

    @property
    def residual(self) -> np.ndarray:
        """The log minus the run."""
        return self.measured - self.predicted

    @property
    def share_inside(self) -> float:
        """Share of the samples within two standard deviations of the campaign; NaN without one."""
        if self.mean is None or self.deviation is None:
            return np.nan
        known = np.isfinite(self.deviation)
        inside = np.abs(self.measured - self.mean)[known] <= 2.0 * self.deviation[known]
        return float(np.mean(inside)) if known.any() else np.nan


@printed(mean="", rms="", largest="", time="s")
class ResidualRow(NamedTuple):
    """Residuals of a channel in a phase, or in all of them, in the unit of the column.

    - `samples`: their number.
    - `mean`, `rms`: of the residuals.
    - `largest`: the one with the largest magnitude, at the `time`, s, of the run."""

    channel: str
    phase: str
    unit: str
    samples: int
    mean: float
    rms: float
    largest: float
    time: float


@printed(measured="", predicted="", measured_time="s", predicted_time="s")
class ExtremeRow(NamedTuple):
    """The `which` (greatest or least) value of a channel within the common time, and its time on
    the clock of the run, s, in the log and in the run."""

    channel: str
    which: str
    unit: str
    measured: float
    predicted: float
    measured_time: float
    predicted_time: float

    @property
    def difference(self) -> float:
        """The log minus the run."""
        return self.measured - self.predicted


@suggests
class LogComparison(NamedTuple):
    """A flight log beside a run; printing it shows all tables, and
    `jaxspace.plots.flight_log.log_figure` draws it.

    - `path`: of the log.
    - `offset`: seconds added to the times of the log to give those of the run.
    - `alignment`: how it was determined.
    - `channels`: the residuals of each column.
    - `phases`: names of the phases of the run.
    - `rows`: residuals by channel and phase.
    - `extremes`: greatest and least values.
    - `missing`: number of missing samples by column; `outside`: that of samples outside the run."""

    path: str
    offset: float
    alignment: str
    channels: tuple[ChannelResiduals, ...]
    phases: tuple[str, ...]
    rows: tuple[ResidualRow, ...]
    extremes: tuple[ExtremeRow, ...]
    missing: Mapping[str, int]
    outside: int

    def __repr__(self) -> str:
        head = (
            f"{self.path} beside the run: t(run) = t(log) {self.offset:+.6g} s ({self.alignment})"
        )
        heads = ("channel", "phase", "unit", "samples", "mean", "rms", "largest", "at time (s)")
        rows = [
            (r.channel, r.phase, r.unit, str(r.samples))
            + tuple(f"{x:.4g}" for x in (r.mean, r.rms, r.largest, r.time))
            for r in self.rows
        ]
        parts = [head, "residuals, log minus run\n" + aligned([heads, *rows], left=3)]
        heads = ("extreme", "unit", "log", "run", "difference", "time in log (s)", "in run (s)")
        rows = [
            (f"{x.which} {x.channel}", x.unit)
            + tuple(f"{y:.6g}" for y in (x.measured, x.predicted))
            + tuple(f"{y:.4g}" for y in (x.difference, x.measured_time, x.predicted_time))
            for x in self.extremes
        ]
        parts.append(aligned([heads, *rows], left=2))
        tested = [(x, x.test) for x in self.channels if x.test is not None]
        if tested:
            heads = ("channel", "chi-square", "modes", "probability", "within 2 std dev", "runs")
            rows = [
                (x.name, f"{test.chi_square:.3g}", str(test.modes), f"{test.probability:.3g}")
                + (f"{100.0 * x.share_inside:.3g} %", str(test.runs))
                for x, test in tested
            ]
            parts.append("the log as a run of the campaign\n" + aligned([heads, *rows], left=1))
        notes = [f"{k} samples of {name} are missing" for name, k in self.missing.items() if k]
        notes += [f"{self.outside} samples are outside the run"] if self.outside else []
        return "\n\n".join([*parts, *(["; ".join(notes)] if notes else [])])


def compare_log(
    run: Simulated | LoopRun,
    log: FlightLog | str | os.PathLike[str],
    channels: Mapping[str, str | Callable] | None = None,
    *,
    scene: SceneFile | None = None,
    align: str | float = 0.0,
    campaign: Campaign | None = None,
    runs: int = 200,
    seed: int = 0,
    noise: Mapping[str, float] | None = None,
) -> LogComparison:
    """Compare a flight log, or the result of another program, with a single run.

    **Arguments**

    - `run`: a trajectory, or the result of a mission, of which the branches are left out.
    - `log`: the log, or the path of its CSV file.
    - `channels`: for each column of the log that is compared the quantity of the run: a number of
      the state ("position.2"), an output of the `scene` ("altitude", "site.east"), or, without a
      scene, a function declared with `jaxspace.core.output`, whose unit it gives. By default the
      columns whose names, in small letters and with underscores, are such a quantity.
    - `scene`: the scene file of the run, for its outputs.
    - `align`: the offset, s, that is added to the times of the log; or an event of both, the
      "greatest COLUMN" or "least COLUMN", or the first time at which "COLUMN > VALUE" or "COLUMN <
      VALUE", such as "altitude > 30 m" (a value without a unit is in that of the column); or
      "fit", the offset of least squares.
    - `campaign`: whose `runs` with this `seed` give the scatter of each channel.
    - `noise`: standard deviations of the errors of measurement by column, in its unit, for the
      chi-square.

    **Raises** `InputError` for a batch of runs, for a column without a unit, or with one of another
    dimension than its channel, without a column in common, without a time in common, and for an
    event that does not occur."""
    run = run.trajectory if isinstance(run, LoopRun) else run
    if np.ndim(run.status):
        raise InputError("run is a batch: it must be a single run, such as run.of(0).")
    given = log if isinstance(log, FlightLog) else read_log(log)
    names = _names(given, channels, scene, run)
    made = Channels(names, scene, run)
    factors = {name: _factor(given, name, made.units[name]) for name in names}
    measured = {name: _samples(given, name) for name in names}
    predicted = {
        name: _scaled(curve, factors[name]) for name, curve in made.of(resolved(run)).items()
    }
    offset, how = clock_offset(align, given, measured, predicted)
    scatter = {}
    if campaign is not None:
        scatter = _scatter(campaign, made, factors, runs, seed)
    found = tuple(
        _residuals(name, given.units[name], offset, measured[name], predicted[name])
        for name in names
    )
    if not any(x.times.size for x in found):
        raise InputError(no_common_time(given, offset, predicted))
    sigma = noise or {}
    found = tuple(
        _tested(x, scatter[x.name], sigma.get(x.name, 0.0)) if x.name in scatter else x
        for x in found
    )
    phases = run.names if isinstance(run, MissionTrajectory) else ("run",)
    return LogComparison(
        given.path,
        offset,
        how,
        found,
        tuple(phases),
        tuple(row for x in found for row in _rows(x, phases)),
        tuple(row for x in found for row in _extremes(x, predicted[x.name])),
        {name: int(np.isnan(given.columns[name]).sum()) for name in names},
        max(measured[x.name][0].size - x.times.size for x in found),
    )


def _names(
    log: FlightLog,
    channels: Mapping[str, str | Callable] | None,
    scene: SceneFile | None,
    run: Simulated,
) -> Mapping[str, str | Callable]:
    """What each column is compared with."""
    if channels is not None:
        for name in channels:
            column_of(log, name)
        if not channels:
            raise InputError("channels is empty: it must name at least one column of the log.")
        return channels
    plain = {name: re.sub(r"\W+", "_", name.lower()).strip("_") for name in log.columns}
    found = {}
    for name, word in plain.items():
        for what in (name, word):
            if name not in found and known_channel(scene, what, run):
                found[name] = what
    if not found:
        raise InputError(
            f"{log.path} has no column with the name of a quantity of the run: it has "
            f"{', '.join(log.columns)}. Name what each of them is in channels, such as "
            '{"height": "position.2"}.'
        )
    return found


def _factor(log: FlightLog, name: str, si: str) -> float:
    """Units of the column in one SI unit of its channel."""
    unit = log.units[name]
    if si and not unit:
        raise InputError(
            f'{log.path}: the column {name} has no unit: its heading must be such as "{name} '
            f'({si})".'
        )
    try:
        return in_unit(si, unit)
    except ValueError:
        raise InputError(
            f"{log.path}: the column {name} is in {unit}: it must be in a unit of its channel, "
            f"such as {si or '1'}."
        ) from None


def _samples(log: FlightLog, name: str) -> Samples:
    """Times and values of a column, without missing ones."""
    x = log.columns[name]
    good = np.isfinite(x)
    if not good.any():
        raise InputError(f"{log.path}: the column {name} has no number.")
    return log.times[good], x[good]


def _scaled(curve: Curve, factor: float) -> Curve:
    return Curve({k: (t, factor * x) for k, (t, x) in curve.phases.items()})


def _residuals(
    name: str, unit: str, offset: float, measured: Samples, predicted: Curve
) -> ChannelResiduals:
    times = measured[0] + offset
    values, phase = predicted.at(times)
    known = np.isfinite(values)
    return ChannelResiduals(
        name, unit, times[known], phase[known], measured[1][known], values[known]
    )


def _scatter(
    campaign: Campaign, channels: Channels, factors: Mapping[str, float], runs: int, seed: int
) -> dict[str, list[Curve]]:
    """The channels of the successful runs of a campaign, in the units of the log."""
    result, samples = run_states(campaign, np.arange(runs), seed=seed)
    good = np.asarray(result.status) <= Status.EVENT
    each = channels.of_each(result, samples)
    return {
        name: [_scaled(curve, factors[name]) for curve, ok in zip(curves, good, strict=True) if ok]
        for name, curves in each.items()
    }


def _tested(x: ChannelResiduals, curves: list[Curve], noise: float) -> ChannelResiduals:
    """The channel with the mean and the deviation of the runs, and the test of its log."""
    if noise < 0.0 or not np.isfinite(noise):
        raise InputError(f"noise[{x.name!r}] is {noise}: it must be zero or more, and finite.")
    if len(curves) < LEAST_ACTIVE:
        raise InputError(
            f"The campaign has {len(curves)} successful runs: at least {LEAST_ACTIVE} are required "
            "for its scatter."
        )
    values = np.stack([curve.at(x.times)[0] for curve in curves])
    active = np.isfinite(values)
    some = active.sum(axis=0) >= LEAST_ACTIVE
    # Runs that have ended have no value.
    count = np.maximum(active.sum(axis=0), 2)
    filled = np.where(active, values, 0.0)
    mean = filled.sum(axis=0) / count
    squares = np.where(active, (values - mean) ** 2, 0.0).sum(axis=0)
    deviation = np.sqrt(squares / (count - 1))
    every = active.all(axis=0)
    test = None
    if every.any() and np.ptp(values[:, every], axis=0).max() > 0.0:
        test = curve_test(x.measured[every], values[:, every], noise)
    return x._replace(
        mean=np.where(some, mean, np.nan), deviation=np.where(some, deviation, np.nan), test=test
    )


def _rows(x: ChannelResiduals, phases: tuple[str, ...]) -> list[ResidualRow]:
    """The residuals in each phase with samples, and over all if there are several."""
    used = [k for k in range(len(phases)) if np.any(x.phase == k)]
    parts = [(phases[k], x.phase == k) for k in used]
    if len(parts) != 1:
        parts.append(("all", np.full(x.phase.shape, True)))
    rows = []
    for name, here in parts:
        r, t = x.residual[here], x.times[here]
        if not r.size:
            rows.append(ResidualRow(x.name, name, x.unit, 0, *(np.nan,) * 4))
            continue
        k = int(np.argmax(np.abs(r)))
        numbers = float(r.mean()), float(np.sqrt(np.mean(r**2))), float(r[k]), float(t[k])
        rows.append(ResidualRow(x.name, name, x.unit, r.size, *numbers))
    return rows


def _extremes(x: ChannelResiduals, curve: Curve) -> list[ExtremeRow]:
    """The greatest and the least value within the common time."""
    if not x.times.size:
        return []
    # With the times of the log, because its first and its last one limit the comparison.
    t, y = (
        np.concatenate(parts) for parts in zip(curve.points, (x.times, x.predicted), strict=True)
    )
    common = (t >= x.times[0]) & (t <= x.times[-1])
    t, first = np.unique(t[common], return_index=True)
    y = y[common][first]
    rows = []
    for which, sign in (("greatest", 1.0), ("least", -1.0)):
        (log_time, log), (run_time, run) = peak(x.times, sign * x.measured), peak(t, sign * y)
        rows.append(ExtremeRow(x.name, which, x.unit, sign * log, sign * run, log_time, run_time))
    return rows
