"""One integration: method, tolerances and save times resolved once, the loop, events, derivatives.
No physics."""

from ._accuracy import Accuracy as Accuracy
from ._accuracy import least_tolerance as least_tolerance
from ._crossings import Crossings as Crossings
from ._events import Event as Event
from ._selection import eligible_methods as eligible_methods
from ._selection import select_method as select_method
from ._status import SimulationError as SimulationError
from ._status import Status as Status
