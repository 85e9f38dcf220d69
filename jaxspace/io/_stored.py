"""The scene file that a stored campaign came from."""

import tempfile
from pathlib import Path

from ..core import InputError
from ..dispersion import Dispersion
from ._load import load
from ._scene_file import SceneFile


def stored_scene(dispersion: Dispersion) -> SceneFile:
    """The scene file whose text a dispersion carries in its record.

    Raises `InputError` for a campaign that was made in Python, and `SceneError` for a text that
    this version no longer understands."""
    text = str(dispersion.attributes.get("description", ""))
    if "[dispersion" not in text:
        raise InputError("the record holds no scene file: the campaign was made in Python.")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.toml"
        path.write_text(text, encoding="utf-8")
        return load(path)
