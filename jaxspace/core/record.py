"""The provenance record of a result, in JSON-compatible form."""

import os
import shlex
from typing import Any, TypeAlias

# `Any`, because Python's types cannot express JSON without a cast at every access.
Record: TypeAlias = dict[str, Any]
"""Texts, numbers, lists and further records, by name."""


def resuming(attributes: Record, store: str | os.PathLike[str]) -> str:
    """The command that computes the missing runs of a store, or the call where the campaign with
    these attributes was built in Python: the command line can rebuild campaigns of scene files
    only."""
    if "scene_file" in attributes:
        return f"jaxspace resume {shlex.quote(str(store))}"
    return "disperse(..., resume=True)"
