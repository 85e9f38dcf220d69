"""Integrators written as diffrax solvers, and their step control. No physics.

Every solver integrates one run or many at once; the runs are on the last axes of every block of the
state. A solver declares its `traits`, which tell the integration loop its requirements.
"""

from typing import TYPE_CHECKING

from ..core.modules import modules_of as _modules_of
from ._adaptive_regularised import AdaptiveRegularised as AdaptiveRegularised
from ._exponential import ExponentialRosenbrock as ExponentialRosenbrock
from ._fixed_steps import FixedSteps as FixedSteps
from ._munthe_kaas import MuntheKaas as MuntheKaas
from ._regularised import Regularised as Regularised
from ._rkn1210 import RKN1210 as RKN1210
from ._runge_kutta import DOP853 as DOP853
from ._runge_kutta import Tsit5 as Tsit5
from ._splitting import Splitting as Splitting
from ._stormer import Stormer as Stormer

if TYPE_CHECKING:
    # For type checkers, which do not see how a module is imported when it is first used.
    from . import protocol as protocol
else:
    __getattr__, __dir__ = _modules_of(__name__)
