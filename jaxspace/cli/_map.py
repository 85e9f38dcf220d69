"""The landings of a stored campaign as files for maps."""

import os
from collections.abc import Sequence
from pathlib import Path

from ..core import InputError
from ..io import stored_scene
from ..io.maps import landings_geojson, landings_kml
from ..stores import open_store
from ._output import make_folder
from ._report import attempt
from ._warning_lines import warnings_as_lines


def write_map(path: str, folder: str | None, modules: Sequence[str] = ()) -> int:
    """Write `NAME.kml` and `NAME.geojson` of a store and print their paths; returns the exit
    status."""
    with warnings_as_lines():
        result = open_store(path)
    file = stored_scene(result, modules)
    if file.site is None:
        raise InputError(f"{path}: the scene has no launch site, so its landings have no place.")
    name = Path(path).name.removesuffix(".zarr")
    folder = str(Path(path).parent) if folder is None else folder
    make_folder(folder)
    start = os.path.join(folder, name)

    def kml(unfinished: str) -> None:
        landings_kml(result, unfinished, site=file.site, title=file.title)

    def geojson(unfinished: str) -> None:
        landings_geojson(result, unfinished, site=file.site)

    return max(attempt("map", f"{start}.kml", kml), attempt("map", f"{start}.geojson", geojson))
