"""Single precision stays, whatever Python numbers meet it: every public formula of the systems in
the registry, and of classes that have formulas alone, with a Python number for each number. And it
is as good as its roundings next to singular places, where squares underflow."""

import dataclasses
import inspect
import math
from typing import get_args

import equinox as eqx
import fuzz_single
import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from more_systems import MORE
from systems import GYRO, SAMPLES

from jaxspace import Scene
from jaxspace.attitude import SpinningMissile, TorqueFreeBody, YoYo
from jaxspace.attitude.principal_spins import cone_bounds
from jaxspace.attitude.torque_free import space_cone_angle
from jaxspace.bodies import BodyState, PadAtmosphere, PrincipalInertia, RigidBody
from jaxspace.bodies.atmosphere import GAS_CONSTANT, GRAVITY, MOLAR_MASS
from jaxspace.bodies.standard_atmosphere import geopotential_height
from jaxspace.core import InputError, Scalar, Spline, State
from jaxspace.gyros import TwoGimbalGyro
from jaxspace.gyros._earth import Earth
from jaxspace.gyros.bearing import BearingFriction, RotorMotor
from jaxspace.gyros.navigation_errors import coupled_rates
from jaxspace.mechanics import SimplePendulum
from jaxspace.mechanics.beams import beam_roots, beam_shape
from jaxspace.mechanics.variational import action, hanging_chain
from jaxspace.orbits.central_force import power_law, sphere_gravity
from jaxspace.orbits.kepler import kepler_flow
from jaxspace.orbits.lambert import lambert
from jaxspace.orbits.planets import synodic_period
from jaxspace.orbits.point_gravity import point_gravity
from jaxspace.orbits.radial_motion import radial_motion
from jaxspace.rockets import GravityTurnState, SpinningRocket, Thrust, ThrustProfile
from jaxspace.rockets.gravity_turn import gravity_turn_after
from jaxspace.rotations import Quaternion

RUBBING = TwoGimbalGyro(
    *(0.002, 0.0008, 500.0, 0.0006, 0.0005, 0.0004, 0.0015),
    inner_bearing=BearingFriction(0.01, 0.02),
    outer_bearing=BearingFriction(0.02, 0.03),
    motor=RotorMotor(1e-3, 450.0),
)
# Without a state; and a gyro with all of its parts, before those of the registry.
FIRST = [
    (SpinningRocket(6.0, 0.01, 1.2, 0.8, 0.3), None),
    (SpinningMissile(2.0, 0.5, 20.0), None),
    (YoYo(0.264, 0.127, 0.01134, 1.0), None),
    (GYRO.walk(1.0, 2.0), None),
    (RUBBING, RUBBING.state(1.05, 0.1, 2.0, 0.3)),
]


single = fuzz_single.single


def everything():
    """Each class once, with a state where it has one."""
    found = {type(part).__name__: (part, state) for part, state in FIRST}
    for sample in (*SAMPLES, *MORE):
        parts = sample.system.effects if isinstance(sample.system, Scene) else [sample.system]
        for part in parts:
            found.setdefault(type(part).__name__, (part, sample.state))
    return found


EVERYTHING = everything()


def argument(annotation, state):
    """What a formula is given in place of such a parameter; None for what is no number."""
    if annotation == Scalar:
        return 0.3
    if annotation == State or (isinstance(annotation, type) and isinstance(state, annotation)):
        return state
    # Components are an array, and so of the precision of the system.
    for kind in (annotation, *get_args(annotation)):
        size = getattr(kind, "dim_str", "").split(" ")[0]
        if size.isdigit():
            return jnp.full(int(size), 0.1, jnp.float32)
    return None


def calls(part, state):
    """The public formulas whose arguments can be made here, and these."""
    for name in dir(type(part)):
        # A static method and one of the class know no system whose precision they could keep.
        if name.startswith("_") or not inspect.isfunction(inspect.getattr_static(part, name)):
            continue
        parameters = inspect.signature(getattr(part, name)).parameters.values()
        needed = [p.annotation for p in parameters if p.default is inspect.Parameter.empty]
        args = [argument(annotation, state) for annotation in needed]
        if all(x is not None for x in args):
            yield name, args


