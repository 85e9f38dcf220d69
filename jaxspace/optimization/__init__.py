"""Optimal rockets and transfers: staging, steering, direct shooting, rendezvous. The searches of
`minimisation`, which they use, are given on."""

from typing import TYPE_CHECKING

from ..core.modules import modules_of as _modules_of
from ..minimisation import Criterion as Criterion
from ..minimisation import Minimum as Minimum
from ..minimisation import Progress as Progress
from ..minimisation import StopReason as StopReason
from ..minimisation import minimise as minimise
from ..minimisation import minimise_from as minimise_from
from ._insertion import Insertion as Insertion
from ._insertion import InsertionOptimum as InsertionOptimum
from ._insertion import InsertionState as InsertionState
from ._insertion import optimise_insertion as optimise_insertion
from ._propellant_use import PropellantUse as PropellantUse
from ._propellant_use import propellant_use as propellant_use
from ._rendezvous import Rendezvous as Rendezvous
from ._rendezvous import least_rendezvous as least_rendezvous
from ._shooting import SteeredFlight as SteeredFlight
from ._shooting import SteeringOptimum as SteeringOptimum
from ._shooting import optimise_steering as optimise_steering
from .laws import SteeringProfile as SteeringProfile
from .staging import Staging as Staging
from .staging import optimal_staging as optimal_staging

if TYPE_CHECKING:
    # For type checkers, which do not see how a module is imported when it is first used.
    from . import ascent as ascent
    from . import fixed_masses as fixed_masses
    from . import flown_staging as flown_staging
    from . import laws as laws
    from . import optimisers as optimisers
    from . import staged_flight as staged_flight
    from . import staging as staging
    from . import steering as steering
else:
    __getattr__, __dir__ = _modules_of(__name__)
