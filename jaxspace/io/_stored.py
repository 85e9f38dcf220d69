"""The scene file that a stored campaign came from."""

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
    path = str(dispersion.attributes.get("scene_file", "scene.toml"))
    return load(path, text=text, files=dispersion.attributes.get("files"))
