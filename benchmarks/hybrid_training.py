"""One training step of a network inside a system, which consists of the loss and its gradient, for
256 trajectories of a plane pendulum with a network of 1,282 weights, tolerance 1e-3, single
precision, in one program; and a handwritten mapped solve with diffrax with the same method and
tolerance."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp

from jaxspace.core import AbstractSystem
from jaxspace.simulation import Accuracy, simulate_batch
from jaxspace.solvers import Tsit5

from ._measure import in_turn

RUNS, SPAN = 256, 4.0


class Hybrid(AbstractSystem):
    """x'' = -x + network(x, x')."""

    network: eqx.nn.MLP

    def vector_field(self, t, y):
        apply = jax.vmap(self.network, in_axes=-1, out_axes=-1)
        return {"v": apply(jnp.concatenate([y["x"], y["v"]])) - y["x"], "x": y["v"]}

    def invariants(self, t, y):
        return {}


def measure() -> dict:
    """Paths trained on in a second, ours and by diffrax mapped, and how far the losses differ."""
    key = iter(jax.random.split(jax.random.key(0), 4))
    single = jnp.float32
    network = eqx.nn.MLP(4, 2, 32, 2, activation=jax.nn.tanh, dtype=single, key=next(key))
    ts = jnp.linspace(0.0, SPAN, 21, dtype=single)
    x, v = (jax.random.normal(next(key), (2, RUNS), single) for _ in range(2))
    data = jax.random.normal(next(key), (2, 21, RUNS), single)

    def ours(network):
        accuracy = Accuracy(1e-3, method=Tsit5(), max_steps=64)
        run = simulate_batch(Hybrid(network), {"v": v, "x": x}, ts, accuracy=accuracy)
        return jnp.mean((run.states["x"] - data) ** 2)

    def mapped(network):
        def one(x, v):
            def field(t, y, args):
                return y[1], network(jnp.concatenate(y)) - y[0]

            return diffrax.diffeqsolve(
                diffrax.ODETerm(field), diffrax.Tsit5(), ts[0], ts[-1], 0.05, (x, v),
                saveat=diffrax.SaveAt(ts=ts), max_steps=64,
                stepsize_controller=diffrax.PIDController(rtol=1e-3, atol=1e-3),
            ).ys[0]  # fmt: skip

        paths = jax.vmap(one, in_axes=-1, out_axes=-1)(x, v)
        return jnp.mean((jnp.moveaxis(paths, 0, 1) - data) ** 2)

    cases = {"ours, simulate_batch": ours, "diffrax under vmap": mapped}
    steps = {name: eqx.filter_jit(eqx.filter_value_and_grad(f)) for name, f in cases.items()}
    rows = in_turn({name: lambda f=f: f(network) for name, f in steps.items()}, RUNS, repeats=15)
    losses = [float(f(network)[0]) for f in steps.values()]
    for row in rows.values():
        row["difference_of_the_losses"] = abs(losses[0] - losses[1]) / losses[1]
    return rows
