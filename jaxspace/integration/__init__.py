"""One integration: method, tolerances and save times resolved once, the loop, events, derivatives.
No physics."""

from ._selection import eligible_methods as eligible_methods
from ._selection import select_method as select_method
