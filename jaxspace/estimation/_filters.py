"""Kalman filters for any system with white process noise, between readings at discrete times.

    predict    m' = f(t, m),  L' = A L,  P = L L^T + Q_d                    (extended)
               m = sum w_i x_i,  P = sum w_i (x_i - m)(x_i - m)^T + Q_d     (unscented)
    update     r = z - h(m),  S = H P H^T + R,  K = P H^T S^-1
               m <- m + K r,  P <- P - K S K^T

    symbol  meaning
    m, P    mean, and covariance of its local coordinates (of an attitude a small rotation, rad)
    L       a root of P, the only one computed (`_roots`)
    Q, R    spectral density of the process noise, 1/s; covariance of the readings
    x_i     sigma points m +- columns of sqrt(n + k) L, propagated as one batch; k = 1
    H       derivatives of h at the mean; of the unscented filter half differences of its readings
            at the sigma points, whose even part adds to R
    Q_d     covariance due to the process noise over the interval, about the mean
    r, S    innovation and its covariance

Source: Maybeck, Stochastic Models, Estimation, and Control, 9.5; Julier and Uhlmann (Proc. IEEE 92,
2004); Bar-Shalom, Li and Kirubarajan, Estimation with Applications, 5.4 (consistency).
"""

import math
from collections.abc import Callable
from typing import TypeAlias, final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float, Int

from ..core import AbstractSystem, InputError, Scalar, State
from ..core.jit import quick_jit
from ..core.printing import printed
from ..core.square_roots import sqrt
from ..core.structure import HashedModule
from ..simulation import Accuracy, simulate, simulate_batch
from ..studies.coordinates import Coordinates
from ..studies.covariance import Factors, MeanRoot, Noise, Uncertain, UncertainRoot
from ._roots import lower_root, root_of, updated

KINDS = ("extended", "unscented")

Measure: TypeAlias = Callable[[Scalar, State], Array]
"""Function that predicts a reading from the time and the state."""

FilterArguments: TypeAlias = tuple[
    AbstractSystem, Array, Array, Array, Noise, Accuracy | Scalar | None
]
"""The data shared by all runs: system, covariance, times, noise of readings and process,
accuracy."""

KAPPA = 1.0
"""k of the sigma points: positive, so that no weight is negative for any number of points."""


