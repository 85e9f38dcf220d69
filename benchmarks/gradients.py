"""What a derivative costs beside the run itself: reverse mode, and the full matrix of first derivatives by forward mode."""

import diffrax
import jax
import jax.numpy as jnp

from jaxspace.orbits import TwoBody
from jaxspace.simulation import Accuracy, simulate_batch

from ._measure import in_turn, worst
from .low_orbits import SCENE, orbits

LANES, SPAN = 256, 20.0
REVERSE, FORWARD = diffrax.RecursiveCheckpointAdjoint(), diffrax.ForwardMode()


def measure() -> dict:
    """Speed of the run, of its reverse mode and of its 6 x 6 matrix; the same for the closed form; and the error of the reverse
    mode against the matrix."""
    y0 = jax.tree.map(lambda x: x[:LANES], orbits())
    ts = jnp.array([0.0, SPAN])
    free = TwoBody(1.0)

    def end(system, y, adjoint=REVERSE):
        accuracy = Accuracy(rtol=1e-9, adjoint=adjoint)
        return simulate_batch(system, y, ts, accuracy=accuracy, in_axes=(None, 0)).final

    def of_first(system):
        return jax.grad(lambda y: jnp.sum(end(system, y).position[:, 0]))

    def matrix(y):
        def column(k):
            blocks = jnp.zeros((LANES, 6)).at[:, k].set(1.0)
            tangent = type(y)(blocks[:, :3], blocks[:, 3:])
            return jax.jvp(lambda s: end(SCENE, s, FORWARD), (y,), (tangent,))[1].position

        return jax.vmap(column)(jnp.arange(6))

    run, reverse, full = jax.jit(lambda y: end(SCENE, y)), jax.jit(of_first(SCENE)), jax.jit(matrix)
    flow, of_flow = jax.jit(lambda y: end(free, y)), jax.jit(of_first(free))
    calls = {
        "run": lambda: run(y0),
        "run and reverse mode": lambda: reverse(y0),
        "run and 6 x 6 matrix": lambda: full(y0),
        "closed form": lambda: flow(y0),
        "closed form and reverse mode": lambda: of_flow(y0),
    }
    rows = in_turn(calls, LANES, repeats=11)
    gradient, columns = reverse(y0), full(y0)
    rows["run and reverse mode"]["worst_relative_error"] = worst(gradient.position, columns[:3, :, 0].T)
    for name, base in (
        ("run and reverse mode", "run"),
        ("run and 6 x 6 matrix", "run"),
        ("closed form and reverse mode", "closed form"),
    ):
        rows[name]["times_the_run"] = rows[base]["runs_per_cpu_second"] / rows[name]["runs_per_cpu_second"]
    return rows
