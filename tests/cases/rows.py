"""The rows of the theory by section: which functions and which reference cases stand for each.

A row takes every case whose name begins with one of its `cases`, unless another row names it by a
longer beginning. The functions that its cases compute with are added to those that stand here.
`docs/_case_pages.py` writes a page of each table."""

from typing import NamedTuple


class Row(NamedTuple):
    """One row of the theory.

    - `section`: of Thomson; of Harrison and Nettleton with an H before it.
    - `title`: what it is.
    - `cases`: beginnings of the names of its cases.
    - `functions`: public names, `package.name`, besides those that its cases compute with."""

    section: str
    title: str
    cases: str = ""
    functions: str = ""


CHAPTERS_1_TO_4 = (
    Row(
        "1.1", "Law of gravitation, weight", "T1.1", "orbits.point_gravity.point_gravity_potential"
    ),
    Row("1.3, 1.4", "Vector algebra, moment", "T1.P TA-6", "core.vectors.matvec"),
    Row("1.5", "Finite rotations", "T1.3-rot", "rotations.Quaternion"),
    Row("1.6", "Rate of a vector in a turning frame", "T1.P15", "rotations.MovingFrame"),
    Row("2.2", "Polar components", "T2.3-P7"),
    Row(
        *("2.3", "Tangential and normal components, projectiles", "T2.3"),
        "orbits.projectile.projectile_envelope orbits.projectile.projectile_angles",
    ),
    Row("2.4", "Motion on a turning curve", "T2.4 T2.5-P3", "rotations.MovingFrame"),
    Row("2.5", "General motion in space", "T2.5", "rotations.MovingFrame"),
    Row(
        "2.5 P15",
        "Satellite seen from the turning Earth",
        "T2.5-P15",
        "orbits.rotating_earth.planet_frame",
    ),
    Row(
        *("2.6", "Motion relative to the turning Earth", "T2.6"),
        "orbits.rotating_earth.local_frame orbits.projectile.projectile_position",
    ),
    Row("2.6 P1", "Plumb line", "T2.6-P1"),
    Row(
        *("3.1 to 3.3", "Plane motion, instantaneous centre", "T3-P1 T3-P6 T3-P7 T3-P8"),
        "rotations.plane_motion.centrodes",
    ),
    Row("3.4", "Euler angles", "", "rotations.from_euler_angles rotations.to_euler_angles"),
    Row(
        *("3.5", "Rates of Euler angles", "T3.5"),
        "rotations.euler_angles.omega_from_euler_rates "
        "rotations.euler_angles.euler_rates_from_omega",
    ),
    Row("3 P9 to P12", "Navigation frame", "T3-P12"),
    Row(
        *("3 P11", "Look angles of a satellite", "T3-P11"),
        "orbits.Station orbits.ground_track.ground_point",
    ),
    Row(
        *("3 P13 to P16", "Rates of direction cosines", "T3-P15"),
        "rotations.direction_cosines.omega_from_cosine_rates "
        "rotations.direction_cosines.cosine_conditions",
    ),
    Row("4.2", "Impulse, restitution, crushable pad", "T4.2"),
    Row("4.3, 4.4 P3", "Work and energy", "T4.3", "mechanics.work.work_along"),
    Row(
        *("4.4", "Moment about a moving point", "T4.4"),
        "mechanics.moving_point.momentum_about mechanics.moving_point.moment_about_moving_point",
    ),
    Row(
        *("4.5", "Central forces", "T4.5"),
        "orbits.PowerLawForce orbits.radial_motion.radial_motion "
        "orbits.radial_motion.turning_points orbits.orbit_force.force_of_orbit",
    ),
    Row(
        "4.6",
        "Reduction of two bodies",
        "T4.6",
        "orbits.two_masses.reduced_mass orbits.two_masses.sphere_of_influence",
    ),
    Row("4.7", "Kepler's problem", "T4.7", "orbits.kepler.kepler_flow orbits.TwoBody"),
    Row(
        *("4.8", "Geometry of conics", "T4.8"),
        "orbits.ClassicalElements orbits.elements.elements_from_state "
        "orbits.elements.state_from_elements orbits.conic.conic_radius "
        "orbits.conic.eccentric_anomaly orbits.conic.mean_anomaly",
    ),
    Row(
        *("4.9", "Orbit from the burnout", "T4.9"),
        "orbits.burnout.elements_from_burnout orbits.burnout.orbit_from_burnout",
    ),
    Row(
        *("4.10", "Launch along the horizon, period, escape", "T4.10"),
        "orbits.time_of_flight.period orbits.burnout.escape_speed "
        "orbits.initial.orbit_from_radius orbits.burnout.excess_speed "
        "orbits.conic.turning_angle",
    ),
    Row(
        *("4.11", "Hohmann transfer, planets", "T4.11"),
        "orbits.transfers.bielliptic_transfer orbits.bielliptic.bielliptic_break_even "
        "orbits.planets.synodic_period orbits.planets.departure_phase constants.PLANETS",
    ),
    Row("4.12", "Coaxial ellipses", "T4.12"),
    Row(
        *("4.13", "Change by an impulse, time of flight", "T4.13"),
        "orbits.impulses.apse_line_impulse orbits.impulses.plane_change_impulse orbits.Impulse "
        "orbits.time_of_flight.time_of_flight orbits.time_of_flight.true_anomaly_after "
        "orbits.impulses.eccentricities_through orbits.small_impulse.impulse_change",
    ),
    Row(
        *("4.14", "Small impulses", "T4.14"),
        "orbits.small_impulse.impulse_change",
    ),
    Row("4.15", "Stability of circular orbits", "T4.15"),
    Row(
        *("4.16", "Interception and rendezvous", "T4.16"),
        "orbits.lambert.lambert orbits.lambert.least_duration "
        "orbits.clohessy_wiltshire.clohessy_wiltshire_flow "
        "orbits.clohessy_wiltshire.clohessy_wiltshire_transfer "
        "orbits.interception.interception orbits.phasing.phasing orbits.interception.porkchop "
        "orbits.ClohessyWiltshire optimization.least_rendezvous",
    ),
    Row(
        *("4.17", "Ballistic trajectory", "T4.17"),
        "orbits.ballistic.ballistic_angles orbits.ballistic.least_energy_launch",
    ),
    Row(
        *("4.18", "Oblate body: moment, secular rates", "T4.18"),
        "orbits.Oblateness orbits.oblateness.node_regression_rate "
        "orbits.oblateness.apsidal_rate orbits.Zonals orbits.secular_rates.secular_rates "
        "orbits.secular_rates.sun_synchronous_inclination",
    ),
    Row(
        "H 5.2",
        "Gravity of shells and spheres",
        "H5.8 H5.11",
        "orbits.central_force.sphere_potential",
    ),
    Row("H 5.3", "Two bodies", "H5.17"),
    Row("H 5.4", "Central force K r^n", "H5.22 H5.24"),
)

