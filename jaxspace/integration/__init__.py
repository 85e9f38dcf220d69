"""One integration: method, tolerances and save times resolved once, the loop, events, derivatives.
No physics."""

from typing import TYPE_CHECKING

from ..core.modules import modules_of as _modules_of
from ._selection import eligible_methods as eligible_methods
from ._selection import select_method as select_method

if TYPE_CHECKING:
    # For type checkers, which do not see how a module is imported when it is first used.
    from . import crossings as crossings
else:
    __getattr__, __dir__ = _modules_of(__name__)
