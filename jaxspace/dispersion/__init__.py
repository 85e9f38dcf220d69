"""Campaigns of many runs: random inputs, engines, statistics and stores."""

from typing import TYPE_CHECKING

from ..core.modules import modules_of as _modules_of
from ._campaign import Campaign as Campaign
from ._cone import ConeDirection as ConeDirection
from ._correlated import Correlated as Correlated
from ._correlated import MultivariateNormal as MultivariateNormal
from ._dask import DaskCluster as DaskCluster
from ._engine import disperse as disperse
from ._engines import MultiHost as MultiHost
from ._footprint import Footprint as Footprint
from ._joint import AbstractJoint as AbstractJoint
from ._lock import StoreError as StoreError
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
from ._store import DamagedStore as DamagedStore
from ._stored import open_store as open_store
from ._work import AbstractEngine as AbstractEngine
from .covariance import moments as moments
from .distributions import AbstractDistribution as AbstractDistribution
from .distributions import Constant as Constant
from .distributions import Normal as Normal
from .distributions import TruncatedNormal as TruncatedNormal
from .distributions import Uniform as Uniform
from .spread import StopRule as StopRule
from .statistics import Dispersion as Dispersion

if TYPE_CHECKING:
    # For type checkers, which do not see how a module is imported when it is first used.
    from . import comparison as comparison
    from . import contributors as contributors
    from . import covariance as covariance
    from . import distributions as distributions
    from . import evaluate as evaluate
    from . import extremes as extremes
    from . import limits as limits
    from . import purpose as purpose
    from . import rare as rare
    from . import replay as replay
    from . import requirements as requirements
    from . import sensitivity as sensitivity
    from . import spread as spread
    from . import statistics as statistics
    from . import table as table
else:
    __getattr__, __dir__ = _modules_of(__name__)
