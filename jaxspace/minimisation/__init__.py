"""Minima under constraints, by gradients: quadratic programmes, or any optimiser of optax. The
package is independent of the minimised problem."""

from ._criterion import Criterion as Criterion
from ._criterion import Minimum as Minimum
from ._criterion import StopReason as StopReason
from ._drive import Progress as Progress
from ._minimise import minimise as minimise
from ._minimise import minimise_from as minimise_from
