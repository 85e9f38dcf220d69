"""The door to scene files, which imports what reads them when it is opened."""

import os
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .io import SceneFile


def load(
    path: "str | os.PathLike[str]",
    also: "Iterable[Any]" = (),
    *,
    modules: "Iterable[str | os.PathLike[str]]" = (),
) -> "SceneFile":
    """The scene file at `path`: what moves, from where, when, how accurately, and what scatters.

    `file.system`, `file.y0`, `file.ts` and `file.accuracy` are what `simulate` takes, of a mission
    `simulate_mission`;
    `file.simulate()` runs it, `file.campaign()` is what `disperse` takes.

    **Arguments**

    - `path`: of a file in TOML.
    - `also`: classes and declared functions that the file may name besides those of the library.
    - `modules`: paths of Python files, which are run; the file may name what they define.

    **Raises** `jaxspace.io.SceneError`, one line for each thing that is wrong; nothing is compiled
    before. Needs the extra `app` for units."""
    # Here, so that `import jaxspace` stays as quick as what it is used for.
    from .io import load as load_file

    return load_file(path, also, modules=modules)
