"""The example scenes that are included in the package."""

__all__ = ["scenes"]

from pathlib import Path

from ..core import InputError


def example(name: str) -> Path:
    """The path of an example scene that is included in the package, for `load`.

    **Arguments**

    - `name`: such as "kick_stage"; `jaxspace examples` lists all names.

    **Raises** `InputError` for an unknown name, with similar names."""
    path = scenes() / f"{name}.toml"
    names = sorted(file.stem for file in scenes().glob("*.toml"))
    if name not in names:
        raise InputError(
            f"{name} is not a bundled example: `jaxspace examples` lists "
            f"them.{InputError.hint(name, names)}"
        )
    return path


def scenes() -> Path:
    """The folder of the example scenes: part of the wheel, and in a clone examples/scenes."""
    package = Path(__file__).resolve().parents[1]
    installed = package / "examples"
    return installed if installed.is_dir() else package.parent / "examples" / "scenes"