@pytest.mark.parametrize("name", EVERYTHING)
def test_a_python_number_raises_no_precision(name):
    """By their shapes alone, as the compiler is told them: nothing is compiled."""
    part, state = (single(x) for x in EVERYTHING[name])
    for formula, args in calls(part, state):
        numbers, arrays = eqx.partition(args, lambda x: isinstance(x, float))

        def called(part, arrays, formula=formula, numbers=numbers):
            return getattr(part, formula)(*eqx.combine(numbers, arrays))

        try:
            found = jax.tree.leaves(eqx.filter_eval_shape(called, part, arrays))
        except InputError:
            # The end of a burn, without a mass at which it ends.
            continue
        doubles = [x for x in found if getattr(x, "dtype", None) == jnp.float64]
        # A weak type follows what it meets.
        assert all(x.weak_type for x in doubles), formula


def test_a_moment_that_changes_with_the_time_keeps_single_precision():
    """Its integral is by nodes that are known."""
    missile = single(SpinningMissile(2.0, 0.5, 20.0))
    pair = jnp.array([0.1, 0.2], jnp.float32)

    def moment(t):
        return jnp.stack([jnp.sin(t), jnp.cos(t)])

    rate = eqx.filter_eval_shape(
        lambda m, pair: m.transverse_rate(0.3, pair, moment), missile, pair
    )
    tilt = eqx.filter_eval_shape(
        lambda m, pair: m.complex_tilt(0.3, pair, pair, moment), missile, pair
    )
    assert rate.dtype == tilt.dtype == jnp.float32


def python(x):
    """The tree, with a Python number or a list of them for each array."""
    if eqx.is_inexact_array(x):
        return np.asarray(x).tolist()
    if isinstance(x, RigidBody):
        return RigidBody(python(x.mass), python(x.moment_of_inertia))
    if isinstance(x, eqx.Module):
        fields = {f.name: python(getattr(x, f.name)) for f in dataclasses.fields(x) if f.init}
        parameters = inspect.signature(type(x).__init__).parameters
        # Others are made from tables and files, which say their precision.
        return type(x)(**fields) if set(fields) <= set(parameters) else x
    if isinstance(x, tuple):
        return type(x)(*map(python, x)) if hasattr(x, "_fields") else tuple(map(python, x))
    return x


@pytest.mark.parametrize("sample", [*SAMPLES, *MORE], ids=lambda s: s.name)
def test_a_list_of_python_numbers_raises_no_precision(sample):
    """Vector field and invariants of a system of such numbers, for a state of single precision."""
    if sample.name == "tabulated_rocket":
        pytest.skip("its tables are arrays of double precision")
    system, state = python(sample.system), single(sample.state)

    def rates(system, state):
        t = jnp.asarray(0.1, jnp.float32)
        return system.vector_field(t, state), system.invariants(t, state)

    found = jax.tree.leaves(eqx.filter_eval_shape(rates, system, state))
    doubles = [x for x in found if getattr(x, "dtype", None) == jnp.float64]
    assert all(x.weak_type for x in doubles)


def test_the_body_of_the_manual_keeps_single_precision():
    state = BodyState(
        attitude=Quaternion(jnp.asarray([1.0, 0.0, 0.0, 0.0], jnp.float32)),
        omega=jnp.asarray([0.1, 0.2, 0.3], jnp.float32),
    )
    for body in (
        TorqueFreeBody([1.0, 2.0, 3.0]),
        TorqueFreeBody(PrincipalInertia([1.0, 2.0, 3.0])),
    ):
        flow = eqx.filter_eval_shape(lambda b, y: b.closed_form().flow(0.5, y), body, state)
        rate = eqx.filter_eval_shape(lambda b, y: b.vector_field(0.0, y), body, state)
        assert {x.dtype for x in jax.tree.leaves((flow, rate))} == {np.dtype(np.float32)}


# Some of `fuzz_single.py`, which searches all of them for longer.
SINGULAR = (
    *("arctangent", "length", "direction", "quotient", "kepler", "elements", "constants"),
    *("cones", "coast", "plane_change", "turning_by_gravity"),
    *("pseudo_potential", "quickest_descent"),
)


@pytest.mark.parametrize("name", SINGULAR)
def test_closed_forms_next_to_their_singular_places(name):
    """Values and both modes of derivatives where squares underflow, in roundings times the
    condition number: as many as a search may find (`fuzz_single.DEFECT`), because each formula
    rounds some tens of times."""
    (subject,) = fuzz_single.subjects([name], places=60)
    found = fuzz_single.search(subject)
    assert not found.promotes
    assert found.value < fuzz_single.DEFECT, found.inputs
    assert found.slope < fuzz_single.DEFECT, found.slope_inputs


