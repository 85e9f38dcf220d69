"""Surfaces and engines that a controller moves: loads against closed forms and fixed parts, limits,
what is refused, and loops that fly them."""

import dataclasses
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mpmath import mp, mpf

import jaxspace
from jaxspace import Accuracy, BodyState, Scene, simulate_batch
from jaxspace.bodies import BurningBody, ExponentialAtmosphere, RigidBody
from jaxspace.control import ApogeeControl, FinControl, LandingControl
from jaxspace.control.vehicle_laws import drag_apogee
from jaxspace.core import InputError
from jaxspace.rockets import ColdGasThrusters, ThrottledEngine
from jaxspace.rockets.servo import servo_rate
from jaxspace.rotations import Quaternion, from_euler_angles
from jaxspace.scene import Scaled
from jaxspace.simulation import Status
from jaxspace.solvers import Tsit5
from jaxspace.vehicles import Aerodynamics, AirBrake, FinSet, MovableFins, Wind
from jaxspace.vehicles.flights import apogee
from jaxspace.vehicles.local_air import LocalAir

SCENES = Path(__file__).resolve().parents[2] / "examples" / "scenes"
AIR = LocalAir(
    ExponentialAtmosphere(1.2, 0.0, 7000.0), wind=Wind([0.0, 1e4], [3.0, 8.0], [-2.0, 1.0])
)
BODY = RigidBody(16.0, [8.0, 8.0, 0.04])
Y = BodyState(
    jnp.array([10.0, -20.0, 800.0]),
    jnp.array([20.0, -15.0, 180.0]),
    from_euler_angles(jnp.array([0.4, 0.2, -0.9])),
    jnp.array([0.3, -0.2, 0.7]),
)
CANARDS = FinSet(4, 0.05, 0.06, 0.03, 0.02, 0.0635, 0.9)
FAST = Accuracy(1e-6, method=Tsit5(), max_steps=64)
FOUR = np.arange(4.0) * np.pi / 2.0


def with_part(effect, y=Y, **part):
    """The state with the parts of the effect, moved to other positions."""
    y = Scene([effect], BODY).start(y)
    return dataclasses.replace(y, parts={**y.parts, **part})


def test_a_servo_is_late_and_within_its_limits():
    """Proportional to a small lag, at its greatest rate by a large one, and at rest at its stop."""
    command = jnp.array([1e-4, 0.9, -3.0, 0.2])
    found = servo_rate(command, jnp.array([0.0, -0.3, -0.3, 0.2]), -0.3, 0.3, 0.5, 0.1)
    # The hyperbolic tangent of 12 is 1 but for 8e-11; that of x is x but for a third of its cube.
    np.testing.assert_allclose(found, [1e-3, 0.5, 0.0, 0.0], rtol=2e-6, atol=1e-14)


@pytest.mark.parametrize("count", [3, 4])
def test_fins_at_rest_are_fixed_fins(count):
    """Force, moments and damping of `Aerodynamics` with the same set of fins, for any flow."""
    fins = dataclasses.replace(CANARDS, count=jnp.asarray(float(count)))
    movable = MovableFins(fins, 0.3 + np.arange(count) * 2.0 * np.pi / count, air=AIR)
    fixed = Aerodynamics(0.0127, 0.0, fins=fins, air=AIR)
    found, expected = (e.load(0.0, with_part(movable), BODY) for e in (movable, fixed))
    np.testing.assert_allclose(found.force_N, expected.force_N, rtol=1e-12)
    np.testing.assert_allclose(found.torque_B, expected.torque_B, rtol=1e-12)


