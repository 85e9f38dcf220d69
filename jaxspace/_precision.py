"""The one switch of precision, thrown by its caller and never by an import."""

import jax


def enable_x64() -> None:
    """Let JAX compute in float64 from now on, in this process. Call it before the first array is
    made."""
    jax.config.update("jax_enable_x64", True)
