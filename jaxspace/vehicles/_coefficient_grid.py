"""Full grid with slopes for an `AerodynamicTable`, from the columns of a table.

Rows may come in any order. Transverse coefficients are divided by sin(alpha), with limits at 0 and
pi from the even parabola through the next two angles. The slopes along the angle are those of an
even function, along the roll those of a periodic one.
"""

from collections.abc import Mapping

import numpy as np

from ..core import InputError, check
from ..core.hermite import monotone_slopes
from ._aerodynamic_file import COEFFICIENTS

AXES = ("mach", "angle", "roll", "reynolds")
UNITS = {"mach": "", "angle": " rad", "roll": " rad", "reynolds": ""}
# Coefficients that the parts of an airframe do not give.
AXIAL = ("axial", "axial_burning")
# Coefficients that are stored without a division by sin(alpha).
PLAIN = ("roll_moment", "pitch_damping", "roll_damping")


def on_grid(
    columns: Mapping[str, np.ndarray], name: str
) -> tuple[dict[str, np.ndarray], tuple[str, ...], np.ndarray]:
    """The nodes of each axis, the names of the numbers, and these with their slopes in the form of
    `product`, (points, numbers).

    Arguments and errors as those of `AerodynamicTable.of_columns`."""
    axes, grid = _grid(dict(columns), name)
    names, values = _stored(axes["angle"], grid, name)
    # The last axis first, as `product` has them.
    for key in reversed(AXES):
        if axes[key].size > 1:
            values = np.concatenate([values, _slopes(axes, key, values, name)], axis=-1)
    return axes, names, values.reshape(-1, values.shape[-1])