def test_fins_turned_together_are_canted_fins():
    """To the first order in the angle, of a flow along the axis."""
    y = dataclasses.replace(
        Y, velocity=jnp.array([0.0, 0.0, 180.0]), attitude=Quaternion.identity(), omega=jnp.zeros(3)
    )
    calm = LocalAir(ExponentialAtmosphere(1.2, 0.0, 7000.0))
    angle = 1e-4
    movable = MovableFins(CANARDS, FOUR, air=calm)
    found = movable.load(0.0, with_part(movable, y, fins=jnp.full(4, angle)), BODY)
    canted = dataclasses.replace(CANARDS, cant=jnp.asarray(angle))
    expected = Aerodynamics(0.0127, 0.0, fins=canted, air=calm).load(0.0, y, BODY)
    # What is left is of the order of the square of the angle.
    np.testing.assert_allclose(found.torque_B[2], expected.torque_B[2], rtol=1e-7)
    np.testing.assert_allclose(found.torque_B[:2], 0.0, atol=1e-12)


def test_fins_turned_about_an_axis_turn_the_body_about_it():
    """The force of each fin along its normal, at its place, summed by hand."""
    movable = MovableFins(CANARDS, FOUR, air=AIR)
    angles = movable.mixed(jnp.array([0.03, -0.05, 0.02]))
    np.testing.assert_allclose(angles, [-0.01, 0.07, 0.05, -0.03], atol=1e-15)
    y = dataclasses.replace(with_part(movable, fins=angles), omega=jnp.array([0.3, -0.2, 0.0]))
    load = movable.load(0.0, y, BODY)
    air, moving = AIR.at(y.position)
    w = np.asarray(y.attitude.rotate_back(y.velocity - moving))
    speed = np.linalg.norm(w)
    mach, arm = speed / air.sound_speed, np.array([0.0, 0.0, CANARDS.centre()])
    flow = w + np.cross(y.omega, arm)
    force, moment, push = np.zeros(3), np.zeros(3), 0.5 * air.density * speed
    for azimuth, d in zip(FOUR, angles, strict=True):
        t = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        normal = t * np.cos(d) - np.array([0.0, 0.0, np.sin(d)])
        # Along the axis the flow is that at the centre of mass, as the fins turn at no rate of it.
        here = -push * 0.5 * CANARDS.slope(mach) * np.dot(flow, normal) * normal
        force, moment = force + here, moment + np.cross(arm, here)
    np.testing.assert_allclose(y.attitude.rotate_back(load.force_N), force, rtol=1e-11)
    np.testing.assert_allclose(load.torque_B[:2], moment[:2], rtol=1e-11)


def test_stalled_fins_are_outside_of_the_model():
    """From an incidence of 15 degrees on, of the flow at the fins, their angle and their cant, at a
    dynamic pressure above 1 kPa."""
    tenth, limit = np.degrees(0.1), np.sqrt(2.0 * 1000.0 / 1.2)
    # tan 15 deg = 0.268 = tan 12 deg + 0.055: the flow by a rate of pitch over that along the axis.
    pitch = 100.0 * np.cos(np.radians(12.0)) / float(CANARDS.centre())
    rows = [
        # Incidence of the flow, deg, speed, angle of the fins, rate of pitch, and what is expected.
        *((a, 100.0, 0.0, 0.0, a * a > 225.0) for a in (14.9, -14.9, 15.1, -15.1)),
        *((40.0, share * limit, 0.0, 0.0, share > 1.0) for share in (0.99, 1.01)),
        *((a - tenth, 100.0, 0.1, 0.0, a > 15.0) for a in (14.8, 15.2)),
        *((12.0, 100.0, 0.0, share * pitch, share > 0.055) for share in (0.05, 0.06)),
    ]
    degrees, speed, angle, rate, left = map(jnp.array, zip(*rows, strict=True))
    calm = LocalAir(ExponentialAtmosphere(1.2, 0.0, 7000.0))

    def status(fins, degrees, wrap=lambda effect: effect):
        a, zero = jnp.radians(degrees), jnp.zeros(degrees.size)
        command = jnp.stack([zero, zero, angle[: a.size]])
        scene = Scene([wrap(MovableFins(fins, FOUR, air=calm, command=command))], BODY)
        y = BodyState(
            jnp.zeros((3, a.size)),
            speed[: a.size] * jnp.stack([jnp.sin(a), zero, jnp.cos(a)]),
            Quaternion.about(0, zero),
            jnp.stack([zero, rate[: a.size], zero]),
        )
        # So short that the state barely changes.
        ts = jnp.array([0.0, 1e-4])
        return simulate_batch(scene, scene.start(y), ts, accuracy=FAST, throw=False).status

    expected = np.where(left, Status.OUTSIDE_MODEL, Status.COMPLETED)
    np.testing.assert_array_equal(status(CANARDS, degrees), expected)
    # A cant adds to the angles, and a scaled effect has the range of the one that it scales.
    canted = dataclasses.replace(CANARDS, cant=jnp.asarray(0.1))
    found = status(canted, degrees[:4] - tenth, lambda effect: Scaled(effect, 0.5))
    np.testing.assert_array_equal(found[::2], expected[:4:2])


