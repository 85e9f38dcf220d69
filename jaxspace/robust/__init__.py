"""The best design where everything scatters: `minimise` over the runs of a campaign."""

from typing import TYPE_CHECKING

from ..core.modules import modules_of as _modules_of
from ._judge import judge_designs as judge_designs
from ._optimum import DesignOptimum as DesignOptimum
from ._search import optimise_design as optimise_design
from ._search import optimise_nominal as optimise_nominal
from ._train import train_design as train_design
from .judged import JudgedDesigns as JudgedDesigns

if TYPE_CHECKING:
    # For type checkers, which do not see how a module is imported when it is first used.
    from . import free as free
    from . import judged as judged
    from . import statistics as statistics
else:
    __getattr__, __dir__ = _modules_of(__name__)
