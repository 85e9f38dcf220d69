"""Mean and covariance of the outputs without many runs: from derivatives, or from sigma points.

    lincov         y = f(m),                    C_kl = J_k P J_l^T
    second order   y_k = f_k(m) + tr(H_k P)/2,  C_kl = J_k P J_l^T + tr(H_k P H_l P)/2
    unscented      y = sum_i w_i f(T(z_i)),     C = sum_i w_i (f_i - y)(f_i - y)^T
                   z_0 = 0, z_i = +- sqrt(n + k) e_i;  w_0 = k/(n + k), w_i = 1/(2 (n + k))

    symbol  meaning                                              unit
    f       outputs as a function of the inputs                  of the outputs
    m, P    mean and covariance of the inputs                    of the inputs
    J, H    first and second derivatives of f at m               outputs per input(s)
    T       from standard normal numbers to the inputs           of the inputs
    n       number of independent normal numbers                 1
    k       3 - n for n < 3, and 0 above: no weight is negative  1

Source: Maybeck, Stochastic Models, Estimation, and Control, 12.3 (second order, for normal inputs);
Julier and Uhlmann, Proc. IEEE 92 (2004), 401.
None of them is valid at a kink: a magnitude whose nominal value is zero has a mean above zero. The
second-order method, whose curvature is undefined there, gives NaN for such an output. A series that
is valid only close to the mean, as for the angle of a fast spin, gives plausible but wrong numbers.
So every result is compared with a sample of runs, and has a warning where they disagree.
"""

__all__ = ["METHODS", "MONTE_CARLO", "Moments", "sampled"]

import math
import time
import warnings
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from ..core import InputError, Scalar
from ..core.printing import printed
from ..core.status import SimulationError, Status
from ..integration.accuracy import Accuracy
from ..sampling.designs import map_normals, normal_columns
from ..sampling.distributions import AbstractDistribution
from ..sampling.joint import Component
from ..statistics.sample_check import warning_of
from ._campaign import Campaign, check_no_sweep, in_order
from ._interface import jit_of_campaign
from ._whole import check_whole
from .evaluate import BLOCK, Evaluator, evaluate_traced

# How far from the mean the slopes are compared with the curvature, in deviations; and by which part
# of them they may differ before the output counts as not smooth.
NEARBY, MISSING_SHARE = 0.01, 1e-3

MONTE_CARLO, AUTO = "monte_carlo", "auto"
METHODS = ("lincov", "second_order", "unscented")

# From fewer runs the deviation is too uncertain for a comparison.
FEWEST = 32


@printed(seconds="s")
class Moments(NamedTuple):
    """Mean and covariance of the outputs of a campaign, without its runs.

    - `names`: of the outputs, in the order of the campaign; `mean`, (d,), and `covariance`, (d, d),
      in this order.
    - `jacobian`: derivatives of the outputs with respect to the inputs, (d, inputs); `None` if
      unscented.
    - `inputs`: their names, in the order of the columns.
    - `method`, `runs`, `seconds`: method, number of runs and computing time, without compilation
      and the sample.
    - `warnings`: by output, a message if a sample of runs contradicts its numbers; empty
      otherwise.
    - `reason`: why the method was chosen automatically; empty for a given one."""

    names: tuple[str, ...]
    mean: np.ndarray
    covariance: np.ndarray
    jacobian: np.ndarray | None
    inputs: tuple[str, ...]
    method: str
    runs: int
    seconds: float
    warnings: Mapping[str, str] = MappingProxyType({})
    reason: str = ""

    def std(self, name: str) -> float:
        """The standard deviation of an output."""
        k = self.names.index(name)
        return float(np.sqrt(self.covariance[k, k]))


class _Series(NamedTuple):
    """Value, first and second derivatives of each output, by name, and the status of the run; and
    the first derivatives on both sides of the mean, (2, inputs)."""

    values: dict[str, Array]
    first: dict[str, Array]
    second: dict[str, Array]
    beside: dict[str, Array]
    status: Array