# Where a search found more roundings than that: beside singular places, or where products left the
# range of float32.
TILTED = 1.0629281997680664, 1.0263546705245972, 1.0000139474868774, 1.0001505613327026
UNSTABLE = 1.6274036169052124, 0.9999998807907104, 1.0102986097335815
MOVING = 0.8015385866165161, 0.3, 10000.0107421875, 200.0, -50.0, 1.0, 0.4
PLACES = [
    # The shadow falls along the position.
    ("shells", (0.3, 0.0, 0.0, 1.0, 1.0, 50.0, 0.0, 1.2e-35, 1e-6, 0.02)),
    # Next to the centre, in metres.
    ("third", (7e-6, 6e-18, -2e-18, 3e8, -8e-18, 4e-18, 4.9e12)),
    # A top nearly without spin.
    ("turning_circles", (9.5e-26, 0.498, 2.0, 0.1)),
    # An impulse far below a rounding of the speed.
    ("impulse", (0.6, 0.985, 0.187, -0.738, 0.722, 0.146, 1e-9, -2e-9, 1e-9, 1.0)),
    # A turn through 0.01 rad.
    ("free_flight", (3.66385555, 1.99997759, 1.00000048, 0.0029, 0.00484, -0.00393, 1.7334)),
    # Hardly any time.
    ("turned_by_gravity", (-8.173e-31, 2.0, 9.81, 100.0, 0.2)),
    # The slope of gravity along a meridian is small, those of its parts are not.
    ("navigator", (*MOVING, 100.0, 200.0, 30.0, 0.1, 0.2, 0.3, 1e-4, 2e-4, 3e-4, 10.0)),
    # A narrow cone; a tilt from the separatrix whose square underflows, and one from an axis.
    ("principal_spins", (*TILTED, -5.57718e-06, 2.8189948e-05, 0.9998600482940674)),
    ("principal_spins", (*UNSTABLE, 1.0, 4.90577e-27, 6.27426e-27, 1.0006606578826904)),
    ("principal_spins", (3.0, 2.0, 1.5, 1.0, 0.9, 3e-27, -5e-27)),
    ("polhode_period", (2.99998784, 2.01874995, 0.908459425, -1.9086e-29, 1.30294216, 2.1295e-29)),
    ("polhode_period", (2.99989104, 2.0, 1.0, 0.0, 1.0, -1.12e-20)),
    # A point that hardly moves in a slow rotation.
    ("at_rest", (0.3166, -0.176, 0.7, 5.067e-19, 6.478e-20, 2.522e-19, 1.57e-10)),
    ("at_rest", (0.3, -0.2, 0.7, 1.2e-24, 0.5e-24, 0.0, 2e-25)),
    # Next to an apse of a nearly circular orbit, before and after the gain exceeds e.
    ("tangential", (1.0, 3.3454e-07, 1.8856e-06, 1e-8)),
    ("tangential", (1.0036, 6.034e-13, -3.457e-13, 1e-8)),
    # Thin air.
    ("density", (700000.0, 1.2, 0.0, 10112.027)),
]


@pytest.mark.parametrize(("name", "place"), PLACES, ids=[name for name, _ in PLACES])
def test_closed_forms_at_places_found_by_the_search(name, place):
    (subject,) = fuzz_single.subjects([name], places=1)
    place = fuzz_single.single_numbers([place])
    found = fuzz_single.judge(subject, place, np.random.default_rng(0))
    assert found.value < 30.0
    assert found.slope < 30.0


@pytest.mark.parametrize("duration", [1e-8, 1e-12])
def test_a_transfer_along_a_fast_hyperbola(duration):
    """The cube of the slope of its time of flight is below the range of float32. The path is
    straight: r2 - r1 = v T."""
    start, end = (jnp.asarray(x, jnp.float32) for x in ([1.0, 0.0, 0.0], [1.6, 0.2, 0.1]))
    given = start, end, jnp.asarray(duration, jnp.float32), jnp.asarray(1.0, jnp.float32)
    for velocity in lambert(*given):
        np.testing.assert_allclose(velocity * duration, end - start, rtol=2e-6)


