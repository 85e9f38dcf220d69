"""Campaigns of many runs: what scatters, the engine that runs them, what they show, and where they
are kept."""

from ._campaign import Campaign as Campaign
from ._distributions import NOMINAL as NOMINAL
from ._distributions import OF_INPUT as OF_INPUT
from ._distributions import SHARE_OF_INPUT as SHARE_OF_INPUT
from ._distributions import AbstractDistribution as AbstractDistribution
from ._distributions import Constant as Constant
from ._distributions import Normal as Normal
from ._distributions import TruncatedNormal as TruncatedNormal
from ._distributions import Uniform as Uniform
from ._engine import disperse as disperse
from ._engines import AbstractEngine as AbstractEngine
from ._engines import DaskCluster as DaskCluster
from ._engines import MultiHost as MultiHost
from ._engines import ProcessPool as ProcessPool
from ._lock import StoreError as StoreError
from ._replay import Replay as Replay
from ._statistics import Contributors as Contributors
from ._statistics import Dispersion as Dispersion
from ._statistics import Failure as Failure
from ._statistics import Row as Row
from ._stored import DamagedStore as DamagedStore
from ._stored import open_store as open_store
