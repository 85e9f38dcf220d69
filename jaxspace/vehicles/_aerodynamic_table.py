"""Coefficients of the air on a rocket by Mach number, angle of attack, roll and Reynolds number.

    key              coefficient, made dimensionless by rho/2 |w|^2 A (and by L)         sign
    axial            C_A of the motor off                                                backwards
    axial_burning    C_A of the motor on, whose jet fills the base                       backwards
    base             share of the base in C_A; C_A - C_base where `axial_burning` lacks  backwards
    drag, lift       C_D, C_L in place of `axial` and `normal`; drag_burning alike       flow
    normal           C_N, in the plane of the angle of attack                            to the lee
    normal_slope     its slope at zero angle, 1/rad
    centre           distance of the centre of pressure behind the station, m
    pitch            C_m about the station, in place of `centre`                         nose to lee
    side, yaw        C_Y across the plane, C_n about the station                         right
    roll_moment      C_l about the axis                                                  about +z
    pitch_damping    C_mq (+ C_m alpha rate), by omega L/(2 |w|)                         < 0 damps
    roll_damping     C_lp, by omega_z L/(2 |w|)                                          < 0 damps

What acts across the axis is stored over sin(alpha). So stored it is even in the angle, and the
force is right and has a slope where the flow comes from ahead and no plane is defined. Between the
points all is cubic with a continuous slope (`_hermite.py`): even about 0 and 180 degrees, and
periodic in the roll, whose last point is a period behind the first.

Beyond the greatest angle a of the table the force follows the components of the flow: C_N is
C_N(a) sin(alpha)/sin(a), and C_A is C_A(a) cos(alpha)/cos(a), or C_A(a) where a is above 84
degrees. It is bounded, and never a thrust. Beyond the Mach and Reynolds numbers the coefficients
stay as they are at the last one. `outside` says where that is.

Source: Zipfel, Modeling and Simulation of Aerospace Vehicle Dynamics, 6.2 and 8.2; Blake, Missile
DATCOM User's Manual, AFRL-VA-WP-TR-1998-3009, 3 (signs and reference lengths).
"""

import os
from collections.abc import Mapping
from typing import final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import (
    AbstractParameters,
    FileName,
    Flag,
    InputError,
    Scalar,
    argument,
    check,
    constructor,
    quantity,
)
from ._aerodynamic_file import COEFFICIENTS, read_columns
from ._coefficient import MachTable
from ._hermite import monotone_slopes, of_all_runs, product

# What the parts of an airframe cannot give.
AXIAL = ("axial", "axial_burning")
# Stored as they are.
PLAIN = ("roll_moment", "pitch_damping", "roll_damping")
# Held by cos(alpha), which would divide by zero for a table that ends closer to 90 degrees.
STEEPEST = 0.1


