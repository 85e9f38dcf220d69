"""What-if questions about a stored campaign: its statistics with other distributions of inputs."""

from collections.abc import Sequence

from ..core import InputError
from ..io import stored_scene
from ..stores import open_store
from ._waiting import waiting
from ._warning_lines import warnings_as_lines


def reweight(store: str, changes: Sequence[str], modules: Sequence[str] = ()) -> int:
    """Print the statistics of a store with the changed distributions of its inputs; returns the
    exit status."""
    tables: dict[str, dict[str, object]] = {}
    for text in changes:
        path, key, value = _change(text)
        tables.setdefault(path, {})[key] = value
    with warnings_as_lines():
        result = open_store(store)
    file = stored_scene(result, modules)
    with waiting("computing the weights"):
        found = file.reweight(result, tables)
    print(f"{file.title}: {found!r}")
    return 0


def _change(text: str) -> tuple[str, str, object]:
    """Path, key and value of a change such as "body.mass.deviation=2 kg"."""
    name, equals, value = text.partition("=")
    path, dot, key = name.strip().rpartition(".")
    if not (equals and dot and path and key and value.strip()):
        raise InputError(
            f"{text!r} must be the path of an input, a key of its table and a value, such as "
            '"body.mass.deviation=2 kg".'
        )
    try:
        return path, key, float(value)
    except ValueError:
        return path, key, value.strip()
