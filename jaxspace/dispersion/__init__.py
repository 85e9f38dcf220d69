"""Campaigns of many runs, and further analyses of a campaign."""

from typing import TYPE_CHECKING

from ..core.modules import modules_of as _modules_of
from ..engines import AbstractEngine as AbstractEngine
from ..engines import DaskCluster as DaskCluster
from ..engines import MultiHost as MultiHost
from ..engines import Part as Part
from ..engines import ProcessPool as ProcessPool
from ..sampling import AbstractDesign as AbstractDesign
from ..sampling import AbstractDistribution as AbstractDistribution
from ..sampling import AbstractJoint as AbstractJoint
from ..sampling import ConeDirection as ConeDirection
from ..sampling import Constant as Constant
from ..sampling import Correlated as Correlated
from ..sampling import Discrete as Discrete
from ..sampling import LatinHypercube as LatinHypercube
from ..sampling import Lognormal as Lognormal
from ..sampling import MultivariateNormal as MultivariateNormal
from ..sampling import Normal as Normal
from ..sampling import Samples as Samples
from ..sampling import Sobol as Sobol
from ..sampling import Triangular as Triangular
from ..sampling import TruncatedNormal as TruncatedNormal
from ..sampling import Uniform as Uniform
from ..statistics import Dispersion as Dispersion
from ..statistics import Footprint as Footprint
from ..statistics import StopRule as StopRule
from ..stores import DamagedStore as DamagedStore
from ..stores import StoreError as StoreError
from ..stores import open_store as open_store
from ._campaign import Campaign as Campaign
from ._engine import disperse as disperse
from ._run_paths import RunPaths as RunPaths
from ._run_paths import run_paths as run_paths
from .covariance import moments as moments

if TYPE_CHECKING:
    # For type checkers, which do not see how a module is imported when it is first used.
    from . import automatic as automatic
    from . import comparison as comparison
    from . import covariance as covariance
    from . import evaluate as evaluate
    from . import purpose as purpose
    from . import rare as rare
    from . import replay as replay
    from . import reweighting as reweighting
    from . import sensitivity as sensitivity
    from . import states as states
else:
    __getattr__, __dir__ = _modules_of(__name__)