def test_the_synodic_period_of_close_circles():
    """To the digits of the difference of the radii, S = T r / (1.5 dr)."""
    radii = 1.0, 1.0 + 2.0**-20
    found = synodic_period(*(jnp.asarray(x, jnp.float32) for x in (*radii, 1.0)))
    np.testing.assert_allclose(found, 2.0 * math.pi / 1.5 * 2.0**20, rtol=2e-6)
    assert jnp.isinf(synodic_period(1.0, 1.0, 1.0))
    assert jax.grad(synodic_period)(1.0, 1.0, 1.0) == 0.0


def test_the_space_cone_of_a_tilt_whose_square_underflows():
    """Of a small tilt g of omega the angle is g (C - A) / C."""
    omega, slope = (jnp.asarray(x, jnp.float32) for x in ([3e-25, 4e-25, 1.0], [0.6, 0.8, 0.0]))
    found = jax.jvp(lambda w: space_cone_angle(w, 2.0, 3.0), (omega,), (slope,))
    np.testing.assert_allclose(found, [5e-25 / 3.0, 1.0 / 3.0], rtol=1e-6)


def test_derivatives_of_a_radial_motion_between_far_radii():
    """Of Kepler's ellipse, by the inner radius: T = 2 pi a^(3/2), E = -1/(2 a), a = (r1 + r2)/2."""
    inner, outer = (jnp.asarray(x, jnp.float32) for x in (2.0**-8, 8.0))
    motion, slopes = jax.jvp(
        lambda r: radial_motion(lambda r: -1.0 / r, r, outer), (inner,), (jnp.ones_like(inner),)
    )
    a = 0.5 * (inner + outer)
    np.testing.assert_allclose(motion.period, 2.0 * math.pi * a**1.5, rtol=2e-6)
    np.testing.assert_allclose(slopes.period, 1.5 * math.pi * a**0.5, rtol=1e-5)
    np.testing.assert_allclose(slopes.energy, 0.25 / a**2, rtol=2e-6)


def test_gravity_of_far_planets_in_metres():
    """1 / r^3 of Neptune is below the range of float32, its acceleration is not."""
    r = jnp.asarray([4.5e12, 0.0, 0.0], jnp.float32)
    mu = jnp.asarray(1.327e20, jnp.float32)
    expected = -1.327e20 / 4.5e12**2
    np.testing.assert_allclose(point_gravity(r, mu)[0], expected, rtol=1e-6)
    slope = jax.jacfwd(point_gravity)(r, mu)
    np.testing.assert_allclose(slope[0, 0], -2.0 * expected / 4.5e12, rtol=2e-6)
    np.testing.assert_allclose(slope[1, 1], expected / 4.5e12, rtol=2e-6)
    np.testing.assert_allclose(jax.jacrev(point_gravity)(r, mu), slope, rtol=2e-6)


def test_a_circle_whose_squared_radius_underflows():
    """r = 1e-20 and mu = 1: its square is zero in float32."""
    r = jnp.asarray([1e-20, 0.0, 0.0], jnp.float32)
    v = jnp.asarray([0.0, 1e10, 0.0], jnp.float32)
    given = r, v, jnp.asarray(1e-30, jnp.float32), jnp.asarray(1.0, jnp.float32)
    place, velocity = kepler_flow(*given)
    expected = np.array([math.cos(1.0), math.sin(1.0), 0.0])
    np.testing.assert_allclose(place / 1e-20, expected, atol=1e-6)
    np.testing.assert_allclose(velocity[:2] / 1e10, [-expected[1], expected[0]], atol=1e-6)


def test_a_gravity_turn_that_starts_next_to_the_vertical():
    """The tangent of half its angle grows by a factor of 1e9; slopes for a share of each input."""
    given = np.float32([9.9930735, 0.4521936, 9.9510708, 5.1595774, 1e-6])

    def turn(x):
        y = GravityTurnState(x[3], x[4], 0.0 * x[0], 0.0 * x[0])
        return jnp.stack(jax.tree.leaves(gravity_turn_after(*x[:3], y)))

    exact = jnp.asarray(given, jnp.float64)
    np.testing.assert_allclose(turn(jnp.asarray(given)), turn(exact), rtol=1e-5)
    expected = np.asarray(jax.jacfwd(turn)(exact)) * given
    for mode in (jax.jacfwd, jax.jacrev):
        slope = np.asarray(mode(turn)(jnp.asarray(given))) * given
        most = np.max(np.abs(expected), axis=1, keepdims=True)
        np.testing.assert_allclose(slope / most, expected / most, atol=1e-5)


