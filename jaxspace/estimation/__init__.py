"""States and parameters from data: least squares through any simulation, Kalman filters."""

from ._filters import Filtered as Filtered
from ._filters import kalman_filter as kalman_filter
from ._fit import fit as fit
from ._fit_result import Fit as Fit
from ._residuals import ResidualTests as ResidualTests
from ._residuals import residual_tests as residual_tests
