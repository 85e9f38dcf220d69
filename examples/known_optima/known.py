"""Solves one of the problems in this folder, and compares its optimum with the known one."""

import time
from collections.abc import Callable

import jaxspace
from jaxspace.optimization import Minimum


def report(
    name: str,
    known: float,
    search: Callable[[], Minimum],
    optimum: Callable[[Minimum], float],
    within: float = 1e-5,
) -> None:
    """Print the `optimum` of a `search`, the `known` one, their relative difference and the
    seconds by the clock and of the processor, compilation included.

    Raises `SystemExit` where the search did not converge or the difference exceeds `within`."""
    jaxspace.enable_x64()
    began, used = time.perf_counter(), time.process_time()
    found = search()
    ours = optimum(found)
    seconds, busy = time.perf_counter() - began, time.process_time() - used
    error = ours / known - 1.0
    print(
        f"{name}: {ours:.10g} found, {known:.10g} known, "
        f"relative error {error:.1e}, {seconds:.1f} s, {busy:.1f} s of the processor"
    )
    print(found.sentence())
    if not found.converged or abs(error) > within:
        raise SystemExit(1)
