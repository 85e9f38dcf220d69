"""Orientation: quaternion, Euler angles, matrix, rotation vector, their rates, interpolation and
mean; motion seen from moving frames. No mass, no force."""

from typing import TYPE_CHECKING

from ..core.modules import modules_of as _modules_of
from ._quaternion import Quaternion as Quaternion
from .euler_angles import from_euler_angles as from_euler_angles
from .euler_angles import to_euler_angles as to_euler_angles
from .moving_frame import MovingFrame as MovingFrame

if TYPE_CHECKING:
    # For type checkers, which do not see how a module is imported when it is first used.
    from . import direction_cosines as direction_cosines
    from . import euler_angles as euler_angles
    from . import interpolation as interpolation
    from . import mean as mean
    from . import moving_frame as moving_frame
    from . import plane_motion as plane_motion
    from . import rotation_vector as rotation_vector
    from . import tilt as tilt
else:
    __getattr__, __dir__ = _modules_of(__name__)
