"""The names of each package by task: a name of its root, or a module, which includes all of its
names. Names that are not listed form a separate group."""

TASKS = {
    "simulation": {
        "Simulation": "simulate simulate_batch simulate_mission simulate_mission_batch "
        "simulate_compact",
        "Accuracy, events and missions": "Accuracy FinalError Event Mission Phase crossings",
        "Results": "Trajectory MissionTrajectory CompactRun Status SimulationError",
        "Errors of derivatives": "gradient_error CheckedGradient",
    },
    "scene": {
        "Composition": "Scene Custom",
        "Random loads": "random_loads",
        "Analysis of effects": "explain budget EffectRow Scaled scaled outputs",
    },
    "bodies": {
        "Bodies and states": "RigidBody BurningBody BodyState state AbstractBody",
        "Mass properties": "MassProperties mass_properties solids PrincipalInertia InertiaTensor "
        "inertia principal_axes principal_frame",
        "Atmosphere and wind": "StandardAtmosphere standard_atmosphere PadAtmosphere "
        "ExponentialAtmosphere Air AbstractAtmosphere atmosphere",
        "Random signals": "random_signals",
        "Equations of motion": "newton_euler FreeRotation",
        "Separation": "parting Detached",
        "User-defined effects, jumps and events": "AbstractEffect Load effects AbstractJump "
        "AbstractCondition",
    },
    "rotations": {
        "Rotations of vectors": "Quaternion direction_cosines rotation_vector tilt",
        "Euler angles": "from_euler_angles to_euler_angles euler_angles",
        "Interpolation and means": "interpolation mean",
        "Moving frames": "MovingFrame moving_frame plane_motion",
    },
    "orbits": {
        "Effects": "PointGravity Oblateness Zonals SphericalHarmonics PlanetRotation Drag "
        "ThirdBody SolarPressure LowThrust QLaw UniformGravity SphereGravity RotatingFrame",
        "Systems": "TwoBody ClohessyWiltshire CentralPotential PowerLawForce",
        "Orbital elements": "ClassicalElements EquinoctialElements ModifiedEquinoctialElements "
        "elements conic initial burnout",
        "Propagation": "kepler time_of_flight steps",
        "Transfers": "lambert transfers bielliptic phasing Interception interception planets",
        "Impulses": "Impulse impulses small_impulse VelocityToBeGained",
        "Perturbations": "oblateness zonals spherical_harmonics gravity_file secular_rates drag "
        "third_body solar_pressure low_thrust shadow",
        "Rendezvous": "clohessy_wiltshire",
        "Ground tracks and stations": "Station station ground_track rotating_earth",
        "Ballistic flight": "ballistic projectile uniform_gravity",
        "Central forces": "central_force radial_motion orbit_force point_gravity two_masses",
        "Paths of other bodies": "CircularPath KeplerPath TabulatedPath paths",
        "Events and outputs": "AtAltitude AtTargetOrbit outputs deviation_outputs",
    },
    "attitude": {
        "Free rotation": "TorqueFreeBody torque_free polhode principal_spins",
        "Tops, disks and pendulums": "Top nutation top_motion top_relatives RollingDisk "
        "TiltState disk_tilt SphericalPendulum PendulumState ShaftPendulum",
        "Applied torques": "BodyTorque SpaceTorque SpringTorque ViscousTorque MagneticDipole "
        "DipoleField applied_torques forced_rotation",
        "Gravity gradient": "GravityGradient gravity_gradient libration pitch_libration",
        "Despin": "YoYo despin unwinding swinging",
        "Internal energy dissipation": "AttitudeDrift DriftState drift EnergySink energy_sink "
        "NutationDamper nutation_damper MovingMasses moving_masses",
        "Wheels and control moment gyros": "ReactionWheels ControlMomentGyros wheels motors",
        "Spinning missiles": "SpinningMissile spinning_missile",
        "Precession of the Earth": "precession_of_earth",
        "Initial states and outputs": "initial outputs",
    },
    "gyros": {
        "Gyros in gimbals": "TwoGimbalGyro GimbalState gimbal_state gimbal_walk bearing",
        "Gyrocompasses and gyropendulums": "Gyrocompass GyrocompassState Gyropendulum "
        "GyropendulumState gyropendulum",
        "Rate gyros": "RateGyro RateGyroState noise",
        "Platforms": "PlatformAxis PlatformState platform StablePlatform StablePlatformState "
        "stable_platform",
        "Inertial navigation": "InertialNavigator NavigatorState Place navigation_errors",
        "Oscillators": "duffing",
    },
    "rockets": {
        "Thrust and actuators": "Thrust SteeredThrust GimballedThrust Gimbal ThrottledEngine "
        "ColdGasThrusters AttitudeControl servo",
        "Motors": "read_motor Motor ThrustProfile ThrottleTable BackPressure",
        "Steering": "steering PitchKick GravityTurn GravityTurnState gravity_turn",
        "Variable mass": "Separation PropellantDepletion JetDamping jet_damping MassStream "
        "variable_mass sprinkler",
        "Burns": "rocket_equation SpinningRocket angle_of_attack",
    },
    "vehicles": {
        "Complete flights": "Vehicle LaunchSite Recovery sounding_flight Rail flights landings",
        "Atmosphere and wind": "Wind UncertainWind MeasuredWind MeasuredAtmosphere DrydenGusts "
        "local_air sounding",
        "Aerodynamics": "Aerodynamics TabulatedAerodynamics aerodynamic_table AirDrag Parachute "
        "air_drag FinSet NoseCone RadiusChange airframe coefficient along_air",
        "Control surfaces": "AirBrake MovableFins",
        "Flexible bodies": "FlexibleStage",
        "Gravity near the ground": "ground_gravity",
    },
    "mechanics": {
        "Lagrangian and Hamiltonian systems": "Lagrangian AbstractLagrangian GeneralisedState "
        "Hamiltonian CanonicalState reduction variational discrete",
        "Constraints": "constraints rolling InclineDisk",
        "Impacts": "impact impulse LandingLegs",
        "Pendulums": "SimplePendulum DoublePendulum ElasticPendulum CentrifugalPendulum "
        "FramedPendulum ArmPendulum ArmState arm RotatingHoop",
        "Mechanisms": "BarOnSpring BarOnString SliderCarrier Trailer TrailerState",
        "Flexible bodies": "beams FlexibleMissile MissileState missile_loop",
        "Theorems of mechanics": "moving_point work",
    },
    "control": {
        "Closed loops": "ClosedLoop LoopRun step plan_step StepPlan",
        "Control laws": "attitude_laws point_laws vehicle_laws ApogeeControl FinControl "
        "LandingControl AbstractController Feedback",
        "Commands": "CommandedTorque CommandedAcceleration CommandedEngine CommandedMotor commands",
        "Sensors": "Sensor StarTracker AbstractSensor",
        "Environments": "SlewTask LandingTask RendezvousTask AbstractEnvironment environment "
        "point_tasks",
    },
    "dispersion": {
        "Campaigns": "disperse Campaign Dispersion StopRule",
        "Distributions": "Normal Uniform TruncatedNormal Triangular Lognormal Discrete Samples "
        "Constant AbstractDistribution ConeDirection Correlated MultivariateNormal AbstractJoint",
        "Sampling designs": "LatinHypercube Sobol AbstractDesign",
        "Other input distributions": "reweighting",
        "Sensitivity": "sensitivity",
        "Uncertainty of results": "rare Footprint",
        "Tolerance selection": "purpose",
        "Methods without sampling": "moments covariance comparison evaluate "
        "automatic",
        "Replaying runs": "run_paths RunPaths states replay",
        "Stores": "open_store DamagedStore StoreError",
        "Engines": "ProcessPool DaskCluster MultiHost Part AbstractEngine",
    },
    "sampling": {
        "Distributions": "Normal Uniform TruncatedNormal Triangular Lognormal Discrete Samples "
        "Constant distributions AbstractDistribution",
        "Joint distributions": "ConeDirection Correlated MultivariateNormal AbstractJoint",
        "Sampling designs": "LatinHypercube Sobol AbstractDesign",
        "Sweeps": "sweeps",
        "Densities": "densities",
    },
    "statistics": {
        "Results of campaigns": "Dispersion Failure table requirements purpose",
        "Sensitivity": "contributors correlation",
        "Uncertainty of results": "limits spread StopRule Footprint",
        "Sweeps": "sweeps",
        "Other input distributions": "weighted",
        "Extremes along a run": "extremes",
        "Comparison with measurements": "curves",
    },
    "stores": {
        "Stores": "open_store DamagedStore StoreError",
        "Archives": "archive",
    },
    "engines": {
        "Engines": "ProcessPool DaskCluster MultiHost Part",
        "User-defined engines": "AbstractEngine AbstractRunner",
    },
    "minimisation": {
        "Minimisation": "minimise minimise_from Criterion Minimum StopReason",
    },
    "optimization": {
        "Minimisation": "minimise minimise_from Criterion Minimum StopReason",
        "Staging": "optimal_staging Staging staging fixed_masses flown_staging staged_flight",
        "Ascent steering": "optimise_steering SteeredFlight SteeringOptimum SteeringProfile "
        "steering ascent laws",
        "Rendezvous and interception": "least_rendezvous Rendezvous PropellantUse propellant_use",
        "Orbit insertion": "optimise_insertion Insertion InsertionOptimum InsertionState",
    },
    "robust": {
        "Optimisation under uncertainty": "optimise_design train_design "
        "DesignOptimum",
        "Design variables": "free",
        "Assessment": "assess_designs DesignAssessment assessment",
        "Objectives and constraints": "statistics",
    },
    "studies": {
        "Cost of accuracy": "accuracy_cost AccuracyCost cost_table",
        "Significance of effects": "effect_budget EffectBudget budget_table",
        "Linearisation and sensitivities": "modes Modes equilibrium sensitivity Sensitivity "
        "MissionSensitivity",
        "Covariance propagation": "propagate_covariance MissionCovariance covariance",
    },
    "core": {
        "Systems and quantities": "AbstractSystem AbstractParameters quantity argument reference "
        "Choice FileName quantities",
        "Optional capabilities": "AbstractClosedForm AbstractSplit AbstractRegularised "
        "AbstractDecoupled AbstractSecondOrderForm AbstractGroupElement known_time",
        "Declarations for scene files": "constructor event initial output declarations",
        "Validation of inputs": "InputError MissingExtra check checks",
        "Numerical functions": "vectors square_roots shapes safe special elliptic jacobi Table "
        "Spline tables types",
    },
    "solvers": {
        "Methods": "DOP853 Tsit5 RKN1210 Stormer Regularised AdaptiveRegularised "
        "ExponentialRosenbrock Splitting MuntheKaas FixedSteps",
        "User-defined methods": "protocol",
    },
}
