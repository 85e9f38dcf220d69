"""Runs the cases: one compiled program for all cases of a function."""

import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..core import InputError
from ._case import Case, CaseFunction
from ._cases import CASES
from .report import CaseResult, Verification

PRECISIONS = ("float64", "float32")
# Programs compile in parallel; more threads than cores only wait for each other.
THREADS = 2


def run_cases(
    cases: Sequence[Case] = CASES, *, precision: str = "float64", device: str | None = None
) -> Verification:
    """Evaluate edge cases in value, forward and reverse derivatives.

    **Arguments**

    - `cases`: by default all.
    - `precision`: "float64" or "float32". In float32 the inputs are rounded, and the truth is that
      of the rounded inputs to first order.
    - `device`: "cpu", "gpu" or another platform of JAX; by default its default one.

    **Returns** a `Verification`; `passed` reports whether every case is within its tolerance.

    **Raises** `InputError` for a precision that is not enabled and for a device that is not there.
    """
    started = time.perf_counter()
    # Before anything is compiled, which takes minutes.
    where = _device(device)
    _check_precision(precision)
    # By their functions, because each is one program, whose compilation takes most of the time.
    groups: dict[CaseFunction, list[Case]] = {}
    for case in cases:
        if precision == "float64" or not case.single:
            groups.setdefault(case.function, []).append(case)
    with ThreadPoolExecutor(THREADS) as pool:
        jobs = [pool.submit(_run_group, f, g, precision, where) for f, g in groups.items()]
        results = {result.name: result for job in jobs for result in job.result()}
    rows = tuple(results.get(case.name) or CaseResult.left_out(case) for case in cases)
    return Verification(rows, precision, where.device_kind, time.perf_counter() - started)


def _device(name: str | None) -> jax.Device:
    try:
        return jax.devices(name)[0]
    except RuntimeError as error:
        raise InputError(f'device is "{name}": JAX finds no such device here.') from error


def _check_precision(precision: str) -> None:
    if precision not in PRECISIONS:
        raise InputError(f'precision is "{precision}": it must be one of {", ".join(PRECISIONS)}.')
    if precision == "float64" and not jax.config.read("jax_enable_x64"):
        raise InputError('precision is "float64": call jaxspace.enable_x64() first.')


def _run_group(
    function: CaseFunction, cases: list[Case], precision: str, device: jax.Device
) -> list[CaseResult]:
    """The results of the cases of one function."""
    results = []
    with_slopes = [case for case in cases if case.truth()[1]]
    if with_slopes:
        inputs = np.asarray([case.inputs for case in with_slopes], precision)
        program = _program(function).lower(jax.device_put(inputs, device)).compile()
        # In one piece: a case of a loop that does not end would otherwise look like any other.
        result = jax.tree.map(np.asarray, program(jax.device_put(inputs, device)))
        for number, case in enumerate(with_slopes):
            value, forward, reverse = (x[number] for x in result)
            results.append(_judge(case, value, forward, reverse, precision))
    for case in cases:
        if case not in with_slopes:
            # Not compiled, because what has no derivative may read its numbers, as a distribution
            # does.
            with jax.default_device(device):
                value = np.asarray(function(jnp.asarray(case.inputs, precision)), float)
            results.append(_judge(case, value, None, None, precision))
    return results


def _program(function: CaseFunction) -> "jax.stages.Wrapped":
    """Value, forward and reverse derivatives of each row of inputs."""

    def one(x: Array) -> tuple[Array, Array, Array]:
        value, pull = jax.vjp(function, x)
        (reverse,) = jax.vmap(pull)(jnp.eye(value.size, dtype=x.dtype))
        # Value and reverse mode share one trace, because compiling takes most of the time.
        return value, jax.jacfwd(function)(x), reverse

    # Row by row: under `vmap` a branch becomes a selection, and a case would not run as it does
    # alone.
    return jax.jit(lambda xs: jax.lax.map(one, xs))


def _judge(
    case: Case,
    value: np.ndarray,
    forward: np.ndarray | None,
    reverse: np.ndarray | None,
    precision: str,
) -> CaseResult:
    """The errors of a case compared with its tolerances."""
    true_value, true_slopes = (np.asarray(x, float) for x in case.truth())
    eps = float(np.finfo(precision).eps)
    shift = np.asarray(case.inputs, precision).astype(float) - np.asarray(case.inputs)
    if true_slopes.size:
        # The truth of the inputs as the precision rounds them.
        true_value = true_value + np.where(np.isfinite(true_slopes), true_slopes, 0.0) @ shift
    error = difference(value, true_value, case.conditioning())
    slopes = [
        _slope_error(result, true_slopes, np.asarray(case.inputs))
        for result in (forward, reverse)
        if result is not None
    ]
    # One mode alone may be wrong: a rule for tangents is not that of their transposition.
    good = error <= case.roundings * eps
    good = good and all(s <= case.slope_roundings * eps for s in slopes)
    forward_error, reverse_error = slopes or (None, None)
    return CaseResult(
        case.name,
        error,
        forward_error,
        reverse_error,
        case.roundings * eps,
        case.slope_roundings * eps,
        "holds" if good else "fails",
        case.why,
    )


def _slope_error(computed: np.ndarray, truth: np.ndarray, inputs: np.ndarray) -> float:
    """The largest error of derivatives, (outputs, inputs), relative to the largest of its output.

    Those by inputs far from one, which have large units, count as derivatives by their logarithm.
    """
    # Not below one: for an input of zero a derivative with respect to its logarithm is meaningless.
    weights = np.maximum(np.abs(inputs), 1.0)
    overall = _size(truth * weights)
    return max(
        difference(a * weights, b * weights, _size(b * weights, overall))
        for a, b in zip(computed, truth, strict=True)
    )


def _size(numbers: np.ndarray, otherwise: float = 1.0) -> float:
    """The largest finite number that is not zero."""
    finite = np.abs(numbers[np.isfinite(numbers) & (numbers != 0.0)])
    return float(np.max(finite, initial=0.0)) or otherwise


def difference(computed: np.ndarray, truth: np.ndarray, size: float) -> float:
    """The largest |found - truth| over `size`; infinite where one is infinite or not a number and
    the other is not the same."""
    computed, truth = np.asarray(computed, float), np.asarray(truth, float)
    finite = np.isfinite(truth)
    # An infinite truth is met by the same infinity alone.
    same = np.array_equal(computed[~finite], truth[~finite], equal_nan=True)
    if not same or not np.all(np.isfinite(computed[finite])):
        return float("inf")
    return float(np.max(np.abs(computed[finite] - truth[finite]), initial=0.0)) / size
