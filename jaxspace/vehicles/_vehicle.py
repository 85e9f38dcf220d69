"""A rocket, described once, as a point that follows a steering law or as a rotating body.

    point   position, velocity, mass                      thrust along a law, drag along the flow
    body    with attitude and angular velocity            thrust along the axis, forces of the
                                                          parts, jet damping, control

The effects of the point do not read an attitude: a scene with them does not integrate or compile
rotation.

Source: Thomson 7.8 to 7.10, 8.5; Barrowman, 1967.
"""

import dataclasses
import os
from collections.abc import Sequence
from typing import final

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ..bodies import AbstractBody, AbstractEffect, BurningBody, PrincipalInertia
from ..core import (
    AbstractParameters,
    FileName,
    InputError,
    NumberField,
    OptionalNumberField,
    Scalar,
    Vector,
    argument,
    check,
    constructor,
    quantity,
)
from ..core.checks import is_concrete
from ..core.field_types import shown
from ..core.types import as_float, as_optional_float
from ..rockets import (
    AttitudeControl,
    Gimbal,
    GimballedThrust,
    JetDamping,
    Motor,
    SteeredThrust,
    Thrust,
    read_motor,
)
from ..rockets.steering import AbstractSteering
from ._aerodynamics import Aerodynamics
from ._tabulated_aerodynamics import TabulatedAerodynamics
from .aerodynamic_table import AerodynamicTable
from .air_drag import AirDrag
from .airframe import (
    FINS_DOC,
    RADIUS_CHANGES_DOC,
    Fins,
    FinSet,
    NoseCone,
    RadiusChange,
    RadiusChanges,
    parts_field,
)
from .coefficient import MachTable, as_optional_coefficient
from .ground_gravity import RADIUS, STANDARD_GRAVITY
from .local_air import LocalAir

# The parts of a rocket by the name of the station that `model_rocket` moves.
PARTS_BY_STATION = {
    "tip": NoseCone,
    "leading_edge": FinSet,
    "fore_end": RadiusChange,
    "station": AerodynamicTable,
}


