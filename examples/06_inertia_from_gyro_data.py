"""The inertia tensor of a free body from noisy rate gyros: least squares through the simulated
motion.

Torque-free motion determines the tensor only up to a factor (twice the inertia moves the same way):
one moment is set to 1."""

import jax
import jax.numpy as jnp

import jaxspace
from jaxspace import BodyState, simulate
from jaxspace.attitude import TorqueFreeBody
from jaxspace.bodies import InertiaTensor, principal_axes
from jaxspace.rotations import Quaternion

jaxspace.enable_x64()

NOISE = 2e-3  # rad/s, standard deviation of every reading
ts = jnp.linspace(0.0, 60.0, 301)
names = (
    "J_yy/J_xx",
    "J_zz/J_xx",
    "J_xy/J_xx",
    "J_xz/J_xx",
    "J_yz/J_xx",
    "omega_x",
    "omega_y",
    "omega_z",
)
truth = jnp.array([1.30, 1.55, 0.05, -0.08, 0.03, 0.20, 0.35, -0.10])
guess = jnp.array([1.20, 1.70, 0.00, 0.00, 0.00, 0.21, 0.34, -0.09])


def tensor(p):
    """The inertia over its first element, from the first five parameters."""
    yy, zz, xy, xz, yz = p[:5]
    return jnp.stack(
        [jnp.stack([jnp.ones_like(yy), xy, xz]), jnp.stack([xy, yy, yz]), jnp.stack([xz, yz, zz])]
    )


def readings(p):
    """What perfect gyros read, rad/s, at all times one after the other."""
    y0 = BodyState(attitude=Quaternion.identity(), omega=p[5:])
    run = simulate(TorqueFreeBody(InertiaTensor(tensor(p))), y0, ts)
    return run.states.omega.ravel()


data = readings(truth) + NOISE * jax.random.normal(jax.random.key(7), (3 * ts.size,))


@jax.jit
def gauss_newton(p):
    """The next parameters, the weighted misfit of these ones, and the covariance that the noise
    implies."""
    residual = readings(p) - data
    # Far more readings than parameters: forward mode is the cheaper one.
    jacobian = jax.jacfwd(readings)(p)
    step = jnp.linalg.lstsq(jacobian, residual)[0]
    covariance = NOISE**2 * jnp.linalg.inv(jacobian.T @ jacobian)
    return p - step, jnp.mean((residual / NOISE) ** 2), covariance


estimate = guess
for k in range(8):
    estimate, misfit, covariance = gauss_newton(estimate)
    print(f"step {k}   mean square of the residuals over the noise's: {misfit:12.4f}")

sigma = jnp.sqrt(jnp.diag(covariance))
print("\nparameter       truth   estimate  standard deviation  error in it")
for name, true, found, spread in zip(names, truth, estimate, sigma, strict=True):
    print(f"{name:10s}  {true:9.5f}  {found:9.5f}  {spread:18.5f}  {(found - true) / spread:11.2f}")

moments, _ = principal_axes(InertiaTensor(tensor(estimate)))
expected, _ = principal_axes(InertiaTensor(tensor(truth)))
print("\nprincipal moments over J_xx:", jnp.round(moments, 5), "true:", jnp.round(expected, 5))
assert abs(misfit - 1.0) < 0.2
assert jnp.max(jnp.abs(estimate - truth) / sigma) < 4.0
