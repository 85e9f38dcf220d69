"""A free asymmetric body over a hundred precessions: closed form, integration, and heyoka's Taylor
method."""

import jax.numpy as jnp
import numpy as np

from jaxspace import BodyState
from jaxspace.attitude import TorqueFreeBody
from jaxspace.rotations import Quaternion
from jaxspace.simulation import Accuracy, simulate_batch
from jaxspace.solvers import DOP853

from ._measure import heyoka_ends, in_turn, on_one_device, optional, with_errors_of_rotation

RUNS, SPAN, MOMENTS = 1024, 100.0 * 2.0 * np.pi / 0.84, (1.0, 1.7, 2.5)
BODY = TorqueFreeBody(list(MOMENTS))


def starts():
    """Rates of length one in every direction, attitudes of every kind: (7, runs)."""
    g = np.random.default_rng(7)
    omega, q = g.standard_normal((3, RUNS)), g.standard_normal((4, RUNS))
    return np.concatenate([omega / np.linalg.norm(omega, axis=0), q / np.linalg.norm(q, axis=0)])


def equations(heyoka):
    """The same motion in heyoka's symbols."""
    names = ("a", "b", "c", "q0", "q1", "q2", "q3")
    a, b, c, q0, q1, q2, q3 = heyoka.make_vars(*names)
    i1, i2, i3 = MOMENTS
    euler = [(a, (i2 - i3) / i1 * b * c), (b, (i3 - i1) / i2 * c * a), (c, (i1 - i2) / i3 * a * b)]
    return [
        *euler,
        (q0, 0.5 * (-q1 * a - q2 * b - q3 * c)),
        (q1, 0.5 * (q0 * a + q2 * c - q3 * b)),
        (q2, 0.5 * (q0 * b + q3 * a - q1 * c)),
        (q3, 0.5 * (q0 * c + q1 * b - q2 * a)),
    ]


def measure() -> dict:
    """Error of rate and attitude, and speed, of every method."""
    start = starts()
    y0 = BodyState(omega=jnp.asarray(start[:3]), attitude=Quaternion(jnp.asarray(start[3:])))
    ts = jnp.array([0.0, SPAN])

    def ours(accuracy):
        final = simulate_batch(BODY, on_one_device(y0), ts, accuracy=accuracy).final
        return jnp.concatenate([final.omega, final.attitude.wxyz])

    def stepped(rtol):
        return ours(Accuracy(rtol=rtol, method=DOP853()))

    calls = {f"ours, DOP853 {rtol:.0e}": lambda rtol=rtol: stepped(rtol) for rtol in (1e-8, 1e-10)}
    calls["ours, by default"] = lambda: ours(Accuracy())
    if optional("heyoka") is not None:
        for tolerance in (1e-9, 1e-12):
            ends = heyoka_ends(equations, start, SPAN, tolerance)
            calls[f"heyoka, vectors of 8, {tolerance:.0e}"] = lambda ends=ends: ends().copy()
        reference = heyoka_ends(equations, start, SPAN, 1e-18)().copy()
    else:
        reference = stepped(1e-13)
    return with_errors_of_rotation(in_turn(calls, RUNS), calls, np.asarray(reference))
