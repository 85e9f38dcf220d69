"""Figures of trajectories, dispersions and studies, and runs that move.

Plotting libraries are imported on demand."""

from typing import TYPE_CHECKING

from ..core.modules import modules_of as _modules_of
from ._convergence_figure import convergence_figure as convergence_figure
from ._designs_figure import designs_figure as designs_figure
from ._designs_page import designs_page as designs_page
from ._dispersion_figure import dispersion_figure as dispersion_figure
from ._dispersion_page import dispersion_page as dispersion_page
from ._modes_figure import bode_figure as bode_figure
from ._modes_figure import root_locus_figure as root_locus_figure
from ._porkchop_figure import porkchop_figure as porkchop_figure
from ._study_figures import accuracy_cost_figure as accuracy_cost_figure
from ._study_figures import effect_budget_figure as effect_budget_figure
from ._sweep_figure import sweep_figure as sweep_figure
from ._trajectory_figure import trajectory_figure as trajectory_figure
from ._view_page import show_run as show_run
from ._view_page import view_page as view_page
from .footprint import footprint_figure as footprint_figure

if TYPE_CHECKING:
    # For type checkers, which do not see how a module is imported when it is first used.
    from . import flight_log as flight_log
    from . import footprint as footprint
else:
    __getattr__, __dir__ = _modules_of(__name__)
