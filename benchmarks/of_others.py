"""What others measure themselves by, done here: ensembles of the Lorenz system, as DiffEqGPU's
benchmarks have them, beside diffrax under `vmap` and SciPy one by one; and two-body orbits a day
later, as brahe's benchmarks have them, beside brahe.

The Lorenz systems differ in rho, from 0 to 21, and go from (1, 0, 0) to t = 1 by the same method of
order 5 at the same tolerance; DiffEqGPU takes 8 million of them on a GPU, here are as many as fit a
quiet minute. brahe takes one orbit at a time in compiled code, without a batch."""

from typing import final

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxspace.core import AbstractSystem, Scalar, quantity
from jaxspace.orbits import ClassicalElements
from jaxspace.orbits.elements import state_from_elements
from jaxspace.orbits.kepler import kepler_flow
from jaxspace.simulation import Accuracy, simulate_batch
from jaxspace.solvers import DOP853, Tsit5

from ._measure import in_turn, on_one_device, optional, worst

SYSTEMS, ALONE, ORBITS, END = 8192, 8, 4096, 1.0
TOLERANCES = (1e-5, 1e-8)
SIGMA, BETA = 10.0, 8.0 / 3.0
DAY, MU = 86400.0, 3.986004415e14


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


def measure() -> dict:
    """The rows of both."""
    return lorenz() | two_body()
