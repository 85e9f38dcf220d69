"""Mean and covariance of a state along a run under white noise, to first order.

    y' = f(t, y) + w,     E[w(t) w(s)^T] = Q delta(t - s)
    m' = f(t, m)
    P' = A P + P A^T + Q,     A = df/dy at m

    symbol  meaning                                                      unit
    m, P    mean and covariance, in local coordinates                    of the state, squared
    Q       spectral density of the process noise                        that of P, 1/s
    A       matrix of the linearised motion of the error                 1/s

The error of a quaternion q is the small rotation e in body axes, q = m exp(e/2); its matrix A
contains that the body axes turn with the mean.

Source: Maybeck, Stochastic Models, Estimation, and Control, 4.9; for attitude Markley and
Crassidis, Fundamentals of Spacecraft Attitude Determination and Control, 6.2.
"""

from collections.abc import Callable
from typing import Any, final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float, PyTree

from ..core import AbstractSystem, InputError, Scalar, State
from ..integration._layout import broadcast_state
from ..simulation import Trajectory, simulate, simulate_batch
from ._coordinates import Coordinates

Noise = Float[ArrayLike, "n n"] | Callable[[Scalar, Any], Array] | None


@final
class MeanCovariance(eqx.Module):
    """The state of `Uncertain`: a mean and the covariance of its local coordinates."""

    mean: State
    covariance: Float[Array, "n n *#runs"]


@final
class Uncertain(AbstractSystem):
    """Any system with the covariance of its state, as a system that every verb takes.

    - `system`: the one that moves.
    - `noise`: the spectral density Q (n, n) of its process noise, or a function (t, y) -> (n, n) of
      it; `None` for none."""

    system: AbstractSystem
    noise: Any = None

    def vector_field(self, t: Scalar, y: MeanCovariance) -> MeanCovariance:
        P = y.covariance
        A = error_matrix(self.system, t, y.mean, P.ndim - 2)
        AP = jnp.einsum("ij...,jk...->ik...", A, P)
        rate = AP + jnp.swapaxes(AP, 0, 1)
        if self.noise is not None:
            Q = jnp.asarray(self.noise(t, y.mean) if callable(self.noise) else self.noise)
            rate = rate + Q.reshape(Q.shape + (1,) * (rate.ndim - Q.ndim))
        return MeanCovariance(self.system.vector_field(t, y.mean), rate)

    def invariants(self, t: Scalar, y: MeanCovariance) -> dict[str, Array]:
        return self.system.invariants(t, y.mean)

    def breaks(self) -> Float[Array, "times *#runs"] | None:
        return self.system.breaks()

    def outside(self, t: Scalar, y: MeanCovariance) -> Any:
        return self.system.outside(t, y.mean)


def error_matrix(
    system: AbstractSystem, t: Scalar, y: State, run_axes: int
) -> Float[Array, "n n *runs"]:
    """A, 1/s, (n, n, *runs): e' = A e for a small error e of the state `y` at the time `t`, s."""
    coordinates = Coordinates.of(y, run_axes)
    runs = coordinates.trailing[0]
    zero = jnp.zeros((coordinates.count, *runs), coordinates.dtype)

    def off(y: State, e: Array) -> State:
        """The tangent of the state that an error e is: dy = T(y) e."""
        return jax.jvp(coordinates.at(y).moved, (zero,), (e,))[1]

    def column(e: Array) -> Array:
        e = jnp.broadcast_to(e.reshape(-1, *(1,) * run_axes), zero.shape)
        rate, change = jax.jvp(lambda y: system.vector_field(t, y), (y,), (off(y, e),))
        # T e' = (df/dy) T e - T' e: where T depends on the state, as on a group, it moves too.
        _, turn = jax.jvp(lambda y: off(y, e), (y,), (rate,))
        return coordinates.components(jax.tree.map(jnp.subtract, change, turn))

    return jax.vmap(column, out_axes=1)(jnp.eye(coordinates.count, dtype=coordinates.dtype))


def propagate_covariance(
    system: AbstractSystem,
    y0: State,
    ts: Any,
    covariance: Float[ArrayLike, "n n *#runs"],
    *,
    noise: Noise = None,
    batch: bool = False,
    **options: Any,
) -> tuple[Trajectory, Float[Array, "n n times *runs"]]:
    """The run of the mean with the covariance of its state under white noise, to first order.

    **Arguments**

    - `system`, `y0`, `ts`: as in `simulate`.
    - `covariance`: that of the initial state, (n, n), in the coordinates of `Sensitivity.rows`.
    - `noise`: the spectral density Q of the process noise, (n, n), per s, or a function of the time
      and the state.
    - `batch`: whether `simulate_batch` runs it, with the runs on the last axis.
    - `options`: further arguments of `simulate` or `simulate_batch`; an event here reads
      a `MeanCovariance`.

    **Returns** the run, whose states are `MeanCovariance`, and its covariance, (n, n, times,
    *runs). Without noise, and for missions, `Sensitivity.covariance` is the cheaper way.

    **Raises** `InputError` as `simulate` does, and for a covariance or a noise of another size."""
    t0 = jnp.asarray(ts)[0]
    y0 = broadcast_state(system, t0, y0)
    size = Coordinates.of(y0, int(batch))
    covariance = jnp.asarray(covariance, size.dtype)
    noise = noise if noise is None or callable(noise) else jnp.asarray(noise, size.dtype)
    for name, matrix in (("covariance", covariance), ("noise", noise)):
        shape = getattr(matrix, "shape", (size.count,) * 2)
        if shape[:2] != (size.count,) * 2:
            rows = ", ".join(size.labels)
            raise InputError(
                f"{name} has the shape {shape}: it must be ({size.count}, {size.count}) for {rows}."
            )
    runs = size.trailing[0]
    missing = (1,) * (2 + len(runs) - covariance.ndim)
    covariance = jnp.broadcast_to(
        covariance.reshape(covariance.shape + missing), (size.count, size.count, *runs)
    )
    verb: Callable[..., PyTree] = simulate_batch if batch else simulate
    run = verb(Uncertain(system, noise), MeanCovariance(y0, covariance), ts, **options)
    return run, run.states.covariance