def test_an_air_brake_drags_by_its_share():
    brake = AirBrake(0.01, 1.2, air=AIR, command=0.7)
    y = with_part(brake, air_brake=jnp.asarray(0.4))
    load = brake.load(0.0, y, BODY)
    air, moving = AIR.at(y.position)
    w = np.asarray(y.velocity - moving)
    expected = -0.5 * air.density * np.linalg.norm(w) * 0.4 * 0.01 * 1.2 * w
    np.testing.assert_allclose(load.force_N, expected, rtol=1e-13)
    np.testing.assert_allclose(load.parts_rate["air_brake"], 2.0 * np.tanh(3.0), rtol=1e-13)
    # It starts where its command holds it, within its stops.
    wide = dataclasses.replace(brake, command=jnp.asarray(3.0))
    assert with_part(wide).part("air_brake") == 1.0


def test_an_engine_pushes_turns_and_burns():
    """At angles a and b: F along (-tan b, tan a, 1), and the torque of its lever."""
    body = BurningBody(800.0, [900.0, 900.0, 300.0], [0.8, 0.8, 0.6], -0.5)
    engine = ThrottledEngine(2e4, 2800.0, 810.0, -2.0, least_throttle=0.3)
    y = dataclasses.replace(Y, mass=jnp.asarray(1000.0))
    y = dataclasses.replace(y, parts={"engine": jnp.array([0.6, 0.05, -0.08])})
    load = engine.load(0.0, y, body)
    force = np.asarray(y.attitude.rotate_back(load.force_N))
    np.testing.assert_allclose(np.linalg.norm(force), 1.2e4, rtol=1e-13)
    np.testing.assert_allclose(force[:2] / force[2], [np.tan(0.08), np.tan(0.05)], rtol=1e-12)
    lever = np.array([0.0, 0.0, -2.0]) - np.asarray(body.centre_of_mass(y.mass))
    np.testing.assert_allclose(load.torque_B, np.cross(lever, force), rtol=1e-12)
    # From behind the centre of mass a positive angle turns about its own axis.
    assert load.torque_B[0] > 0.0 > load.torque_B[1]
    np.testing.assert_allclose(load.mass_rate, -1.2e4 / 2800.0, rtol=1e-14)
    # Commands beyond the stops are met at the stops, at the greatest rates.
    wild = dataclasses.replace(engine, command=jnp.array([-4.0, 9.0, -9.0]))
    rates = np.array([1.0, 0.5, 0.5])
    expected = rates * np.tanh(np.array([-0.3, 0.05, -0.02]) / (0.05 * rates))
    np.testing.assert_allclose(wild.load(0.0, y, body).parts_rate["engine"], expected, rtol=1e-12)
    first = wild.start(y, body)["engine"]
    np.testing.assert_allclose(first, [0.3, 0.1, -0.1])
    dry = engine.load(0.0, dataclasses.replace(y, mass=jnp.asarray(810.0)), body)
    assert not np.any(dry.force_N) and dry.mass_rate == 0.0


