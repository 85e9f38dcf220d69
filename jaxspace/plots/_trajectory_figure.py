"""A figure of a trajectory: every block of the state against time, with Euler angles."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import jax
import numpy as np
from jax.typing import ArrayLike

from ..core import InputError
from ..core.extras import extra
from ..rotations import Quaternion, to_euler_angles
from ._leaves import state_leaves
from ._refinement import Drawn
from ._resolution import resolved
from ._style import BAD, COLOURS, MUTED, dress, headline

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..simulation import MissionTrajectory, Trajectory

EULER_LABELS = ("ψ precession", "θ nutation", "φ spin")
MOST_RUNS = 20
"""Maximum number of distinguishable lines of one component."""
FAR = 1e5
"""m: longer lengths would have an axis in powers of ten."""
Scale: TypeAlias = Callable[[str, str], tuple[str, float]]
MOST_LINES = 7
"""Components that one panel shows."""


NOT_RESOLVED = "points only, not resolved: lines require more saved times or a shorter run"


class Block(NamedTuple):
    """One block of a state along a trajectory.

    - `unit`: of its values; empty for pure numbers.
    - `labels`: of its components.
    - `values`: (components, times, runs).
    - `wraps`: whether the values are angles in degrees that jump by a whole turn.
    - `coarse`: whether the motion between two times is more than a line between them shows.
    """

    unit: str
    labels: tuple[str, ...]
    values: np.ndarray
    wraps: bool = False
    coarse: bool = False


def trajectory_figure(
    trajectory: "Trajectory | MissionTrajectory",
    *,
    units: dict[str, str] | None = None,
    runs: int = MOST_RUNS,
    title: str = "",
    scale: Scale | None = None,
) -> "Figure":
    """A matplotlib figure with a panel for each block of the state against time.

    `trajectory_figure(run).savefig("run.png")` draws a trajectory, or all phases of a mission. An
    attitude is shown as Euler's angles 3-1-3, and the event that ended a run as a line. Where the
    motion between two saved times is more than a line would show, the run is drawn at more times:
    by its closed form, by its steps (`dense=True`), or, without these, by repeating it. A closed
    loop cannot be repeated: it is drawn as points, with a note in its panel. The same applies to a
    motion that requires more than 20,000 points.

    **Arguments**

    - `trajectory`: its states are (components, times) or (components, times, runs).
    - `units`: of blocks by name, where the class of the state declares none.
    - `runs`: how many runs of a batch are drawn.
    - `title`: of the whole figure.
    - `scale`: of the name of a block, or "time", and its unit: the unit that is shown, and how many
      of it one is. By default lengths in m beyond 100 km are shown in km.

    **Raises** `InputError` where the times are not behind the components.
    """
    with extra("app"):
        from matplotlib.figure import Figure

    # By what they have and not by their class, because an import of it would be a circle: a
    # trajectory draws itself by this function.
    trajectory = getattr(trajectory, "trajectory", trajectory)
    phases: Any = getattr(trajectory, "phases", (trajectory,))
    names = getattr(trajectory, "names", ("",))
    parts = []
    for phase in phases:
        drawn = resolved(phase, runs)
        batched = np.ndim(phase.status) == 1
        parts.append((_times(drawn.ts, runs), _blocks(drawn, batched, runs, units or {})))
    clock, seconds = ("s", 1.0) if scale is None else scale("time", "s")
    units_shown = _shown_units([result for _, result in parts], scale)
    parts = [(seconds * ts, _scaled(result, units_shown)) for ts, result in parts]
    # Phases may have states of different classes: a panel for each block of any of them.
    blocks = list(dict.fromkeys(key for _, result in parts for key in result))
    figure = Figure(figsize=(9.0, 0.7 + 2.1 * len(blocks)), layout="constrained")
    if title:
        headline(figure, title)
    panels = figure.subplots(len(blocks), 1, sharex=True, squeeze=False)[:, 0]
    for axes, key in zip(panels, blocks, strict=True):
        present = [(ts, result[key]) for ts, result in parts if key in result]
        _panel(axes, present)
        name, block = key[0], present[0][1]
        label = name.replace("_", " ") + (f"\n[{block.unit}]" if block.unit else "")
        dress(axes, "", f"time [{clock}]" if axes is panels[-1] else "", label)
        if block.wraps:
            axes.set_yticks([-180, -90, 0, 90, 180])
    _bounds(panels, [ts for ts, _ in parts], names)
    ended = phases[-1]
    # Of a batch each run may end by another event.
    if np.ndim(ended.status) == 0 and int(getattr(ended, "event", -1)) >= 0:
        _line(panels, float(parts[-1][0][-1, 0]), "event")
    figure.align_ylabels(list(panels))
    return figure


def _shown_units(
    parts: list[dict[str, Block]], scale: Scale | None
) -> dict[tuple[str, str], tuple[str, float]]:
    """The unit that shows a block, by its name and unit, and how many of it one is: the same in all
    phases."""
    result = {}
    for name, unit in dict.fromkeys((name, x.unit) for part in parts for name, x in part.items()):
        same = [part[name] for part in parts if name in part and part[name].unit == unit]
        if same[0].wraps:
            result[name, unit] = unit, 1.0
        elif scale is not None:
            result[name, unit] = scale(name, unit)
        else:
            greatest = max(np.nanmax(np.abs(x.values), initial=0.0) for x in same)
            result[name, unit] = ("km", 1e-3) if unit == "m" and greatest > FAR else (unit, 1.0)
    return result


def _scaled(
    blocks: dict[str, Block], shown: dict[tuple[str, str], tuple[str, float]]
) -> dict[tuple[str, str], Block]:
    """The blocks in their displayed units, by name and unit: blocks with the same name and
    different units have separate panels."""
    result = {}
    for name, block in blocks.items():
        unit, factor = shown[name, block.unit]
        result[name, unit] = block._replace(unit=unit, values=factor * block.values)
    return result


def _times(ts: ArrayLike, runs: int) -> np.ndarray:
    """The times, s, (times, runs), or (times, 1) where all runs share them."""
    ts = np.asarray(ts)
    # A second axis also where all runs share the times, so that a line reads them by run.
    return ts.reshape(len(ts), -1)[:, :runs]


def _blocks(drawn: Drawn, batched: bool, runs: int, units: dict[str, str]) -> dict[str, Block]:
    """Every block of the states by name."""
    times = len(np.asarray(drawn.ts))
    result: dict[str, Block] = {}
    for name, unit, leaf in state_leaves(drawn.states):
        quaternion = isinstance(leaf, Quaternion)
        values = np.asarray(leaf.wxyz if quaternion else leaf)
        if values.ndim < 1 + batched or values.shape[values.ndim - 1 - batched] != times:
            raise InputError(
                f"{name} has the shape {values.shape}: the {times} times must be on its "
                f"{'last axis but one' if batched else 'last axis'}."
            )
        # One axis for all components: none of a mass, several of a tensor.
        values = values.reshape(-1, times, values.shape[-1] if batched else 1)[:, :, :runs]
        coarse = name in drawn.coarse
        # Nobody reads the four components of a quaternion.
        if quaternion:
            angles = _euler_degrees(values)
            prefix = "" if name == "attitude" else f"{name}, "
            result[f"{prefix}Euler angles 3-1-3"] = Block("deg", EULER_LABELS, angles, True, coarse)
        else:
            labels = _labels(len(values))
            result[name] = Block(units.get(name, unit), labels, values, coarse=coarse)
    return result


@jax.jit
def _euler(wxyz: jax.Array) -> jax.Array:
    # Compiled as one, because the many small operations of a conversion are slow one by one.
    return to_euler_angles(Quaternion(wxyz))


def _euler_degrees(wxyz: np.ndarray) -> np.ndarray:
    """Euler's angles 3-1-3, deg, (3, times, runs)."""
    return np.degrees(np.asarray(_euler(wxyz)))