CHAPTER_5 = (
    Row(
        *("5.1", "Euler's theorem, composition of rotations", "T5.1"),
        "rotations.Quaternion rotations.interpolation.slerp "
        "rotations.interpolation.interpolate_attitude rotations.mean.mean_attitude",
    ),
    Row(
        *("5.2 to 5.5", "Momentum, energy, tensor and ellipsoid of inertia", "T5.2 T5.5 T5.12-P2"),
        "bodies.InertiaTensor bodies.inertia.parallel_axes "
        "bodies.principal_axes.principal_axes bodies.mass_properties.combined "
        "bodies.mass_properties.inertia_ellipsoid bodies.inertia.kinetic_energy",
    ),
    Row("5.5 P10", "Landing on a pivot", "T5.5-P10"),
    Row("5.6, 5.7", "Euler's equations", "T5.7", "bodies.newton_euler.angular_acceleration"),
    Row(
        *("5.8", "Free symmetric body, in the body", "T5.8"),
        "attitude.torque_free.body_precession_rate attitude.torque_free.cone_angles "
        "attitude.torque_free.symmetric_flow",
    ),
    Row(
        *("5.9", "Free symmetric body, in space", "T5.9-P1 T5.9-P2 T5.9-P3 T5.9-P4"),
        "attitude.torque_free.precession_rate attitude.torque_free.space_cone_angle "
        "attitude.torque_free.coning_omega",
    ),
    Row("5.9 P8 to P13", "Skew bodies, airplane", "T5.9"),
    Row(
        *("5.10", "Poinsot's construction", "T5.10 T5.12-P8"),
        "attitude.polhode.Polhode attitude.principal_spins.invariable_plane "
        "attitude.principal_spins.cone_bounds",
    ),
    Row(
        *("5.11", "Free asymmetric body", "T5.11 T5.12-P9"),
        "attitude.TorqueFreeBody bodies.principal_frame.free_turn",
    ),
    Row(
        *("5.12", "Stability of principal rotations, flips", "T5.12"),
        "attitude.principal_spins.spin_modes attitude.principal_spins.spin_stiffness",
    ),
    Row("5.12 P7", "Pendulum with its exact period", "T5.12-P7", "attitude.Top"),
    Row(
        *("5.13", "Heavy top", "T5.13"),
        "attitude.Top attitude.nutation.Nutation attitude.top_motion.TopMotion",
    ),
    Row(
        *("5.14", "Steady precession, sleeping top", "T5.14"),
        "attitude.Top.steady_precession_rates attitude.Top.least_spin",
    ),
    Row("5.14 P12", "Disk on a turning shaft", "T5.14-P12"),
    Row(
        *("5.14 P13", "Elastically restrained flywheel", "T5.14-P13"),
        "attitude.top_relatives.sprung_flywheel_frequencies",
    ),
    Row(
        *("5.14 P14 to P17", "Ore crusher", "T5.14-P16 T5.14-P17"),
        "attitude.top_relatives.crusher_force attitude.top_relatives.best_crusher_tilt",
    ),
    Row(
        *("5.14 P20", "Gyro on a string", "T5.14-P20"),
        "attitude.top_relatives.gyro_on_a_string",
    ),
    Row(
        *("5.15", "Precession by Sun and Moon", "T5.15"),
        "attitude.precession_of_earth.luni_solar_rate "
        "attitude.precession_of_earth.luni_solar_nutation",
    ),
    Row(
        *("5.16", "Rolling disk", "T5.16"),
        "attitude.RollingDisk attitude.disk_tilt.disk_tilt",
    ),
    Row("H 4.9", "Binet's diagrams", "H4.14 H4.15 H4.16"),
    Row("H 4.10", "Euler's rates, node axes", "H4.78 H4.81"),
    Row(
        *("H 4.11", "Top, pseudo-potential", "H4.11 H4.25"),
        "attitude.Top.least_spin attitude.Top.pseudo_potential "
        "attitude.Top.pseudo_potential_minimum",
    ),
    Row("H 4.12", "Forced precession", "H4.12"),
    Row("H 4.13", "Satellites as a gyroscope", "H4.13"),
)

