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
        *("orbits.*_error", "orbits.eccentricity", "orbits.node_longitude"),
        *("orbits.argument_of_periapsis",),
        *("attitude.ControlMomentGyros.*", "attitude.DamperMotion", "attitude.MovingMasses*"),
        *("attitude.NutationDamper.e*", "attitude.NutationDamper.motion"),
        *("attitude.NutationDamper.reduced_mass", "attitude.ParticleEquations"),
        *("attitude.ReactionWheels.rotor", "attitude.ReactionWheels.speeds"),
        *("attitude.ReactionWheels.limited", "attitude.antenna_drift_constant"),
        *("attitude.AttitudeDrift.angle_after", "attitude.AttitudeDrift.drift_time"),
        *("attitude.AttitudeDrift.rate", "attitude.drift_by_dissipation", "attitude.drift_energy"),
        *("attitude.gyrostat_nutation_rate", "attitude.particle_equations"),
        *("attitude.rotor_moment", "attitude.structural_damping", "attitude.tube_drift_constant"),
        *("attitude.LibrationModes", "attitude.SpinningMissile.*", "attitude.StretchingCords.*"),
        *("attitude.SwingOutArms.*", "attitude.SwingingCords.*", "attitude.angle_of_attack"),
        *("attitude.UnwindingCords.inertia_ratio", "attitude.UnwindingCords.state"),
        *("attitude.UnwindingCords.tension", "attitude.forced_pitch", "attitude.inertia_ratios"),
        *("attitude.jacobi_integral", "attitude.libration_is_stable", "attitude.libration_modes"),
        *("attitude.principal_tilt", "attitude.radial_release_spin"),
        "attitude.zero_spin_radial_cord",
        *("attitude.PointingControl.torque", "attitude.ConstantTorque.torque"),
        *("attitude.energy_sink_angle", "attitude.pitch_libration"),
        *("orbits.semi_major_axis_of_period", "rotations.cosine_*"),
        "rotations.omega_from_cosine_rates",
        *("attitude.BearingReactions", "attitude.InvariablePlane", "attitude.bank_angle"),
        *(
            "attitude.DipoleField*",
            "attitude.RollingDisk.[a-hl-u]*",
            "attitude.RollingDisk.velocity",
            "attitude.ShaftPendulum.[c-fps]*",
        ),
        *("attitude.TopMotion.*", "attitude.best_crusher_tilt", "attitude.crusher_force"),
        *("attitude.crusher_spin", "attitude.disk_tilt", "attitude.gyro_on_a_string"),
        *("attitude.lies_flat", "attitude.luni_solar_*", "attitude.sprung_flywheel_frequencies"),
        *("attitude.Nutation.circle_rates", "attitude.Nutation.loops"),
        *("attitude.bearing_reactions", "attitude.cone_bounds", "attitude.invariable_plane"),
        *("gyros.Duffing*", "gyros.Gyrocompass*", "gyros.Gyropendulum*", "gyros.NavigationError*"),
        *("gyros.Platform*", "gyros.RateGyro*", "gyros.coupled_rates", "gyros.gimbal_lock_margin"),
        *("gyros.resolve_signals", "gyros.schuler_*", "gyros.table_rates"),
        *("gyros.allan_*", "gyros.gyro_noise", "gyros.InertialNavigator*", "gyros.Navigator*"),
        *("gyros.Place*", "gyros.StablePlatform*", "gyros.gimbal_axes"),
        *("attitude.required_torque", "attitude.space_cone_angle", "attitude.spin_modes"),
        *("attitude.spin_stiffness", "bodies.MassProperties*", "bodies.PivotImpact"),
        *("bodies.box", "bodies.combined", "bodies.cone", "bodies.conical_shell"),
        *("bodies.cylinder", "bodies.ellipsoid", "bodies.inertia_ellipsoid"),
        *("bodies.moment_along", "bodies.particles", "bodies.pivot_impact", "bodies.simplex"),
        *("bodies.sphere", "bodies.turned_tensor", "orbits.BallisticFlight"),
        *("orbits.BallisticImpact", "orbits.EquinoctialElements*", "orbits.Impulse"),
        *("orbits.ImpulsiveTransfer*", "orbits.ModifiedEquinoctialElements*"),
        *("orbits.OrbitChange", "orbits.RadialMotion", "orbits.apse_line_impulse"),
        *("orbits.apsidal_impulse", "orbits.ballistic_angles", "orbits.ballistic_flight"),
        *("orbits.ballistic_impact", "orbits.bielliptic_break_even"),
        *("orbits.bielliptic_transfer", "orbits.circular_rate", "orbits.circular_speed"),
        *("orbits.clohessy_wiltshire_flow", "orbits.clohessy_wiltshire_transfer"),
        *("orbits.coaxial_transfer", "orbits.eccentricities_through"),
        *("orbits.effective_potential", "orbits.elements_from_burnout", "orbits.escape_speed"),
        *("orbits.from_relative", "orbits.hohmann_transfer", "orbits.least_energy_launch"),
        *("orbits.local_frame", "orbits.longest_range", "orbits.navigation_rates"),
        *("orbits.orbit_from_burnout", "orbits.period", "orbits.plane_change_impulse"),
        *("orbits.planet_frame", "orbits.plumb_line_deviation", "orbits.power_law"),
        *("orbits.power_law_potential", "orbits.radial_frequency_squared"),
        *("orbits.radial_motion", "orbits.reduced_mass", "orbits.shell_gravity"),
        *("orbits.shell_potential", "orbits.small_tangential_impulse", "orbits.sphere_gravity"),
        *("orbits.sphere_of_influence", "orbits.sphere_potential", "orbits.tangential_impulse"),
        *("orbits.time_of_flight", "orbits.to_relative", "orbits.true_anomaly_after"),
        *("orbits.GroundPoint", "orbits.LookAngles", "orbits.Station.*", "orbits.ground_point"),
        *("rotations.centrodes", "orbits.conic_radius", "orbits.eccentric_anomaly"),
        *("orbits.mean_anomaly", "orbits.true_anomaly", "orbits.turning_angle"),
        *("orbits.departure_phase", "orbits.synodic_period", "orbits.force_of_orbit"),
        *("orbits.projectile*", "orbits.impulse_change", "orbits.excess_speed"),
        *(
            "orbits.ClohessyWiltshire.closed_form",
            "orbits.LowThrust.*",
            "orbits.Phasing",
        ),
        *("orbits.Interception*", "orbits.Porkchop*", "orbits.interception", "orbits.phasing"),
        *("orbits.porkchop", "orbits.spiral_radius", "optimization.Rendezvous"),
        *("optimization.least_rendezvous", "orbits.OrbitState"),
        *("orbits.geocentric_latitude", "orbits.position_of"),
        *("orbits.turning_points", "orbits.vis_viva_speed", "rotations.MovingFrame*"),
        *("rotations.Quaternion.axis_angle", "rotations.Quaternion.from_axis_angle"),
        *("rotations.Quaternion.projected", "rotations.instantaneous_centre"),
        "vehicles.*",
        *("bodies.Air", "bodies.ExponentialAtmosphere*", "bodies.StandardAtmosphere*"),
        *("bodies.geometric_height", "bodies.geopotential_height", "bodies.standard_atmosphere"),
        *("orbits.*Path*", "orbits.RotatingFrame*", "orbits.SecularRates", "orbits.SolarPressure*"),
        *("orbits.ThirdBody*", "orbits.Zonals*", "orbits.secular_rates", "orbits.shadow*"),
        *("orbits.solar_pressure", "orbits.sun_synchronous_inclination", "orbits.sunlight"),
        *("orbits.third_body*", "orbits.zonal*"),
        *("rotations.interpolate_attitude", "rotations.mean_attitude"),
        *("rotations.omega_from_rotation_vector_rate", "rotations.path_components"),
        *("rotations.polar_components", "rotations.rotation_vector_rate", "rotations.slerp"),
        *(
            "rockets.GravityTurn.closed_form",
            "rockets.GravityTurnState",
            "rockets.MassStream*",
            "rockets.SpinningRocket*",
        ),
        *("rockets.angle_of_attack", "rockets.complex_angle_of_attack", "rockets.gravity_turn*"),
        *("rockets.jet_engine_thrust", "rockets.sprinkler_*", "rockets.swept_motion"),
        *("rockets.AbstractSteering*", "rockets.AlongVelocity*", "rockets.AttitudeControl*"),
        *("rockets.BackPressure*", "rockets.FixedDirection*", "rockets.FlightPlane*"),
        *("rockets.Motor*", "rockets.PitchPolynomial*", "rockets.PitchTable*"),
        *("rockets.Separation", "rockets.SteeredThrust*", "rockets.TangentSteering*"),
        *("rockets.UserSteering*", "rockets.read_motor"),
        *("attitude.wheel_torques", "orbits.UniformGravity*", "orbits.touchdown"),
        *("rockets.variable_mass_acceleration", "optimization.propellant_use"),
        *("optimization.PropellantUse*", "optimization.equal_stages_payload"),
        *("optimization.MaximumVelocitySteering*", "optimization.maximum_velocity_steering"),
    ),
}


def public_names() -> set[str]:
    """Functions, and the methods of classes, "room.name" and "room.Class.method"."""
    names = set()
    for room in ROOMS:
        module = importlib.import_module(f"jaxspace.{room}")
        for name, found in vars(module).items():
            if name.startswith("_") or inspect.ismodule(found) or not callable(found):
                continue
            if room == "core" and found.__module__.rpartition(".")[2] not in FLOOR:
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
    return [f".{name}" for name in own if not name.startswith("_")] or [""]


def _acts(name, value) -> bool:
    kinds = (property, classmethod, staticmethod)
    return not name.startswith("_") and (callable(value) or isinstance(value, kinds))