def _labels(count: int) -> tuple[str, ...]:
    """The labels of the components of a block."""
    return {1: ("",), 3: ("x", "y", "z")}.get(count, tuple(str(k + 1) for k in range(count)))


def _panel(axes: "Axes", parts: list[tuple[np.ndarray, Block]]) -> None:
    """The lines of one block, over all phases that have it, and their legend."""
    for ts, block in parts:
        runs = block.values.shape[2]
        width, alpha = (1.3, 1.0) if runs == 1 else (0.7, 0.5)
        for k, label in list(enumerate(block.labels))[:MOST_LINES]:
            for run in range(runs):
                y = block.values[k, :, run]
                axes.plot(
                    # All runs may share one column of times.
                    ts[:, min(run, ts.shape[1] - 1)],
                    _broken(y) if block.wraps else y,
                    color=COLOURS[k],
                    label=label,
                    linewidth=width,
                    alpha=alpha,
                    # A line would invent a slow motion between the points of a fast one.
                    **({"linestyle": "", "marker": ".", "markersize": 2} if block.coarse else {}),
                )
    if any(block.coarse for _, block in parts):
        axes.set_title(NOT_RESOLVED, loc="right", fontsize=8, color=BAD)
    handles, labels = axes.get_legend_handles_labels()
    # One entry for each component, whatever the number of its lines.
    first = dict(zip(reversed(labels), reversed(handles), strict=True))
    shown = [label for label in dict.fromkeys(labels) if label]
    if shown:
        legend = axes.legend(
            [first[label] for label in shown],
            shown,
            fontsize=8,
            loc="center left",
            bbox_to_anchor=(1.0, 0.5),
            frameon=False,
        )
        # Samples of thin and pale lines would be hard to see.
        for line in legend.get_lines():
            line.set(alpha=1.0, linewidth=1.6)


def _broken(angle: np.ndarray) -> np.ndarray:
    """Degrees with a gap where the angle jumps by a turn, instead of a line across the panel."""
    jump = np.abs(np.diff(angle, prepend=angle[:1])) > 180.0
    return np.where(jump, np.nan, angle)


def _bounds(panels: np.ndarray, times: list[np.ndarray], names: tuple[str, ...]) -> None:
    """A line at the end of each phase (of the first run), and the names of the phases on top."""
    if len(times) < 2:
        return
    lines = list(dict.fromkeys(name.rpartition(".")[0] for name in names))
    for ts, name in zip(times, names, strict=True):
        start = ts[0, 0]
        end = ts[-1, 0]
        panels[0].annotate(
            name,
            (0.5 * (start + end), 1.0),
            # The phases of branches run at the same times: a row above for each branch.
            (0, 3 + 11 * lines.index(name.rpartition(".")[0])),
            ("data", "axes fraction"),
            textcoords="offset points",
            ha="center",
            fontsize=9,
        )
        if ts is not times[-1]:
            _line(panels, end)


def _line(panels: np.ndarray, time: float, words: str = "") -> None:
    """A line at a time through all panels, with words on top."""
    for axes in panels:
        axes.axvline(time, color=MUTED, linewidth=0.9, linestyle="--")
    where = {"xycoords": ("data", "axes fraction"), "textcoords": "offset points"}
    panels[0].annotate(words, (time, 1.0), (0, 3), **where, ha="right", fontsize=9, color=MUTED)
