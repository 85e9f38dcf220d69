"""The public names of the rooms with formulas, and those that the hunt leaves out."""

import importlib
import inspect
from collections.abc import Iterable
from fnmatch import fnmatch

ROOMS = (
    "core rotations bodies orbits attitude gyros mechanics rockets vehicles optimization".split()
)
# Of core only these files hold formulas.
FLOOR = ("_safe", "_special", "_elliptic", "_linear", "_tables")

# Patterns of names, by why there is nothing to search.
LEFT_OUT: dict[str, list[str]] = {
    "declares an interface, or holds inputs or results": """
        attitude.AbstractMotor* attitude.CordState attitude.DriftState attitude.SwingState
        attitude.LibrationState bodies.Abstract* bodies.Load bodies.BodyState.*
        attitude.PendulumState gyros.GimbalState optimization.AbstractThrustAcceleration
        optimization.Ascent optimization.ConstantThrustAcceleration optimization.Criterion
        optimization.Progress optimization.FlightState optimization.Minimum* optimization.Staging
        optimization.SteeringOptimum optimization.StopReason*
    """.split(),
    "returns a field, a component of the state, a constant or nothing": """
        bodies.*Body.constant_mass bodies.*Body.has_inertia bodies.*Body.least_mass
        bodies.*Body.loaded_mass bodies.RigidBody.inertia* bodies.RigidBody.centre*
        bodies.PrincipalInertia.matrix attitude.spin_rate orbits.*_node core.axis core.expand
        rotations.Quaternion.coordinates rotations.Quaternion.identity rotations.Quaternion.*xyzw
        *.breaks orbits.Drag.potential *.scaled rockets.JetDamping.potential
        rockets.Thrust.potential bodies.sample_state attitude.*Torque.potential
        attitude.MagneticDipole.potential attitude.TiltState attitude.NutationDamper.potential
        attitude.ReactionWheels.potential attitude.EnergySink.potential
        attitude.GravityGradient.potential optimization.SteeredFlight.invariants
        rockets.ThrustProfile.constant
    """.split(),
    "chooses, counts or checks, without an error to measure": """
        bodies.as_inertia orbits.steps_for orbits.transfer_status core.breaks_of
        orbits.TransferStatus.sentence rotations.Quaternion.check_start
    """.split(),
    "calls one of the functions above and nothing else": """
        attitude.AttitudeDrift.closed_form attitude.UnwindingCords.closed_form *.start *.part
        bodies.with_parts attitude.GravityGradient.load attitude.continuous_precession
        orbits.apoapsis orbits.periapsis orbits.TwoBody.closed_form
        orbits.PointGravity.closed_form attitude.TorqueFreeBody.closed_form
        rockets.Thrust.propellant_left bodies.FreeRotation.flow attitude.Top.closed_form
    """.split(),
    "gives integrators a form of the motion, whose steps they check": """
        attitude.Top.split orbits.PointGravity.regularised
    """.split(),
    "reads a table in NumPy": """
        rockets.ThrustProfile.of_table rockets.ThrustProfile.tabulated
    """.split(),
    "is half of a rule of differentiation, seen in the derivatives above": """
        core.times_slope
    """.split(),
    "iterates to a tolerance, and is tested against the closed forms": """
        optimization.minimise* optimization.optimise_steering
        optimization.optimal_staging_by_gradient
    """.split(),
    "is not hunted yet; its own tests hold it against closed forms, quadrature or 30 digits": """
        attitude.BearingReactions attitude.ConstantTorque.torque attitude.ControlMomentGyros.*
        attitude.DamperMotion attitude.DipoleField* attitude.InvariablePlane
        orbits.Drag.dynamic_pressure vehicles.Aerodynamics.dynamic_pressure
        attitude.MovingMasses* attitude.Nutation.circle_rates attitude.Nutation.loops
        attitude.NutationDamper.e* attitude.NutationDamper.motion
        attitude.NutationDamper.reduced_mass attitude.ParticleEquations
        attitude.PointingControl.torque attitude.ReactionWheels.limited
        attitude.ReactionWheels.rotor attitude.ReactionWheels.speeds
        attitude.RollingDisk.[a-hl-u]* attitude.RollingDisk.velocity
        attitude.ShaftPendulum.plane_period attitude.ShaftPendulum.state
        attitude.SpinningMissile.* attitude.StretchingCords.* attitude.SwingOutArms.*
        attitude.SwingingCords.* attitude.TopMotion.* attitude.UnwindingCords.inertia_ratio
        attitude.UnwindingCords.state attitude.UnwindingCords.tension attitude.bank_angle
        attitude.bearing_reactions attitude.best_crusher_tilt attitude.disk_tilt
        attitude.energy_sink_angle attitude.gyro_on_a_string attitude.invariable_plane
        attitude.jacobi_integral attitude.libration_is_stable attitude.lies_flat
        attitude.particle_equations attitude.pitch_libration attitude.principal_tilt
        attitude.required_torque attitude.space_cone_angle attitude.wheel_torques
        bodies.ExponentialAtmosphere* bodies.StandardAtmosphere.air_at
        bodies.StandardAtmosphere.named bodies.StandardAtmosphere.scaled bodies.inertia_ellipsoid
        gyros.Duffing* gyros.Gyrocompass.frame_rate gyros.Gyrocompass.slow_motion
        gyros.Gyrocompass.small_motion gyros.Gyrocompass.state gyros.GyrocompassState
        gyros.Gyropendulum* gyros.InertialNavigator.earth gyros.InertialNavigator.error_equations
        gyros.InertialNavigator.errors gyros.InertialNavigator.felt gyros.InertialNavigator.state
        gyros.NavigationErrorState gyros.NavigationErrors.closed_form
        gyros.NavigationErrors.errors gyros.Navigator* gyros.Place* gyros.Platform*
        gyros.RateGyro.closed_form gyros.RateGyro.damping_ratio gyros.RateGyro.drift_rate
        gyros.RateGyro.error_torque gyros.RateGyro.frequency_response gyros.RateGyro.invariants
        gyros.RateGyro.natural_frequency gyros.RateGyro.step_response gyros.RateGyro.vector_field
        gyros.RateGyroState gyros.StablePlatform.held gyros.StablePlatform.state
        gyros.StablePlatform.vehicle_turn gyros.StablePlatformState gyros.allan_*
        gyros.gimbal_axes gyros.gyro_noise mechanics.AbstractLagrangian.* mechanics.Accelerations
        mechanics.ArmPendulum.* mechanics.ArmState mechanics.CanonicalState
        mechanics.CentrifugalPendulum.* mechanics.DoublePendulum.* mechanics.ElasticPendulum.*
        mechanics.FlexibleMissile.* mechanics.FramedPendulum.* mechanics.GeneralisedState
        mechanics.Hamiltonian.* mechanics.InclineDisk.* mechanics.Lagrangian.*
        mechanics.MissileLoop.felt_pitch mechanics.MissileLoop.state mechanics.MissileLoopState
        mechanics.MissileState mechanics.RotatingHoop.* mechanics.SimplePendulum.*
        mechanics.SliderCarrier.* mechanics.Trailer.stability_margin mechanics.TrailerState
        mechanics.action mechanics.apply_impact mechanics.apply_impulse mechanics.beam_integral
        mechanics.beam_roots mechanics.beam_shape mechanics.brachistochrone
        mechanics.contact_impulse mechanics.contact_inverse_mass mechanics.crushable_pad
        mechanics.degrees_of_freedom mechanics.foucault_motion mechanics.hanging_chain
        mechanics.impact_energy_loss mechanics.moment_about_moving_point mechanics.momentum_about
        mechanics.rolling_loop mechanics.routh mechanics.turntable_motion
        mechanics.variational_motion optimization.MaximumVelocitySteering*
        optimization.PropellantUse* optimization.Rendezvous optimization.equal_stages_payload
        optimization.least_rendezvous optimization.maximum_velocity_steering
        optimization.propellant_use orbits.*Path* orbits.ClohessyWiltshire.closed_form
        orbits.Impulse orbits.Interception* orbits.LookAngles orbits.LowThrust.* orbits.OrbitState
        orbits.Porkchop* orbits.RadialMotion orbits.RotatingFrame* orbits.SolarPressure*
        orbits.Station.* orbits.ThirdBody* orbits.Zonals* orbits.along_track_error orbits.altitude
        orbits.argument_of_periapsis orbits.circular_rate orbits.cross_track_error
        orbits.eccentricity orbits.effective_potential orbits.force_of_orbit orbits.impulse_change
        orbits.interception orbits.local_frame orbits.node_longitude orbits.period
        orbits.planet_frame orbits.porkchop orbits.projectile_position orbits.radial_error
        orbits.radial_frequency_squared orbits.radial_motion orbits.radial_speed
        orbits.semi_major_axis_of_period orbits.shadow_event orbits.shell_gravity
        orbits.shell_potential orbits.solar_pressure orbits.third_body* orbits.touchdown
        orbits.turning_points rockets.AbstractSteering* rockets.AlongVelocity*
        rockets.AttitudeControl* rockets.BackPressure* rockets.FixedDirection*
        rockets.FlightPlane* rockets.GravityTurn.closed_form rockets.GravityTurnState
        rockets.MassStream* rockets.Motor* rockets.PitchPolynomial* rockets.PitchTable*
        rockets.Separation rockets.SpinningRocket.angle_of_attack
        rockets.SpinningRocket.of_lengths rockets.SteeredThrust* rockets.TangentSteering*
        rockets.UserSteering* rockets.gravity_turn_after rockets.read_motor
        rockets.variable_mass_acceleration rotations.Quaternion.projected rotations.centrodes
        rotations.cosine_* rotations.mean_attitude rotations.omega_from_cosine_rates vehicles.*
    """.split(),
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
