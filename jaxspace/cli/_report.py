"""What the commands print: states, orbits, tables, in an analyst's units."""

import math
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from ..bodies import BodyState
from ..core import State
from ..dispersion import Dispersion
from ..gyros import GimbalState
from ..io import SceneFile
from ..orbits import apoapsis_radius, inclination, periapsis_radius
from ..rotations import to_euler_angles
from ..simulation import Status

DEGREE, RPM, KM = math.pi / 180.0, math.pi / 30.0, 1000.0


def columns(rows: Sequence[Sequence[str]]) -> str:
    """Rows as aligned columns: the first to the left, the others to the right."""
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    lines = []
    for row in rows:
        cells = [
            cell.ljust(w) if k == 0 else cell.rjust(w)
            for k, (cell, w) in enumerate(zip(row, widths, strict=True))
        ]
        lines.append("  ".join(cells).rstrip())
    return "\n".join(lines)


def number(x: Any) -> str:
    """A number to six significant digits, zero without a tail of rounding."""
    x = float(x)
    return "0" if abs(x) < 1e-10 else f"{x:.6g}"


def numbers(xs: Any) -> str:
    """Several numbers in a row."""
    return ", ".join(number(x) for x in np.asarray(xs).reshape(-1))


def state_rows(y: State) -> list[tuple[str, str]]:
    """Names with units, and values, of the parts of a state."""
    if isinstance(y, GimbalState):
        return [
            ("theta, psi [deg]", numbers(np.array([y.theta, y.psi]) / DEGREE)),
            ("theta rate [deg/s]", number(y.theta_rate / DEGREE)),
            ("angular momentum [kg m^2/s]", number(y.angular_momentum)),
        ]
    assert isinstance(y, BodyState)
    rows = []
    if y.position is not None and y.velocity is not None:
        rows += [
            ("position [km]", numbers(y.position / KM)),
            ("velocity [km/s]", numbers(y.velocity / KM)),
        ]
    if y.attitude is not None and y.omega is not None:
        rows += [
            ("quaternion", numbers(y.attitude.wxyz)),
            ("Euler angles 3-1-3 [deg]", numbers(to_euler_angles(y.attitude) / DEGREE)),
            ("angular velocity [rpm]", numbers(y.omega / RPM)),
        ]
    return rows if y.mass is None else [*rows, ("mass [kg]", number(y.mass))]


def orbit_rows(file: SceneFile, y: State) -> list[tuple[str, str]]:
    """The size and the inclination of the orbit, where the file says of what."""
    planet = file.values.get("planet") or file.values.get("system", {})
    if not isinstance(y, BodyState) or y.position is None or planet.get("mu") is None:
        return []
    mu, radius = float(planet["mu"]), planet.get("radius")
    apsides = [f(y.position, y.velocity, mu) / KM for f in (periapsis_radius, apoapsis_radius)]
    rows = [("radii of the apsides [km]", numbers(apsides))]
    if radius is not None:
        rows.append(
            ("altitudes of the apsides [km]", numbers([a - float(radius) / KM for a in apsides]))
        )
    return [*rows, ("inclination [deg]", number(inclination(y.position, y.velocity) / DEGREE))]


def error_rows(error: State) -> list[tuple[str, str]]:
    """The largest component of the estimated error of every part, in SI."""
    rows = []
    for path, leaf in jax.tree_util.tree_flatten_with_path(error)[0]:
        rows.append(
            (
                f"error of {jax.tree_util.keystr(path).strip('.')}",
                f"{float(np.max(np.abs(leaf))):.1e}",
            )
        )
    return rows


def drift_rows(drift: dict[str, Any]) -> list[tuple[str, str]]:
    """The largest relative change of every invariant."""
    return [
        (f"drift of {name.replace('_', ' ')}", f"{float(np.max(np.abs(d))):.1e}")
        for name, d in drift.items()
    ]


def dispersion_table(result: Dispersion, nominal: dict[str, Any]) -> str:
    """Mean, standard deviation and 99 % limits of every output, beside its nominal value."""
    rows: list[tuple[str, ...]] = [
        ("output", "unit", "nominal", "mean", "std dev", "0.5 %", "99.5 %")
    ]
    for row in result.table():
        own = number(np.asarray(nominal[row.name]).reshape(-1)[0])
        rows.append(
            (row.name, row.unit, own, *(number(x) for x in (row.mean, row.std, row.low, row.high)))
        )
    return columns(rows)


def contributor_lines(result: Dispersion, count: int = 3) -> str:
    """For every output the inputs that make most of its variance."""
    if np.count_nonzero(result.good) <= 2 * len(result.inputs) + 1:
        return ""
    rows = []
    for name in result.outputs:
        shares = result.contributors(name, count).shares
        rows.append(
            (
                name,
                ", ".join(
                    f"{path} {100.0 * share:.0f} %"
                    for path, share in shares.items()
                    if share >= 0.01
                ),
            )
        )
    width = max(len(name) for name, _ in rows)
    return "\n".join(
        f"{name.ljust(width)}  {text or 'no single contributor'}" for name, text in rows
    )


def status_lines(result: Dispersion) -> str:
    """How many runs ended well, and each bad end with its sentence."""
    lines = [f"{int(np.count_nonzero(result.good))} of {result.runs} runs ended well."]
    lines += [
        f"{f.count} {'run' if f.count == 1 else 'runs'} failed: {f.sentence}" for f in result.failed
    ]
    return "\n".join(lines)


def status_line(status: Any) -> str:
    """The sentence of a status."""
    return Status(int(status)).sentence
