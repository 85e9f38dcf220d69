"""Inertia, wheel alignment and gyro biases of a satellite from noisy rate gyros.

Torque-free motion determines the inertia tensor only up to a factor. A wheel of known momentum that
is spun up during the measurement determines the scale, and its axis is also estimated."""

import jax
import jax.numpy as jnp
import numpy as np

import jaxspace
from jaxspace import Accuracy, BodyState, Scene, simulate
from jaxspace.attitude import ReactionWheels, TorqueFreeBody
from jaxspace.attitude.motors import ConstantTorque
from jaxspace.bodies import InertiaTensor, RigidBody
from jaxspace.bodies.principal_axes import principal_axes
from jaxspace.estimation import fit
from jaxspace.rotations import Quaternion
from jaxspace.solvers import Tsit5

jaxspace.enable_x64()

NOISE = 2e-3  # rad/s, standard deviation of every reading
ts = jnp.linspace(0.0, 60.0, 301)
WHEEL, TORQUE, UNTIL = 2e-3, 0.10, 30.0  # kg m^2, N m, s
truth = {
    "J": jnp.array([10.0, 13.0, 15.5, 0.5, -0.8, 0.3]),  # xx, yy, zz, xy, xz, yz, kg m^2
    "axis": jnp.array([0.02, -0.03]),  # of the wheel: its parts along x and y beside 1 along z
    "bias": jnp.array([1e-3, -2e-3, 5e-4]),  # rad/s
    "omega": jnp.array([0.20, 0.35, -0.10]),  # rad/s
}
guess = {
    "J": jnp.array([11.0, 12.0, 14.0, 0.0, 0.0, 0.0]),
    "axis": jnp.zeros(2),
    "bias": jnp.zeros(3),
    "omega": jnp.array([0.21, 0.34, -0.09]),
}


def tensor(J):
    """The inertia from its six different elements."""
    return InertiaTensor(J[jnp.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])])


def readings(p, with_wheel=True):
    """What the gyros read, rad/s, (3, times)."""
    axis = jnp.append(p["axis"], 1.0)
    motor = ConstantTorque(TORQUE, until=UNTIL)
    wheel = ReactionWheels.rotor(axis, WHEEL, motor=motor)
    scene = Scene([wheel], RigidBody(inertia=tensor(p["J"])))
    y0 = BodyState(attitude=Quaternion.identity(), omega=p["omega"])
    system, y0 = (scene, scene.start(y0)) if with_wheel else (TorqueFreeBody(tensor(p["J"])), y0)
    accuracy = Accuracy(1e-8, method=Tsit5(), max_steps=512)
    run = simulate(system, y0, ts, accuracy=accuracy, throw=False)
    return run.states.omega + p["bias"][:, None]


data = readings(truth) + NOISE * jax.random.normal(jax.random.key(7), (3, ts.size))
found = fit(readings, data, guess, noise=NOISE)
print(found)
print("p-values of the residuals:", float(found.p_value), found.tests)
true = np.concatenate([truth[name] for name in sorted(truth)])
estimate = np.concatenate([found.parameters[name] for name in sorted(truth)])
moments, _ = principal_axes(tensor(found.parameters["J"]))
expected, _ = principal_axes(tensor(truth["J"]))
print("\nprincipal moments:", jnp.round(moments, 3), "true:", jnp.round(expected, 3))
assert found.converged and found.observability() == ""
assert np.max(np.abs(estimate - true) / found.std) < 4.0

# Without the wheel neither the scale of the inertia nor the axis of the wheel is observable.
blind = fit(lambda p: readings(p, False), readings(truth, False), truth, noise=NOISE)
print(blind.observability())
assert "axis[0] cannot be seen" in blind.observability()
