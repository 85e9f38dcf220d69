"""Stores of campaigns on disk: written chunk by chunk, checked as they are read, opened again."""

from typing import TYPE_CHECKING

from ..core.modules import modules_of as _modules_of
from ._errors import DamagedStore as DamagedStore
from ._errors import StoreError as StoreError
from .stored_runs import open_store as open_store

if TYPE_CHECKING:
    # For type checkers, which do not see how a module is imported when it is first used.
    from . import archive as archive
else:
    __getattr__, __dir__ = _modules_of(__name__)
