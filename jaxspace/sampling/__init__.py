"""Random inputs: distributions, inputs that are drawn together, and how the runs are spread."""

from typing import TYPE_CHECKING

from ..core.modules import modules_of as _modules_of
from ._cone import ConeDirection as ConeDirection
from ._correlated import Correlated as Correlated
from ._correlated import MultivariateNormal as MultivariateNormal
from ._more_distributions import Discrete as Discrete
from ._more_distributions import Lognormal as Lognormal
from ._more_distributions import Samples as Samples
from ._more_distributions import Triangular as Triangular
from .designs import AbstractDesign as AbstractDesign
from .designs import LatinHypercube as LatinHypercube
from .designs import Sobol as Sobol
from .distributions import AbstractDistribution as AbstractDistribution
from .distributions import Constant as Constant
from .distributions import Normal as Normal
from .distributions import TruncatedNormal as TruncatedNormal
from .distributions import Uniform as Uniform
from .joint import AbstractJoint as AbstractJoint

if TYPE_CHECKING:
    # For type checkers, which do not see how a module is imported when it is first used.
    from . import densities as densities
    from . import distributions as distributions
    from . import sweeps as sweeps
else:
    __getattr__, __dir__ = _modules_of(__name__)