def test_cold_gas_turns_within_its_limit_for_its_mass():
    jets = ColdGasThrusters(20.0, 0.5, 600.0, 900.0, command=[5.0, -50.0, 0.0])
    y = dataclasses.replace(Y, mass=jnp.asarray(1000.0))
    load = jets.load(0.0, y, BODY)
    np.testing.assert_allclose(load.torque_B, [5.0, -20.0, 0.0])
    np.testing.assert_allclose(load.mass_rate, -25.0 / 300.0, rtol=1e-14)
    empty = jets.load(0.0, dataclasses.replace(y, mass=jnp.asarray(900.0)), BODY)
    assert not np.any(empty.torque_B) and empty.mass_rate == 0.0


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: AirBrake(0.01, 1.2, rate_limit=0.0), "AirBrake.rate_limit is 0.*positive"),
        (
            lambda: MovableFins(CANARDS, FOUR, rate_limit=0.0),
            "MovableFins.rate_limit is 0.*positive",
        ),
        (
            lambda: ThrottledEngine(1e4, 3e3, 1e3, -2.0, angle_rate=0.0),
            "ThrottledEngine.angle_rate is 0.*positive",
        ),
        (
            lambda: MovableFins(CANARDS, FOUR[:3]),
            "MovableFins.azimuths has the length 3: it must be equal to FinSet.count, 4",
        ),
        (
            lambda: ApogeeControl(3e3, 0.0, 0.1),
            "ApogeeControl.drag is 0.*positive",
        ),
    ],
)
def test_what_cannot_move_is_a_sentence(make, sentence):
    with pytest.raises(InputError, match=sentence):
        make()


def test_loads_have_finite_slopes_in_still_air_and_on_the_axis():
    """At rest in calm air, and without an angle of attack: in both modes, in one program."""
    calm = LocalAir(ExponentialAtmosphere(1.2, 0.0, 7000.0))
    effects = MovableFins(CANARDS, FOUR, air=calm), AirBrake(0.01, 1.2, air=calm)

    @jax.jit
    @jax.vmap
    def slopes(velocity):
        def loads(velocity):
            y = dataclasses.replace(
                Y, velocity=velocity, attitude=Quaternion.identity(), omega=jnp.zeros(3)
            )
            every = [e.load(0.0, with_part(e, y), BODY) for e in effects]
            return jnp.concatenate([every[0].force_N, every[0].torque_B, every[1].force_N])

        return jax.jacfwd(loads)(velocity), jax.jacrev(loads)(velocity)

    forward, reverse = slopes(jnp.array([[0.0, 0.0, 0.0], [0.0, 0.0, 90.0]]))
    np.testing.assert_allclose(forward, reverse, atol=1e-9)
    np.testing.assert_allclose(forward[0], 0.0, atol=1e-12)
    # Against the side slip, by all fins: rho/2 w S.
    push = 0.5 * calm.at(Y.position)[0].density * 90.0
    mach = 90.0 / calm.at(Y.position)[0].sound_speed
    np.testing.assert_allclose(forward[1][0, 0], -push * CANARDS.slope(mach), rtol=1e-12)


def test_the_predicted_apogee_is_that_of_a_vertical_flight():
    """v dv/dz = -g - b v^2, summed by steps of the speed: dz = -v dv/(g + b v^2)."""
    v = np.linspace(0.0, 240.0, 100_001)
    expected = 500.0 + np.trapezoid(v / (9.8 + 3e-4 * v * v), v)
    np.testing.assert_allclose(drag_apogee(500.0, 240.0, 3e-4, 9.8), expected, rtol=1e-9)
    assert drag_apogee(500.0, -3.0, 3e-4, 9.8) == 500.0


