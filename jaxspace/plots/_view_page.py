"""An animated page of a run: body, wheels and orbit in three dimensions, with their traces."""

import os
import tempfile
import webbrowser
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, PyTree

from ..core import InputError
from ..core.record import Record
from ..rotations import Quaternion
from ._page_script import page_script
from ._refinement import LINE, TURNING, Drawn, Rows, Shown, thinned
from ._resolution import TURN, resolved
from ._view_flight import burns, planet_lines, readings
from ._view_shapes import Face, faces_of, top_faces, wheel_faces

if TYPE_CHECKING:
    from ..core import AbstractSystem, State
    from ..simulation import MissionTrajectory, Trajectory

HERE = Path(__file__).parent
MOST_FRAMES = 10_000
"""Frames of a page: more make it slow to load and to draw."""
ERRORS = (1.0, 3.0, 8.0)
"""Errors of the lines between frames that are tried in this order, in parts of `LINE`."""
LINES = ("position", "axis", "rate", "mass")
"""Blocks of the frames that lines show, besides the numbers by the clock."""
FLIGHT = {"velocity", "mass", "direction"}
"""Blocks of the frames that only the numbers by the clock need."""
PLACE = {"direction": "position"}
"""Blocks of states that are shown as a position."""
NAMES = {"axis": "body axis z", "rate": "angular velocity", "momentum": "angular momentum"}
SIGNS = {"orbit": "path", "axis": "z", "rate": "ω", "momentum": "H"}
"""Labels of the controls and arrow tips: short, so that the controls fit on one line."""
LENGTHS = {"axis": 1.3, "rate": 1.5, "momentum": 1.75}
"""Lengths of the arrows, in half-lengths of the body: beyond it, and so that collinear ones are
visible."""
SPEEDS = {"0.1": "1/10", "0.25": "1/4", "0.5": "1/2", "1": "1", "2": "2", "4": "4", "10": "10"}


