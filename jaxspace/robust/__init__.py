"""Design optimisation under dispersion: `minimise` over the runs of a campaign."""

from typing import TYPE_CHECKING

from ..core.modules import modules_of as _modules_of
from ._assess import assess_designs as assess_designs
from ._optimum import DesignOptimum as DesignOptimum
from ._search import optimise_design as optimise_design
from ._train import train_design as train_design
from .assessment import DesignAssessment as DesignAssessment

if TYPE_CHECKING:
    # For type checkers, which do not see how a module is imported when it is first used.
    from . import assessment as assessment
    from . import free as free
    from . import statistics as statistics
else:
    __getattr__, __dir__ = _modules_of(__name__)
