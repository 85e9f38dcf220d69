"""A file in which a search saves its state, so that nothing is lost when its process ends.

The file is written under a temporary name and then renamed: it is complete at any moment. A search
resumed from it performs the same steps as one that was never interrupted, bit for bit, on the same
kind of processor and with the same versions.
"""

import hashlib
import io
import json
import os
import time
from pathlib import Path
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from ..core import InputError

S = TypeVar("S", bound=PyTree)

FORMAT = 1
"""Version of the file."""
# The part of the time that writing may take.
SHARE = 0.05


class SearchStore:
    """The file of one search.

    **Arguments**

    - `path`: of the file.
    - `resume`: whether a search continues from an existing file.
    - `task`: description of the search: a file of another task is rejected.

    **Raises** `InputError` for a file that exists where `resume` is false."""

    def __init__(self, path: str | os.PathLike[str], resume: bool, task: str = ""):
        self.path = Path(path)
        self.resume = resume
        self.task = task
        self._next = 0.0
        if not resume and self.path.exists():
            raise InputError(
                f"store is {self.path}, which exists: resume the search in it, or delete it."
            )

    def begin(self, state: S, setting: PyTree) -> S:
        """The state with which the search continues: that of the file, or `state` if there is none.

        **Arguments**

        - `state`: at the start of the search.
        - `setting`: numbers on which its steps depend.

        **Raises** `InputError` for a file that is damaged or belongs to another search."""
        self._setting = _digest(setting)
        if not (self.resume and self.path.exists()):
            return state
        try:
            # Read simultaneously, because a damaged archive leaves its file open.
            content = io.BytesIO(self.path.read_bytes())
            with np.load(content, allow_pickle=False) as kept:
                told = json.loads(str(kept["told"]))
                leaves = [kept[f"leaf{k}"] for k in range(told["leaves"])]
        except Exception as error:
            raise InputError(f"store is {self.path}, which cannot be read: {error}.") from error
        if told != self._identity(state):
            raise InputError(
                f"store is {self.path}, which belongs to another search: its task, start, bounds, "
                "optimiser and version must be the same."
            )
        return jax.tree.unflatten(jax.tree.structure(state), [jnp.asarray(x) for x in leaves])

    def save(self, state: PyTree, last: bool = False) -> None:
        """Write the state, unless writing would take more than a twentieth of the time since the
        last write.

        **Arguments**

        - `state`: after a whole step.
        - `last`: whether it is written in any case."""
        began = time.perf_counter()
        if not last and began < self._next:
            return
        leaves = [np.asarray(x) for x in jax.tree.leaves(state)]
        content = io.BytesIO()
        told = json.dumps(self._identity(state))
        arrays = {f"leaf{k}": x for k, x in enumerate(leaves)}
        np.savez(content, told=np.array(told), **arrays)  # type: ignore[arg-type]
        self._replace(content.getvalue())
        ended = time.perf_counter()
        self._next = ended + (ended - began) / SHARE

    def _replace(self, content: bytes) -> None:
        beside = self.path.with_name(f"{self.path.name}.{os.getpid()}.part")
        try:
            beside.unlink(missing_ok=True)
            # New, because a link of this name would lead elsewhere.
            with open(beside, "xb") as file:
                file.write(content)
                file.flush()
                # On the disk before the name is, also where the machine fails.
                os.fsync(file.fileno())
            os.replace(beside, self.path)
        finally:
            beside.unlink(missing_ok=True)

    def _identity(self, state: PyTree) -> dict[str, object]:
        """The properties that identify the file of this search."""
        leaves, structure = jax.tree.flatten(state)
        kinds = [(list(np.shape(x)), jnp.result_type(x).name) for x in leaves]
        form = hashlib.sha256(f"{structure}{kinds}".encode()).hexdigest()
        return {
            "format": FORMAT,
            "task": self.task,
            "setting": self._setting,
            "form": form,
            "leaves": len(leaves),
        }


def as_store(
    store: "SearchStore | str | os.PathLike[str] | None", resume: bool
) -> "SearchStore | None":
    """The store of the arguments of a search; `None` for none.

    Raises `InputError` for `resume` without a store."""
    if store is None and resume:
        raise InputError("resume is true without a store: pass the store of the search.")
    if store is None or isinstance(store, SearchStore):
        return store
    return SearchStore(store, resume)


def _digest(setting: PyTree) -> str:
    hashed = hashlib.sha256()
    for leaf in jax.tree.leaves(setting):
        hashed.update(np.ascontiguousarray(np.asarray(leaf)).tobytes())
    return hashed.hexdigest()