@final
class AerodynamicTable(AbstractParameters):
    """Coefficients on a grid; `of_columns` and `read_aerodynamics` make it.

    The nodes of an axis with one point say that nothing depends on it."""

    mach: Float[Array, "machs *#runs"]
    angle: Float[Array, "angles *#runs"]
    roll: Float[Array, "rolls *#runs"]
    reynolds: Float[Array, "reynolds *#runs"]
    data: Float[Array, "points numbers *#runs"]
    names: tuple[str, ...] = eqx.field(static=True)
    area: Float[Array, "*#runs"] = quantity("m^2", positive=True, doc="A, the reference area")
    length: Float[Array, "*#runs"] = quantity("m", positive=True, doc="L, the reference length")
    station: Float[Array, "*#runs"] = quantity(
        "m",
        doc="z in construction axes of the point from which centres count and about which moments "
        "are: the tip of the nose, or the reference of the moments",
    )

    @classmethod
    @constructor(
        sets=("mach", "angle", "roll", "reynolds", "data", "names"),
        file=FileName("of coefficients: CSV with the columns of RASAero, OpenRocket or DATCOM"),
        area=argument("m^2", positive=True, doc="A, the reference area"),
        length=argument("m", positive=True, doc="L, the reference length, mostly the diameter"),
        station=argument(
            "m", doc="z of the nose's tip, or of the point about which the moments of the file are"
        ),
    )
    def of_file(
        cls, file: str | os.PathLike[str], area: Scalar, length: Scalar, station: Scalar
    ) -> "AerodynamicTable":
        """The table of a file; see `read_aerodynamics`."""
        columns = read_columns(file)
        return cls.of_columns(columns, area=area, length=length, station=station, name=str(file))

    @classmethod
    def of_columns(
        cls,
        columns: Mapping[str, np.ndarray],
        *,
        area: Scalar,
        length: Scalar,
        station: Scalar,
        name: str = "The table",
    ) -> "AerodynamicTable":
        """The table of equally long columns, a row for each point of a full grid, in any order.

        **Arguments**

        - `columns`: "mach"; "angle" and "roll", rad, and "reynolds", where the coefficients depend
          on them; and the coefficients by their key (see the top of this page).
        - `area`, m^2; `length`, m; `station`, m: to which they refer.
        - `name`: of the table, for errors.

        **Raises** `InputError` with the point that the grid lacks or has twice, or the value that
        no coefficient can have.
        """
        axes, grid = _grid(dict(columns), name)
        names, values = _stored(axes["angle"], grid, name)
        active = [key for key in AXES if len(axes[key]) > 1]
        # The last axis first, as `product` has them.
        for key in reversed(active):
            values = np.concatenate([values, _slopes(axes, key, values)], axis=-1)
        data = jnp.asarray(values.reshape(-1, values.shape[-1]))
        mach, angle, roll, reynolds = (jnp.asarray(axes[key]) for key in AXES)
        # Over the logarithm, because friction follows that.
        reynolds = jnp.log(reynolds) if reynolds.size > 1 else reynolds
        return cls(mach, angle, roll, reynolds, data, names, area, length, station)

    def at(
        self, mach: Scalar, angle: Scalar, roll: Scalar = 0.0, reynolds: Scalar = 1.0
    ) -> dict[str, Scalar]:
        """The coefficients that the table has, by name.

        **Arguments**

        - `mach`; `angle`: of attack, rad, from 0 to pi; `roll`: rad; `reynolds`: on L.

        **Returns** "normal", "pitch", "side" and "yaw" over sin(angle), all others as they are; of
        a table with centres "lever", m, the moment of "normal" about the station, for "pitch"."""
        point = {"mach": mach, "angle": angle, "roll": roll}
        nodes = {key: of_all_runs(getattr(self, key)) for key in AXES}
        active = [key for key in AXES if nodes[key].shape[0] > 1]
        if "reynolds" in active:
            # At rest the number is zero, and its logarithm none.
            least = jnp.exp(nodes["reynolds"][0])
            point["reynolds"] = jnp.log(jnp.where(reynolds > least, reynolds, least))
        if "roll" in active:
            first, period = nodes["roll"][0], nodes["roll"][-1] - nodes["roll"][0]
            point["roll"] = roll - period * jnp.floor((roll - first) / period)
        place = [point[key] for key in active]
        found = product([nodes[key] for key in active], self.data, place)
        numbers = {name: found[k] for k, name in enumerate(self.names)}
        for name in AXIAL:
            if name in numbers:
                numbers[name] = numbers[name] * self._turned(angle)
        return numbers

    def ahead(self, burning: bool) -> MachTable:
        """C_A by the Mach number at zero angle of attack, with the motor on or off."""
        reynolds = of_all_runs(self.reynolds)[0]
        numbers = self.at(
            self.mach,
            jnp.zeros_like(self.mach),
            of_all_runs(self.roll)[0],
            jnp.exp(reynolds),
        )
        key = "axial_burning" if burning and "axial_burning" in numbers else "axial"
        return MachTable(self.mach, numbers[key])

    def _turned(self, angle: Scalar) -> Scalar:
        """What multiplies the axial coefficients beyond the greatest angle: the flow along the axis
        turns about, and so does its force."""
        greatest = of_all_runs(self.angle)[-1]
        last = jnp.cos(greatest)
        steep = last < STEEPEST
        ratio = jnp.cos(angle) / jnp.where(steep, 1.0, last)
        return jnp.where(steep | (angle <= greatest), 1.0, ratio)

    def outside(self, mach: Scalar, angle: Scalar, reynolds: Scalar = 1.0) -> Flag:
        """Whether a point is beyond the Mach numbers, the angles or the Reynolds numbers of the
        table, where coefficients are held. Slower than the least Mach number counts as inside."""
        beyond = self._faster(self.mach, mach) | self._faster(self.angle, angle)
        return beyond | self._faster(jnp.exp(self.reynolds), reynolds)

    @staticmethod
    def _faster(nodes: Array, x: Scalar) -> Flag:
        return x > of_all_runs(nodes)[-1] if nodes.shape[0] > 1 else jnp.zeros(jnp.shape(x), bool)


