"""Kalman filters for any system with white process noise, between readings at discrete times.

    predict    m' = f(t, m),  P' = A P + P A^T + Q                          (extended)
               m = sum w_i x_i,  P = sum w_i (x_i - m)(x_i - m)^T + Q_d     (unscented)
    update     r = z - h(m),  S = H P H^T + R,  K = P H^T S^-1
               m <- m + K r,  P <- (I - K H) P (I - K H)^T + K R K^T

    symbol  meaning
    m, P    mean, and covariance of its local coordinates (of an attitude a small rotation, rad)
    Q, R    spectral density of the process noise, 1/s; covariance of the readings
    x_i     sigma points m +- columns of sqrt((n + k) P), propagated as one batch; k = 1
    Q_d     covariance by the process noise over the interval, about the mean
    r, S    innovation and its covariance

Source: Maybeck, Stochastic Models, Estimation, and Control, 9.5; Julier and Uhlmann (Proc. IEEE 92,
2004); Bar-Shalom, Li and Kirubarajan, Estimation with Applications, 5.4 (consistency).
"""

from collections.abc import Callable
from typing import TypeAlias, final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float, Int

from ..core import AbstractSystem, InputError, Scalar, State
from ..core.jit import quick_jit
from ..core.printing import printed
from ..core.square_roots import inverse_sqrt, sqrt
from ..core.structure import HashedModule
from ..simulation import Accuracy, simulate, simulate_batch
from ..studies.coordinates import Coordinates
from ..studies.covariance import MeanCovariance, Noise, Uncertain

KINDS = ("extended", "unscented")

Measure: TypeAlias = Callable[[Scalar, State], Array]
"""What predicts a reading from the time and the state."""

FilterArguments: TypeAlias = tuple[
    AbstractSystem, Array, Array, Array, Noise, Accuracy | Scalar | None
]
"""What all runs share: system, covariance, times, noise of readings and process, accuracy."""

KAPPA = 1.0
"""k of the sigma points: positive, so that no weight is negative whatever their number."""


@final
@printed(ts="s")
class Filtered(HashedModule):
    """Estimates of a filter after each reading; the runs of a batch are on the last axis.

    - `ts`, `states`, `covariance`: times (times,), means and covariances (n, n, times, *runs), in
      the coordinates named by `names`.
    - `innovations`: readings less predictions (m, times, *runs), zero where there is none, and
      their covariance S.
    - `status`: of each propagation, (times - 1, *runs), as in a `Trajectory`."""

    ts: Float[Array, " times"]
    names: tuple[str, ...] = eqx.field(static=True)
    states: State
    covariance: Float[Array, "n n times *#runs"]
    innovations: Float[Array, "m times *#runs"]
    innovation_covariance: Float[Array, "m m times *#runs"]
    status: Int[Array, "intervals *#runs"]

    @property
    def std(self) -> Float[Array, "n times *#runs"]:
        """Standard deviations of the coordinates of the state."""
        return jnp.sqrt(jnp.stack([self.covariance[k, k] for k in range(len(self.names))]))

    @property
    def nis(self) -> Float[Array, "times *#runs"]:
        """Normalised innovations squared, r^T S^-1 r: chi^2 with m degrees of freedom on average if
        the filter is consistent."""
        return _normalised(self.innovations, self.innovation_covariance)

    def nees(self, truth: State) -> Float[Array, "times *#runs"]:
        """Normalised estimation errors squared, e^T P^-1 e, beside the true states: chi^2 with n
        degrees of freedom on average if the filter is consistent."""
        coordinates = Coordinates.of(self.states, self.covariance.ndim - 2)
        error = coordinates.components(jax.tree.map(jnp.subtract, truth, self.states))
        return _normalised(error, self.covariance)