def moments(
    campaign: Campaign,
    method: str = "lincov",
    *,
    accuracy: Accuracy | Scalar | None = None,
    check: int = BLOCK,
) -> Moments:
    """Mean and covariance of the outputs of a campaign.

    **Arguments**

    - `campaign`: as for `disperse`.
    - `method`: "lincov" (first derivatives, one run), "second_order" (with second derivatives), or
      "unscented" (2 n + 1 runs).
    - `accuracy`: as in `disperse`.
    - `check`: number of runs of the campaign for comparison, at least 32; 0 for none.
      Up to 256 cost the same.

    **Returns** a `Moments`. Where the mean or the standard deviation of an output differs from that
    of the sample by more than four of its standard errors and a tenth of the standard deviation,
    `Moments.warnings` reports it, and a warning names the output. With "second_order" an output
    that is not smooth at the mean, like the norm of a vector that is zero there, is NaN, and a
    warning names it.

    **Raises** `InputError` for an unknown method, and for a sample that is too small;
    `SimulationError` if the nominal run, or a sigma point, fails."""
    if method not in METHODS:
        raise InputError(f"method is {method!r}: it must be one of {', '.join(METHODS)}.")
    check_whole("check", check)
    check_no_sweep(campaign, f"the method {method!r}")
    if 0 < check < FEWEST:
        raise InputError(f"check is {check}: it must be 0, or at least {FEWEST}.")
    accuracy = campaign.accuracy_for(accuracy)
    result = (
        _unscented(campaign, accuracy)
        if method == "unscented"
        else _expanded(campaign, accuracy, method)
    )
    # A sigma point may be infinite although its run ends well.
    lost = [name for name in result.names if not math.isfinite(result.std(name))]
    if lost and method == "unscented":
        warnings.warn(
            f"unscented omits {', '.join(lost)}: not finite at a sigma point; use Monte Carlo.",
            stacklevel=2,
        )
    if check == 0:
        return result
    result = result._replace(warnings=_warnings(campaign, accuracy, result, check))
    # The user has been warned of outputs that are not finite already.
    unsure = [name for name in result.warnings if math.isfinite(result.std(name))]
    if unsure:
        warnings.warn(
            f"{method} is not reliable for {', '.join(unsure)}: {check} runs contradict it, see "
            "Moments.warnings. Use monte_carlo.",
            stacklevel=2,
        )
    return result


def _warnings(campaign: Campaign, accuracy: Accuracy, found: Moments, runs: int) -> dict[str, str]:
    """Warnings, for each output, where a sample contradicts its mean or its standard deviation."""
    n = sum(map(len, normal_columns(campaign.inputs).values()))
    # At random, without the design: the standard errors are valid for independent runs only.
    z = np.random.default_rng(0).standard_normal((runs, n))
    outputs = Evaluator(campaign, accuracy)(map_normals(campaign.inputs, z)).outputs
    sentences = (
        (name, warning_of(float(mean), found.std(name), outputs[name].astype(float)))
        for name, mean in zip(found.names, found.mean, strict=True)
    )
    return {name: sentence for name, sentence in sentences if sentence}


def _expanded(campaign: Campaign, accuracy: Accuracy, method: str) -> Moments:
    """Compute the moments from the Taylor series about the mean."""
    inputs = tuple(campaign.inputs)
    centre, covariance = input_moments(campaign.inputs)
    # In deviations: the columns of the derivatives are then of one size.
    scale = np.sqrt(np.diag(covariance))
    scale = np.where(scale > 0.0, scale, 1.0)
    second = method == "second_order"

    def differentiate() -> _Series:
        point = jnp.asarray(centre), jnp.asarray(scale)
        return _derivatives(campaign, accuracy, *point, inputs, second)

    values, first, hessian, beside, status = differentiate()
    _check_good(int(status), "nominal run")
    # Run again for the time: that of the first call includes compiling.
    started = time.perf_counter()
    jax.block_until_ready(differentiate())
    seconds = time.perf_counter() - started
    names = tuple(in_order(campaign, values))
    # By a root of the covariance: a sum of squares is not negative.
    sizes, axes = np.linalg.eigh(covariance / np.outer(scale, scale))
    root = axes * np.sqrt(np.maximum(sizes, 0.0))
    j = np.stack([np.asarray(first[name]) for name in names])
    mean = np.array([float(values[name]) for name in names])
    along = j @ root
    c = along @ along.T
    if second:
        h = root.T @ np.stack([np.asarray(hessian[name]) for name in names]) @ root
        mean = mean + 0.5 * np.trace(h, axis1=1, axis2=2)
        c = c + 0.5 * np.einsum("kij,lji->kl", h, h)
        kinks = [k for k, name in enumerate(names) if _has_kink(hessian[name], beside[name])]
        mean[kinks] = c[kinks, :] = c[:, kinks] = math.nan
        if kinks:
            warnings.warn(
                f"second_order omits {', '.join(names[k] for k in kinks)}: not smooth at the "
                "nominal run, like the norm of a vector that is zero there; use Monte Carlo.",
                stacklevel=4,
            )
    return Moments(names, mean, c, j / scale, inputs, method, 1, seconds)


@jit_of_campaign
def _derivatives(
    campaign: Campaign,
    accuracy: Accuracy,
    centre: Float[Array, " inputs"],
    scale: Float[Array, " inputs"],
    names: tuple[str, ...],
    second: bool,
) -> _Series:
    """Value, first and second derivatives of every output at `centre`, in units of `scale`.

    `names`: of the inputs in order, which a dict loses in `jit`."""

    def outputs(u: Array) -> tuple[dict[str, Array], tuple[dict[str, Array], Array]]:
        x = centre + scale * u
        samples = {name: x[k : k + 1] for k, name in enumerate(names)}
        found, status = evaluate_traced(campaign, accuracy, samples)
        found = {name: y[0] for name, y in found.items()}
        return found, (found, status[0])

    # Forward mode computes the derivatives in all inputs along with one run.
    slopes = jax.jacfwd(outputs, has_aux=True)
    zero = jnp.zeros_like(centre)
    if not second:
        first, (values, status) = slopes(zero)
        return _Series(values, first, {}, {}, status)

    # One program for each column of the second derivatives and for the slopes next to the point: a
    # second direction in the same program would take several times as long to compile.
    def columns_at(
        row: tuple[Array, Array],
    ) -> tuple[dict[str, Array], dict[str, Array], PyTree]:
        point, direction = row
        return jax.jvp(slopes, (point,), (direction,), has_aux=True)

    n = centre.size
    aside = NEARBY * jnp.ones_like(centre)
    points = jnp.concatenate([jnp.zeros((n, n)), aside[None], -aside[None]])
    directions = jnp.concatenate([jnp.eye(n), jnp.zeros((2, n))])
    first, columns, aux = jax.lax.map(columns_at, (points, directions))
    values, status = jax.tree.map(lambda x: x[0], aux)
    return _Series(
        values,
        {name: y[0] for name, y in first.items()},
        {name: y[:n] for name, y in columns.items()},
        {name: y[n:] for name, y in first.items()},
        status,
    )