AXES = ("mach", "angle", "roll", "reynolds")
UNITS = {"mach": "", "angle": " rad", "roll": " rad", "reynolds": ""}


def _grid(
    columns: dict[str, np.ndarray], name: str
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """The nodes of each axis, and the coefficients on the grid, (machs, angles, rolls, ...)."""
    if "mach" not in columns:
        raise InputError(f"{name} has no column of Mach numbers: it must have one.")
    known = [key for key in columns if key in COEFFICIENTS]
    if not known:
        raise InputError(f"{name} has no coefficient: it must have some of {list(COEFFICIENTS)}.")
    columns = {key: np.asarray(columns[key], float) for key in (*AXES, *known) if key in columns}
    for key, x in columns.items():
        check(x.shape == columns["mach"].shape, f"{name}: {key}", x.size, "as long as mach")
        check(np.isfinite(x), f"{name}: {key}", x, "finite")
    check(columns["mach"] >= 0.0, f"{name}: mach", columns["mach"], "zero or positive")
    columns, given = _folded(columns, name)
    axes = {key: np.zeros(1) for key in AXES}
    place, shape = np.zeros(columns["mach"].size, int), []
    for key in AXES:
        if key in given:
            axes[key], number = np.unique(columns[key], return_inverse=True)
            place = place * axes[key].size + number
        shape.append(axes[key].size)
    count = np.bincount(place, minlength=int(np.prod(shape)))
    if np.any(count != 1):
        wrong = int(np.argmax(count != 1))
        at = np.unravel_index(wrong, shape)
        point = ", ".join(
            f"{key} {axes[key][k]:.6g}{UNITS[key]}"
            for key, k in zip(AXES, at, strict=True)
            if key in given
        )
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
        # The other side of the plane, which the roll gives.
        ahead = columns["angle"] >= 0.0
        columns = {key: x[ahead] for key, x in columns.items()}
        columns["angle"] = np.minimum(columns["angle"], np.pi)
    given = [key for key in AXES if key in columns and np.unique(columns[key]).size > 1]
    if "mach" not in given:
        raise InputError(
            f"{name} has {np.unique(columns['mach']).size} Mach numbers: it must have two or more."
        )
    if "reynolds" in given:
        check(columns["reynolds"] > 0.0, f"{name}: reynolds", columns["reynolds"], "positive")
        rest = [columns[key] for key in given if key != "reynolds"]
        # One of them for each point: a number of the height at which the table was made.
        if np.unique(np.stack(rest), axis=1).shape[1] == columns["mach"].size:
            given.remove("reynolds")
    return columns, given


def _stored(
    angle: np.ndarray, grid: dict[str, np.ndarray], name: str
) -> tuple[tuple[str, ...], np.ndarray]:
    """Names and values of what a table holds, (machs, angles, rolls, reynolds, numbers)."""
    a = angle[:, None, None]
    s, c = np.sin(a), np.cos(a)
    if "axial" not in grid and "drag" in grid:
        if "lift" not in grid and angle.size > 1:
            raise InputError(f"{name} has a drag and no lift: it must have both, or C_A and C_N.")
        lift = grid.get("lift", 0.0 * grid["drag"])
        grid["axial"] = grid["drag"] * c - lift * s
        if "drag_burning" in grid:
            grid["axial_burning"] = grid["drag_burning"] * c - lift * s
        if "lift" in grid:
            grid["normal"] = grid["drag"] * s + lift * c
    if "axial" not in grid and "axial_burning" not in grid:
        raise InputError(f"{name} has no axial force and no drag: it must have one of them.")
    if "axial" not in grid:
        grid["axial"] = grid["axial_burning"]
    if "axial_burning" not in grid and "base" in grid:
        grid["axial_burning"] = grid["axial"] - grid["base"]
    found = {key: grid[key] for key in AXIAL if key in grid}
    slope = grid.get("normal_slope")
    if "normal" in grid and (angle.size > 1 or slope is not None):
        normal = _over_sine(angle, grid["normal"], None if slope is None else slope)
    else:
        normal = slope
    if normal is not None:
        found["normal"] = normal
        if "pitch" in grid:
            found["pitch"] = _over_sine(angle, grid["pitch"])
        elif "centre" in grid:
            found["lever"] = -normal * grid["centre"]
        else:
            raise InputError(
                f"{name} has a normal force and neither its centre nor a moment: it must have one."
            )
    for key in ("side", "yaw"):
        if key in grid:
            found[key] = _over_sine(angle, grid[key])
    found |= {
        key: grid[key] for key in ("roll_moment", "pitch_damping", "roll_damping") if key in grid
    }
    if angle[0] == 0.0:
        # Ahead of the flow no roll is defined: what is left of it there would be no function.
        for key, x in found.items():
            found[key] = x.copy()
            # The last roll is the first one again.
            turn = x[:, 0, : max(x.shape[2] - 1, 1)]
            found[key][:, 0] = turn.mean(axis=1, keepdims=True)
    return tuple(found), np.stack(list(found.values()), axis=-1)


def _over_sine(angle: np.ndarray, x: np.ndarray, ahead: np.ndarray | None = None) -> np.ndarray:
    """What acts across the axis, over sin(alpha): at 0 and pi its limit, by the even parabola
    through the two next angles, or from the slope `ahead`, 1/rad."""
    singular = (angle == 0.0) | (angle == np.pi)
    found = x / np.where(singular, 1.0, np.sin(angle))[:, None, None]
    for k, step in ((0, 1), (-1, -1)):
        if not singular[k]:
            continue
        if k == 0 and ahead is not None:
            found[:, 0] = ahead[:, 0]
        elif angle.size < 3:
            found[:, k] = found[:, k + step]
        else:
            near, far = ((angle[k + j * step] - angle[k]) ** 2 for j in (1, 2))
            one, two = found[:, k + step], found[:, k + 2 * step]
            found[:, k] = one - (two - one) * near / (far - near)
    return found


def _slopes(axes: dict[str, np.ndarray], key: str, values: np.ndarray) -> np.ndarray:
    """The slopes of all numbers along one axis."""
    along = AXES.index(key)
    x, y = axes[key], np.moveaxis(values, along, 0)
    if key == "reynolds":
        x = np.log(x)
    low = high = 0
    if key == "roll":
        period = x[-1] - x[0]
        check(
            np.abs(y[-1] - y[0]) <= 1e-6 * np.max(np.abs(y)),
            "roll",
            x[-1],
            "a period behind the first one, with the same coefficients",
        )
        x = np.concatenate([[x[-2] - period], x, [x[1] + period]])
        y, low, high = np.concatenate([y[-2:-1], y, y[1:2]]), 1, 1
    if key == "angle" and x[0] == 0.0:
        x, y, low = np.concatenate([[-x[1]], x]), np.concatenate([y[1:2], y]), 1
    if key == "angle" and x[-1] == np.pi:
        x, y, high = np.append(x, 2.0 * np.pi - x[-2]), np.concatenate([y, y[-2:-1]]), 1
    d = np.asarray(monotone_slopes(x, y))
    return np.moveaxis(d[low : d.shape[0] - high], 0, along)


def read_aerodynamics(
    path: str | os.PathLike[str], *, area: Scalar, length: Scalar, station: Scalar
) -> AerodynamicTable:
    """The table of a CSV file, by the names of its columns.

    **Arguments**

    - `path`: of the file, at most 64 MB (`_aerodynamic_file` has the formats).
    - `area`: reference area, m^2; `length`: reference length, m, mostly the diameter.
    - `station`: z in construction axes, m: of the nose's tip, behind which a centre of pressure
      counts, or of the point about which the moments of the file are.

    **Raises** `InputError` with the file and its row for what is no number, a missing column, or a
    point that the grid lacks or has twice.
    """
    return AerodynamicTable.of_file(path, area, length, station)
