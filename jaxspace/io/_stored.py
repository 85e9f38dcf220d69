"""The scene file that a stored campaign came from."""

import os
from collections.abc import Iterable

from ..core import InputError
from ..statistics import Dispersion
from ._load import load
from ._modules import check_stored, read_modules
from ._scene_file import SceneFile


def stored_scene(
    dispersion: Dispersion, modules: Iterable[str | os.PathLike[str]] = ()
) -> SceneFile:
    """The scene file whose text a dispersion carries in its record.

    **Arguments**

    - `dispersion`: that of a scene file, such as one from `open_store`.
    - `modules`: as in `load`; those with which it was computed.

    **Raises** `InputError` for a campaign that was made in Python and for other modules, and
    `SceneError` for a text that this version no longer understands."""
    text = str(dispersion.attributes.get("description", ""))
    if "[dispersion" not in text:
        raise InputError("the record holds no scene file: the campaign was made in Python.")
    user_modules = read_modules(modules)
    check_stored(dispersion.attributes, user_modules)
    path = str(dispersion.attributes.get("scene_file", "scene.toml"))
    return load(path, modules=user_modules, text=text, files=dispersion.attributes.get("files"))
