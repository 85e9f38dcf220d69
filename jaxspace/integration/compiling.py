"""Options of the compiler, as arguments of `equinox.filter_jit`."""

from typing import Any

# For what runs a few times, and takes far longer to compile: half of it is saved so.
QUICK: dict[str, Any] = {"compiler_options": {"xla_backend_optimization_level": 0}}
