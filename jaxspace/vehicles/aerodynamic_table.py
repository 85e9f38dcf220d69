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

Transverse coefficients are stored divided by sin(alpha). So stored it is even in the angle, and the
force is right and has a slope where the flow comes from ahead and no plane is defined. Between the
points all is cubic with a continuous slope (`hermite.py`): even about 0 and 180 degrees, and
periodic in the roll, whose last point is a period behind the first.

Beyond the greatest angle a of the table the force follows the components of the flow: C_N is
C_N(a) sin(alpha)/sin(a), and C_A is C_A(a) cos(alpha)/cos(a), or C_A(a) where a is above 84
degrees. It is bounded, and never a thrust. Beyond the Mach and Reynolds numbers the coefficients
stay as they are at the last one. `outside` indicates where this occurs.

Source: Zipfel, Modeling and Simulation of Aerospace Vehicle Dynamics, 6.2 and 8.2; Blake, Missile
DATCOM User's Manual, AFRL-VA-WP-TR-1998-3009, 3 (signs and reference lengths).
"""

__all__ = ["AerodynamicTable", "read_aerodynamics"]

import os
from collections.abc import Mapping, Sequence
from typing import final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import (
    AbstractParameters,
    FileName,
    Flag,
    NumberField,
    Scalar,
    argument,
    constructor,
    quantity,
)
from ..core.formula import POSITIVE, formula
from ..core.hermite import of_all_runs, product
from ..core.limits import Limit, any_passed
from ..core.types import as_float
from ._aerodynamic_file import read_columns
from ._coefficient_grid import AXES, AXIAL, on_grid
from .coefficient import MachTable

# Held by cos(alpha), which would divide by zero for a table that ends closer to 90 degrees.
STEEPEST = 0.1


@final
class AerodynamicTable(AbstractParameters):
    """Coefficients on a grid; `of_columns` and `read_aerodynamics` make it.

    - `mach`: nodes, ascending, of the Mach number.
    - `angle`, `roll`: nodes, rad, ascending, of the angle of attack and of the roll angle.
    - `reynolds`: nodes, ascending, of the natural logarithm of the Reynolds number.
    - `data`: coefficients and their slopes at each point of the grid, the last axis fastest.
    - `names`: of the coefficients.

    An axis with one node means that nothing depends on it."""

    mach: Float[Array, "machs *#runs"] = eqx.field(converter=as_float)
    angle: Float[Array, "angles *#runs"] = eqx.field(converter=as_float)
    roll: Float[Array, "rolls *#runs"] = eqx.field(converter=as_float)
    reynolds: Float[Array, "reynolds *#runs"] = eqx.field(converter=as_float)
    data: Float[Array, "points numbers *#runs"] = eqx.field(converter=as_float)
    names: tuple[str, ...] = eqx.field(static=True)
    area: NumberField = quantity("m^2", positive=True, doc="A, the reference area")
    length: NumberField = quantity("m", positive=True, doc="L, the reference length")
    station: NumberField = quantity(
        "m",
        doc="z in construction axes of the reference point of centres and moments: the tip of the "
        "nose, or the moment reference",
    )

    @classmethod
    @constructor(
        sets=("mach", "angle", "roll", "reynolds", "data", "names"),
        file=FileName("of coefficients: CSV with the columns of RASAero, OpenRocket or DATCOM"),
        area=argument("m^2", positive=True, doc="A, the reference area"),
        length=argument("m", positive=True, doc="L, the reference length, mostly the diameter"),
        station=argument("m", doc="z of the nose's tip, or of the moment reference of the file"),
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

        **Raises** `InputError` with the point that is missing or twice in the grid, or the value
        that no coefficient can have.
        """
        axes, names, data = on_grid(columns, name)
        mach, angle, roll, reynolds = (jnp.asarray(axes[key]) for key in AXES)
        # Over the logarithm, because friction follows that.
        reynolds = jnp.log(reynolds) if reynolds.size > 1 else reynolds
        return cls(mach, angle, roll, reynolds, jnp.asarray(data), names, area, length, station)

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
            # A table may begin anywhere, as at -90 degrees.
            first = nodes["roll"][0]
            period = nodes["roll"][-1] - nodes["roll"][0]
            # Into the period that the table covers; the derivative by the roll stays one.
            point["roll"] = roll - period * jnp.floor((roll - first) / period)
        place = [point[key] for key in active]
        result = product([nodes[key] for key in active], self.data, place)
        numbers = {name: result[k] for k, name in enumerate(self.names)}
        for name in AXIAL:
            if name in numbers:
                numbers[name] = numbers[name] * self._turned(angle)
        return numbers

    def ahead(self, burning: bool) -> MachTable:
        """C_A by the Mach number at zero angle of attack, with the motor on or off."""
        # Of the least one, at which friction is greatest; on the axis no roll is defined.
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
        """Factor of the axial coefficients beyond the greatest angle: the flow along the axis
        turns about, and so does its force."""
        greatest = of_all_runs(self.angle)[-1]
        last = jnp.cos(greatest)
        steep = last < STEEPEST
        # The divisor is one where the ratio is not taken: a quotient by zero would have no
        # derivative.
        ratio = jnp.cos(angle) / jnp.where(steep, 1.0, last)
        return jnp.where(steep | (angle <= greatest), 1.0, ratio)

    def outside(self, mach: Scalar, angle: Scalar, reynolds: Scalar = 1.0) -> Flag:
        """Whether a point is beyond the Mach numbers, the angles or the Reynolds numbers of the
        table, where coefficients are held. Slower than the least Mach number counts as inside."""
        passed = any_passed(self.limits(mach, angle, reynolds))
        return jnp.zeros(jnp.shape(mach), bool) if passed is None else passed

    def limits(self, mach: Scalar, angle: Scalar, reynolds: Scalar = 1.0) -> Sequence[Limit]:
        """The largest Mach number, angle of attack, rad, and Reynolds number of the table, as far
        as it depends on them."""
        rows = [
            ("the Mach number", "", self.mach, mach),
            ("the angle of attack", "rad", self.angle, angle),
            ("the Reynolds number", "", jnp.exp(self.reynolds), reynolds),
        ]
        return [
            Limit(name, unit, x, high=of_all_runs(nodes)[-1])
            for name, unit, nodes, x in rows
            if nodes.shape[0] > 1
        ]


@formula(area=POSITIVE, length=POSITIVE)
def read_aerodynamics(
    path: str | os.PathLike[str], *, area: Scalar, length: Scalar, station: Scalar
) -> AerodynamicTable:
    """The table of a CSV file, by the names of its columns.

    **Arguments**

    - `path`: of the file, at most 64 MB (`_aerodynamic_file` has the formats).
    - `area`: reference area, m^2; `length`: reference length, m, mostly the diameter.
    - `station`: z in construction axes, m: of the nose's tip, behind which a centre of pressure
      counts, or of the point about which the moments of the file are.

    **Raises** `InputError` with the file and its row for an invalid number, a missing column, or a
    missing or duplicate grid point; `OSError` for a file that cannot be opened.
    """
    return AerodynamicTable.of_file(path, area, length, station)
