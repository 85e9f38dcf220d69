"""Options of the compiler, as arguments of `core.jit.quick_jit`."""

from collections.abc import Callable
from typing import ParamSpec, TypeVar

from ..core.jit import Options, quick_jit

P = ParamSpec("P")
T = TypeVar("T")

# For programs that run a few times and take far longer to compile: it halves that time.
QUICK: Options = {"compiler_options": {"xla_backend_optimization_level": 0}}


def jit_quickly(function: Callable[P, T]) -> Callable[P, T]:
    """The function under `quick_jit` with the options `QUICK`."""
    return quick_jit(function, **QUICK)
