"""The values of a file as a tree, and the paths of its numbers: "body.dry_mass",
"phase.2.jump.yo_yo.mass"."""

from collections.abc import Iterator, Mapping
from typing import Any

import jax.numpy as jnp

from ._quantities import Measure


def at(values: Any, path: str) -> Any:
    """What stands at the path; `None` where nothing does."""
    for step in path.split("."):
        if isinstance(values, Mapping):
            values = values.get(step)
        elif isinstance(values, list) and step.isdigit() and int(step) < len(values):
            values = values[int(step)]
        else:
            return None
    return values


def measures(values: Any, path: str = "") -> Iterator[tuple[str, Measure]]:
    """The path of every number that may be dispersed, and the number."""
    if isinstance(values, Measure):
        yield path, values
    items = (
        values.items()
        if isinstance(values, Mapping)
        else enumerate(values)
        if isinstance(values, list)
        else ()
    )
    for name, value in items:
        yield from measures(value, f"{path}.{name}" if path else str(name))


def replaced(values: Any, samples: Mapping[str, Any], path: str = "") -> Any:
    """The tree with arrays as numbers: those of `samples` at their paths, and what the file says
    elsewhere."""
    if path in samples:
        return samples[path]
    if isinstance(values, Measure):
        return jnp.asarray(float(values))
    if isinstance(values, Mapping):
        return {
            k: replaced(v, samples, f"{path}.{k}" if path else str(k)) for k, v in values.items()
        }
    if isinstance(values, list):
        return [replaced(v, samples, f"{path}.{k}") for k, v in enumerate(values)]
    return values
