"""The head of a store: its attributes and those of its arrays, in the file `zarr.json`.

Zarr has checksums for the numbers of a store, and none for its head. A copy in the manifest begins
with its checksum. Where the two differ the copy is valid: it is written first, and no campaign
changes only `zarr.json`.
"""

import hashlib
import json
import time
from pathlib import Path
from typing import Any

from ..core.record import Record
from ._errors import StoreError
from ._files import read_plain

HEAD, COPY = "zarr.json", ".manifest/head"
# Longest time between the two writes of a running campaign, s.
PATIENCE = 0.05
# Attributes of every store, in whatever form, and of no Zarr group of another program.
MARKS = ("form", "planned_runs", "chunk", "seed", "digest")
# Exceptions raised by reading arbitrary JSON.
UNREADABLE = (OSError, ValueError, RecursionError)


def sealed(head: bytes) -> bytes:
    """The copy of a head: the checksum on a separate line, then the head."""
    return hashlib.sha256(head).hexdigest().encode() + b"\n" + head


def unsealed(copy: bytes) -> bytes | None:
    """The head in a copy; `None` where the copy is damaged."""
    _, _, head = copy.partition(b"\n")
    return head if sealed(head) == copy else None


def is_store(folder: Path) -> bool:
    """Whether this is the folder of a store, in whatever form, by its head or the copy of that."""
    return any(_is_marked(head) for head in _both(folder))


def _is_marked(head: bytes | None) -> bool:
    try:
        attributes = json.loads(head or b"null")["attributes"]
    except (*UNREADABLE, LookupError, TypeError):
        return False
    return isinstance(attributes, dict) and all(name in attributes for name in MARKS)


def read_head(folder: Path) -> tuple[bytes, str]:
    """The head of the store in this folder, and a message about damaged files; empty if there are
    none.

    **Raises** `StoreError` where neither file can be read."""
    head, copy = _both(folder)
    if copy != head:
        # A running campaign may just have written one of them.
        time.sleep(PATIENCE)
        head, copy = _both(folder)
    if copy is None and head is None:
        raise StoreError(
            f"{folder} cannot be read: it must be the Zarr store of a dispersion, and has no "
            f"{HEAD}."
        )
    if copy is None:
        # The copy is damaged or lost, so that the head cannot be compared.
        assert head is not None
        return head, f"{COPY}, the copy of {HEAD}, differs from its checksum."
    if copy != head:
        return copy, f"{HEAD} differs from its copy in {COPY}, which is read in its place."
    return copy, ""


def damaged_arrays(folder: Path, arrays: Record) -> list[str]:
    """The names of the arrays whose metadata file differs from the head, where `arrays` has the
    metadata."""
    result = [name for name, head in arrays.items() if _parsed(folder, name) != head]
    if result:
        # A campaign that ends writes the head first, and these a moment later.
        time.sleep(PATIENCE)
    return [name for name in result if _parsed(folder, name) != arrays[name]]


def differs_in_runs(folder: Path, name: str, head: Record) -> bool:
    """Whether an array's metadata file differs from its `head` only by the number of runs."""
    own = _parsed(folder, name)
    if not isinstance(own, dict) or own | {"shape": head["shape"]} != head:
        return False
    shape = own["shape"]
    if not isinstance(shape, list) or len(shape) != len(head["shape"]):
        return False
    return isinstance(shape[0], int) and shape[1:] == head["shape"][1:]


def _parsed(folder: Path, name: str) -> Any:
    """The metadata of an array in its file; `None` if it is missing or not JSON."""
    try:
        return json.loads(read_plain(folder / name / HEAD, folder))
    except UNREADABLE:
        return None


def _both(folder: Path) -> tuple[bytes | None, bytes | None]:
    """The head, and that in its copy."""
    head, copy = _bytes_of(folder, HEAD), _bytes_of(folder, COPY)
    return head, None if copy is None else unsealed(copy)


def _bytes_of(folder: Path, name: str) -> bytes | None:
    try:
        return read_plain(folder / name, folder)
    except OSError:
        return None