def test_a_thrust_just_before_its_ignition():
    """The time over the burn time is zero in float32."""
    before = jnp.asarray(-2e-38, jnp.float32)
    for profile in (None, ThrustProfile([0.0, 1.0], [1.2, 0.8])):
        motor = single(Thrust(*(jnp.asarray(x) for x in (2.5e4, 2800.0, 60.0)), profile))
        assert motor.thrust(before, 900.0) == 0.0
        assert motor.thrust(-before, 900.0) > 0.0


def test_the_slope_of_a_steep_force_in_metres():
    """da/dr = -n a/r, where r^-(n+3) is below the range of float32 in both factors."""
    r = jnp.asarray([6.65e6, 0.0, 0.0], jnp.float32)
    k, n = (jnp.asarray(x, jnp.float32) for x in (6e17, 3.4873979))
    expected = -6e17 * 6.65e6 ** -float(n)
    for mode in (jax.jacfwd, jax.jacrev):
        slope = mode(power_law)(r, k, n)
        np.testing.assert_allclose(slope[0, 0], -float(n) * expected / 6.65e6, rtol=1e-5)
        np.testing.assert_allclose(slope[1, 1], expected / 6.65e6, rtol=1e-5)
        by_exponent = mode(power_law, 2)(r, k, n)
        np.testing.assert_allclose(by_exponent[0], -expected * math.log(6.65e6), rtol=1e-5)


def test_the_slope_of_the_field_in_a_planet_by_its_radius_in_metres():
    """da/dR = 3 mu r/R^4: the square of R^3 is infinite."""
    r = jnp.asarray([6.65e6, 0.0, 0.0], jnp.float32)
    mu, radius = (jnp.asarray(x, jnp.float32) for x in (3.986e14, 7e6))
    for mode in (jax.jacfwd, jax.jacrev):
        slope = mode(sphere_gravity, 2)(r, mu, radius)
        np.testing.assert_allclose(slope[0], 3.0 * 3.986e14 * 6.65e6 / 7e6**4, rtol=1e-5)


def test_constants_of_splines_beams_and_actions_keep_single_precision():
    """Their own nodes and weights are numbers of NumPy or of solved equations."""
    x, y = jnp.asarray(0.4, jnp.float32), jnp.zeros(4, jnp.float32)
    root = float(beam_roots("clamped-free", 1, 0.6)[0])
    swing = single(SimplePendulum(jnp.asarray(1.0), jnp.asarray(9.8)))
    for function in (
        lambda x, y: Spline([0.0, 1.0, 2.0, 3.0], y)(x),
        lambda x, y: Spline([0.0, 1.0, 2.0, 3.0], [1.0, 0.0, 2.0, 1.0])(x),
        lambda x, y: beam_shape("clamped-free", root, x, 0, 0.6),
        lambda x, y: action(swing, lambda t: jnp.sin(t)[None] * x, 0.0, x),
    ):
        assert eqx.filter_eval_shape(function, x, y).dtype == jnp.float32


# Kinds of the inputs of forms: length, speed, time, gravitational parameter, number.
SOLAR = {
    **dict.fromkeys(("constants", "elements", "radii", "sizes", "equinoctial"), "LLLVVVM"),
    "state": "L00000M",
    "kepler": "LLLVVVTM",
    "transfer": "LLLLLLTM",
    "shortest": "LLLLLLM",
    "apsides": "LLLLM",
    "burnout_elements": "LV0M",
    "ballistic": "LV0M",
    "farthest": "LVM",
    "flight_time": "00L0M",
    "detour": "LL0M",
}


@pytest.mark.parametrize(
    ("name", "length", "mu"),
    [*((name, 1.5e11, 1.327e20) for name in SOLAR), ("kepler", 1e-20, 1e-20)],
)
def test_orbits_of_the_sun_and_of_small_lengths_in_metres(name, length, mu):
    """Values and both modes of derivatives, where the square of mu or of the length leaves the
    range of float32."""
    sizes = {"L": length, "V": math.sqrt(mu / length), "T": length * math.sqrt(length / mu)}
    sizes |= {"M": mu, "0": 1.0}
    (subject,) = fuzz_single.subjects([name], places=24)
    key = np.random.default_rng(0)
    starts = np.asarray(subject.form.starts, float)
    shares = 10.0 ** key.uniform(-6.0, -0.5, (24, starts.shape[1]))
    x = starts[np.arange(24) % len(starts)]
    x = np.where(x == 0.0, shares, x * (1.0 + shares)) * [sizes[kind] for kind in SOLAR[name]]
    found = fuzz_single.judge(subject, fuzz_single.single_numbers(x), key)
    assert found.value < fuzz_single.DEFECT, found.inputs
    assert found.slope < fuzz_single.DEFECT, found.slope_inputs