VEHICLES = (
    Row("7.1", "Rigid body in body axes that are no principal ones", "T7.1"),
    Row(
        *("7.2", "Spinning missile under a transverse moment", "T7.2"),
        "attitude.SpinningMissile",
    ),
    Row("7.2 P5", "Symmetric body with damping", "T7.2-P5"),
    Row("7.3", "Complex angle of attack", "T7.3", "attitude.torque_free.symmetric_flow"),
    Row(
        *("7.4", "Nearly symmetric body", "T7.4-P5 T7.4-P9"),
        "attitude.spinning_missile.principal_tilt rotations.tilt.tilt_of_axis",
    ),
    Row("7.4 P6 to P10", "Thrust misalignment in inertial axes", "T7.4-P6"),
    Row("7.4 P11, P12", "Angles 3-2-1", "T7.4-P11", "rotations.from_euler_angles"),
    Row("7.4 P13", "Rolling missile", "T7.4-P13"),
    Row(
        *("7.4 P14, P15", "Gravity gradient", "T7.4-P14 T7.4-P15 T7.4-GG"),
        "attitude.GravityGradient attitude.gravity_gradient.gravity_gradient_torque "
        "attitude.gravity_gradient.pitch_libration_period attitude.libration.libration_modes "
        "attitude.libration.libration_is_stable attitude.libration.jacobi_integral",
    ),
    Row(
        *("7.5", "Yo-yo", "T7.5"),
        "attitude.YoYo attitude.despin.cord_length attitude.despin.zero_spin_cord_length "
        "attitude.unwinding.UnwindingCords attitude.unwinding.StretchingCords",
    ),
    Row(
        *("7.6 P3", "Swing-out arms", "T7.6-P3"),
        "attitude.swinging.SwingOutArms attitude.swinging.SwingingCords",
    ),
    Row(
        *("7.6", "Attitude drift by structural damping", "T7.6"),
        "attitude.AttitudeDrift attitude.drift.structural_damping",
    ),
    Row("7.6-13, 14", "Field of acceleration", "T7.6-14"),
    Row(
        *("7.11", "Particles, moving origin", "T7.11-11..14 T7.11-P2"),
        "attitude.MovingMasses",
    ),
    Row(
        *("7.11 Ex. 1", "Reaction wheel, gyrostat", "T7.11-Ex1 T7.11-P4"),
        "attitude.ReactionWheels attitude.ControlMomentGyros",
    ),
    Row(
        *("7.11 P12", "Nutation damper", "T7.11-P12"),
        "attitude.NutationDamper",
    ),
)

