"""Instruments: the free rotor in two gimbals."""

from ._gimbal_walk import GimbalWalk as GimbalWalk
from ._two_gimbal import GimbalState as GimbalState
from ._two_gimbal import TwoGimbalGyro as TwoGimbalGyro
