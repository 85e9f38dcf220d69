"""Calls as users make them: tests alone check shapes and types, at every call."""

import contextlib
from collections.abc import Iterator

from jaxtyping import config


@contextlib.contextmanager
def unchecked() -> Iterator[None]:
    """No annotation is enforced within it."""
    config.update("jaxtyping_disable", True)
    try:
        yield
    finally:
        config.update("jaxtyping_disable", False)
