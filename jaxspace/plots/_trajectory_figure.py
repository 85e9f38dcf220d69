"""Every block of a trajectory's states against time, whatever the system, and the Euler angles of
an attitude."""

from typing import TYPE_CHECKING, Any

import jax
import numpy as np

from ..rotations import Quaternion, to_euler_angles
from ..simulation import MissionTrajectory, Trajectory
from ._style import COLOURS, dress

if TYPE_CHECKING:
    from matplotlib.figure import Figure

UNITS = {"position": "m", "velocity": "m/s", "omega": "rad/s", "mass": "kg", "attitude": ""}
EULER_SUFFIX = "Euler angles 3-1-3"
EULER = ("ψ precession", "θ nutation", "φ spin")
MOST_RUNS = 20  # lines of one component that can still be told apart
MOST_LINES = 7  # components of one panel

Blocks = dict[str, tuple[tuple[str, ...], np.ndarray]]


def trajectory_figure(
    trajectory: Trajectory | MissionTrajectory,
    *,
    units: dict[str, str] | None = None,
    runs: int = MOST_RUNS,
    title: str = "",
) -> "Figure":
    """A matplotlib figure with a panel for each block of the state against time, over all phases of
    a mission.

    - `units`: of blocks by name; those of a `BodyState` (position, velocity, omega, mass) are
      known.
    - `runs`: of a batch, how many runs are drawn.

    An attitude is shown as quaternion and as Euler's angles 3-1-3, deg. States at few times give
    angular lines: ask the simulation for more samples."""
    from matplotlib.figure import Figure

    phases, names = (
        (trajectory.phases, trajectory.names)
        if isinstance(trajectory, MissionTrajectory)
        else ((trajectory,), ("",))
    )
    parts = [(_times(phase, runs), _blocks(phase, runs)) for phase in phases]
    blocks = list(dict.fromkeys(name for _, found in parts for name in found))
    known = {**UNITS, **(units or {})}
    figure = Figure(figsize=(9.0, 0.7 + 2.1 * len(blocks)), layout="constrained")
    if title:
        figure.suptitle(title, fontsize=12, fontweight="bold", x=0.01, ha="left")
    panels = figure.subplots(len(blocks), 1, sharex=True, squeeze=False)[:, 0]
    for axes, name in zip(panels, blocks, strict=True):
        _panel(axes, name, [(ts, found[name]) for ts, found in parts if name in found])
        unit = "deg" if name.endswith(EULER_SUFFIX) else known.get(name, "")
        words = name.replace("_", " ")
        dress(
            axes,
            "",
            "time [s]" if axes is panels[-1] else "",
            words + (f"\n[{unit}]" if unit else ""),
        )
        if name.endswith(EULER_SUFFIX):
            axes.set_yticks([-180, -90, 0, 90, 180])
    _bounds(panels, [ts for ts, _ in parts], names)
    figure.align_ylabels(list(panels))
    return figure


def _times(phase: Trajectory, runs: int) -> np.ndarray:
    """The times, (runs, times)."""
    return np.atleast_2d(np.asarray(phase.ts))[:runs]


def _blocks(phase: Trajectory, runs: int) -> Blocks:
    """Every block by name: labels of its components, and values (runs, times, components)."""
    batch = np.ndim(phase.ts) == 2
    found: Blocks = {}
    flat = jax.tree_util.tree_flatten_with_path(
        phase.states, is_leaf=lambda x: isinstance(x, Quaternion)
    )[0]
    for path, leaf in flat:
        name = _name(path)
        quaternion = isinstance(leaf, Quaternion)
        values = np.asarray(leaf.wxyz if quaternion else leaf)
        values = values[:runs] if batch else values[None]
        values = values.reshape(*values.shape[:2], -1)
        found[name] = (_labels(values.shape[2], quaternion), values)
        if quaternion:
            found[f"{name}, {EULER_SUFFIX}".removeprefix("attitude, ")] = (
                EULER,
                _euler_degrees(values),
            )
    return found


def _euler_degrees(wxyz: np.ndarray) -> np.ndarray:
    """Euler's angles, deg, of quaternions with their components last; compiled as one, which is
    quicker than piece by piece."""
    angles = jax.jit(lambda q: to_euler_angles(Quaternion(q)))(np.moveaxis(wxyz, -1, 0))
    return np.degrees(np.moveaxis(np.asarray(angles), 0, -1))


def _name(path: tuple[Any, ...]) -> str:
    words = [
        str(getattr(key, "name", getattr(key, "key", getattr(key, "idx", key)))) for key in path
    ]
    return " ".join(word for word in words if word != "parts") or "state"


def _labels(count: int, quaternion: bool) -> tuple[str, ...]:
    if quaternion:
        return ("w", "x", "y", "z")
    return {1: ("",), 3: ("x", "y", "z")}.get(count, tuple(str(k + 1) for k in range(count)))


def _panel(
    axes: Any, name: str, parts: list[tuple[np.ndarray, tuple[tuple[str, ...], np.ndarray]]]
) -> None:
    for ts, (labels, values) in parts:
        style = (
            {"linewidth": 1.3, "alpha": 1.0}
            if len(values) == 1
            else {"linewidth": 0.7, "alpha": 0.5}
        )
        for k, label in list(enumerate(labels))[:MOST_LINES]:
            for t, y in zip(ts, values[:, :, k], strict=True):
                axes.plot(
                    t,
                    _broken(y) if name.endswith(EULER_SUFFIX) else y,
                    color=COLOURS[k],
                    label=label,
                    **style,
                )
    handles, labels = axes.get_legend_handles_labels()
    first = dict(zip(reversed(labels), reversed(handles), strict=True))
    shown = [label for label in dict.fromkeys(labels) if label]
    if shown:
        lines = axes.legend(
            [first[label] for label in shown],
            shown,
            fontsize=8,
            loc="center left",
            bbox_to_anchor=(1.0, 0.5),
            frameon=False,
        )
        for line in lines.get_lines():
            line.set(alpha=1.0, linewidth=1.6)


def _broken(angle: np.ndarray) -> np.ndarray:
    """Degrees with a gap where the angle leaps over the half turn, instead of a line across the
    panel."""
    leap = np.abs(np.diff(angle, prepend=angle[:1])) > 180.0
    return np.where(leap, np.nan, angle)


def _bounds(panels: Any, times: list[np.ndarray], names: tuple[str, ...]) -> None:
    """A line at every end of a phase (of the first run), and the names of the phases above the
    first panel."""
    if len(times) < 2:
        return
    for ts, name in zip(times, names, strict=True):
        start, end = ts[0, 0], ts[0, -1]
        panels[0].annotate(
            name,
            (0.5 * (start + end), 1.0),
            (0, 3),
            ("data", "axes fraction"),
            textcoords="offset points",
            ha="center",
            fontsize=9,
        )
        for axes in panels:
            if ts is not times[-1]:
                axes.axvline(end, color="#707070", linewidth=0.9, linestyle="--")
