"""Campaigns of many runs: random inputs, and the engines that compute the runs."""

from typing import TYPE_CHECKING

from ..core.modules import modules_of as _modules_of
from ..statistics import Dispersion as Dispersion
from ..statistics import Footprint as Footprint
from ..statistics import StopRule as StopRule
from ..stores import DamagedStore as DamagedStore
from ..stores import StoreError as StoreError
from ..stores import open_store as open_store
from ._campaign import Campaign as Campaign
from ._cone import ConeDirection as ConeDirection
from ._correlated import Correlated as Correlated
from ._correlated import MultivariateNormal as MultivariateNormal
from ._dask import DaskCluster as DaskCluster
from ._engine import disperse as disperse
from ._engines import MultiHost as MultiHost
from ._joint import AbstractJoint as AbstractJoint
from ._more_distributions import Discrete as Discrete
from ._more_distributions import Lognormal as Lognormal
from ._more_distributions import Samples as Samples
from ._more_distributions import Triangular as Triangular
from ._process_pool import ProcessPool as ProcessPool
from ._run_paths import RunPaths as RunPaths
from ._run_paths import run_paths as run_paths
from ._sampling import AbstractDesign as AbstractDesign
from ._sampling import LatinHypercube as LatinHypercube
from ._sampling import Sobol as Sobol
from ._work import AbstractEngine as AbstractEngine
from .covariance import moments as moments
from .distributions import AbstractDistribution as AbstractDistribution
from .distributions import Constant as Constant
from .distributions import Normal as Normal
from .distributions import TruncatedNormal as TruncatedNormal
from .distributions import Uniform as Uniform

if TYPE_CHECKING:
    # For type checkers, which do not see how a module is imported when it is first used.
    from . import comparison as comparison
    from . import covariance as covariance
    from . import distributions as distributions
    from . import evaluate as evaluate
    from . import purpose as purpose
    from . import rare as rare
    from . import replay as replay
    from . import sensitivity as sensitivity
else:
    __getattr__, __dir__ = _modules_of(__name__)
