"""General mechanics: systems from a Lagrangian, constraints, impulse and impact, beams."""

from typing import TYPE_CHECKING

from ..core.modules import modules_of as _modules_of
from ._bars import BarOnSpring as BarOnSpring
from ._bars import BarOnString as BarOnString
from ._carried_pendulums import CentrifugalPendulum as CentrifugalPendulum
from ._carried_pendulums import FramedPendulum as FramedPendulum
from ._carried_pendulums import RotatingHoop as RotatingHoop
from ._carried_pendulums import SliderCarrier as SliderCarrier
from ._description import GeneralisedState as GeneralisedState
from ._flexible_missile import FlexibleMissile as FlexibleMissile
from ._flexible_missile import MissileState as MissileState
from ._lagrangian import AbstractLagrangian as AbstractLagrangian
from ._lagrangian import Lagrangian as Lagrangian
from ._landing_legs import LandingLegs as LandingLegs
from ._pendulums import DoublePendulum as DoublePendulum
from ._pendulums import ElasticPendulum as ElasticPendulum
from ._pendulums import SimplePendulum as SimplePendulum
from .arm import ArmPendulum as ArmPendulum
from .arm import ArmState as ArmState
from .reduction import CanonicalState as CanonicalState
from .reduction import Hamiltonian as Hamiltonian
from .rolling import InclineDisk as InclineDisk
from .rolling import Trailer as Trailer
from .rolling import TrailerState as TrailerState

if TYPE_CHECKING:
    # For type checkers, which do not see how a module is imported when it is first used.
    from . import arm as arm
    from . import beams as beams
    from . import constraints as constraints
    from . import discrete as discrete
    from . import impact as impact
    from . import impulse as impulse
    from . import missile_loop as missile_loop
    from . import moving_point as moving_point
    from . import reduction as reduction
    from . import rolling as rolling
    from . import variational as variational
    from . import work as work
else:
    __getattr__, __dir__ = _modules_of(__name__)
