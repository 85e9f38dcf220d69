"""One integration: method, tolerances and save times resolved once, the loop, events, derivatives.
No physics."""

from ._selection import eligible_methods as eligible_methods
from ._selection import select_method as select_method
from .accuracy import Accuracy as Accuracy
from .accuracy import least_tolerance as least_tolerance
from .crossings import Crossings as Crossings
from .events import Event as Event
from .status import SimulationError as SimulationError
from .status import Status as Status
