"""Instruments: free gyro, gyrocompass, gyropendulum, rate gyro, platform, navigator and its
errors."""

from typing import TYPE_CHECKING

from ..core.modules import modules_of as _modules_of
from ._gyrocompass import Gyrocompass as Gyrocompass
from ._gyrocompass import GyrocompassState as GyrocompassState
from ._navigator import InertialNavigator as InertialNavigator
from ._navigator import NavigatorState as NavigatorState
from ._rate_gyro import RateGyro as RateGyro
from ._rate_gyro import RateGyroState as RateGyroState
from ._two_gimbal import TwoGimbalGyro as TwoGimbalGyro
from ._vehicle import Place as Place
from .gimbal_state import GimbalState as GimbalState
from .gyropendulum import Gyropendulum as Gyropendulum
from .gyropendulum import GyropendulumState as GyropendulumState
from .platform import PlatformAxis as PlatformAxis
from .platform import PlatformState as PlatformState
from .stable_platform import StablePlatform as StablePlatform
from .stable_platform import StablePlatformState as StablePlatformState

if TYPE_CHECKING:
    # For type checkers, which do not see how a module is imported when it is first used.
    from . import bearing as bearing
    from . import duffing as duffing
    from . import gimbal_state as gimbal_state
    from . import gimbal_walk as gimbal_walk
    from . import gyropendulum as gyropendulum
    from . import navigation_errors as navigation_errors
    from . import noise as noise
    from . import platform as platform
    from . import stable_platform as stable_platform
else:
    __getattr__, __dir__ = _modules_of(__name__)
