"""Statistics of many runs, on plain arrays: limits, joint spread, contributors, requirements."""

from typing import TYPE_CHECKING

from ..core.modules import modules_of as _modules_of
from ._dispersion import Dispersion as Dispersion
from ._failures import Failure as Failure
from ._footprint import Footprint as Footprint
from .spread import StopRule as StopRule

if TYPE_CHECKING:
    # For type checkers, which do not see how a module is imported when it is first used.
    from . import comparison as comparison
    from . import contributors as contributors
    from . import correlation as correlation
    from . import curves as curves
    from . import extremes as extremes
    from . import limits as limits
    from . import purpose as purpose
    from . import requirements as requirements
    from . import spread as spread
    from . import sweeps as sweeps
    from . import table as table
    from . import weighted as weighted
else:
    __getattr__, __dir__ = _modules_of(__name__)