@final
class Vehicle(AbstractParameters):
    """A rocket: its body, its motor, and its aerodynamics."""

    body: AbstractBody = eqx.field(metadata={"doc": "mass and inertia"})
    motor: Thrust = eqx.field(metadata={"doc": "thrust and propellant over time"})
    area: NumberField = quantity("m^2", positive=True, doc="reference area of the drag")
    # The checker takes the quantity above for a default.
    drag: MachTable | None = eqx.field(  # pyright: ignore[reportGeneralTypeIssues]
        converter=as_optional_coefficient,
        default=None,
        metadata={"doc": "coefficient of the drag while the motor burns; `None` with a table"},
    )
    coasting_drag: MachTable | None = eqx.field(
        default=None,
        converter=as_optional_coefficient,
        metadata={"doc": "coefficient of the drag after burnout; the same by default"},
    )
    nose: NoseCone | None = eqx.field(default=None, metadata={"doc": "the nose"})
    fins: Fins = parts_field(FINS_DOC)
    tail: RadiusChanges = parts_field(RADIUS_CHANGES_DOC)
    exit_station: OptionalNumberField = quantity(
        "m", optional=True, doc="z of the nozzle's exit in construction axes, for jet damping"
    )
    exit_radius: NumberField = quantity(
        "m", non_negative=True, default=0.0, doc="of the nozzle's exit"
    )
    table: AerodynamicTable | None = eqx.field(
        default=None,
        metadata={"doc": "of the aerodynamic forces; the parts provide missing coefficients"},
    )
    axial_factor: NumberField = quantity(
        "", non_negative=True, default=1.0, doc="factor on the axial force, for dispersions"
    )

    def __check_init__(self):
        if self.drag is None and self.table is None:
            raise InputError(
                "Vehicle.drag is None: it must be a coefficient or a table by the Mach number, "
                "unless Vehicle.table has the aerodynamic forces."
            )

    @classmethod
    @constructor(
        sets=("body", "area"),
        motor=FileName("of the motor: RASP (.eng), RockSim (.rse), or columns"),
        radius=argument("m", positive=True, doc="of the tube, for the reference area"),
        mass=argument("kg", positive=True, doc="of the rocket without its motor"),
        inertia=argument(
            "kg m^2", positive=True, shape=(3,), doc="about its centre of mass, principal"
        ),
        centre=argument("m", doc="station of its centre of mass"),
        case_mass=argument("kg", non_negative=True, doc="of the empty motor"),
        case_station=argument("m", doc="of its centre"),
        case_inertia=argument(
            "kg m^2",
            non_negative=True,
            shape=(3,),
            default=(0.0, 0.0, 0.0),
            doc="about it, principal",
        ),
        propellant_station=argument("m", doc="of the centre of the propellant"),
        grain=argument(
            "m",
            non_negative=True,
            shape=(3,),
            doc="outer and inner radius, and length of the column of all grains",
        ),
        exit_station=argument("m", doc="of the nozzle's exit"),
        exit_radius=argument("m", non_negative=True, doc="of the nozzle's exit"),
        propellant_mass=argument(
            "kg", positive=True, optional=True, doc="by default from the motor's file"
        ),
        tube_length=argument("m", positive=True, optional=True, doc="of the motor tube"),
        impulse_factor=argument(
            "", positive=True, default=1.0, doc="factor on the thrust, for dispersions"
        ),
    )
    def model_rocket(
        cls,
        motor: Motor | str | os.PathLike[str],
        *,
        radius: Scalar,
        mass: Scalar,
        inertia: Vector | Sequence[Scalar],
        centre: Scalar,
        case_mass: Scalar,
        case_station: Scalar,
        case_inertia: Vector | Sequence[Scalar] = (0.0, 0.0, 0.0),
        propellant_station: Scalar,
        grain: Vector | tuple[Scalar, Scalar, Scalar],
        exit_station: Scalar,
        exit_radius: Scalar,
        propellant_mass: Scalar | None = None,
        tube_length: Scalar | None = None,
        impulse_factor: Scalar = 1.0,
        axial_factor: Scalar = 1.0,
        drag: MachTable | Scalar | None = None,
        coasting_drag: MachTable | Scalar | None = None,
        table: AerodynamicTable | None = None,
        nose: NoseCone | None = None,
        fins: FinSet | Sequence[FinSet] | None = None,
        tail: RadiusChange | Sequence[RadiusChange] | None = None,
    ) -> "Vehicle":
        """A model rocket assembled from its parts.

        All stations are along one axis towards the nose, from an arbitrary origin; the origin of
        the body's construction axes is the dry centre of mass.

        **Arguments**

        - `motor`: from `read_motor`, or its file; `propellant_mass`, kg, where the file has none.
        - `radius`: of the tube, m, for the reference area; `tube_length`, m, optional.
        - `mass`, kg, principal `inertia`, kg m^2, (3,), and `centre` of mass, m, of the rocket
          without its motor.
        - `case_mass`, `case_station`, `case_inertia`: of the empty motor, about its centre.
        - `propellant_station`: of the propellant's centre, m; `grain`: outer and inner radius and
          length of the whole column of grains, m.
        - `exit_station`, `exit_radius`: of the nozzle, m.
        - `drag`, `coasting_drag`: coefficients of the axial force as functions of the Mach number.
        - `table`: of all aerodynamic forces, in place of `drag`.
        - `nose`, `fins`, `tail`, `table`: with stations from this origin; `fins` and `tail` may be
          sequences.
        - `impulse_factor`, `axial_factor`: factors on thrust and axial force, for dispersions.

        **Raises** `InputError` for a file that `read_motor` rejects, and for a motor that is longer
        or wider than the tube.
        """
        motor = motor if isinstance(motor, Motor) else read_motor(motor)
        _check_room(motor, radius, tube_length, grain)
        mass, case_mass = as_float(mass), as_float(case_mass)
        dry_mass = mass + case_mass
        dry_centre = (mass * centre + case_mass * case_station) / dry_mass
        # The reduced mass has the parallel-axis terms of both parts in one.
        apart = mass * case_mass / dry_mass * (as_float(centre) - case_station) ** 2
        parts = [jnp.asarray(a) + b for a, b in zip(inertia, case_inertia, strict=True)]
        # Along the axis the distance does not count: the zero carries its runs.
        dry_inertia = jnp.stack([parts[0] + apart, parts[1] + apart, parts[2] + 0.0 * apart])
        outer, inner, length = (as_float(x) for x in grain)
        square = outer * outer + inner * inner
        # As radii of gyration, because the mass goes down as it burns.
        across = jnp.sqrt(0.25 * square + length * length / 12.0)
        filled = motor.propellant_mass if propellant_mass is None else propellant_mass
        body = BurningBody(
            dry_mass,
            PrincipalInertia(dry_inertia),
            jnp.stack([across, across, jnp.sqrt(0.5 * square)]),
            propellant_station - dry_centre,
            as_optional_float(filled),
        )
        thrust = motor.thrust(propellant_mass)
        factor = as_float(impulse_factor)
        return cls(
            body=body,
            # The same propellant leaves faster.
            motor=dataclasses.replace(
                thrust,
                mean_thrust=factor * thrust.mean_thrust,
                exhaust_velocity=factor * thrust.exhaust_velocity,
            ),
            # Of the tube, to which makers refer the coefficient of the drag.
            area=np.pi * as_float(radius) ** 2,
            drag=drag,
            coasting_drag=coasting_drag,
            nose=_shifted(nose, "tip", dry_centre),
            fins=_each_shifted(fins, "leading_edge", dry_centre),
            tail=_each_shifted(tail, "fore_end", dry_centre),
            exit_station=exit_station - dry_centre,
            exit_radius=exit_radius,
            table=_shifted(table, "station", dry_centre),
            axial_factor=axial_factor,
        )

    def as_point(
        self, air: LocalAir, steering: AbstractSteering | None = None
    ) -> tuple[AbstractEffect, ...]:
        """The effects on a point: thrust along a law, and drag along the flow.

        **Arguments**

        - `air`: about the vehicle.
        - `steering`: of the thrust; without it the motor is off."""
        if steering is None:
            return (AirDrag(self._drag_area(), self._drag(False), air),)
        thrust = SteeredThrust.of_thrust(self.motor, steering)
        coasting, burnout = self._coasting(True)
        drag = AirDrag(self._drag_area(), self._drag(True), air, coasting, burnout)
        return (thrust, drag)

    def as_body(
        self,
        air: LocalAir,
        *,
        powered: bool = True,
        control: AttitudeControl | Gimbal | None = None,
    ) -> tuple[AbstractEffect, ...]:
        """The effects on a rotating body: thrust along its axis, jet damping, aerodynamic forces,
        and the control of its attitude.

        **Arguments**

        - `air`: about the vehicle.
        - `powered`: whether the motor is active.
        - `control`: of the attitude, by default none: a torque, or the gimbal of the motor, which
          is at the nozzle's exit.

        **Raises** `InputError` for a gimbal without an `exit_station`."""
        effects: tuple[AbstractEffect, ...] = (self._air_forces(air, powered),)
        if powered:
            effects = (self._motor(control), *effects)
            # The damping by the jet depends on the square of its distance, for which there is no
            # default.
            if self.exit_station is not None:
                # A full exit has the mean square radius of a ring of its radius over sqrt(2).
                ring = self.exit_radius / np.sqrt(2.0)
                damping = JetDamping(self.motor.mass_rate, self.exit_station, ring)
                effects = (*effects, damping)
        return (*effects, control) if isinstance(control, AttitudeControl) else effects

    @property
    def ceiling(self) -> Scalar:
        """A height above the start, m, that no flight from rest on the Earth exceeds: that of a
        climb at the greatest speed for the burn time, followed by a ballistic ascent without air.

        Source: Thomson 8.1."""
        loaded = self.body.loaded_mass()
        dry = self.body.least_mass()
        assert loaded is not None and dry is not None
        # In free space: gravity and drag only take from it.
        speed = self.motor.exhaust_velocity * jnp.log(loaded / dry)
        thrown = speed**2 / (2.0 * STANDARD_GRAVITY)
        # Because gravity falls with the height, a throw that is fast enough never comes back.
        left = jnp.where(thrown < RADIUS, 1.0 - thrown / RADIUS, 0.0)
        return speed * self.motor.burn_time + thrown / left

    def _air_forces(self, air: LocalAir, powered: bool) -> AbstractEffect:
        parts = {"nose": self.nose, "fins": self.fins, "tail": self.tail}
        if self.table is not None:
            burnout = self.motor.burnout() if powered else None
            factor = self.axial_factor
            return TabulatedAerodynamics(self.table, air, burnout, **parts, axial_factor=factor)
        coasting, burnout = self._coasting(powered)
        area = self._drag_area()
        drag = self._drag(powered)
        return Aerodynamics(area, drag, air=air, coasting=coasting, burnout=burnout, **parts)

    def _drag_area(self) -> Scalar:
        """The reference area, m^2, with the factor of the force along the axis."""
        return self.axial_factor * self.area

    def _motor(self, control: AttitudeControl | Gimbal | None) -> AbstractEffect:
        # A control torque is an effect separate from the motor; a gimbal turns the motor itself.
        if not isinstance(control, Gimbal):
            return self.motor
        if self.exit_station is None:
            raise InputError("Vehicle.exit_station is None: a gimbal requires it, a z in m.")
        return GimballedThrust.of_thrust(self.motor, control, self.exit_station)

    def _drag(self, powered: bool) -> MachTable:
        if self.drag is None:
            assert self.table is not None
            return self.table.ahead(powered)
        return self.drag if powered or self.coasting_drag is None else self.coasting_drag

    def _coasting(self, powered: bool) -> tuple[MachTable | None, Scalar | None]:
        """The coefficient after burnout, and its time, s; empty if it does not change."""
        coasting = self.coasting_drag
        # A table that knows the motor on has the motor off, too.
        if self.drag is None and self.table is not None and "axial_burning" in self.table.names:
            coasting = self.table.ahead(False)
        # Without power `_drag` uses that coefficient from the start.
        if not powered or coasting is None:
            return None, None
        return coasting, self.motor.burnout()