CHAPTER_8 = (
    Row(
        *("8.1", "Single stage, vertical: burnout, height, coast, partial derivatives", "T8.1"),
        "rockets.rocket_equation.vertical_burnout_velocity "
        "rockets.rocket_equation.vertical_burnout_height rockets.rocket_equation.coast_height "
        "rockets.rocket_equation.propulsive_efficiency",
    ),
    Row(
        *("8.1 Fig. 2", "Speed at burnout over the share of the mass that is left", "T8.1-Fig2"),
        "rockets.rocket_equation.vertical_burnout_velocity",
    ),
    Row(
        *("8.2", "Staging: shares of the velocity, stages that vanish, their number", "T8.2"),
        "optimization.optimal_staging optimization.staging.optimal_staging_by_gradient "
        "optimization.fixed_masses.number_of_stages "
        "optimization.flown_staging.staging_with_losses "
        "optimization.staging.equal_stages_payload optimization.staging.stationary_mass_ratio",
    ),
    Row(
        *("8.3", "Linear-tangent steering; the least time, direct shooting", "T8.3"),
        "optimization.steering.linear_tangent_steering "
        "optimization.steering.maximum_velocity_steering "
        "optimization.steering.minimum_time_steering optimization.optimise_steering "
        "optimization.optimise_insertion",
    ),
    Row(
        *("8.4", "Propellant use: impulses at the start, at the end or split", "T8.4"),
        "optimization.propellant_use optimization.ascent.burnout_state optimization.ascent.apex",
    ),
    Row(
        *("8.5", "Gravity turn at a constant thrust ratio, with n = 1 and n = 1/2", "T8.5"),
        "rockets.GravityTurn rockets.gravity_turn.gravity_turn "
        "rockets.gravity_turn.gravity_turn_after",
    ),
    Row(
        *("8.5 var.", "Gravity turn with a ratio that changes with the mass", "T8.5-var"),
        "rockets.GravityTurn rockets.SteeredThrust rockets.steering.AlongVelocity",
    ),
)

