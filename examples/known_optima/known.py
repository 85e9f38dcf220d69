"""Searches one of the problems beside this file, and prints its optimum beside the known one."""

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
    seconds, compilation included.

    Raises `SystemExit` where the search did not converge or the difference exceeds `within`."""
    jaxspace.enable_x64()
    began = time.perf_counter()
    found = search()
    ours = optimum(found)
    seconds = time.perf_counter() - began
    error = ours / known - 1.0
    print(
        f"{name}: {ours:.10g} found, {known:.10g} known, "
        f"relative error {error:.1e}, {seconds:.1f} s"
    )
    print(found.sentence())
    if not found.converged or abs(error) > within:
        raise SystemExit(1)