def _check_room(
    motor: Motor,
    radius: Scalar,
    tube_length: Scalar | None,
    grain: Vector | tuple[Scalar, Scalar, Scalar],
) -> None:
    """Raise `InputError` for a motor or a grain that does not fit, if the lengths are known."""
    length = motor.length or 0.0
    width = 0.5 * (motor.diameter or 0.0)
    if tube_length is not None and is_concrete(tube_length):
        words = f"at least {length:g} m, the length of the motor {motor.name}"
        check(tube_length >= length, "Vehicle.tube_length", tube_length, words)
    # Campaigns draw lengths, which are traced: only known ones are rejected here.
    if is_concrete(radius):
        words = f"at least {width:g} m, the radius of the motor {motor.name}"
        check(radius >= width, "Vehicle.radius", radius, words)
    if all(is_concrete(x) for x in grain):
        outer, inner, _ = grain
        words = "an outer radius above the inner one, and a length, in m"
        check(outer > inner, "Vehicle.grain", grain, words)


def _shifted(part, field: str, origin: Scalar):
    """The part with its station from another origin; `None` for no part."""
    return None if part is None else _moved(part, field, origin)


def _each_shifted(parts, field: str, origin: Scalar):
    """One part, or each of several, shifted as in `_shifted`."""
    if isinstance(parts, Sequence):
        return tuple(_moved(part, field, origin) for part in parts)
    return _shifted(parts, field, origin)


def _moved(part, field: str, origin: Scalar):
    known = getattr(part, field, None)
    if known is None:
        kind = PARTS_BY_STATION[field]
        raise InputError(
            f"Vehicle.model_rocket has a part {shown(part)} with an unknown {field}: it must be a "
            f"{kind.__name__}."
        )
    return eqx.tree_at(lambda p: getattr(p, field), part, getattr(part, field) - origin)