@pytest.mark.parametrize("temperature", [216.44, 216.65, 250.0, 288.0])
def test_slope_of_the_air_above_a_pad_by_its_temperature(temperature):
    """Next to 216.65 K, the temperature of the tropopause, the layer is nearly isothermal."""
    level = float(geopotential_height(jnp.asarray(4e3)))
    temperature = float(np.float32(temperature))

    def pressure(T):
        rate = (mpmath.mpf("216.65") - T) / 11000
        per_height = mpmath.mpf(GRAVITY) * MOLAR_MASS / GAS_CONSTANT
        if rate == 0:
            return 101325 * mpmath.exp(-per_height * level / T)
        return 101325 * (1 + rate * level / T) ** (-per_height / rate)

    with mpmath.workdps(40):
        expected = mpmath.diff(pressure, mpmath.mpf(temperature), h=mpmath.mpf("1e-12"))
    height, given = jnp.asarray(4e3, jnp.float32), jnp.asarray(temperature, jnp.float32)
    for mode in (jax.jacfwd, jax.jacrev):
        slope = mode(lambda T: PadAtmosphere(0.0, T, 101325.0).air_at(height).pressure)(given)
        np.testing.assert_allclose(slope, float(expected), rtol=1e-5)


def test_growth_of_navigation_errors_of_a_slow_vehicle():
    """d(growth)/dw = -(5/3) w / (sqrt(2) w0) for w << w0."""
    w0, w = jnp.asarray(1.2e-3, jnp.float32), jnp.asarray(1e-8, jnp.float32)
    expected = -5.0 / 3.0 * 1e-8 / (math.sqrt(2.0) * 1.2e-3)
    for mode in (jax.jacfwd, jax.jacrev):
        slope = mode(lambda w: coupled_rates(w0, w)[1])(w)
        np.testing.assert_allclose(slope, expected, rtol=1e-5)


def test_cone_bounds_of_a_slight_tilt():
    """The swing of the middle axis is h_b / h = sqrt(B C (A - C) / (A - B)) w_c / (A w_a)."""
    A, B, C, rate = 2.0, 1.25, 1.0, 0.9
    moments = jnp.asarray([A, B, C], jnp.float32)
    expected = math.sqrt(B * C * (A - C) / (A - B)) / (A * rate)
    omega = jnp.asarray([rate, 0.0, 1e-9], jnp.float32)
    for mode in (jax.jacfwd, jax.jacrev):
        least, greatest = mode(lambda omega: cone_bounds(moments, omega))(omega)
        np.testing.assert_allclose(least[1, 2], -expected, rtol=1e-5)
        np.testing.assert_allclose(greatest[1, 2], expected, rtol=1e-5)


def test_sag_of_a_long_chain_hardly_depends_on_the_span():
    """sag = l/2 tanh(u/2), where sinh(u)/u = l/d."""
    span, length = 0.08, 9.75
    with mpmath.workdps(30):

        def sag(d):
            u = mpmath.findroot(lambda u: mpmath.sinh(u) / u - mpmath.mpf(length) / d, 6.7)
            return 0.5 * length * mpmath.tanh(0.5 * u)

        expected = float(mpmath.diff(sag, mpmath.mpf(span)))
    given = jnp.asarray(span, jnp.float32), jnp.asarray(length, jnp.float32)
    for mode in (jax.jacfwd, jax.jacrev):
        np.testing.assert_allclose(mode(hanging_chain)(*given)[1], expected, rtol=2e-5)


def test_gravity_gradient_of_a_navigator():
    """dg/dh = 2 mu / r^3 upwards over a sphere that does not rotate: the square of r^3, 7e40 m^6,
    is infinite."""
    earth = Earth(radius=6.4e6, flattening=0.0, mu=3.986e14, j2=0.0, rate=0.0)
    height, latitude = jnp.asarray(1e4, jnp.float32), jnp.asarray(0.8, jnp.float32)
    for mode in (jax.jacfwd, jax.jacrev):
        slope = mode(lambda h: earth.gravity(latitude, h)[2])(height)
        np.testing.assert_allclose(slope, 2.0 * 3.986e14 / 6.41e6**3, rtol=1e-5)
