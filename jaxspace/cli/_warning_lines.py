"""The warnings about a campaign and its store, as lines on the error output."""

import warnings
from collections.abc import Callable
from typing import Any

from ..stores import DamagedStore
from ._output import harmless, say

UNFINISHED = ".* planned runs are in the store"
"""Pattern of the warning about an unfinished store, which every report prints separately."""


class warnings_as_lines:
    """Writes the warnings for users as sentences, without the place in the source that gave them.

    `write`: function that receives a line; by default it is printed on stderr."""

    def __init__(self, write: Callable[[str], None] = say):
        self.write = write
        self.context = warnings.catch_warnings()

    def __enter__(self) -> None:
        self.context.__enter__()
        before = warnings.showwarning

        def show(
            message: Warning | str, category: type[Warning], *more: Any, **options: Any
        ) -> None:
            if issubclass(category, UserWarning):
                self.write(harmless(str(message)))
            else:
                before(message, category, *more, **options)

        warnings.simplefilter("always", DamagedStore)
        warnings.filterwarnings("ignore", UNFINISHED)
        # NumPy warnings about numbers that are not finite: the status of the run reports this.
        warnings.simplefilter("ignore", RuntimeWarning)
        warnings.showwarning = show

    def __exit__(self, *error: Any) -> None:
        self.context.__exit__(*error)
