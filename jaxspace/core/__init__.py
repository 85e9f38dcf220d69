"""Base of all packages: the interface of a system, vector algebra, functions without NaN,
declared quantities, checks of input. Imports jax and equinox only."""

from typing import TYPE_CHECKING

from ._system import AbstractClosedForm as AbstractClosedForm
from ._system import AbstractDecoupled as AbstractDecoupled
from ._system import AbstractRegularised as AbstractRegularised
from ._system import AbstractSecondOrderForm as AbstractSecondOrderForm
from ._system import AbstractSplit as AbstractSplit
from ._system import AbstractSystem as AbstractSystem
from ._system import RunWarning as RunWarning
from .checks import InputError as InputError
from .checks import check as check
from .declarations import Choice as Choice
from .declarations import FileName as FileName
from .declarations import constructor as constructor
from .declarations import event as event
from .declarations import initial as initial
from .declarations import known_time as known_time
from .declarations import output as output
from .declarations import reference as reference
from .extras import MissingExtra as MissingExtra
from .groups import AbstractGroupElement as AbstractGroupElement
from .modules import modules_of as _modules_of
from .quantities import AbstractParameters as AbstractParameters
from .quantities import argument as argument
from .quantities import quantity as quantity
from .tables import Spline as Spline
from .tables import Table as Table
from .types import Flag as Flag
from .types import Matrix as Matrix
from .types import NumberField as NumberField
from .types import OptionalNumberField as OptionalNumberField
from .types import Scalar as Scalar
from .types import State as State
from .types import Vector as Vector

if TYPE_CHECKING:
    # For type checkers, which do not see how a module is imported when it is first used.
    from . import checks as checks
    from . import declarations as declarations
    from . import elliptic as elliptic
    from . import jacobi as jacobi
    from . import quantities as quantities
    from . import safe as safe
    from . import shapes as shapes
    from . import special as special
    from . import square_roots as square_roots
    from . import tables as tables
    from . import types as types
    from . import vectors as vectors
else:
    __getattr__, __dir__ = _modules_of(__name__)
