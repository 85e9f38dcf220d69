"""Random errors of a gyro, and the Allan variance that shows them.

    w_k = N n_k / sqrt(dt) + b_k,   b_k+1 = b_k + K sqrt(dt) m_k        n, m: normal, independent
    sigma^2(tau) = N^2 / tau + K^2 tau / 3                              for tau of many samples

    symbol   meaning                                              unit
    w, b     error of the rate, its slowly wandering part         rad/s
    N        angle random walk                                    rad/s^(1/2)
    K        rate random walk                                     rad/s^(3/2)
    tau, dt  time of averaging, time between samples              s

Source: IEEE Std 952-1997, annex C.
"""

__all__ = ["allan_of_walks", "allan_variance", "gyro_noise"]

import functools
import operator
from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import InputError, Scalar
from ..core.compensated import running_sums, two_sum
from ..core.formula import NOT_NEGATIVE, POSITIVE, formula
from ..core.square_roots import sqrt


@formula(step=POSITIVE, angle_walk=NOT_NEGATIVE, rate_walk=NOT_NEGATIVE)
def gyro_noise(
    key: Array, samples: int, step: Scalar, angle_walk: Scalar, rate_walk: Scalar = 0.0
) -> Float[Array, "samples *#runs"]:
    """Errors of the rate of a gyro; the same `key` gives the same errors.

    **Arguments**

    - `key`: of `jax.random`.
    - `samples`, `step`: their number, and dt, s.
    - `angle_walk`: N, rad/s^(1/2); `rate_walk`: K, rad/s^(3/2): scalars or (*runs,).

    **Returns** the errors, rad/s, (samples, *runs), which begin without a bias.
    """
    runs = jnp.broadcast_shapes(jnp.shape(angle_walk), jnp.shape(rate_walk), jnp.shape(step))
    white, wander = (jax.random.normal(k, (samples, *runs)) for k in jax.random.split(key))
    root = sqrt(jnp.asarray(step, white.dtype))
    # The sum up to the previous step, so that the bias begins at zero.
    bias = rate_walk * root * (jnp.cumsum(wander, axis=0) - wander)
    return angle_walk / root * white + bias


@formula(step=POSITIVE)
def allan_variance(
    rates: Float[Array, "samples *#runs"], step: Scalar, factors: Sequence[int]
) -> Float[Array, "times *#runs"]:
    """The Allan variance of measured rates at the times `factors` * `step`, with overlap.

    **Arguments**

    - `rates`: rad/s, at equal steps, (samples, *runs).
    - `step`: dt, s.
    - `factors`: samples in each average, whole numbers from 1 to half of the samples.

    **Returns** half the mean square of the difference of adjacent averages, (rad/s)^2,
    (times, *runs).

    **Raises** `InputError` for no factor, and for one that is out of this range.
    """
    return _variance(rates, step, _checked_factors(factors, rates.shape[0]))


@functools.partial(jax.jit, static_argnames="factors")
def _variance(rates: Array, step: Scalar, factors: tuple[int, ...]) -> Array:
    # With the digits that a rounded angle has lost: its second differences are as small as the
    # noise, while the angle grows with the mean rate and the length of the log.
    angle, missing = (
        jnp.concatenate([jnp.zeros_like(rates[:1]), sums]) for sums in running_sums(rates)
    )
    # One, and NaN where the step is: the averages do not depend on it.
    unit = jnp.asarray(step, angle.dtype) / step
    result = []
    for m in factors:
        # Second differences of the angle: overlapping averages without a loop over them.
        later, lost_later = two_sum(angle[2 * m :], -angle[m:-m])
        former, lost_former = two_sum(angle[m:-m], -angle[: -2 * m])
        rest = missing[2 * m :] - 2.0 * missing[m:-m] + missing[: -2 * m]
        second = (later - former) + (lost_later - lost_former + rest)
        result.append(unit * jnp.mean((second / m) ** 2, axis=0) / 2.0)
    return jnp.stack(result)


def _checked_factors(factors: Sequence[int], samples: int) -> tuple[int, ...]:
    """The factors as whole numbers. Raises `InputError` as `allan_variance` does."""
    allowed = f"they must be whole numbers from 1 to {samples // 2}, half of the {samples} rates"
    try:
        wholes = tuple(operator.index(m) for m in factors)
    except TypeError:
        raise InputError(f"factors are {factors!r}: {allowed}.") from None
    if not wholes:
        raise InputError(f"factors are empty: {allowed}.")
    for m in wholes:
        if not 1 <= m <= samples // 2:
            raise InputError(f"factors hold {m}: {allowed}.")
    return wholes


@formula(time=POSITIVE, angle_walk=NOT_NEGATIVE, rate_walk=NOT_NEGATIVE)
def allan_of_walks(time: Scalar, angle_walk: Scalar, rate_walk: Scalar = 0.0) -> Scalar:
    """The Allan variance, (rad/s)^2, that `gyro_noise` has at averages over many samples.

    **Arguments**

    - `time`: time over which is averaged, s.
    - `angle_walk`, `rate_walk`: as in `gyro_noise`."""
    return angle_walk**2 / time + rate_walk**2 * time / 3.0
