"""Heavy tops released from rest, with spins of 0.2 to 3 times that of a sleeping top, over a
hundred nutations: closed form, integration, and heyoka's Taylor method. The speed of the closed
form is also given as a multiple of that of DOP853 at an error of 1e-9, interpolated between its
rows."""

import jax.numpy as jnp
import numpy as np

from jaxspace import BodyState
from jaxspace.attitude import Top
from jaxspace.rotations import Quaternion
from jaxspace.simulation import Accuracy, simulate_batch
from jaxspace.solvers import DOP853

from ._measure import heyoka_ends, in_turn, on_one_device, optional, with_errors_of_rotation

RUNS, ERROR = 1024, 1e-9
A, C, WL = 0.002, 0.0008, 0.3
TOP = Top(A, C, WL)


def starts():
    """States (7, runs) at rest but for the spin, tilts of 0.3 to 2 rad."""
    g = np.random.default_rng(11)
    spin = float(TOP.least_spin(0.0)) * g.uniform(0.2, 3.0, RUNS)
    tilt, turn, zero = g.uniform(0.3, 2.0, RUNS), g.uniform(0.0, 6.0, RUNS), np.zeros(RUNS)
    y = Top.state(jnp.stack([turn, tilt, -turn]), jnp.stack([zero, zero, spin]))
    return np.concatenate([y.omega, y.attitude.wxyz])


def equations(heyoka):
    """The same motion in heyoka's symbols."""
    a, b, c, q0, q1, q2, q3 = heyoka.make_vars("a", "b", "c", "q0", "q1", "q2", "q3")
    # Z in body axes, and the spin beside it.
    x, y, k = 2.0 * (q1 * q3 - q0 * q2), 2.0 * (q2 * q3 + q0 * q1), (A - C) / A
    return [
        (a, k * b * c + WL / A * y),
        (b, -k * a * c - WL / A * x),
        (c, 0.0 * c),
        (q0, 0.5 * (-q1 * a - q2 * b - q3 * c)),
        (q1, 0.5 * (q0 * a + q2 * c - q3 * b)),
        (q2, 0.5 * (q0 * b + q3 * a - q1 * c)),
        (q3, 0.5 * (q0 * c + q1 * b - q2 * a)),
    ]


def measure() -> dict:
    """Error of rate and attitude, and speed, of every method."""
    start = starts()
    y0 = BodyState(omega=jnp.asarray(start[:3]), attitude=Quaternion(jnp.asarray(start[3:])))
    # As many nutations of the mean run.
    span = 100.0 * float(jnp.mean(TOP.nutation(y0).period))
    ts = jnp.array([0.0, span])

    def ours(accuracy):
        final = simulate_batch(TOP, on_one_device(y0), ts, accuracy=accuracy).final
        return jnp.concatenate([final.omega, final.attitude.wxyz])

    def stepped(rtol):
        return ours(Accuracy(rtol=rtol, method=DOP853()))

    calls = {
        f"ours, DOP853 {rtol:.0e}": lambda rtol=rtol: stepped(rtol)
        for rtol in (1e-10, 1e-11, 1e-12)
    }
    calls["ours, by default"] = lambda: ours(Accuracy())
    if optional("heyoka") is not None:
        for tolerance in (1e-11, 1e-14):
            ends = heyoka_ends(equations, start, span, tolerance)
            calls[f"heyoka, vectors of 8, {tolerance:.0e}"] = lambda ends=ends: ends().copy()
        reference = heyoka_ends(equations, start, span, 1e-18)().copy()
    else:
        reference = ours(Accuracy(rtol=1e-13, method=DOP853(), max_steps=65536))
    rows = with_errors_of_rotation(in_turn(calls, RUNS), calls, np.asarray(reference))
    steps = [row for name, row in rows.items() if "DOP853" in name]
    steps.sort(key=lambda row: row["worst_error_of_the_attitude"])
    errors = np.log([row["worst_error_of_the_attitude"] for row in steps])
    speeds = np.log([row["runs_per_cpu_second"] for row in steps])
    equal = float(np.exp(np.interp(np.log(ERROR), errors, speeds)))
    best = rows["ours, by default"]
    best["times_the_integration"] = best["runs_per_cpu_second"] / equal
    return rows
