"""Integrators written as diffrax solvers, and their step control. No physics.

Every solver integrates one run or many in one integration; the runs lie on the last axes of every
block of the state. A solver declares its `traits`, by which the runner knows what it needs.
"""

from ._adaptive_regularised import AdaptiveRegularised as AdaptiveRegularised
from ._error_tracking import ErrorTrackingSolver as ErrorTrackingSolver
from ._exponential import ExponentialRosenbrock as ExponentialRosenbrock
from ._fixed_steps import FixedSteps as FixedSteps
from ._munthe_kaas import MuntheKaas as MuntheKaas
from ._protocol import AbstractDeclaredSolver as AbstractDeclaredSolver
from ._protocol import AbstractFixedStep as AbstractFixedStep
from ._protocol import SolverTraits as SolverTraits
from ._protocol import bind as bind
from ._protocol import refine as refine
from ._protocol import small_program as small_program
from ._protocol import solver_traits as solver_traits
from ._regularised import Regularised as Regularised
from ._rkn1210 import RKN1210 as RKN1210
from ._splitting import Splitting as Splitting
from ._stormer import Stormer as Stormer
from ._tolerance import Tolerance as Tolerance
from ._vector_field import ScaledField as ScaledField
from .runge_kutta import DOP853 as DOP853
from .runge_kutta import Tsit5 as Tsit5
from .step_control import BatchStepController as BatchStepController
from .step_control import StepTo as StepTo
