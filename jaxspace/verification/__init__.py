"""Hard cases that ship with the library, and the laws that the motion of any system obeys."""

from ._case import Case as Case
from ._laws import Law as Law
from ._laws import LawReport as LawReport
from ._laws import verify as verify
from ._report import CaseResult as CaseResult
from ._report import Verification as Verification
from ._runner import CASES as CASES
from ._runner import run_cases as run_cases
