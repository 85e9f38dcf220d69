"""A small network learns to stop and point a tumbling body, trained with gradients through the
simulation."""

import equinox as eqx
import jax
import jax.numpy as jnp
import optax

from jaxspace import Accuracy, BodyState, Scene, simulate_batch
from jaxspace.bodies import Load, RigidBody
from jaxspace.core.vectors import norm
from jaxspace.rotations import Quaternion
from jaxspace.scene import Custom
from jaxspace.solvers import Tsit5

BODIES, SECONDS, UPDATES = 24, 8.0, 120  # in single precision, which is enough here
UP = jnp.array([0.0, 0.0, 1.0])  # where the body's z axis shall point


class Control(eqx.Module):
    """Torque from angular velocity and the body components of the direction `UP`."""

    network: eqx.nn.MLP

    def __call__(self, t, y, body):
        up = UP.reshape(3, *(1,) * (y.omega.ndim - 1))
        x = jnp.concatenate([y.omega, y.attitude.rotate_back(up)])
        # The batch axis is the last one: the network is mapped over it.
        network = self.network if x.ndim == 1 else jax.vmap(self.network, -1, -1)
        return Load(torque_B=network(x))


def closed_loop(network):
    """A body with three different moments of inertia, kg m^2, under the torque of the network."""
    return Scene(
        [Custom(Control(network))],
        RigidBody(inertia=[1.0, 1.5, 2.0]),
    )


def tumbling(key, count):
    """States that turn with about 0.5 rad/s, their axes 46 degrees off on average."""
    turn, rate = jax.random.normal(key, (2, 3, count))
    return BodyState(attitude=Quaternion.from_rotation_vector(0.7 * turn), omega=0.3 * rate)


def performance(network, y0s):
    """Rate, rad/s, and cosine of the pointing error, (times, runs)."""
    ts = jnp.linspace(0.0, SECONDS, 5)
    accuracy = Accuracy(rtol=1e-3, method=Tsit5(), max_steps=256)
    # The weights have no batch axis: all runs share them.
    states = simulate_batch(closed_loop(network), y0s, ts, accuracy=accuracy).states
    axis_N = states.attitude.rotate(UP[:, None, None])
    return norm(states.omega), axis_N[2]


def loss(network, y0s):
    """Mean of rate^2 and squared pointing error over the runs, the later samples counting more."""
    rate, cosine = performance(network, y0s)
    weight = jnp.linspace(0.0, 1.0, rate.shape[0])[:, None] ** 2
    return jnp.mean(weight * 2.0 * (rate**2 + 1.0 - cosine))


key, weights, trials = jax.random.split(jax.random.key(1), 3)
network = eqx.nn.MLP(
    in_size=6, out_size=3, width_size=16, depth=1, activation=jnp.tanh, key=weights
)
optimiser = optax.adam(optax.cosine_decay_schedule(0.03, UPDATES))


@eqx.filter_jit
def update(network, opt_state, y0s):
    value, gradient = eqx.filter_value_and_grad(loss)(network, y0s)
    change, opt_state = optimiser.update(gradient, opt_state)
    return eqx.apply_updates(network, change), opt_state, value


opt_state = optimiser.init(eqx.filter(network, eqx.is_array))
history = []
for k, draw in enumerate(jax.random.split(key, UPDATES)):
    network, opt_state, value = update(network, opt_state, tumbling(draw, BODIES))
    history.append(float(value))
    if k % 20 == 0 or k == UPDATES - 1:
        print(f"update {k:3d}   loss {value:.5f}")

rate, cosine = performance(network, tumbling(trials, BODIES))  # bodies that it has not seen
error = jnp.degrees(jnp.arccos(jnp.clip(cosine, -1.0, 1.0)))
for name, x in (("rate, rad/s:", rate), ("pointing error, deg:", error)):
    print(
        f"{name:20s} {x[0].mean():7.3f} at first, {x[-1].mean():.4f} at last,"
        f" {x[-1].max():.4f} at worst"
    )
assert history[-1] < 0.02 * history[0] and rate[-1].mean() < 0.05
