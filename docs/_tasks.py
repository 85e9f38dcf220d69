"""The names of each package by what a reader wants to do: a name of its root, or a module, which
stands for all of its names. What is not listed follows in a group of its own."""

TASKS = {
    "simulation": {
        "Run": "simulate simulate_batch simulate_mission simulate_mission_batch simulate_compact",
        "Say how": "Accuracy FinalError Event Mission Phase crossings",
        "Read the result": "Trajectory MissionTrajectory CompactRun Status "
        "SimulationError",
        "Know the error of a derivative": "gradient_error CheckedGradient",
    },
    "scene": {
        "Put a system together": "Scene Custom",
        "See what each effect does": "explain budget EffectRow Scaled scaled outputs",
    },
    "bodies": {
        "Describe a body": "RigidBody BurningBody BodyState state AbstractBody",
        "Compute its mass and inertia": "MassProperties mass_properties solids PrincipalInertia "
        "InertiaTensor inertia principal_axes principal_frame",
        "Know the air": "StandardAtmosphere standard_atmosphere PadAtmosphere "
        "ExponentialAtmosphere Air AbstractAtmosphere atmosphere",
        "Move it": "newton_euler FreeRotation",
        "Let it come apart": "parting Detached",
        "Write an effect, a jump or an end": "AbstractEffect Load effects AbstractJump "
        "AbstractCondition",
    },
    "rotations": {
        "Turn vectors": "Quaternion direction_cosines rotation_vector tilt",
        "Convert angles": "from_euler_angles to_euler_angles euler_angles",
        "Interpolate and average": "interpolation mean",
        "Change the frame": "MovingFrame moving_frame plane_motion",
    },
    "orbits": {
        "Put a scene together": "PointGravity Oblateness Zonals Drag ThirdBody SolarPressure "
        "LowThrust QLaw UniformGravity SphereGravity RotatingFrame",
        "Take a system as it is": "TwoBody ClohessyWiltshire CentralPotential PowerLawForce",
        "Describe an orbit": "ClassicalElements EquinoctialElements ModifiedEquinoctialElements "
        "elements conic initial burnout",
        "Go along an orbit": "kepler time_of_flight steps",
        "Go from one place or orbit to another": "lambert transfers bielliptic phasing "
        "Interception interception planets",
        "Give an impulse": "Impulse impulses small_impulse VelocityToBeGained",
        "Know what disturbs an orbit": "oblateness zonals secular_rates drag third_body "
        "solar_pressure low_thrust shadow",
        "Meet a target": "clohessy_wiltshire",
        "See the ground and be seen": "Station station ground_track rotating_earth",
        "Throw and come down": "ballistic projectile uniform_gravity",
        "Study central forces": "central_force radial_motion orbit_force point_gravity two_masses",
        "Say where another body is": "CircularPath KeplerPath TabulatedPath paths",
        "End a phase, read a result": "AtAltitude AtTargetOrbit outputs deviation_outputs",
    },
    "attitude": {
        "Turn freely": "TorqueFreeBody torque_free polhode principal_spins",
        "Spin a top": "Top nutation top_motion top_relatives RollingDisk TiltState disk_tilt "
        "SphericalPendulum PendulumState ShaftPendulum",
        "Apply a torque": "BodyTorque SpaceTorque SpringTorque ViscousTorque MagneticDipole "
        "DipoleField applied_torques forced_rotation",
        "Be held by gravity": "GravityGradient gravity_gradient libration pitch_libration",
        "Stop a spin": "YoYo despin unwinding swinging",
        "Lose energy inside": "AttitudeDrift DriftState drift EnergySink energy_sink "
        "NutationDamper nutation_damper MovingMasses moving_masses",
        "Turn by wheels": "ReactionWheels ControlMomentGyros wheels motors",
        "Point a spinning missile": "SpinningMissile spinning_missile",
        "Follow the Earth's axis": "precession_of_earth",
        "Start and read": "initial outputs",
    },
    "gyros": {
        "Spin a gyro in gimbals": "TwoGimbalGyro GimbalState gimbal_state gimbal_walk bearing",
        "Find north and the vertical": "Gyrocompass GyrocompassState Gyropendulum "
        "GyropendulumState gyropendulum",
        "Measure a rate": "RateGyro RateGyroState noise",
        "Hold a platform": "PlatformAxis PlatformState platform StablePlatform "
        "StablePlatformState stable_platform",
        "Navigate": "InertialNavigator NavigatorState Place navigation_errors",
        "Study an oscillator": "duffing",
    },
    "rockets": {
        "Push": "Thrust SteeredThrust GimballedThrust Gimbal ThrottledEngine ColdGasThrusters "
        "AttitudeControl servo",
        "Describe a motor": "read_motor Motor ThrustProfile ThrottleTable BackPressure",
        "Steer": "steering PitchKick GravityTurn GravityTurnState gravity_turn",
        "Lose mass": "Separation PropellantDepletion JetDamping jet_damping MassStream "
        "variable_mass sprinkler",
        "Compute a burn": "rocket_equation SpinningRocket angle_of_attack",
    },
    "vehicles": {
        "Fly from the rail to the ground": "Vehicle LaunchSite Recovery sounding_flight Rail "
        "flights landings",
        "Know the air": "Wind UncertainWind MeasuredWind MeasuredAtmosphere DrydenGusts local_air "
        "sounding",
        "Meet the air": "Aerodynamics TabulatedAerodynamics aerodynamic_table AirDrag Parachute "
        "air_drag FinSet NoseCone RadiusChange airframe coefficient along_air",
        "Move surfaces": "AirBrake MovableFins",
        "Bend": "FlexibleStage",
        "Fall": "ground_gravity",
    },
    "mechanics": {
        "Write a system from its energy": "Lagrangian AbstractLagrangian GeneralisedState "
        "Hamiltonian CanonicalState reduction variational discrete",
        "Constrain it": "constraints rolling InclineDisk",
        "Let it strike": "impact impulse LandingLegs",
        "Swing": "SimplePendulum DoublePendulum ElasticPendulum CentrifugalPendulum "
        "FramedPendulum ArmPendulum ArmState arm RotatingHoop",
        "Take a mechanism as it is": "BarOnSpring BarOnString SliderCarrier Trailer TrailerState",
        "Bend": "beams FlexibleMissile MissileState missile_loop",
        "Use the theorems": "moving_point work",
    },
    "control": {
        "Close a loop": "ClosedLoop LoopRun step plan_step StepPlan",
        "Take a law": "attitude_laws point_laws vehicle_laws ApogeeControl FinControl "
        "LandingControl AbstractController Feedback",
        "Drive": "CommandedTorque CommandedAcceleration CommandedEngine CommandedMotor commands",
        "Measure": "Sensor StarTracker AbstractSensor",
        "Learn by trial": "SlewTask LandingTask RendezvousTask AbstractEnvironment environment "
        "point_tasks",
    },
    "dispersion": {
        "Run a campaign": "disperse Campaign Dispersion StopRule",
        "Scatter an input": "Normal Uniform TruncatedNormal Triangular Lognormal Discrete Samples "
        "Constant AbstractDistribution ConeDirection Correlated MultivariateNormal "
        "AbstractJoint",
        "Choose the samples": "LatinHypercube Sobol AbstractDesign",
        "Know what causes the scatter": "sensitivity",
        "Know how sure a number is": "rare Footprint",
        "Take the tolerance that serves": "purpose",
        "Do without many runs": "moments covariance comparison evaluate",
        "Run one again": "run_paths RunPaths replay",
        "Keep the runs": "open_store DamagedStore StoreError",
        "Choose where they run": "ProcessPool DaskCluster MultiHost AbstractEngine",
    },
    "sampling": {
        "Scatter an input": "Normal Uniform TruncatedNormal Triangular Lognormal Discrete Samples "
        "Constant distributions AbstractDistribution",
        "Scatter inputs together": "ConeDirection Correlated MultivariateNormal AbstractJoint",
        "Choose the samples": "LatinHypercube Sobol AbstractDesign",
    },
    "statistics": {
        "Read the runs": "Dispersion Failure table requirements purpose",
        "Know what causes the scatter": "contributors correlation",
        "Know how sure a number is": "limits spread StopRule Footprint",
        "Know the extremes along a run": "extremes",
    },
    "stores": {
        "Read a store": "open_store DamagedStore StoreError",
    },
    "engines": {
        "Choose where runs are computed": "ProcessPool DaskCluster MultiHost",
        "Write an engine": "AbstractEngine AbstractRunner",
    },
    "minimisation": {
        "Minimise": "minimise minimise_from Criterion Minimum StopReason",
    },
    "optimization": {
        "Minimise": "minimise minimise_from Criterion Minimum StopReason",
        "Stage a rocket": "optimal_staging Staging staging fixed_masses flown_staging "
        "staged_flight",
        "Steer an ascent": "optimise_steering SteeredFlight SteeringOptimum SteeringProfile "
        "steering ascent laws",
        "Meet a target": "least_rendezvous Rendezvous PropellantUse propellant_use",
        "Reach an orbit": "optimise_insertion Insertion InsertionOptimum InsertionState",
    },
    "robust": {
        "Search": "optimise_design train_design optimise_nominal DesignOptimum",
        "Name what is free": "free",
        "Assess by fresh runs": "assess_designs DesignAssessment assessment",
        "Say what is best": "statistics",
    },
    "studies": {
        "Know what accuracy costs": "accuracy_cost AccuracyCost cost_table",
        "Know which effects matter": "effect_budget EffectBudget budget_table",
        "Linearise": "modes Modes equilibrium sensitivity Sensitivity MissionSensitivity",
        "Carry a covariance": "propagate_covariance MissionCovariance covariance",
    },
    "core": {
        "Write a system": "AbstractSystem AbstractParameters quantity argument reference Choice "
        "FileName quantities",
        "Say what it can do": "AbstractClosedForm AbstractSplit AbstractRegularised "
        "AbstractDecoupled AbstractSecondOrderForm AbstractGroupElement known_time",
        "Declare for files": "constructor event initial output declarations",
        "Refuse a wrong input": "InputError MissingExtra check checks",
        "Compute": "vectors square_roots shapes safe special elliptic jacobi Table Spline tables "
        "types",
    },
    "solvers": {
        "Choose a method": "DOP853 Tsit5 RKN1210 Stormer Regularised AdaptiveRegularised "
        "ExponentialRosenbrock Splitting MuntheKaas FixedSteps",
        "Write a method": "protocol",
    },
}