def kalman_filter(
    system: AbstractSystem,
    y0: State,
    covariance: Float[ArrayLike, "n n"],
    ts: Float[ArrayLike, " times"],
    readings: Float[ArrayLike, "m ..."],
    measure: Measure,
    *,
    noise: Float[ArrayLike, "..."],
    process: Noise = None,
    kind: str = "extended",
    batch: bool = False,
    accuracy: Accuracy | Scalar | None = None,
) -> Filtered:
    """The state of a system from readings, one after the other.

    **Arguments**

    - `system`: any system. `y0`, `covariance`: mean and covariance of its state at the first time
      before its reading; the covariance, (n, n), in local coordinates, zero for a state known
      exactly.
    - `ts`: the times of the readings, s, ascending.
    - `readings`: (m, times); NaN where there is none.
    - `measure`: a function (t, y) -> (m,) that predicts a reading.
    - `noise`: standard deviations of the readings, (m,), or their covariance R, (m, m).
    - `process`: the spectral density Q of the process noise, (n, n), per s, or a function (t, y) of
      it; none by default.
    - `kind`: "extended", by derivatives, or "unscented", by sigma points.
    - `batch`: whether `y0` and `readings` carry runs on their last axis, each filtered by itself.
    - `accuracy`: of the propagation, as in `simulate`.

    **Returns** a `Filtered`. Differentiable, as a run is. A propagation that fails leaves NaN from
    there on, and its status.

    **Raises** `InputError` for another kind, and for shapes that do not fit."""
    if kind not in KINDS:
        raise InputError(f"kind is {kind!r}: it must be one of {', '.join(KINDS)}.")
    ts, readings = jnp.asarray(ts), jnp.asarray(readings)
    if readings.ndim != 2 + int(batch) or readings.shape[1:2] != ts.shape:
        runs = ", runs" if batch else ""
        raise InputError(
            f"readings have the shape {readings.shape}: it must be (m, {ts.size}{runs}), with the "
            f"{ts.size} times."
        )
    given = (system, jnp.asarray(covariance), ts, jnp.asarray(noise), process, accuracy)
    return _filter_all(given, y0, readings, measure, kind, batch)


@quick_jit
def _filter_all(
    given: FilterArguments, y0: State, readings: Array, measure: Measure, kind: str, batch: bool
) -> Filtered:
    def one(y0: State, readings: Array) -> Filtered:
        return _filter_one(given, y0, readings, measure, kind)

    return jax.vmap(one, in_axes=-1, out_axes=-1)(y0, readings) if batch else one(y0, readings)


def _filter_one(
    given: FilterArguments, y0: State, readings: Array, measure: Measure, kind: str
) -> Filtered:
    system, covariance, ts, noise, process, accuracy = given
    n = Coordinates.of(y0, 0)
    if covariance.shape != (n.count, n.count):
        raise InputError(
            f"covariance has the shape {covariance.shape}: it must be ({n.count}, {n.count}) for "
            f"{', '.join(n.labels)}."
        )
    R = jnp.diag(noise**2) if noise.ndim == 1 else noise
    if R.shape != (readings.shape[0],) * 2:
        raise InputError(
            f"noise has the shape {noise.shape} for readings of {readings.shape[0]} numbers: it "
            f"must be ({readings.shape[0]},), or that squared for a covariance."
        )
    extended = kind == "extended"
    update = _update_extended if extended else _update_unscented
    predict = _predict_extended if extended else _predict_unscented
    known = MeanCovariance(y0, covariance.astype(n.dtype))

    def step(known: MeanCovariance, row: tuple[Array, Array, Array]) -> tuple:
        t0, t1, z = row
        predicted, status = predict(system, known, t0, t1, process, accuracy)
        known, about = update(predicted, t1, z, measure, R)
        return known, (known, *about, status)

    first, about = update(known, ts[0], readings[:, 0], measure, R)
    rows = (ts[:-1], ts[1:], readings[:, 1:].T)
    _, (later, *more, status) = jax.lax.scan(step, first, rows)

    def joined(a: Array, b: Array) -> Array:
        return jnp.moveaxis(jnp.concatenate([a[None], b]), 0, -1)

    every, r, S = jax.tree.map(joined, (first, *about), (later, *more))
    return Filtered(ts, n.labels, every.mean, every.covariance, r, S, status)


def _predict_extended(
    system: AbstractSystem,
    known: MeanCovariance,
    t0: Array,
    t1: Array,
    process: Noise,
    accuracy: Accuracy | Scalar | None,
) -> tuple[MeanCovariance, Array]:
    ts = jnp.stack([t0, t1])
    # A propagation that fails must not end the filters of the other runs.
    run = simulate(Uncertain(system, process), known, ts, accuracy=accuracy, throw=False)
    return run.final, run.status


def _predict_unscented(
    system: AbstractSystem,
    known: MeanCovariance,
    t0: Array,
    t1: Array,
    process: Noise,
    accuracy: Accuracy | Scalar | None,
) -> tuple[MeanCovariance, Array]:
    ts = jnp.stack([t0, t1])
    points, weights = _sigma_points(known)
    run = simulate_batch(system, points, ts, accuracy=accuracy)
    # Errors are small beside the point that started at the mean.
    about = Coordinates.of(jax.tree.map(lambda x: x[..., 0], run.final), 0)
    errors = _errors(about, run.final)
    mean, P = _moments(errors, weights)
    status = jnp.max(run.status)
    if process is not None:
        # The covariance that the noise adds to a known state.
        exact = MeanCovariance(known.mean, jnp.zeros_like(P))
        added, status_of_noise = _predict_extended(system, exact, t0, t1, process, accuracy)
        P = P + added.covariance
        status = jnp.maximum(status, status_of_noise)
    return MeanCovariance(about.moved(mean), P), status