def view_page(
    trajectory: "Trajectory | MissionTrajectory",
    path: str | os.PathLike[str],
    *,
    planet_radius: float | None = None,
    title: str = "",
) -> Path:
    """Write a page that plays a run in three dimensions; it needs no network.

    It shows the position with its orbit, the attitude as the homogeneous body of the same moments
    of inertia (a box, a cylinder, a top), the wheels of effects that provide their `speeds`, and
    the sun of an effect that provides its path as `sun`, from which the light then comes; next to
    the clock altitude and speed; in another colour the powered part of the trajectory. The planet
    has its graticule, and the Earth its coasts: the run has no date, so Greenwich is along X at t =
    0. Drag to look from elsewhere. The view interpolates between frames that are close enough for a
    line between them: where the saved times are not, the run is evaluated between them, by its
    closed form, by its steps (`dense=True`), or by repeating it. For a motion that requires more
    than 10,000 frames, such as a spin of many thousand turns, the page shows the frames only, with
    a note. It also reports motion that is too fast to display at the playback speed.

    **Arguments**

    - `trajectory`: of one run (`run.of(0)` of a batch), or a mission, whose phases follow one
      another.
    - `path`: of the HTML file.
    - `planet_radius`: of the body at the origin, m. If left out, and something attracts (has a
      `mu`), the radius that an effect states (`ground`), or a third of the closest distance.
    - `title`: of the page.

    **Returns** the path.

    **Raises** `InputError` for a batch, where the states have neither position nor attitude, and
    for a closed loop, which cannot be repeated, that was saved at too few times.
    """
    data = _data(trajectory, planet_radius)
    boxes = [
        f'<label title="{words}"><input type=checkbox value={name} checked '
        f'aria-label="{words}"> {SIGNS[name]}</label>'
        for name, words in _traces(data).items()
    ]
    if data["position"] and data["attitude"]:
        boxes.insert(
            0,
            "<select id=near aria-label='view'><option value=orbit>whole path"
            "<option value=body>body</select>",
        )
    speeds = "".join(
        f"<option value={v}{' selected' * (v == '1')}>{w} x</option>" for v, w in SPEEDS.items()
    )
    page = f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{escape(title or "jaxspace")}</title><style>
{(HERE / "_view.css").read_text(encoding="utf-8")}</style></head><body>
{f"<h1>{escape(title)}</h1>" if title else ""}
<canvas id="view" role="img" aria-label="the run in three dimensions"></canvas>
<p id="note" role="status"></p>
<div id="controls"><button id="play">Play</button><span id="clock"></span>
<span id="readings"></span>
<input id="time" type="range" min="0" max="1" step="0.0005" value="0" aria-label="time">
<select id="speed" aria-label="speed">{speeds}</select>
<span id="boxes">{"".join(boxes)}</span></div>
{page_script(data, "_view_objects", "_view")}</body></html>
"""
    path = Path(path)
    path.write_text(page, encoding="utf-8")
    return path


def show_run(
    trajectory: "Trajectory | MissionTrajectory",
    path: str | os.PathLike[str] | None = None,
    *,
    planet_radius: float | None = None,
    title: str = "",
) -> Path:
    """Write the page of `view_page`, and open it in the browser.

    **Arguments**

    - `trajectory`: of one run, or a mission.
    - `path`: of the HTML file; a temporary one if left out.
    - `planet_radius`, `title`: as in `view_page`.

    **Returns** the path.
    """
    if path is None:
        # Not removed: the browser reads it when this process may be gone.
        path = Path(tempfile.mkdtemp(prefix="jaxspace-")) / "run.html"
    page = view_page(trajectory, path, planet_radius=planet_radius, title=title)
    webbrowser.open(page.resolve().as_uri())
    return page


def _traces(data: Record) -> dict[str, str]:
    """Words for each trace that the page can show."""
    result = {name: words for name, words in NAMES.items() if name in data["traces"]}
    return {"orbit": "path", **result} if data["position"] else result


def _data(trajectory: "Trajectory | MissionTrajectory", planet: float | None) -> Record:
    """Data for the script of the page."""
    # By attributes: to import the classes would close a circle with `simulation`.
    # One place at a time: a branch has a page of its own.
    without: Any = getattr(trajectory, "without_branches", lambda: trajectory)
    line = without()
    # For a closed loop, which contains more.
    line = getattr(line, "trajectory", line)
    phases: Any = getattr(line, "phases", (line,))
    names = getattr(line, "names", ())
    if any(np.ndim(phase.status) for phase in phases):
        raise InputError("The page shows a single run: use run.of(0) for a batch.")
    if not any(_can_be_seen(phase.states) for phase in phases):
        raise InputError(
            "The states have neither a position nor an attitude: use run.plot() for time histories."
        )
    ground = _ground(phases[0].system) if planet is None else planet
    shown = jax.tree_util.Partial(seen_rows, ground)
    drawn = [_resolved(phase, shown) for phase in phases]
    parts = [_frames(phase.system, d.ts, d.states) for phase, d in zip(phases, drawn, strict=True)]
    # Blocks common to all phases; a block that begins later has no frames before.
    blocks = {name for name in parts[0] if all(name in part for part in parts)}
    joined = {name: np.concatenate([part[name] for part in parts], axis=-1) for name in blocks}
    if joined["times"][-1] < joined["times"][0]:
        # The clock of the page runs forwards.
        joined = {name: values[..., ::-1] for name, values in joined.items()}
    times = joined.pop("times")
    flight = {name: joined.pop(name) for name in FLIGHT & blocks}
    turned = _turned(times, joined)
    pick, coarse = _picked(times, joined | flight, turned, ground)
    coarse |= {PLACE.get(name, name) for d in drawn for name in d.coarse}
    rows = {name: _listed(values[..., pick]) for name, values in joined.items()}
    return {
        "times": times[pick].tolist(),
        "phases": [(float(phase.ts[0]), name) for phase, name in zip(phases, names, strict=False)]
        or None,
        "coarse": sorted(coarse & {"position", "attitude"} & rows.keys()),
        "turned": np.round(turned[pick], 3).tolist(),
        **_orbit(phases[0], joined, rows, planet),
        **_flight(joined | flight, ground, pick),
        **_body(phases[0], drawn[0], rows, times, pick),
        "sun": _sun(phases[0].system, times[pick]),
    }


def _can_be_seen(states: "State") -> bool:
    attitude = isinstance(getattr(states, "attitude", None), Quaternion)
    places = (getattr(states, name, None) for name in ("position", "direction"))
    return attitude or any(x is not None for x in places)


def _resolved(phase: "Trajectory", shown: Shown) -> Drawn:
    """The phase at times that show its motion. Raises `InputError` where it was saved at too few
    of them and cannot be repeated."""
    result = resolved(phase, shown=shown)
    # Too many points are thinned out, and said to be; too few cannot be.
    if result.coarse and len(result.ts) == len(phase.ts):
        raise InputError(
            f"The {len(phase.ts)} saved times do not resolve {', '.join(sorted(result.coarse))}, "
            "and a closed loop cannot be repeated without its controller: simulate it with more "
            "save times, such as ts=jnp.linspace(0.0, 100.0, 501), or num_saved=501 for a mission."
        )
    return result


def seen_rows(
    ground: float | None, _system: object, _t: object, state: "State"
) -> dict[str, PyTree]:
    """The values of one state for lines and numbers of the page, (components,)."""
    rows = _places(state)
    shown = readings(rows, ground, jnp)
    rows.pop("velocity", None)
    if getattr(state, "mass", None) is not None:
        rows["mass"] = state.mass
    attitude = getattr(state, "attitude", None)
    if isinstance(attitude, Quaternion):
        rows |= {TURNING: attitude.wxyz, "axis": attitude.matrix()[:, 2]}
        omega = getattr(state, "omega", None)
        if omega is not None:
            rows["rate"] = attitude.rotate(omega)
    return rows | shown


def _turned(times: np.ndarray, joined: Rows) -> np.ndarray:
    """The angle by which the body has turned at each time, rad, not less than by its rate."""
    turned = np.zeros(len(times))
    if "rate" in joined:
        rate = np.linalg.norm(joined["rate"], axis=0)
        # Also of states that come from elsewhere, whose equations are not known.
        turned[1:] = np.cumsum(np.fmax(rate[1:], rate[:-1]) * np.diff(times))
    return turned


def _picked(
    times: np.ndarray, blocks: Rows, turned: np.ndarray, ground: float | None
) -> tuple[np.ndarray, set[str]]:
    """Indices of the displayed times, and the quantities not resolved by lines between them."""
    rows = {name: blocks[name] for name in LINES if name in blocks}
    rows |= {name: x[None] for name, x in readings(blocks, ground).items()}
    if "attitude" in blocks:
        rows[TURNING] = blocks["attitude"]
    found = (thinned(times, rows, LINE * x, MOST_FRAMES, turned, TURN) for x in ERRORS)
    pick = next((x for x in found if x is not None), None)
    coarse = set()
    if pick is None:
        coarse.add("position")
        even = np.linspace(times[0], times[-1], MOST_FRAMES)
        pick = np.unique(np.searchsorted(times, even).clip(0, len(times) - 1))
    if np.any(np.diff(turned[pick]) > TURN):
        coarse.add("attitude")
    return pick, coarse


def _frames(system: "AbstractSystem", ts: ArrayLike, states: "State") -> dict[str, np.ndarray]:
    """The displayable blocks of the states, each (components, times), finite ones only."""
    result = {"times": np.asarray(ts)[None]}
    result |= {name: np.asarray(x) for name, x in _places(states).items()}
    mass = getattr(states, "mass", None)
    if "position" in result and mass is not None:
        result["mass"] = np.asarray(mass)[None]
    attitude = getattr(states, "attitude", None)
    if isinstance(attitude, Quaternion):
        result["attitude"] = _continuous(np.asarray(attitude.wxyz))
        result["axis"] = np.asarray(attitude.matrix())[:, 2]
        omega = getattr(states, "omega", None)
        if omega is not None:
            result["rate"] = np.asarray(attitude.rotate(omega))
            momentum = _momentum(system, ts, states)
            if momentum is not None:
                result["momentum"] = np.asarray(momentum)
    good = np.all([np.all(np.isfinite(x), axis=0) for x in result.values()], axis=0)
    result = {name: values[:, good] for name, values in result.items()}
    result["times"] = result["times"][0]
    return result


def _places(states: "State") -> dict[str, PyTree]:
    """Position, or the direction that is shown as one, and velocity, where the states have them."""
    direction = getattr(states, "direction", None)
    if direction is not None:
        return {"position": direction, "direction": direction}
    position = getattr(states, "position", None)
    if position is None:
        return {}
    velocity = getattr(states, "velocity", None)
    return {"position": position, **({} if velocity is None else {"velocity": velocity})}


def _continuous(wxyz: np.ndarray) -> np.ndarray:
    """Choose the sign of each quaternion that brings it closest to the one before."""
    # The page interpolates: between q and -q, one attitude, it would show a turn.
    jumps = np.where(np.sum(wxyz[:, 1:] * wxyz[:, :-1], axis=0) < 0.0, -1.0, 1.0)
    return wxyz * np.concatenate([[1.0], np.cumprod(jumps)])


def _momentum(system: PyTree, ts: ArrayLike, states: PyTree) -> Array | None:
    """The angular momentum of the rotating body, (3, times); `None` where it is unknown: with
    wheels and other parts the system provides it if only they change that of the body."""
    if not getattr(states, "parts", None):
        inertia = _inertia(system, states)
        return None if inertia is None else states.attitude.rotate(inertia.times(states.omega))
    invariants = jax.vmap(system.invariants, in_axes=(0, -1), out_axes=-1)(jnp.asarray(ts), states)
    return invariants.get("rotational_momentum")


def _inertia(system: PyTree, states: PyTree) -> PyTree:
    """The inertia of the rotating body, at the masses of the states; `None` where the system has
    none."""
    body = getattr(system, "body", system)
    if getattr(body, "has_inertia", lambda: False)():
        return body.inertia(getattr(states, "mass", None))
    result = getattr(system, "inertia", None)
    return result if hasattr(result, "times") else None


def _orbit(phase: "Trajectory", blocks: dict, rows: dict, planet: float | None) -> Record:
    """The path, and the object at the origin."""
    if "position" not in blocks:
        return {"position": None}
    distance = np.linalg.norm(blocks["position"], axis=0)
    system = phase.system
    attracts = any(hasattr(x, "mu") for x in (system, *getattr(system, "effects", ())))
    ground = _ground(system) if planet is None else planet
    fallback = float(np.min(distance)) / 3.0 if ground is None else ground
    radius = fallback if attracts or planet is not None else 0.0
    return {
        "position": rows["position"],
        "extent": float(np.max(distance)),
        "planet": radius,
        **planet_lines(phase, radius),
        # A system that is a body of a radius, such as a rolling disk, is drawn as large as it is.
        "size": float(getattr(system, "radius", 0.0)),
        "rod": getattr(phase.states, "direction", None) is not None,
    }


def _ground(system: object) -> float | None:
    """The radius of the ground that an effect states, m: one that is meant above it knows."""
    effects = getattr(system, "effects", ())
    grounds = [g for x in effects if (g := getattr(x, "ground", lambda: None)()) is not None]
    return float(np.max(grounds)) if grounds else None


def _flight(joined: Rows, ground: float | None, pick: np.ndarray) -> Record:
    """Altitude and speed at the frames, and where propellant leaves."""
    shown = readings(joined, ground)
    lit = burns(joined["mass"][0][pick] if "mass" in joined else None)
    return {
        "readings": {name: _listed(values[None, pick]) for name, values in shown.items()},
        "burns": None if lit is None else lit.astype(int).tolist(),
    }


def _body(
    phase: "Trajectory", drawn: Drawn, rows: dict, times: np.ndarray, pick: np.ndarray
) -> dict:
    """The body with its wheels, and the traces of its vectors, each in units of its greatest."""
    if "attitude" not in rows:
        return {"attitude": None, "traces": {}, "faces": [], "wheels": [], "reach": 1.2}
    traces = {}
    for name in NAMES:
        if name in rows:
            vectors = np.asarray(rows[name])
            size = np.max(np.linalg.norm(vectors, axis=1))
            # The vectors of a body at rest have no size to divide by.
            traces[name] = _listed((LENGTHS[name] / (size or 1.0) * vectors).T)
    faces = _faces(phase)
    wheels = _wheels(phase.system, drawn, times, pick)
    corners = [point for face in faces for point in face["points"]]
    for k, wheel in enumerate(wheels):
        along = np.asarray(wheel["axis"])
        # Outside of the body, where it is seen.
        wheel["at"] = ((np.max(corners @ along) + 0.1) * along).tolist()
        faces += wheel_faces(k, along)
    reach = {"reach": 1.9, "faces": faces, "wheels": wheels, "traces": traces, "names": SIGNS}
    # A top is on the ground.
    reach["ground"] = hasattr(phase.system, "weight_moment")
    return (
        {"attitude": rows["attitude"], "extent": 1.9, **reach}
        if "position" not in rows
        else {"attitude": rows["attitude"], **reach}
    )


def _sun(system: object, times: np.ndarray) -> list | None:
    """The directions of the sun from the origin at the times; `None` where no effect states it."""
    paths = [effect.sun for effect in getattr(system, "effects", ()) if hasattr(effect, "sun")]
    if not paths:
        return None
    place = np.asarray(jax.vmap(paths[0], out_axes=-1)(jnp.asarray(times)))
    return _listed(place / np.linalg.norm(place, axis=0))


def _faces(phase: PyTree) -> list[Face]:
    """The shape of the body from its inertia; a top on its tip; a box if nothing is known."""
    if hasattr(phase.system, "weight_moment"):
        return top_faces()
    inertia = _inertia(phase.system, phase.initial)
    if hasattr(phase.system, "axial_inertia") and hasattr(phase.system, "transverse_inertia"):
        across = float(phase.system.transverse_inertia)
        return faces_of(np.array([across, across, float(phase.system.axial_inertia)]), np.eye(3))
    if inertia is None:
        return faces_of(np.array([2.0, 3.0, 4.0]), np.eye(3))
    tensor = np.asarray(inertia.matrix(), float)
    # A diagonal tensor preserves the order of its axes, which `eigh` would sort.
    if np.allclose(tensor, np.diag(np.diag(tensor)), rtol=0.0, atol=1e-9 * np.max(tensor)):
        return faces_of(np.diag(tensor), np.eye(3))
    return faces_of(*np.linalg.eigh(tensor))


def _wheels(system: object, drawn: Drawn, times: np.ndarray, pick: np.ndarray) -> list[Record]:
    """Axis, place and angle of every wheel of the effects that state the speeds of wheels."""
    result = []
    for effect in getattr(system, "effects", ()):
        # Speeds belong to the states of one phase: of more phases the frames are others.
        if not hasattr(effect, "speeds") or len(drawn.ts) != len(times):
            continue
        speeds = np.asarray(effect.speeds(drawn.states))
        axes = np.asarray(effect.axes).reshape(3, -1)
        # The state has no angle of a wheel: by the trapezoidal rule, for the eye alone.
        mean = 0.5 * (speeds[:, 1:] + speeds[:, :-1]) * np.diff(times)
        angles = np.cumsum(np.concatenate([np.zeros((len(speeds), 1)), mean], axis=1), axis=1)
        for axis, angle in zip(axes.T, angles, strict=True):
            along = axis / np.linalg.norm(axis)
            result.append({"axis": along.tolist(), "angle": np.round(angle[pick], 3).tolist()})
    return result


def _listed(values: np.ndarray) -> list:
    """(components, times) as a list of times, to six digits of the greatest."""
    size = np.max(np.abs(values), initial=0.0)
    decimals = 5 - int(np.floor(np.log10(size))) if size > 0.0 else 6
    return np.round(values.astype(float), decimals).T.tolist()
