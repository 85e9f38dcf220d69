"""Benchmarks from the documentation of other libraries: ensembles of the Lorenz system, as in
DiffEqGPU's benchmarks, with diffrax under `vmap` and SciPy one run at a time; two-body orbits one
day later, and a low revolution under J2 and under a field of degree and order 5, as in brahe's
benchmarks, with brahe and with astrojax, whose example of numerical propagation takes the same
steps under `vmap`. The free bodies of MuJoCo's MJX are in `environment_steps`.

The Lorenz systems differ in rho, from 0 to 21, and go from (1, 0, 0) to t = 1 by the same method of
order 5 at the same tolerance; DiffEqGPU takes 8 million of them on a GPU, so does one row here on
every core, the others as many as fit a quiet minute. brahe takes one orbit at a time in compiled
code, without a batch; its benchmarks take steps of 30 s by the method of order 4, which are off by
a metre, and it has a method of order 12 too. It has no solution of Lambert's problem.

What the peers do better: brahe compiles nothing, so that its first orbit is there at once, and
brings the field with the axes of the earth, precession and nutation, which this library leaves to
others: the field of degree 5 is here that of astrojax, by `Custom`. diffrax has implicit methods
for every stiff system, events in any of its solvers, and stochastic equations."""

import functools
from typing import final

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxspace import BodyState, Scene
from jaxspace.bodies import Load
from jaxspace.core import AbstractSystem, Scalar, quantity
from jaxspace.orbits import ClassicalElements, Oblateness, PointGravity
from jaxspace.orbits.elements import state_from_elements
from jaxspace.orbits.kepler import kepler_flow
from jaxspace.rotations import Quaternion
from jaxspace.scene import Custom
from jaxspace.simulation import Accuracy, simulate_batch
from jaxspace.solvers import DOP853, RKN1210, Tsit5

from ._measure import in_turn, on_one_device, optional, worst

SYSTEMS, ALONE, ORBITS, END = 8192, 8, 4096, 1.0
# Systems of the wide row, and its repeats.
WIDE, REPEATS = 8_000_000, 3
TOLERANCES = (1e-5, 1e-8)
SIGMA, BETA = 10.0, 8.0 / 3.0
DAY, MU = 86400.0, 3.986004415e14
# Of brahe's low orbits, and of its benchmarks' steps.
LOW, REVOLUTION, STEP, DEGREE = 1024, 5400.0, 30.0, 5
RADIUS, J2 = 6378136.3, 0.0010826261738522227
# The angle of the earth at the start, rad, and its rate, rad/s.
ANGLE, RATE = -1.3930633926725735, 7.292115146706e-5


@final
class Lorenz(AbstractSystem):
    """x' = sigma (y - x), y' = x (rho - z) - y, z' = x y - beta z."""

    rho: Scalar = quantity("", doc="Rayleigh number in units of the critical one")

    def vector_field(self, t: Scalar, y: dict[str, Scalar]) -> dict[str, Scalar]:
        x, z = y["x"], y["z"]
        return {
            "x": SIGMA * (y["y"] - x),
            "y": x * (self.rho - z) - y["y"],
            "z": x * y["y"] - BETA * z,
        }

    def invariants(self, t: Scalar, y: dict[str, Scalar]) -> dict[str, Scalar]:
        return {}


def together(state: dict[str, Array]) -> Array:
    """The states as an array, (3, runs)."""
    return jnp.stack([state["x"], state["y"], state["z"]])


