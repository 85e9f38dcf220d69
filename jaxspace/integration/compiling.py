"""Options of the compiler, as arguments of `equinox.filter_jit`."""

from typing import Any

# For programs that run a few times and take far longer to compile: it halves that time.
QUICK: dict[str, Any] = {"compiler_options": {"xla_backend_optimization_level": 0}}
