"""Stores of campaigns on disk: written chunk by chunk, checked as they are read, opened again."""

from ._errors import DamagedStore as DamagedStore
from ._errors import StoreError as StoreError
from .stored_runs import open_store as open_store
