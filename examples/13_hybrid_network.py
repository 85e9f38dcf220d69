"""A hybrid of a physical model and a network, trained on noisy trajectories in one batch.

A pendulum has friction that is missing in the model. The network learns the missing acceleration
from 64 noisy trajectories, and is tested on new trajectories."""

from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
import optax

from jaxspace import AbstractSystem, Accuracy, simulate_batch
from jaxspace.solvers import Tsit5


@final
class Pendulum(AbstractSystem):
    """x'' = -sin x + missing(x, x') / 10, which starts near zero."""

    missing: eqx.nn.MLP | None = None
    friction: float = 0.0

    def vector_field(self, t, y):
        pull = -jnp.sin(y["x"]) - self.friction * y["v"] * jnp.abs(y["v"])
        if self.missing is not None:
            # A batch is (components, runs): the network is mapped over the last axis.
            apply = jax.vmap(self.missing, in_axes=-1, out_axes=-1)
            pull += 0.1 * apply(jnp.stack([y["x"], y["v"]]))[0]
        return {"v": pull, "x": y["v"]}

    def invariants(self, t, y):
        return {}


ACCURACY = Accuracy(rtol=1e-3, method=Tsit5(), max_steps=64)
ts = jnp.linspace(0.0, 6.0, 25)


def starts(key, runs):
    one, two = jax.random.split(key)
    return {
        "v": 0.5 * jax.random.normal(one, (runs,)),
        "x": jax.random.uniform(two, (runs,), minval=-1.5, maxval=1.5),
    }


def paths(system, y0s):
    return simulate_batch(system, y0s, ts, accuracy=ACCURACY).states["x"]


truth = Pendulum(friction=0.3)
train, test = starts(jax.random.key(1), 64), starts(jax.random.key(2), 32)
data = paths(truth, train) + 0.02 * jax.random.normal(jax.random.key(3), (ts.size, 64))
network = eqx.nn.MLP(2, 1, 16, 2, activation=jax.nn.tanh, key=jax.random.key(0))
optimiser = optax.adam(optax.cosine_decay_schedule(0.01, 400))


@eqx.filter_jit
def update(network, opt_state):
    def loss(network):
        return jnp.mean((paths(Pendulum(network), train) - data) ** 2)

    value, gradient = eqx.filter_value_and_grad(loss)(network)
    change, opt_state = optimiser.update(gradient, opt_state)
    return eqx.apply_updates(network, change), opt_state, value


def error(system):  # root mean square, of paths that were never seen, rad
    return float(jnp.sqrt(jnp.mean((paths(system, test) - paths(truth, test)) ** 2)))


opt_state = optimiser.init(eqx.filter(network, eqx.is_array))
for _ in range(400):
    network, opt_state, value = update(network, opt_state)
print(f"last root mean square misfit {float(value) ** 0.5:.4f} rad")
before, after = error(Pendulum()), error(Pendulum(network))
print(f"error of unseen paths: {before:.4f} rad without, {after:.4f} rad with the network")
assert after < 0.2 * before
