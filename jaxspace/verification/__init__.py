"""Hard cases that ship with the library, and the laws that the motion of any system obeys."""

from typing import TYPE_CHECKING

from ..core.modules import modules_of as _modules_of
from ._case import Case as Case
from ._cases import CASES as CASES
from ._laws import Law as Law
from ._laws import LawReport as LawReport
from ._laws import verify as verify
from ._runner import run_cases as run_cases

if TYPE_CHECKING:
    # For type checkers, which do not see how a module is imported when it is first used.
    from . import report as report
else:
    __getattr__, __dir__ = _modules_of(__name__)
