"""Numbers of interest that every run has."""

__all__ = ["end_time"]

from ..core import Scalar, output


@output("s")
def end_time(t: Scalar) -> Scalar:
    """The time, s, at which the run, or the phase that is named, ends: that of its event."""
    return t