def test_the_landing_law_is_the_quartic_that_ends_upright():
    """Its acceleration is the second derivative of the quartic through both ends at the start."""
    law = LandingControl(
        20.0, [0.0, 0.0, -9.8], 1e5, 1.0, 1.0, 1.0, velocity=[0.0, 0.0, -1.0], tilt_limit=1.4
    )
    x, v = np.array([80.0, -30.0, 900.0]), np.array([-5.0, 4.0, -70.0])
    thrust = law.thrust(0.0, jnp.asarray(x), jnp.asarray(v), jnp.asarray(1000.0))
    # c0 + c1 t + ... + c4 t^4: position and velocity here, position, velocity and zero there.
    t = 20.0
    rows = [[t**2, t**3, t**4], [2 * t, 3 * t**2, 4 * t**3], [2.0, 6 * t, 12 * t**2]]
    for k, end in enumerate((0.0, 0.0, -1.0)):
        right = [-x[k] - v[k] * t, end - v[k], 0.0]
        wanted = 2.0 * np.linalg.solve(rows, right)[0] + (9.8 if k == 2 else 0.0)
        np.testing.assert_allclose(thrust[k], 1000.0 * wanted, rtol=1e-10)
    # Too high at the end: it leans no farther, and never turns over.
    late = dataclasses.replace(law, arrival=jnp.asarray(0.0), tilt_limit=jnp.asarray(0.2))
    wild = late.thrust(0.0, jnp.array([90.0, 0.0, 500.0]), jnp.zeros(3), jnp.asarray(1000.0))
    np.testing.assert_allclose(wild, [-np.tan(0.2), 0.0, 1.0], rtol=1e-12)


def test_fin_control_softens_with_the_pressure_of_the_air():
    law = FinControl([0.0, 0.0, 0.5], [0.0, 0.0, 0.1], full_speed=90.0)
    y = dataclasses.replace(Y, attitude=Quaternion.identity(), omega=jnp.array([0.0, 0.0, 2.0]))
    slow, fast = (
        law.act(0.0, None, dataclasses.replace(y, velocity=jnp.array([0.0, 0.0, v])))[0]
        for v in (30.0, 180.0)
    )
    np.testing.assert_allclose(slow, [0.0, 0.0, -0.2], atol=1e-15)
    np.testing.assert_allclose(fast, 0.25 * slow, atol=1e-15)


def test_an_air_brake_from_a_file_ends_a_climb_at_its_height():
    run = jaxspace.load(SCENES / "air_brake.toml").simulate()
    share = np.asarray(run.states.part("air_brake"))
    # Shut while the motor burns, and never faster than its servo.
    assert np.all(share[run.ts < 3.5] == 0.0) and 0.0 < share.max() < 1.0
    assert np.max(np.diff(share) / np.maximum(np.diff(run.ts), 1e-9)) <= 2.0 + 1e-9
    assert abs(run.final.position[2] - 3000.0) < 5.0 and abs(run.final.velocity[2]) < 1e-9


@pytest.mark.sweep
def test_an_upright_landing_from_a_file():
    run = jaxspace.load(SCENES / "upright_landing.toml").simulate()
    y = run.final
    assert abs(y.position[2]) < 1e-9 and np.hypot(*y.position[:2]) < 1.0
    assert np.linalg.norm(y.velocity) < 2.5
    up = y.attitude.rotate(jnp.array([0.0, 0.0, 1.0]))
    assert np.degrees(np.arccos(up[2])) < 3.0 and abs(y.omega[2]) < 1e-3
    throttle, *angles = np.asarray(run.states.part("engine"))
    # The stops hold, and the rocket equation by the throttle that was flown.
    assert np.all((throttle >= 0.25) & (throttle <= 1.0))
    assert np.max(np.abs(angles)) <= np.radians(8.0)
    burnt = np.trapezoid(throttle, run.ts) * 22e3 / 2700.0
    np.testing.assert_allclose(1100.0 - y.mass, burnt, rtol=5e-3)