def lorenz(systems: int = SYSTEMS) -> dict:
    """Error and speed of every method on an ensemble."""
    rho = jnp.linspace(0.0, 21.0, systems)
    y0 = {"x": jnp.ones(systems), "y": jnp.zeros(systems), "z": jnp.zeros(systems)}
    system, alone = on_one_device((Lorenz(rho), y0))
    ts = jnp.array([0.0, END])

    def ours(rtol, method=None):
        accuracy = Accuracy(rtol=rtol, method=Tsit5() if method is None else method)
        return together(simulate_batch(system, alone, ts, accuracy=accuracy).final)

    @eqx.filter_jit
    def mapped(rtol):
        def one(rho, y):
            return diffrax.diffeqsolve(
                diffrax.ODETerm(lambda t, y, args: Lorenz(rho).vector_field(t, y)),
                diffrax.Tsit5(),
                *(0.0, END, None, y),
                stepsize_controller=diffrax.PIDController(rtol=rtol, atol=rtol),
            ).ys

        return together(jax.tree.map(lambda x: x[:, 0], jax.vmap(one)(rho, y0)))

    calls = {f"Lorenz: ours, Tsit5 {tol:.0e}": lambda tol=tol: ours(tol) for tol in TOLERANCES}
    calls |= {
        f"Lorenz: diffrax Tsit5 under vmap {tol:.0e}": lambda tol=tol: mapped(jnp.asarray(tol))
        for tol in TOLERANCES
    }
    calls["Lorenz: scipy DOP853, one by one, 1e-08"] = lambda: by_scipy(rho[:: systems // ALONE])
    reference = np.asarray(ours(1e-13, DOP853()))
    runs = {name: ALONE if "scipy" in name else systems for name in calls}
    rows = in_turn(calls, runs)
    for name, call in calls.items():
        found = np.asarray(call())
        some = reference if found.shape[1] == systems else reference[:, :: systems // ALONE]
        rows[name]["worst_relative_error"] = worst(found, some[:, : found.shape[1]])
    return rows


def wide_lorenz(systems: int = WIDE) -> dict:
    """The same on every core for as many systems as DiffEqGPU takes."""
    rho, ts = jnp.linspace(0.0, 21.0, systems), jnp.array([0.0, END])

    def ours(rho, accuracy):
        y0 = {"x": jnp.ones(rho.size), "y": jnp.zeros(rho.size), "z": jnp.zeros(rho.size)}
        return together(simulate_batch(Lorenz(rho), y0, ts, accuracy=accuracy).final)

    accuracy = Accuracy(1e-8, method=Tsit5())
    name = f"Lorenz: ours, Tsit5, {systems} systems on every core, 1e-08"
    rows = in_turn({name: lambda: ours(rho, accuracy)}, systems, REPEATS)
    step = max(systems // SYSTEMS, 1)
    exact = ours(rho[::step], Accuracy(1e-13, method=DOP853()))
    rows[name]["worst_relative_error"] = worst(ours(rho, accuracy)[:, ::step], exact)
    return rows


def by_scipy(rhos: Array) -> np.ndarray:
    """The ends of a few systems, one by one, in plain numbers."""
    from scipy.integrate import solve_ivp

    def end(rho):
        def rate(t, y):
            a, b, c = y.tolist()
            return (SIGMA * (b - a), a * (rho - c) - b, a * b - BETA * c)

        given = ((0.0, END), (1.0, 0.0, 0.0))
        return solve_ivp(rate, *given, method="DOP853", rtol=1e-8, atol=1e-8).y[:, -1]

    return np.stack([end(float(rho)) for rho in rhos[:ALONE]], axis=-1)


def orbits(count: int = ORBITS) -> tuple[Array, Array]:
    """Positions and velocities, (3, runs), on ellipses from low orbits to beyond the stationary
    one."""
    g = np.random.default_rng(3)
    a, e = g.uniform(6.8e6, 4.2e7, count), g.uniform(0.0, 0.1, count)
    angles = g.uniform(0.0, 2.0 * np.pi, (4, count))
    angles[0] *= 0.5
    elements = ClassicalElements(*map(jnp.asarray, (a * (1.0 - e**2), e, *angles)))
    return state_from_elements(elements, MU)


def two_body(count: int = ORBITS) -> dict:
    """The orbits a day later, beside brahe's Keplerian propagator."""
    r, v = on_one_device(orbits(count))
    flow = jax.jit(lambda r, v: jnp.concatenate(kepler_flow(r, v, DAY, MU)))
    calls = {"two-body: ours, closed form": lambda: flow(r, v)}
    if (brahe := optional("brahe")) is not None:
        calls["two-body: brahe, one by one"] = by_brahe(brahe, np.concatenate([r, v]))
    rows = in_turn(calls, count)
    for name, call in calls.items():
        distance = worst(np.asarray(call())[:3], flow(r, v)[:3])
        rows[name]["largest_distance_from_ours"] = distance
    return rows


def by_brahe(brahe, states: np.ndarray):
    """A call that gives the states a day later, (6, runs)."""
    start = brahe.Epoch.from_datetime(2024, 1, 1, 12, 0, 0.0, 0.0, brahe.TimeSystem.TAI)
    later = start + DAY
    given = np.ascontiguousarray(states.T)

    def end(state):
        cartesian = brahe.OrbitRepresentation.CARTESIAN
        orbit = brahe.KeplerianPropagator(
            start, state, brahe.CelestialFrame.ECI, cartesian, None, 60.0
        )
        return orbit.state(later)

    return lambda: np.stack([end(state) for state in given], axis=-1)


def low(count: int = LOW) -> BodyState:
    """Low orbits as brahe's benchmarks draw them: 400 to 1500 km, of small eccentricity."""
    g = np.random.default_rng(4)
    a, e = RADIUS + g.uniform(4e5, 1.5e6, count), g.uniform(1e-3, 0.02, count)
    angles = g.uniform(0.0, 2.0 * np.pi, (4, count))
    angles[0] *= 0.5
    elements = ClassicalElements(*map(jnp.asarray, (a * (1.0 - e**2), e, *angles)))
    return BodyState(*state_from_elements(elements, MU))


def oblate() -> Scene:
    """The field of J2."""
    return Scene((PointGravity(MU), Oblateness(MU, J2, RADIUS)))


def attraction(t: Scalar, r: Array) -> Array:
    """The acceleration in the field JGM-3 of degree and order 5 at one place, by astrojax."""
    from astrojax.orbit_dynamics import accel_gravity_spherical_harmonics

    turned = Quaternion.from_axis_angle(jnp.array([0.0, 0.0, 1.0]), ANGLE + RATE * t).matrix().T
    return accel_gravity_spherical_harmonics(r, turned, _field(), DEGREE, DEGREE)


@functools.cache
def _field():
    from astrojax import set_dtype
    from astrojax.orbit_dynamics import GravityModel

    set_dtype(jnp.float64)
    field = GravityModel.from_type("JGM3")
    field.set_max_degree_order(DEGREE, DEGREE)
    return field


def of_degree_five() -> Scene:
    """That field as an effect."""
    # Read before anything is compiled.
    _field()

    def load(t, y, body):
        r = y.position
        if r.ndim == 1:
            return Load(acceleration_N=attraction(t, r))
        times = jnp.broadcast_to(t, r.shape[1:])
        return Load(acceleration_N=jax.vmap(attraction, -1, -1)(times, r))

    return Scene([Custom(load)])


def revolutions(scene: Scene, y0: BodyState, rtol: float, method=None) -> Array:
    """Positions of low orbits a revolution later."""
    accuracy = Accuracy(rtol, method=RKN1210() if method is None else method)
    return simulate_batch(scene, y0, jnp.array([0.0, REVOLUTION]), accuracy=accuracy).final.position


def revolutions_of_brahe(brahe, y0: BodyState, field: str, tolerance: float | None):
    """A call that gives the same by brahe, with the earth turning about the third axis: in steps of
    30 s, as its benchmarks take them, or at a tolerance."""
    brahe.set_global_eop_provider(brahe.StaticEOPProvider.from_zero())
    start = brahe.Epoch.from_datetime(2024, 1, 1, 12, 0, 0.0, 0.0, brahe.TimeSystem.TAI)
    kinds = brahe.GravityConfiguration
    model = {
        "J2": lambda: kinds.earth_zonal(brahe.ZonalHarmonicsDegree.J2),
        "5 x 5": lambda: kinds.spherical_harmonic(
            degree=DEGREE, order=DEGREE, model_type=brahe.GravityModelType.JGM3
        ),
    }[field]()
    turning = brahe.FrameTransformationModel.EARTH_ROTATION_ONLY
    forces = brahe.ForceModelConfig(gravity=model, frame_transform=turning)
    methods, steps = brahe.IntegrationMethod, brahe.IntegratorConfig
    if tolerance is None:
        method, control = methods.RK4, steps.fixed_step(STEP)
    else:
        # The absolute tolerance is of metres and metres a second alike.
        method, control = methods.RKN1210, steps.adaptive(1e3 * tolerance, tolerance)
    settings = brahe.NumericalPropagationConfig(method, control, brahe.VariationalConfig())
    states = np.concatenate([y0.position, y0.velocity]).T

    def end(state):
        orbit = brahe.NumericalOrbitPropagator(start, np.ascontiguousarray(state), settings, forces)
        orbit.set_trajectory_mode(brahe.TrajectoryMode.DISABLED)
        if tolerance is None:
            # As its benchmarks do: `propagate_to` takes longer steps.
            for _ in range(round(REVOLUTION / STEP)):
                orbit.step_by(STEP)
        else:
            orbit.propagate_to(start + REVOLUTION)
        return orbit.current_state()[:3]

    return lambda: np.stack([end(state) for state in states], axis=-1)


def revolutions_of_astrojax(y0: BodyState):
    """A call that gives them by astrojax in that field, in steps of 30 s under `vmap`."""
    from astrojax.integrators import rk4_step

    def rate(t, y):
        return jnp.concatenate([y[3:], attraction(t, y[:3])])

    def one(y):
        def step(k, y):
            return rk4_step(rate, k * STEP, y, STEP).state

        return jax.lax.fori_loop(0, round(REVOLUTION / STEP), step, y)[:3]

    _field()
    program, start = jax.jit(jax.vmap(one, -1, -1)), jnp.concatenate([y0.position, y0.velocity])
    return lambda: program(start)


def fields(count: int = LOW) -> dict:
    """A low revolution in both fields, beside brahe and astrojax."""
    y0, rows = on_one_device(low(count)), {}
    there = optional("brahe"), optional("astrojax")
    for field, scene in (("J2", oblate), ("5 x 5", of_degree_five)):
        if field == "5 x 5" and there[1] is None:
            continue
        system = scene()
        calls = {
            f"{field}: ours, RKN 12(10) {rtol:.0e}": lambda rtol=rtol, system=system: revolutions(
                system, y0, rtol
            )
            for rtol in (1e-6, 1e-9)
        }
        if there[0] is not None:
            for name, tolerance in (("RK4, 30 s", None), ("RKN 12(10) 1e-09", 1e-9)):
                call = revolutions_of_brahe(there[0], y0, field, tolerance)
                calls[f"{field}: brahe {name}, one by one"] = call
        if field == "5 x 5":
            calls[f"{field}: astrojax RK4, 30 s, under vmap"] = revolutions_of_astrojax(y0)
        exact = revolutions(system, y0, 1e-13, DOP853())
        found = in_turn(calls, count)
        for name, call in calls.items():
            found[name]["worst_relative_error"] = worst(call(), exact)
        rows |= found
    return rows


def measure() -> dict:
    """The rows of all."""
    return lorenz() | wide_lorenz() | two_body() | fields()
