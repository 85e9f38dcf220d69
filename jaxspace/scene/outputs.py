"""Numbers of interest that every run has."""

__all__ = ["end_time", "proper_acceleration"]

from ..bodies import BodyState
from ..core import Scalar, output
from ..core.vectors import norm
from ._interface import AbstractScene


@output("s")
def end_time(t: Scalar) -> Scalar:
    """The time, s, at which the run, or the phase that is named, ends: that of its event."""
    return t


@output("m/s^2")
def proper_acceleration(t: Scalar, y: BodyState, scene: AbstractScene) -> Scalar:
    """Acceleration that the body feels at its centre of mass, m/s^2: that of thrust and air,
    without gravity.

    **Arguments**

    - `t`: time, s; `y`: the state.
    - `scene`: whose effects act."""
    return norm(scene.proper_acceleration(t, y))