CHAPTER_6 = (
    Row("6.1", "Small oscillations about steady precession", "T6.1", "attitude.nutation.Nutation"),
    Row(
        *("6.2", "Gyro in gimbals without mass", "T6.2"),
        "gyros.TwoGimbalGyro gyros.TwoGimbalGyro.impulse_response "
        "gyros.TwoGimbalGyro.step_response gyros.TwoGimbalGyro.swing "
        "gyros.TwoGimbalGyro.swing_time",
    ),
    Row(
        *("6.2 P5 to P7", "Change of attitude by two impulses", "T6.2-P6"),
        "gyros.TwoGimbalGyro.attitude_change gyros.TwoGimbalGyro.arrested",
    ),
    Row(
        *("6.3", "Gimbals with mass, gimbal walk", "T6.3"),
        "gyros.TwoGimbalGyro.walk gyros.gimbal_walk.GimbalWalk.drift "
        "gyros.gimbal_walk.GimbalWalk.drift_to_second_order "
        "gyros.gimbal_walk.GimbalWalk.offset_to_second_order",
    ),
    Row(
        "6.3 P1", "Second harmonic of the walk", "", "gyros.gimbal_walk.GimbalWalk.second_harmonic"
    ),
    Row(
        *("6.3 P3, P4", "Duffing oscillator, resonance curve", "T6.3-P3"),
        "gyros.duffing.DuffingOscillator gyros.duffing.DuffingOscillator.resonance_frequencies",
    ),
    Row("6.4", "Gyrocompass at rest", "T6.4", "gyros.Gyrocompass.rest_tilt"),
    Row(
        *("6.5", "Oscillation of the gyrocompass, damping, heading error", "T6.5"),
        "gyros.Gyrocompass gyros.Gyrocompass.frequencies gyros.Gyrocompass.slow_motion",
    ),
    Row(
        *("6.5 P7 to P10", "Gyropendulum, Schuler's tuning", "T6.5-P10"),
        "gyros.Gyropendulum gyros.Gyropendulum.frequencies",
    ),
    Row(
        "6.6",
        "Rate gyro",
        "T6.6",
        "gyros.RateGyro gyros.noise.gyro_noise gyros.noise.allan_variance",
    ),
    Row("6.7", "Integrating gyro", "T6.7", "gyros.RateGyro.integrated_angle"),
    Row(
        *("6.8", "Stable platform about one axis", "T6.8"),
        "gyros.PlatformAxis studies.modes",
    ),
    Row(
        *("6.9", "Platform about three axes, resolver, gimbal lock", "T6.9"),
        "gyros.platform.gimbal_lock_margin",
    ),
    Row("6.10", "Inertial navigator", "", "gyros.InertialNavigator gyros.Place"),
    Row(
        *("6.11", "Errors of inertial navigation", "T6.11"),
        "gyros.navigation_errors.NavigationErrors gyros.InertialNavigator.error_equations "
        "gyros.navigation_errors.coupled_rates gyros.navigation_errors.table_rates",
    ),
)

CHAPTER_9 = (
    Row(
        *("9.2", "Degrees of freedom, generalised coordinates", "T9.2"),
        "mechanics.constraints.degrees_of_freedom",
    ),
    Row(
        *("9.3", "Lagrange's equations, simple and double pendulum", "T9.3"),
        "mechanics.Lagrangian mechanics.DoublePendulum mechanics.SimplePendulum",
    ),
    Row(
        *("9.4, 9.6", "Rolling wheel, sphere on a turntable", "T9.4 T9.6"),
        "mechanics.rolling.rolling_loop mechanics.rolling.turntable_motion",
    ),
    Row(
        "9.7",
        "Hamilton's principle",
        "T9.7",
        "mechanics.variational.action mechanics.discrete.variational_motion",
    ),
    Row(
        *("9.8-1", "Spherical pendulum, cyclic coordinates", "T9.8-Ex1"),
        "attitude.SphericalPendulum mechanics.reduction.routh mechanics.Hamiltonian",
    ),
    Row(
        "9.8-2",
        "Whip antennas, clamped-free beams",
        "T9.8-cantilever",
        "mechanics.beams.beam_shape",
    ),
    Row(
        *("9.9", "Disk on an incline, multipliers", "T9.9"),
        "mechanics.InclineDisk mechanics.AbstractLagrangian.reactions",
    ),
    Row(
        *("9.10", "Impulsive motion, struck bars", "T9.10"),
        "mechanics.impulse.apply_impulse mechanics.impulse.apply_impact mechanics.LandingLegs",
    ),
    Row("9.10 P3", "Foucault's pendulum", "T9.10-P3", "mechanics.arm.foucault_motion"),
    Row("9.10 P8", "Elastic pendulum", "T9.10-P8", "mechanics.ElasticPendulum"),
    Row("9.10 P9", "Bar on a string", "", "mechanics.BarOnString"),
    Row("9.10 P10", "Bar on a spring", "", "mechanics.BarOnSpring"),
    Row("9.10 P11", "Centrifugal pendulum", "T9.10-P11", "mechanics.CentrifugalPendulum"),
    Row("9.10 P12", "Bead on a turning hoop", "T9.10-P12", "mechanics.RotatingHoop"),
    Row("9.10 P19", "Pendulum in a free frame", "T9.10-P19", "mechanics.FramedPendulum"),
    Row("9.10 P20, P21", "Pendulum on a turning arm", "T9.10-P20", "mechanics.ArmPendulum"),
    Row("9.10 P22, P23", "Trailer", "T9.10-P22", "mechanics.Trailer"),
    Row("9.10 P24", "Spin axis turned by two impulses", "T9.10-P24"),
    Row("9.11", "Moving axes: slider on a free carrier", "T9.11", "mechanics.SliderCarrier"),
    Row(
        *("9.12 P6, P7", "Assumed modes, beam of two spans"),
        functions="mechanics.beams.assumed_modes mechanics.beams.beam_roots "
        "mechanics.beams.beam_shape",
    ),
    Row(
        *("9.12", "Flexible missile with an engine that swivels", "T9.12"),
        "mechanics.FlexibleMissile mechanics.missile_loop.MissileLoop vehicles.FlexibleStage "
        "mechanics.beams.beam_roots mechanics.beams.beam_shape",
    ),
    Row("B", "Dyadics: the tensor of inertia", "TB-9", "bodies.RigidBody"),
    Row(
        *("C", "Variational calculus: free end, chain, brachistochrone", "TC-9 TC-12"),
        "mechanics.variational.hanging_chain mechanics.variational.brachistochrone",
    ),
)