@final
@printed(ts="s")
class Filtered(HashedModule):
    """Estimates of a filter after each reading; the runs of a batch are on the last axis.

    - `ts`, s: times of the readings, (times,).
    - `names`: of the n coordinates of the covariance.
    - `states`: means of the state.
    - `covariance`: of the state, (n, n, times, *runs), in the coordinates `names`.
    - `innovations`: readings minus predictions, (m, times, *runs), zero without a reading.
    - `innovation_covariance`: covariance S of the innovations, (m, m, times, *runs).
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
        """Normalised estimation errors squared, e^T P^-1 e, relative to the true states: chi^2 with
        n degrees of freedom on average if the filter is consistent."""
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
    """Kalman filter: the state of a system from sequential readings.

    **Arguments**

    - `system`: any system. `y0`, `covariance`: mean and covariance of its state at the first time
      before its reading; the covariance, (n, n), in local coordinates, zero for a state known
      exactly.
    - `ts`: the times of the readings, s, ascending.
    - `readings`: (m, times); NaN for missing ones.
    - `measure`: a function (t, y) -> (m,) that predicts a reading.
    - `noise`: standard deviations of the readings, (m,), or their covariance R, (m, m).
    - `process`: the spectral density Q of the process noise, (n, n), per s, or a function (t, y) of
      it; none by default.
    - `kind`: "extended", with derivatives, or "unscented", with sigma points.
    - `batch`: whether the last axis of `y0` and `readings` is a batch axis, with separately
      filtered runs.
    - `accuracy`: of the propagation, as in `simulate`.

    **Returns** a `Filtered`. It is differentiable, like a run. After a failed propagation,
    estimates are NaN, and the status reports the failure.

    **Raises** `InputError` for an unknown kind, and for incompatible shapes."""
    if kind not in KINDS:
        raise InputError(f"kind is {kind!r}: it must be one of {', '.join(KINDS)}.")
    ts, readings = jnp.asarray(ts), jnp.asarray(readings)
    if readings.ndim != 2 + int(batch) or readings.shape[1:2] != ts.shape:
        runs = ", runs" if batch else ""
        raise InputError(
            f"readings have the shape {readings.shape}: it must be (m, {ts.size}{runs}), for the "
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
    predict_reading = _reading_extended if extended else _reading_unscented
    predict = _predict_extended if extended else _predict_unscented
    known = MeanRoot(y0, root_of(covariance.astype(n.dtype)))

    def step(known: MeanRoot, row: tuple[Array, Array, Array]) -> tuple:
        t0, t1, z = row
        predicted, status = predict(system, known, t0, t1, process, accuracy)
        known, about = _update(predict_reading, predicted, t1, z, measure, R)
        return known, (known, *about, status)

    first, about = _update(predict_reading, known, ts[0], readings[:, 0], measure, R)
    rows = (ts[:-1], ts[1:], readings[:, 1:].T)
    _, (later, *more, status) = jax.lax.scan(step, first, rows)

    def joined(a: Array, b: Array) -> Array:
        return jnp.moveaxis(jnp.concatenate([a[None], b]), 0, -1)

    every, r, S = jax.tree.map(joined, (first, *about), (later, *more))
    P = jnp.einsum("ik...,jk...->ij...", every.root, every.root)
    return Filtered(ts, n.labels, every.mean, P, r, S, status)


def _predict_extended(
    system: AbstractSystem,
    known: MeanRoot,
    t0: Array,
    t1: Array,
    process: Noise,
    accuracy: Accuracy | Scalar | None,
) -> tuple[MeanRoot, Array]:
    ts = jnp.stack([t0, t1])
    # A propagation that fails must not end the filters of the other runs.
    run = simulate(UncertainRoot(system), known, ts, accuracy=accuracy, throw=False)
    root, status = _with_noise(system, run.final.root, known.mean, ts, process, accuracy)
    return MeanRoot(run.final.mean, root), jnp.maximum(run.status, status)


def _predict_unscented(
    system: AbstractSystem,
    known: MeanRoot,
    t0: Array,
    t1: Array,
    process: Noise,
    accuracy: Accuracy | Scalar | None,
) -> tuple[MeanRoot, Array]:
    ts = jnp.stack([t0, t1])
    points, weights = _sigma_points(known)
    run = simulate_batch(system, points, ts, accuracy=accuracy)
    # Errors are small compared with the point that started at the mean.
    about = Coordinates.of(jax.tree.map(lambda x: x[..., 0], run.final), 0)
    errors = _errors(about, run.final)
    mean = errors @ weights
    # No weight is negative.
    off = (errors - mean[:, None]) * sqrt(weights)
    root, status = _with_noise(system, off, known.mean, ts, process, accuracy)
    return MeanRoot(about.moved(mean), root), jnp.maximum(jnp.max(run.status), status)


def _with_noise(
    system: AbstractSystem,
    columns: Array,
    mean: State,
    ts: Array,
    process: Noise,
    accuracy: Accuracy | Scalar | None,
) -> tuple[Array, Array]:
    """The root of a covariance from these `columns` and from the process noise between two times,
    from the state `mean` on; and the status."""
    n = columns.shape[0]
    if process is None:
        # A square matrix is a root as it is.
        root = columns if columns.shape[1] == n else lower_root(columns)
        return root, jnp.array(0, jnp.int32)
    # The covariance that the noise adds to a known state.
    noisy = Uncertain(system, process)
    exact = Factors(jnp.zeros((n, 1), columns.dtype), jnp.zeros(1, columns.dtype))
    run = simulate(noisy, noisy.about(mean, exact), ts, accuracy=accuracy, throw=False)
    added = root_of(run.final.added)
    return lower_root(jnp.concatenate([columns, added], axis=1)), run.status


def _update(
    predict_reading: Callable[..., tuple[Array, Array, Array]],
    known: MeanRoot,
    t: Array,
    z: Array,
    measure: Measure,
    R: Array,
) -> tuple[MeanRoot, tuple[Array, Array]]:
    h, HL, curved = predict_reading(known, t, measure)
    there = ~jnp.isnan(z)
    r = jnp.where(there, jnp.where(there, z, 0.0) - h, 0.0)
    # A reading that is missing depends on nothing, and its error on that of no other one.
    HL = jnp.where(there[:, None], HL, 0.0)
    both = there[:, None] & there[None]
    noise = R + jnp.where(both, curved, 0.0)
    noise = jnp.where(both | jnp.eye(z.size, dtype=bool), noise, 0.0)
    root, moved = updated(known.root, HL, noise, r)
    about = Coordinates.of(known.mean, 0)
    return MeanRoot(about.moved(moved), root), (r, HL @ HL.T + noise)


def _reading_extended(known: MeanRoot, t: Array, measure: Measure) -> tuple[Array, Array, Array]:
    """The predicted reading, its derivatives along the columns of the root, and the covariance that
    the curvature of the measurement adds: none."""
    about = Coordinates.of(known.mean, 0)

    def predicted(x: Array) -> Array:
        return measure(t, about.moved(x))

    h, along = jax.linearize(predicted, jnp.zeros(about.count, about.dtype))
    HL = jax.vmap(along, in_axes=1, out_axes=1)(known.root)
    return h, HL, jnp.zeros((h.size, h.size), HL.dtype)


def _reading_unscented(known: MeanRoot, t: Array, measure: Measure) -> tuple[Array, Array, Array]:
    """The same from the readings at the sigma points."""
    points, _ = _sigma_points(known)
    h = jax.vmap(measure, in_axes=(None, -1), out_axes=-1)(t, points)
    n = known.root.shape[0]
    centre, up, down = h[:, 0], h[:, 1 : n + 1], h[:, n + 1 :]
    HL = 0.5 * (up - down) / math.sqrt(n + KAPPA)
    even = 0.5 * ((up - centre[:, None]) + (down - centre[:, None]))
    rise = jnp.sum(even, axis=1) / (n + KAPPA)
    off = even - rise[:, None]
    curved = (off @ off.T + KAPPA * jnp.outer(rise, rise)) / (n + KAPPA)
    return centre + rise, HL, curved


def _sigma_points(known: MeanRoot) -> tuple[State, Array]:
    """The points, on the last axis, the mean first, and their weights."""
    about = Coordinates.of(known.mean, 0)
    n = about.count
    columns = math.sqrt(n + KAPPA) * known.root
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


def _inverse(S: Array) -> Array:
    """The inverse or, for exactly known components, the pseudo-inverse, in units of the
    diagonal."""
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