def _grid(
    columns: dict[str, np.ndarray], name: str
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """The nodes of each axis, and the coefficients on the grid, (machs, angles, rolls, ...)."""
    if "mach" not in columns:
        raise InputError(f"{name} has no column of Mach numbers.")
    known = [key for key in columns if key in COEFFICIENTS]
    if not known:
        raise InputError(f"{name} has no coefficients: it must have some of {list(COEFFICIENTS)}.")
    columns = {key: np.asarray(columns[key], float) for key in (*AXES, *known) if key in columns}
    for key, x in columns.items():
        check(x.shape == columns["mach"].shape, f"{name}: {key}", x.size, "as long as mach")
        check(np.isfinite(x), f"{name}: {key}", x, "finite")
    check(columns["mach"] >= 0.0, f"{name}: mach", columns["mach"], "zero or positive")
    columns, given = _folded(columns, name)
    axes = {key: np.zeros(1) for key in AXES}
    place = np.zeros(columns["mach"].size, int)
    shape = []
    for key in AXES:
        if key in given:
            axes[key], number = np.unique(columns[key], return_inverse=True)
            # The number of the point in the grid, the last axis fastest.
            place = place * axes[key].size + number
        shape.append(axes[key].size)
    # Every point once: a hole or a repetition would shift all that follows.
    count = np.bincount(place, minlength=int(np.prod(shape)))
    if np.any(count != 1):
        wrong = int(np.argmax(count != 1))
        at = np.unravel_index(wrong, shape)
        place_of = {key: axes[key][k] for key, k in zip(AXES, at, strict=True)}
        point = ", ".join(f"{key} {place_of[key]:.6g}{UNITS[key]}" for key in given)
        raise InputError(
            f"{name} has {count[wrong]} rows for {point}: it must have one for each point of the "
            f"grid."
        )
    order = np.argsort(place)
    return axes, {key: columns[key][order].reshape(shape) for key in known}


def _folded(columns: dict[str, np.ndarray], name: str) -> tuple[dict[str, np.ndarray], list[str]]:
    """The rows and the axes that count: no negative angles, and no number that follows from the
    others, as the Reynolds number of one height does."""
    if "angle" in columns:
        check(
            np.abs(columns["angle"]) <= np.pi * (1 + 1e-6),
            f"{name}: angle",
            columns["angle"],
            "at most pi rad",
        )
        # Negative angles are the other side of the plane of the flow, which the roll covers.
        ahead = columns["angle"] >= 0.0
        columns = {key: x[ahead] for key, x in columns.items()}
        # Rounded degrees may be beyond half a turn.
        columns["angle"] = np.minimum(columns["angle"], np.pi)
    given = [key for key in AXES if key in columns and np.unique(columns[key]).size > 1]
    if "mach" not in given:
        raise InputError(
            f"{name} has {np.unique(columns['mach']).size} Mach numbers: it must have two or more."
        )
    if "reynolds" in given:
        check(columns["reynolds"] > 0.0, f"{name}: reynolds", columns["reynolds"], "positive")
        rest = [columns[key] for key in given if key != "reynolds"]
        # One Reynolds number for each point follows from the height at which the table was made.
        if np.unique(np.stack(rest), axis=1).shape[1] == columns["mach"].size:
            given.remove("reynolds")
    return columns, given


def _stored(
    angle: np.ndarray, grid: dict[str, np.ndarray], name: str
) -> tuple[tuple[str, ...], np.ndarray]:
    """Names and values of the numbers of a table, (machs, angles, rolls, reynolds, numbers)."""
    grid = _in_body_axes(angle, grid, name)
    # Before the force across the axis, which may come from drag and lift alone.
    result = {key: grid[key] for key in AXIAL if key in grid} | _across(angle, grid, name)
    result |= {key: grid[key] for key in PLAIN if key in grid}
    result = _without_roll_at_ends(angle, result)
    return tuple(result), np.stack(list(result.values()), axis=-1)


def _in_body_axes(
    angle: np.ndarray, grid: dict[str, np.ndarray], name: str
) -> dict[str, np.ndarray]:
    """The coefficients with C_A, motor on and off, and C_N in place of drag and lift."""
    grid = dict(grid)
    a = angle[:, None, None]
    s, c = np.sin(a), np.cos(a)
    # A table that has both is taken by its C_A: drag and lift then follow from it.
    if "axial" not in grid and "drag" in grid:
        if "lift" not in grid and angle.size > 1:
            raise InputError(f"{name} has a drag but no lift: it must have both, or C_A and C_N.")
        lift = grid.get("lift", 0.0 * grid["drag"])
        grid["axial"] = grid["drag"] * c - lift * s
        if "drag_burning" in grid:
            grid["axial_burning"] = grid["drag_burning"] * c - lift * s
        if "lift" in grid:
            # Axes of the flow turned by alpha into those of the body.
            grid["normal"] = grid["drag"] * s + lift * c
    if "axial" not in grid and "axial_burning" not in grid:
        raise InputError(f"{name} has neither an axial force nor a drag: it must have one of them.")
    if "axial" not in grid:
        grid["axial"] = grid["axial_burning"]
    # The jet fills the base, whose share of the drag is gone while the motor burns.
    if "axial_burning" not in grid and "base" in grid:
        grid["axial_burning"] = grid["axial"] - grid["base"]
    return grid


def _across(angle: np.ndarray, grid: dict[str, np.ndarray], name: str) -> dict[str, np.ndarray]:
    """Transverse coefficients over sin(alpha): the normal force with its moment or its lever, and
    the side force with its moment."""
    result = {}
    slope = grid.get("normal_slope")
    normal = slope
    # At a single angle of zero the force itself is zero: only the slope is available.
    if "normal" in grid and (angle.size > 1 or slope is not None):
        normal = _over_sine(angle, grid["normal"], slope)
    if normal is not None:
        result["normal"] = normal
        if "pitch" in grid:
            result["pitch"] = _over_sine(angle, grid["pitch"])
        elif "centre" in grid:
            # A product, and no centre: where the normal force vanishes its centre does not exist.
            result["lever"] = -normal * grid["centre"]
        else:
            raise InputError(
                f"{name} has a normal force and neither its centre nor a moment: it must have one."
            )
    return result | {key: _over_sine(angle, grid[key]) for key in ("side", "yaw") if key in grid}


def _without_roll_at_ends(
    angle: np.ndarray, numbers: dict[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """The numbers with their mean over the roll at the angles 0 and pi, where no roll is defined:
    they must not depend on it there."""
    result = {key: x.copy() for key, x in numbers.items()}
    for k in (0, -1):
        if angle.size == 1 or 0.0 < angle[k] < np.pi:
            continue
        for key, x in numbers.items():
            # The last roll is the first one again.
            turn = x[:, k, : max(x.shape[2] - 1, 1)]
            result[key][:, k] = turn.mean(axis=1, keepdims=True)
    return result


def _over_sine(angle: np.ndarray, x: np.ndarray, ahead: np.ndarray | None = None) -> np.ndarray:
    """Coefficient across the axis over sin(alpha): at 0 and pi its limit, by the even parabola
    through the two next angles, or from the slope `ahead`, 1/rad."""
    singular = (angle == 0.0) | (angle == np.pi)
    result = x / np.where(singular, 1.0, np.sin(angle))[:, None, None]
    for k, step in ((0, 1), (-1, -1)):
        if not singular[k]:
            continue
        if k == 0 and ahead is not None:
            result[:, 0] = ahead[:, 0]
        elif angle.size < 3:
            result[:, k] = result[:, k + step]
        else:
            near, far = ((angle[k + j * step] - angle[k]) ** 2 for j in (1, 2))
            one, two = result[:, k + step], result[:, k + 2 * step]
            result[:, k] = one - (two - one) * near / (far - near)
    return result


def _slopes(axes: dict[str, np.ndarray], key: str, values: np.ndarray, name: str) -> np.ndarray:
    """The slopes of all numbers along one axis."""
    along = AXES.index(key)
    x = axes[key]
    y = np.moveaxis(values, along, 0)
    if key == "reynolds":
        x = np.log(x)
    low = high = 0
    if key == "roll":
        period = x[-1] - x[0]
        check(
            np.abs(y[-1] - y[0]) <= 1e-6 * np.max(np.abs(y)),
            f"{name}: the last roll",
            x[-1],
            "a period behind the first one, with the same coefficients",
        )
        # One point beyond each end, so that the slopes there are those of a periodic function.
        x = np.concatenate([[x[-2] - period], x, [x[1] + period]])
        y = np.concatenate([y[-2:-1], y, y[1:2]])
        low = 1
        high = 1
    if key == "angle" and x[0] == 0.0:
        # Mirrored, because all that is stored is even about zero: its slope there vanishes.
        x = np.concatenate([[-x[1]], x])
        y = np.concatenate([y[1:2], y])
        low = 1
    if key == "angle" and x[-1] == np.pi:
        # Even about half a turn, too.
        x = np.append(x, 2.0 * np.pi - x[-2])
        y = np.concatenate([y, y[-2:-1]])
        high = 1
    d = np.asarray(monotone_slopes(x, y))
    return np.moveaxis(d[low : d.shape[0] - high], 0, along)