@pytest.mark.sweep
def test_a_roll_controller_from_a_file():
    run = jaxspace.load(SCENES / "roll_control.toml").simulate()
    fins, rate = np.asarray(run.states.part("fins")), np.asarray(run.states.omega[2])
    assert np.max(np.abs(fins)) <= np.radians(8.0)
    np.testing.assert_allclose(fins, fins[:1] + 0.0 * fins, atol=1e-12)
    w, _, _, z = run.final.attitude.wxyz
    assert abs(rate[-1]) < 0.02 and abs(np.degrees(2.0 * np.arctan2(z, w))) < 2.0


@pytest.mark.sweep
def test_slopes_of_a_closed_flight_are_its_differences():
    """Of the apogee under an air brake, by the gain and by the drag that its law believes in."""
    file = jaxspace.load(SCENES / "air_brake.toml")
    y0, events = file.y0, jaxspace.Event(apogee, direction=-1)

    @jax.jit
    def height(x):
        law = ApogeeControl(3000.0, 4e-4 * x[1], 0.02 * x[0], 0.3, 3.5)
        loop = dataclasses.replace(file.loop, controller=law)
        run = loop.simulate(y0, np.linspace(0.0, 40.0, 5), accuracy=1e-5, events=events)
        return run.final.position[2]

    slope = jax.jit(jax.jacfwd(height))(jnp.ones(2))
    h = 1e-4
    for k, along in enumerate(np.eye(2)):
        expected = (height(1.0 + h * along) - height(1.0 - h * along)) / (2.0 * h)
        # The truncation of the difference, and the tolerance of the steps.
        np.testing.assert_allclose(slope[k], expected, rtol=1e-3)


def interference(span, radius, root, tip):
    """Barrowman's 3-32 and 3-56 as they are printed, with as many digits as are set."""
    tau, ratio = 1 + mpf(span) / mpf(radius), mpf(tip) / mpf(root)
    a = mp.asin((tau**2 - 1) / (tau**2 + 1))
    b = ((tau**2 + 1) / (tau * (tau - 1))) ** 2
    c = (tau + 1) / (tau * (tau - 1))
    forcing = mp.pi**2 / 4 * ((tau + 1) / tau) ** 2 + mp.pi * b * a - 2 * mp.pi * c
    forcing += b * a**2 - 4 * c * a
    forcing += 8 / (tau - 1) ** 2 * mp.log((tau**2 + 1) / (2 * tau))
    upper = (tau - ratio) / tau - (1 - ratio) / (tau - 1) * mp.log(tau)
    lower = (tau + 1) * (tau - ratio) / 2 - (1 - ratio) * (tau**3 - 1) / (3 * (tau - 1))
    return forcing / mp.pi**2, 1 + upper / lower


# On both sides of the switches to series, and where the printed formulas lose all digits.
@pytest.mark.parametrize("share", [1e-8, 1e-3, 0.1, 0.49, 0.51, 0.55, 0.57, 3.0, 1e3])
@pytest.mark.parametrize("precision, within", [(jnp.float64, 2e-15), (jnp.float32, 1e-6)])
def test_interference_of_short_fins_keeps_its_digits(share, precision, within):
    """Values, and slopes by the span in both modes."""
    x = [precision(y) for y in (0.0635 * share, 0.0635, 0.05, 0.02)]

    def shares(span):
        fins = FinSet(4, span, x[2], x[3], precision(0.01), x[1], precision(0.9))
        return jnp.stack([fins._forcing_share(), fins._damping_share()])

    given = [float(y) for y in x]
    with mp.workdps(50):
        truth = np.array([float(y) for y in interference(*given)])
        slopes = [
            float(mp.diff(lambda s, k=k: interference(s, *given[1:])[k], mpf(given[0])))
            for k in range(2)
        ]
    np.testing.assert_allclose(shares(x[0]), truth, rtol=within)
    for mode in (jax.jacfwd, jax.jacrev):
        found = np.asarray(mode(shares)(x[0]), float)
        # Relative to the value: the slope vanishes for long fins.
        np.testing.assert_allclose(
            found * given[0], np.array(slopes) * given[0], rtol=20 * within, atol=10 * within
        )
