"""Bodies with mass: inertia, mass properties, state, equations of motion, the interface of effects,
and atmospheres."""

from typing import TYPE_CHECKING

from ..core.modules import modules_of as _modules_of
from ._body import AbstractBody as AbstractBody
from ._body import BurningBody as BurningBody
from ._body import RigidBody as RigidBody
from ._condition import AbstractCondition as AbstractCondition
from ._free_motion import FreeRotation as FreeRotation
from ._jump import AbstractJump as AbstractJump
from ._pad_atmosphere import PadAtmosphere as PadAtmosphere
from .atmosphere import AbstractAtmosphere as AbstractAtmosphere
from .atmosphere import Air as Air
from .atmosphere import ExponentialAtmosphere as ExponentialAtmosphere
from .effects import AbstractEffect as AbstractEffect
from .effects import Load as Load
from .inertia import InertiaTensor as InertiaTensor
from .inertia import PrincipalInertia as PrincipalInertia
from .mass_properties import MassProperties as MassProperties
from .parting import Detached as Detached
from .standard_atmosphere import StandardAtmosphere as StandardAtmosphere
from .state import BodyState as BodyState

if TYPE_CHECKING:
    # For type checkers, which do not see how a module is imported when it is first used.
    from . import atmosphere as atmosphere
    from . import effects as effects
    from . import inertia as inertia
    from . import mass_properties as mass_properties
    from . import newton_euler as newton_euler
    from . import parting as parting
    from . import principal_axes as principal_axes
    from . import principal_frame as principal_frame
    from . import random_signals as random_signals
    from . import solids as solids
    from . import standard_atmosphere as standard_atmosphere
    from . import state as state
else:
    __getattr__, __dir__ = _modules_of(__name__)
