"""Loading of scene files, and the bundled examples; the reader is imported on first use."""

import os
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pathlib import Path

    from .io import SceneFile


def load(
    path: "str | os.PathLike[str]",
    also: "Iterable[Any]" = (),
    *,
    modules: "Iterable[str | os.PathLike[str]]" = (),
) -> "SceneFile":
    """The scene file at `path`: system, initial state, times, accuracy and dispersions.

    `file.system`, `file.y0`, `file.ts` and `file.accuracy` are the arguments of `simulate`, or of
    `simulate_mission` for a mission; `file.simulate()` runs it, and `file.campaign()` is the
    argument of `disperse`.

    **Arguments**

    - `path`: of a TOML file.
    - `also`: classes and declared functions available to the file in addition to those of the
      library.
    - `modules`: paths of Python files, which are executed; their definitions are available to the
      file.

    **Raises** `jaxspace.io.SceneError`, with one line per error, before anything is compiled.
    Requires the extra `app` for units."""
    # Here, so that `import jaxspace` stays as quick as what it is used for.
    from .io import load as load_file

    return load_file(path, also, modules=modules)


def example(name: str) -> "Path":
    """The path of an example scene that is included in the package, for `load`.

    **Arguments**

    - `name`: such as "kick_stage"; `jaxspace examples` lists all names.

    **Raises** `jaxspace.core.InputError` for an unknown name, with similar names. Requires the
    extra `app`, as `load` does."""
    from .io import example as example_file

    return example_file(name)
