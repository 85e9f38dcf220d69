"""The public names of the rooms with formulas, and those that the hunt leaves out."""

import importlib
import inspect
from collections.abc import Iterable
from fnmatch import fnmatch

ROOMS = "core rotations bodies orbits attitude gyros rockets vehicles optimization".split()
# Of core only these files hold formulas.
FLOOR = ("_safe", "_special", "_elliptic", "_linear", "_tables")

# Patterns of names, by why there is nothing to search.
LEFT_OUT: dict[str, tuple[str, ...]] = {
    "declares an interface, or holds inputs or results": (
        *("attitude.AbstractMotor*", "attitude.CordState", "attitude.DriftState"),
        *("attitude.SwingState", "attitude.LibrationState"),
        *("bodies.Abstract*", "bodies.Load", "bodies.BodyState.*", "attitude.PendulumState"),
        *("gyros.GimbalState", "optimization.AbstractThrustAcceleration", "optimization.Ascent"),
        *(
            "optimization.ConstantThrustAcceleration",
            "optimization.Criterion",
            "optimization.Progress",
        ),
        *("optimization.FlightState", "optimization.Minimum*", "optimization.Staging"),
        *("optimization.SteeringOptimum", "optimization.StopReason*"),
    ),
    "returns a field, a component of the state, a constant or nothing": (
        *("bodies.*Body.constant_mass", "bodies.*Body.has_inertia", "bodies.*Body.least_mass"),
        *("bodies.*Body.loaded_mass", "bodies.RigidBody.inertia*", "bodies.RigidBody.centre*"),
        *("bodies.PrincipalInertia.matrix", "attitude.spin_rate", "orbits.*_node", "core.axis"),
        *("core.expand", "rotations.Quaternion.coordinates", "rotations.Quaternion.identity"),
        *("rotations.Quaternion.*xyzw", "*.breaks", "orbits.Drag.potential", "*.scaled"),
        *("rockets.JetDamping.potential", "rockets.Thrust.potential", "bodies.sample_state"),
        *("attitude.*Torque.potential", "attitude.MagneticDipole.potential", "attitude.TiltState"),
        *("attitude.NutationDamper.potential", "attitude.ReactionWheels.potential"),
        "attitude.EnergySink.potential",
        *("attitude.GravityGradient.potential", "optimization.SteeredFlight.invariants"),
        "rockets.ThrustProfile.constant",
    ),
    "chooses, counts or checks, without an error to measure": (
        *("bodies.as_inertia", "orbits.steps_for", "orbits.transfer_status", "core.breaks_of"),
        *("orbits.TransferStatus.sentence", "rotations.Quaternion.check_start"),
    ),
    "calls one of the functions above and nothing else": (
        *("attitude.AttitudeDrift.closed_form", "attitude.UnwindingCords.closed_form"),
        *("*.start", "*.part", "bodies.with_parts"),
        *("attitude.GravityGradient.load", "attitude.continuous_precession", "orbits.apoapsis"),
        "orbits.periapsis",
        *("orbits.TwoBody.closed_form", "orbits.PointGravity.closed_form"),
        *("attitude.TorqueFreeBody.closed_form", "rockets.Thrust.propellant_left"),
        "bodies.FreeRotation.flow",
        "attitude.Top.closed_form",
    ),
    "gives integrators a form of the motion, whose steps they check": (
        *("attitude.Top.split", "orbits.PointGravity.regularised"),
    ),
    "reads a table in NumPy": ("rockets.ThrustProfile.of_table", "rockets.ThrustProfile.tabulated"),
    "is half of a rule of differentiation, seen in the derivatives above": ("core.times_slope",),
    "iterates to a tolerance, and is tested against the closed forms": (
        *("optimization.minimise*", "optimization.optimise_steering"),
        "optimization.optimal_staging_by_gradient",
    ),
    "is not hunted yet; its own tests hold it against closed forms, quadrature or 30 digits": (
        *("attitude.particle_equations", "bodies.inertia_ellipsoid", "orbits.Impulse", "orbits.altitude", "orbits.force_of_orbit", "orbits.radial_frequency_squared", "orbits.radial_speed", "rockets.gravity_turn_after", "rotations.mean_attitude"),
        *(
            "orbits.along_track_error",
            "orbits.cross_track_error",
            "orbits.radial_error",
            "orbits.eccentricity",
            "orbits.node_longitude",
        ),
        *("orbits.argument_of_periapsis",),
        *("attitude.ControlMomentGyros.*", "attitude.DamperMotion", "attitude.MovingMasses*"),
        *("attitude.NutationDamper.e*", "attitude.NutationDamper.motion"),
        *("attitude.NutationDamper.reduced_mass", "attitude.ParticleEquations"),
        *("attitude.ReactionWheels.rotor", "attitude.ReactionWheels.speeds"),
        *("attitude.ReactionWheels.limited",),
        *("attitude.particle_equations"),
        *("attitude.SpinningMissile.*", "attitude.StretchingCords.*"),
        *(
            "attitude.SwingOutArms.*",
            "attitude.SwingingCords.*",
        ),
        *("attitude.UnwindingCords.inertia_ratio", "attitude.UnwindingCords.state"),
        *("attitude.UnwindingCords.tension",),
        *(
            "attitude.jacobi_integral",
            "attitude.libration_is_stable",
        ),
        *("attitude.principal_tilt",),
        *("attitude.PointingControl.torque", "attitude.ConstantTorque.torque"),
        *("attitude.energy_sink_angle", "attitude.pitch_libration"),
        *("orbits.semi_major_axis_of_period", "rotations.cosine_*"),
        "rotations.omega_from_cosine_rates",
        *("attitude.BearingReactions", "attitude.InvariablePlane", "attitude.bank_angle"),
        *(
            "attitude.DipoleField*",
            "attitude.RollingDisk.[a-hl-u]*",
            "attitude.RollingDisk.velocity",
            "attitude.ShaftPendulum.plane_period",
            "attitude.ShaftPendulum.state",
        ),
        *(
            "attitude.TopMotion.*",
            "attitude.best_crusher_tilt",
        ),
        *("attitude.disk_tilt", "attitude.gyro_on_a_string"),
        *("attitude.lies_flat",),
        *("attitude.Nutation.circle_rates", "attitude.Nutation.loops"),
        *("attitude.bearing_reactions", "attitude.invariable_plane"),
        *(
            "gyros.Duffing*",
            "gyros.Gyrocompass.frame_rate",
            "gyros.Gyrocompass.slow_motion",
            "gyros.Gyrocompass.small_motion",
            "gyros.Gyrocompass.state",
            "gyros.GyrocompassState",
            "gyros.Gyropendulum*",
            "gyros.NavigationErrorState",
            "gyros.NavigationErrors.closed_form",
            "gyros.NavigationErrors.errors",
        ),
        *(
            "gyros.Platform*",
            "gyros.RateGyro.closed_form",
            "gyros.RateGyro.damping_ratio",
            "gyros.RateGyro.drift_rate",
            "gyros.RateGyro.error_torque",
            "gyros.RateGyro.frequency_response",
            "gyros.RateGyro.invariants",
            "gyros.RateGyro.natural_frequency",
            "gyros.RateGyro.step_response",
            "gyros.RateGyro.vector_field",
            "gyros.RateGyroState",
        ),
        *(
            "gyros.allan_*",
            "gyros.gyro_noise",
            "gyros.InertialNavigator.earth",
            "gyros.InertialNavigator.error_equations",
            "gyros.InertialNavigator.errors",
            "gyros.InertialNavigator.felt",
            "gyros.InertialNavigator.state",
            "gyros.Navigator*",
        ),
        *(
            "gyros.Place*",
            "gyros.StablePlatform.held",
            "gyros.StablePlatform.state",
            "gyros.StablePlatform.vehicle_turn",
            "gyros.StablePlatformState",
            "gyros.gimbal_axes",
        ),
        *(
            "attitude.required_torque",
            "attitude.space_cone_angle",
        ),
        *("bodies.inertia_ellipsoid"),
        *("orbits.Impulse"),
        *("orbits.RadialMotion",),
        *("orbits.circular_rate",),
        *("orbits.effective_potential",),
        *("orbits.local_frame",),
        *("orbits.period",),
        *("orbits.planet_frame",),
        *("orbits.radial_frequency_squared"),
        *("orbits.radial_motion", "orbits.shell_gravity"),
        *("orbits.shell_potential",),
        *(
            "orbits.LookAngles",
            "orbits.Station.*",
        ),
        *("rotations.centrodes",),
        *("orbits.force_of_orbit"),
        *(
            "orbits.projectile_position",
            "orbits.impulse_change",
        ),
        *(
            "orbits.ClohessyWiltshire.closed_form",
            "orbits.LowThrust.*",
        ),
        *(
            "orbits.Interception*",
            "orbits.Porkchop*",
            "orbits.interception",
        ),
        *("orbits.porkchop", "optimization.Rendezvous"),
        *("optimization.least_rendezvous", "orbits.OrbitState"),
        *("orbits.turning_points",),
        *("rotations.Quaternion.projected",),
        "vehicles.*",
        *(
            "bodies.ExponentialAtmosphere*",
            "bodies.StandardAtmosphere.air_at",
            "bodies.StandardAtmosphere.named",
            "bodies.StandardAtmosphere.scaled",
        ),
        *("orbits.*Path*", "orbits.RotatingFrame*", "orbits.SolarPressure*"),
        *("orbits.ThirdBody*", "orbits.Zonals*", "orbits.shadow_event"),
        *("orbits.solar_pressure",),
        *("orbits.third_body*",),
        *("rotations.mean_attitude"),
        *(
            "rockets.GravityTurn.closed_form",
            "rockets.GravityTurnState",
            "rockets.MassStream*",
            "rockets.SpinningRocket.angle_of_attack",
            "rockets.SpinningRocket.of_lengths",
        ),
        *("rockets.gravity_turn_after"),
        *("rockets.AbstractSteering*", "rockets.AlongVelocity*", "rockets.AttitudeControl*"),
        *("rockets.BackPressure*", "rockets.FixedDirection*", "rockets.FlightPlane*"),
        *("rockets.Motor*", "rockets.PitchPolynomial*", "rockets.PitchTable*"),
        *("rockets.Separation", "rockets.SteeredThrust*", "rockets.TangentSteering*"),
        *("rockets.UserSteering*", "rockets.read_motor"),
        *("attitude.wheel_torques", "orbits.touchdown"),
        *("rockets.variable_mass_acceleration", "optimization.propellant_use"),
        *("optimization.PropellantUse*", "optimization.equal_stages_payload"),
        *("optimization.MaximumVelocitySteering*", "optimization.maximum_velocity_steering"),
    ),
}


def public_names() -> set[str]:
    """Functions, and the methods of classes, "room.name" and "room.Class.method""
    names = set()
    for room in ROOMS:
        module = importlib.import_module(f"jaxspace.{room}")
        for name, found in vars(module).items():
            if name.startswith() or inspect.ismodule(found) or not callable(found):
                continue
            if room == "core" and found.__module__.rpartition()[2] not in FLOOR:
                continue
            names |= {f"{room}.{name}{method}" for method in _methods(found)}
    return names


def left_out(names: Iterable[str]) -> dict[str, list[str]]:
    """Of these names those that are left out, each under the first reason that holds."""
    found: dict[str, list[str]] = {why: [] for why in LEFT_OUT}
    for name in sorted(names):
        for why, patterns in LEFT_OUT.items():
            if any(fnmatch(name, pattern) for pattern in patterns):
                found[why].append(name)
                break
    return found


def _methods(found) -> list[str]:
    if not inspect.isclass(found):
        return [""]
    own = [name for name, value in vars(found).items() if _acts(name, value)]
    return [f".{name}" for name in own if not name.startswith()] or [""]


def _acts(name, value) -> bool:
    kinds = (property, classmethod, staticmethod)
    return not name.startswith() and (callable(value) or isinstance(value, kinds))
