"""The public names of the packages with formulas, and those that the fuzz test leaves out."""

import importlib
import inspect
from collections.abc import Iterable
from fnmatch import fnmatch

from jaxspace.core import modules

PACKAGES = (
    "core rotations bodies orbits attitude gyros mechanics rockets vehicles control"
    " optimization".split()
)
# Of core only these files hold formulas.
FLOOR = ("safe", "special", "elliptic", "vectors", "tables")

# Patterns of names, by why there is nothing to search.
LEFT_OUT: dict[str, list[str]] = {
    "interfaces, and containers of inputs or results": """
        attitude.Abstract* attitude.CordState attitude.DriftState attitude.SwingState
        attitude.LibrationState bodies.Abstract* bodies.Load bodies.BodyState.*
        attitude.PendulumState gyros.GimbalState optimization.AbstractThrustAcceleration
        optimization.Ascent optimization.ConstantThrustAcceleration optimization.Criterion
        attitude.BearingReactions attitude.DamperMotion attitude.InvariablePlane
        vehicles.AbstractWind*
        attitude.ParticleEquations gyros.*State mechanics.*State mechanics.Accelerations
        orbits.AbstractPath orbits.LookAngles orbits.RadialMotion orbits.Impulse
        rockets.GravityTurnState rockets.Separation rockets.PitchKick
        optimization.Rendezvous
        optimization.PropellantUse.sentence control.Abstract* control.Box* control.Episode
        control.LoopRun* control.StepPlan
        optimization.Progress optimization.FlightState optimization.Minimum* optimization.Staging
        optimization.SteeringOptimum optimization.StopReason* optimization.StageNumbers
        optimization.StageDesign optimization.FlownStaging* optimization.Insertion*
    """.split(),
    "functions that return a field, a component of the state, a constant or nothing": """
        bodies.*Body.constant_mass bodies.*Body.has_inertia bodies.*Body.least_mass
        bodies.*Body.loaded_mass bodies.RigidBody.inertia* bodies.RigidBody.centre*
        bodies.PrincipalInertia.matrix attitude.spin_rate orbits.*_node core.axis core.identity
        orbits.position_and_velocity
        vehicles.apogee
        core.components rotations.Quaternion.coordinates
        rotations.Quaternion.identity rotations.Quaternion.*xyzw
        *.breaks *.switches *.ground *.scaled *.started_at bodies.sample_state
        attitude.TiltState
        rockets.ThrustProfile.constant vehicles.Rail.load
        vehicles.Aerodynamics.surfaces attitude.ReactionWheels.rotor mechanics.*.state
        attitude.ShaftPendulum.state gyros.*.state vehicles.LaunchSite.east
        vehicles.LaunchSite.north
    """.split(),
    "selections, counts and checks, which have no numerical error": """
        optimization.named_optimiser
        mechanics.AbstractLagrangian.cyclic mechanics.degrees_of_freedom
        attitude.libration_is_stable attitude.lies_flat attitude.Nutation.loops
        control.plan_step *.outside *.limits *.check_values
        bodies.as_inertia orbits.steps_for orbits.transfer_status core.breaks_of core.within
        orbits.TransferStatus.sentence rotations.Quaternion.check_start gyros.BearingFriction.slips
    """.split(),
    "functions that only call one of the functions above": """
        core.over_norm
        attitude.DipoleField mechanics.AbstractLagrangian.projected rockets.GravityTurn.closed_form
        rockets.SteeredThrust.propellant_left vehicles.Rail.rail_exit
        vehicles.LaunchSite.distance vehicles.LaunchSite.drift vehicles.LaunchSite.winds
        vehicles.landing vehicles.ground_place vehicles.landing_latitude vehicles.landing_longitude
        vehicles.Aerodynamics.centre_of_pressure control.CommandedMotor.torque
        attitude.AttitudeDrift.closed_form attitude.UnwindingCords.closed_form *.start *.part
        bodies.with_parts attitude.continuous_precession
        orbits.apoapsis orbits.periapsis orbits.TwoBody.closed_form
        orbits.PointGravity.closed_form attitude.TorqueFreeBody.closed_form
        rockets.PropellantDepletion orbits.AtTargetOrbit rockets.Thrust.propellant_left
        bodies.FreeRotation.flow
        attitude.Top.closed_form rockets.Thrust.net_thrust bodies.spring_speed
        vehicles.FinSet.roll_slope
    """.split(),
    "forms of the motion for integrators, which check the steps": """
        attitude.Top.split orbits.PointGravity.regularised
    """.split(),
    "functions that read a table with NumPy": """
        rockets.ThrustProfile.of_table rockets.ThrustProfile.tabulated
        vehicles.read_aerodynamics vehicles.read_sounding vehicles.Sounding*
    """.split(),
    "parts of a differentiation rule, covered by the derivatives above": """
        core.times_slope
    """.split(),
    "iterations to a tolerance, which are tested against closed forms": """
        optimization.minimise* optimization.optimise_* optimization.staging_with_losses
        optimization.number_of_stages optimization.SteeringNetwork* optimization.TangentLaw*
        optimization.least_rendezvous
        optimization.maximum_velocity_steering optimization.propellant_use
        optimization.MaximumVelocitySteering.angle
        optimization.optimal_staging_by_gradient optimization.lbfgs
    """.split(),
    "functions that call a user-defined function": """
        mechanics.Lagrangian.* mechanics.InclineDisk.nonholonomic rockets.UserSteering.direction
        rotations.centrodes
        control.Feedback* control.ClosedLoop* control.Sensor.truth
    """.split(),
    "compositions of parts whose formulas are listed above": """
        vehicles.Vehicle.* vehicles.LaunchSite.environment vehicles.LaunchSite.air
        vehicles.sounding_flight vehicles.flight_phases vehicles.Recovery.trigger
        rockets.SteeredThrust.of_thrust
        control.Together*
        bodies.come_apart bodies.release bodies.Detached*
        control.with_command
        control.LandingTask* control.RendezvousTask* control.SlewTask*
    """.split(),
    "computations of constants with NumPy": """
        mechanics.FlexibleMissile.roots mechanics.beam_roots rockets.Motor.* rockets.read_motor
        rockets.Thrust.of_file rockets.SteeredThrust.of_file rockets.GimballedThrust.of_file
    """.split(),
    "cubic interpolation of measured values, which is tested against SciPy": """
        vehicles.AerodynamicTable* vehicles.TabulatedAerodynamics* vehicles.Measured*
    """.split(),
    "sums of series by loops, which are tested against mpmath": """
        orbits.spherical_harmonics* orbits.SphericalHarmonics* orbits.PlanetRotation*
        orbits.read_gfc orbits.GravityField*
    """.split(),
    "forces that determine a limit of validity, covered by the tests of that limit": """
        mechanics.BarOnString.tension mechanics.LandingLegs.ground_force
    """.split(),
    "functions that compute eigenvalues with LAPACK": """
        attitude.NutationDamper.eigenvalues
        mechanics.FlexibleMissile.coupled_frequencies_squared
    """.split(),
    "random number generation": """
        gyros.gyro_noise control.StarTracker* control.Sensor.*
        vehicles.UncertainWind* vehicles.DrydenGusts* bodies.RandomSignal* bodies.Fluctuation*
    """.split(),
    "discrete-time systems with memory, covered by `verify` and separate tests": """
        control.* rockets.ThrottledEngine* rockets.servo_rate
        vehicles.AirBrake* vehicles.MovableFins*
    """.split(),
}


def public_names() -> set[str]:
    """Functions, and the methods of classes, "package.name" and "package.Class.method"."""
    names = set()
    for package in PACKAGES:
        module = importlib.import_module(f"jaxspace.{package}")
        for name, found in modules.public_names(module).items():
            if not callable(found):
                continue
            if package == "core" and found.__module__.rpartition(".")[2] not in FLOOR:
                continue
            names |= {f"{package}.{name}{method}" for method in _methods(found)}
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