VARIABLE_MASS = (
    Row(
        *("7.7", "Balance of momentum with inflow and outflow: rocket, jet engine", "T7.7-4"),
        "rockets.rocket_equation.rocket_equation rockets.rocket_equation.mass_ratio_for "
        "rockets.variable_mass.variable_mass_acceleration "
        "rockets.variable_mass.jet_engine_thrust rockets.Thrust rockets.SteeredThrust",
    ),
    Row(
        *("7.7", "Accretion of matter", "T7.7-3"),
        "rockets.MassStream rockets.variable_mass.swept_motion",
    ),
    Row(
        *("7.8", "Jet damping without spin", "T7.8-4 T7.10-P4 T7.10-P5 T7.10-P6"),
        "rockets.JetDamping rockets.jet_damping.jet_damping_ratio",
    ),
    Row(
        *("7.8", "Jet damping under a constant moment", "T7.8-2"),
        "rockets.JetDamping",
    ),
    Row(
        *("7.9", "Spinning rocket: rates in closed form", "T7.9"),
        "rockets.SpinningRocket rockets.jet_damping.spin_ratio "
        "rockets.spin_angle bodies.BurningBody",
    ),
    Row(
        *("7.10", "Angle of attack of that rocket, small angles and full attitude", "T7.10-P8"),
        "rockets.SpinningRocket.complex_tilt rotations.tilt.complex_tilt "
        "rockets.angle_of_attack.angle_of_attack",
    ),
    Row(
        "7.10 P7",
        "Angle of spin through a central nozzle",
        "T7.10-7",
        "rockets.spin_angle",
    ),
    Row(
        *("7.10 P1, P2", "Sprinkler", "T7.10-P1 T7.10-P2"),
        "rockets.sprinkler.sprinkler_moment rockets.sprinkler.sprinkler_speed",
    ),
)

PAGES = {
    "chapters_1_to_4": ("Chapters 1 to 4", CHAPTERS_1_TO_4),
    "chapter_5": ("Chapter 5", CHAPTER_5),
    "chapter_6": ("Chapter 6", CHAPTER_6),
    "chapter_8": ("Chapter 8", CHAPTER_8),
    "vehicles": ("Vehicles", VEHICLES),
    "chapter_9": ("Chapter 9", CHAPTER_9),
    "variable_mass": ("Variable mass", VARIABLE_MASS),
}


def row_of(case: str, rows: tuple[Row, ...]) -> Row | None:
    """The row with the longest beginning of the case's name, which ends where a number ends."""

    def fits(start: str) -> int:
        rest = case.removeprefix(start)
        cut = start[-1].isdigit() and rest[:1].isdigit()
        return 0 if rest == case or cut else len(start)

    found = max(rows, key=lambda row: max(map(fits, row.cases.split()), default=0))
    return found if any(map(fits, found.cases.split())) else None
