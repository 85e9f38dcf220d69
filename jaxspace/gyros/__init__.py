"""Instruments: free gyro, gyrocompass, gyropendulum, rate gyro, platform, navigator and its
errors."""

from ._bearing import BearingFriction as BearingFriction
from ._bearing import RotorMotor as RotorMotor
from ._duffing import DuffingOscillator as DuffingOscillator
from ._duffing import DuffingState as DuffingState
from ._gimbal_state import GimbalState as GimbalState
from ._gimbal_state import near_gimbal_lock as near_gimbal_lock
from ._gimbal_walk import GimbalWalk as GimbalWalk
from ._gyrocompass import Gyrocompass as Gyrocompass
from ._gyrocompass import GyrocompassState as GyrocompassState
from ._gyropendulum import Gyropendulum as Gyropendulum
from ._gyropendulum import GyropendulumState as GyropendulumState
from ._gyropendulum import schuler_frequency as schuler_frequency
from ._gyropendulum import schuler_period as schuler_period
from ._navigation_errors import NavigationErrors as NavigationErrors
from ._navigation_errors import NavigationErrorState as NavigationErrorState
from ._navigation_errors import coupled_rates as coupled_rates
from ._navigation_errors import table_rates as table_rates
from ._navigator import InertialNavigator as InertialNavigator
from ._navigator import NavigatorState as NavigatorState
from ._noise import allan_of_walks as allan_of_walks
from ._noise import allan_variance as allan_variance
from ._noise import gyro_noise as gyro_noise
from ._platform import PlatformAxis as PlatformAxis
from ._platform import PlatformState as PlatformState
from ._platform import gimbal_lock_margin as gimbal_lock_margin
from ._platform import resolve_signals as resolve_signals
from ._rate_gyro import RateGyro as RateGyro
from ._rate_gyro import RateGyroState as RateGyroState
from ._stable_platform import StablePlatform as StablePlatform
from ._stable_platform import StablePlatformState as StablePlatformState
from ._stable_platform import gimbal_axes as gimbal_axes
from ._two_gimbal import TwoGimbalGyro as TwoGimbalGyro
from ._vehicle import Place as Place
