"""Everything that a scene file may name."""

from pathlib import Path

from ..io import Registry, SceneFile
from ..io import load as load_with
from ._effects import EFFECTS, PLANET
from ._ends import EVENTS, JUMPS
from ._initial import ENTRY
from ._outputs import OUTPUTS
from ._systems import SYSTEMS

REGISTRY = Registry(EFFECTS, SYSTEMS, JUMPS, EVENTS, OUTPUTS, ENTRY, PLANET)


def load(path: str | Path) -> SceneFile:
    """The scene file at `path`, with every effect, system and output of the library.

    Raises `SceneError`, one line for each thing that is wrong."""
    return load_with(path, REGISTRY)
