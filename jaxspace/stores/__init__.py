"""Stores of campaigns on disk: written chunk by chunk, checked as they are read, opened again."""

from ._lock import StoreError as StoreError
from .store import DamagedStore as DamagedStore
from .stored_runs import open_store as open_store