def _update_extended(
    known: MeanCovariance, t: Array, z: Array, measure: Measure, R: Array
) -> tuple[MeanCovariance, tuple[Array, Array]]:
    about = Coordinates.of(known.mean, 0)
    zero = jnp.zeros(about.count, about.dtype)

    def predicted(x: Array) -> Array:
        return measure(t, about.moved(x))

    h, along = jax.linearize(predicted, zero)
    H = jax.vmap(along, out_axes=1)(jnp.eye(about.count, dtype=about.dtype))
    there = ~jnp.isnan(z)
    r = jnp.where(there, jnp.where(there, z, 0.0) - h, 0.0)
    # A reading that is missing depends on nothing.
    H = jnp.where(there[:, None], H, 0.0)
    P = known.covariance
    S = H @ P @ H.T + R
    K = P @ H.T @ _inverse(S)
    left = jnp.eye(about.count, dtype=about.dtype) - K @ H
    # Joseph's form: longer than (1 - K H) P, but a sum of squares, which no rounding makes
    # indefinite.
    return MeanCovariance(about.moved(K @ r), left @ P @ left.T + K @ R @ K.T), (r, S)


def _update_unscented(
    known: MeanCovariance, t: Array, z: Array, measure: Measure, R: Array
) -> tuple[MeanCovariance, tuple[Array, Array]]:
    about = Coordinates.of(known.mean, 0)
    points, weights = _sigma_points(known)
    h = jax.vmap(measure, in_axes=(None, -1), out_axes=-1)(t, points)
    there = ~jnp.isnan(z)
    # A missing reading has no variance, and no gain.
    h = jnp.where(there[:, None], h, 0.0)
    mean, S = _moments(h, weights)
    errors = _errors(about, points)
    cross = (errors * weights) @ (h - mean[:, None]).T
    r = jnp.where(there, jnp.where(there, z, 0.0) - mean, 0.0)
    S = S + R
    K = cross @ _inverse(S)
    P = known.covariance - K @ cross.T
    # Made symmetric again, because rounding does not keep it so, and the next root assumes it.
    return MeanCovariance(about.moved(K @ r), 0.5 * (P + P.T)), (r, S)


def _sigma_points(known: MeanCovariance) -> tuple[State, Array]:
    """The points, on the last axis, the mean first, and their weights."""
    about = Coordinates.of(known.mean, 0)
    n = about.count
    columns = _root((n + KAPPA) * known.covariance)
    x = jnp.concatenate([jnp.zeros((n, 1), columns.dtype), columns, -columns], axis=1)
    points = jax.vmap(about.moved, in_axes=-1, out_axes=-1)(x)
    weights = jnp.full(2 * n + 1, 0.5 / (n + KAPPA), columns.dtype)
    return points, weights.at[0].set(KAPPA / (n + KAPPA))


def _errors(about: Coordinates, points: State) -> Array:
    """The coordinates (n, points) of states on the last axis."""
    base = about.tree

    def error(y: State) -> Array:
        return about.components(jax.tree.map(jnp.subtract, y, base))

    return jax.vmap(error, in_axes=-1, out_axes=-1)(points)


def _moments(x: Array, weights: Array) -> tuple[Array, Array]:
    mean = x @ weights
    off = x - mean[:, None]
    return mean, (off * weights) @ off.T


def _root(P: Array) -> Array:
    """L with L L^T = P, also where P has no full rank: a state that is known exactly, in part or
    whole, has columns of zeros."""
    n = P.shape[0]
    least = 16.0 * jnp.finfo(P.dtype).eps * jnp.diag(P)
    columns = []
    for j in range(n):
        d = P[j, j]
        # Remainders below rounding are no variances: their roots would be noise, or of negative
        # numbers.
        good = d > least[j]
        column = jnp.where(good, P[:, j], 0.0) * inverse_sqrt(jnp.where(good, d, 1.0))
        columns.append(column)
        P = P - jnp.outer(column, column)
    return jnp.stack(columns, axis=1)


def _inverse(S: Array) -> Array:
    """The inverse, or of what is known exactly, the pseudo-inverse, in units of the diagonal."""
    size = sqrt(jnp.where(jnp.diag(S) > 0.0, jnp.diag(S), 1.0))
    # In units of the diagonal, because metres and radians in one matrix would decide its rank.
    unit = jnp.linalg.pinv(S / (size[:, None] * size[None]), hermitian=True)
    return unit / (size[:, None] * size[None])


def _normalised(e: Array, P: Array) -> Array:
    """e^T P^-1 e, of errors (n, times, *runs)."""
    shape = e.shape[1:]
    rows = e.reshape(e.shape[0], -1)
    matrices = P.reshape(*P.shape[:2], -1)
    return jax.vmap(lambda e, P: e @ _inverse(P) @ e, in_axes=-1)(rows, matrices).reshape(shape)
