"""The error of a store and the warning about one."""

from ..core import InputError


class StoreError(InputError):
    """A store that rejects a request, or cannot be read or written; the message gives the reason
    and a remedy."""


class DamagedStore(UserWarning):
    """Corrupted files of a store; the message names them."""