def _has_kink(hessian: Array, beside: Array) -> bool:
    """Whether the slopes on both sides of a point differ by more than the second derivatives imply:
    those of |x| at zero are arbitrary."""
    h, (above, below) = np.asarray(hessian), np.asarray(beside)
    if not (np.isfinite(h).all() and np.isfinite(beside).all()):
        return True
    expected = 2.0 * NEARBY * h.sum(axis=1)
    result = above - below
    missing = np.abs(result - expected).max()
    # A fourth derivative causes a small deviation, and rounding another one relative to the slopes.
    steepest = max(np.abs(above).max(), np.abs(below).max())
    return bool(missing > 0.5 * np.abs(result).max() and missing > MISSING_SHARE * steepest)


def _unscented(campaign: Campaign, accuracy: Accuracy) -> Moments:
    """Compute the moments from sigma points of the normal numbers behind the inputs."""
    n = sum(map(len, normal_columns(campaign.inputs).values()))
    # n + k = 3 matches the fourth moment of a normal distribution; no weight may be negative.
    k = max(3 - n, 0)
    size = math.sqrt(n + k)
    z = np.concatenate([np.zeros((1, n)), size * np.eye(n), -size * np.eye(n)])
    weights = np.full(2 * n + 1, 0.5 / (n + k))
    weights[0] = k / (n + k)
    points = map_normals(campaign.inputs, z)
    run = Evaluator(campaign, accuracy)
    result = run(points)
    # Once more, for the time without compiling.
    started = time.perf_counter()
    result = run(points)
    seconds = time.perf_counter() - started
    # A point without weight may fail: for n = 3 or more it is the nominal run.
    for status in result.status[weights > 0.0]:
        _check_good(int(status), "sigma point")
    names = tuple(in_order(campaign, result.outputs))
    y = np.stack([result.outputs[name].astype(float) for name in names])[:, weights > 0.0]
    weights = weights[weights > 0.0]
    # An infinite output has no mean and no covariance with any other.
    y = np.where(np.isfinite(y).all(axis=1, keepdims=True), y, math.nan)
    mean = y @ weights
    away = y - mean[:, None]
    inputs = tuple(campaign.inputs)
    return Moments(
        names, mean, (away * weights) @ away.T, None, inputs, "unscented", len(z), seconds
    )


def _check_good(code: int, what: str) -> None:
    if code > Status.EVENT:
        raise SimulationError(f"The {what} fails. {Status(code).sentence}")


def input_moments(
    inputs: dict[str, AbstractDistribution],
) -> tuple[np.ndarray, np.ndarray]:
    """Mean, (n,), and covariance, (n, n), of the inputs."""
    names = list(inputs)
    centre = np.array([float(inputs[name].expectation) for name in names])
    covariance = np.zeros((len(names), len(names)))
    for a, name in enumerate(names):
        d = inputs[name]
        if not isinstance(d, Component):
            covariance[a, a] = float(d.variance)
            continue
        for b, other in enumerate(names):
            e = inputs[other]
            if isinstance(e, Component) and e.source == d.source:
                covariance[a, b] = float(d.joint.covariance[d.index, e.index])
    return centre, covariance


def sampled(
    campaign: Campaign,
    runs: int = 256,
    *,
    seed: int = 0,
    accuracy: Accuracy | Scalar | None = None,
) -> dict[str, Float[Array, " runs"]]:
    """The outputs of the first runs of a campaign, each (runs,), as a differentiable function.

    Any statistic therefore has a gradient with respect to the parameters of a design:
    `jax.grad(lambda p: jnp.std(sampled(campaign_of(p))["apogee"]))(p)`; the draws do not change
    with the parameters. The gradient of a percentile is that of the run at the percentile.

    **Arguments**

    - `campaign`: may contain traced numbers.
    - `runs`, `seed`, `accuracy`: as in `disperse`."""
    check_whole("runs", runs, 1)
    check_whole("seed", seed)
    samples = campaign.samples(jax.random.key(seed), jnp.arange(runs, dtype=jnp.uint32))
    return evaluate_traced(campaign, campaign.accuracy_for(accuracy), samples)[0]
