"""The best design where everything scatters: `minimise` over the runs of a campaign."""

from ._judge import judge_designs as judge_designs
from ._judged import Estimate as Estimate
from ._judged import JudgedDesign as JudgedDesign
from ._judged import JudgedDesigns as JudgedDesigns
from ._judged import JudgedLimit as JudgedLimit
from ._optimum import DesignOptimum as DesignOptimum
from ._search import optimise_design as optimise_design
from ._search import optimise_nominal as optimise_nominal
from ._statistics import AbstractStatistic as AbstractStatistic
from ._statistics import Constraint as Constraint
from ._statistics import CVaR as CVaR
from ._statistics import Mean as Mean
from ._statistics import MeanPlus as MeanPlus
from ._statistics import Quantile as Quantile
from ._statistics import Violation as Violation
from ._statistics import Worst as Worst
