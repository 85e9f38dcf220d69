"""Scene files: those that come with the package, and loading; the reader is imported on first
use."""

import os
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
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


def example(name: str) -> Path:
    """The path of an example scene that is included in the package, for `load`.

    **Arguments**

    - `name`: such as "kick_stage"; `jaxspace examples` lists all names.

    **Raises** `jaxspace.core.InputError` for an unknown name, with similar names."""
    path = scenes() / f"{name}.toml"
    names = sorted(file.stem for file in scenes().glob("*.toml"))
    if name not in names:
        from .core import InputError

        raise InputError(
            f"{name} is not a bundled example: `jaxspace examples` lists "
            f"them.{InputError.hint(name, names)}"
        )
    return path


def scenes() -> Path:
    """The folder of the example scenes: part of the wheel, and in a clone examples/scenes."""
    package = Path(__file__).resolve().parent
    installed = package / "examples"
    return installed if installed.is_dir() else package.parent / "examples" / "scenes"
