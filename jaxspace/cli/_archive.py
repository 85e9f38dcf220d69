"""Archives of stored campaigns: written from a store, verified and extracted."""

import os
import shlex
import tempfile
from pathlib import Path

from ..core import InputError
from ..io import SceneError, stored_scene
from ..plots import dispersion_page
from ..statistics import Dispersion
from ..stores import StoreError, open_store
from ..stores.archive import ArchiveRecord, archive_store, check_archive, extract_archive
from ._waiting import waiting
from ._warning_lines import warnings_as_lines


def archive(path: str, target: str | None) -> int:
    """Write a store with its scene, table and page to one file; returns the exit status."""
    with warnings_as_lines():
        result = open_store(path)
    name = Path(path).name.removesuffix(".zarr")
    target = os.path.join(Path(path).parent, f"{name}.zip") if target is None else target
    with tempfile.TemporaryDirectory() as folder, waiting(f"writing {target}"):
        # A page that is there may have trajectories, which are not simulated again here.
        page = Path(path).parent / f"{name}.html"
        if not page.is_file():
            page = Path(folder) / "page.html"
            dispersion_page(result, page, title=_title(result, name))
        try:
            record = archive_store(path, target, results={"page.html": page})
        except OSError as error:
            raise StoreError(f"{target} cannot be written: {error.strerror}.") from error
    _print(record)
    print(f"archive {target}")
    print(f"next   jaxspace archive {shlex.quote(target)} --verify --digest {record.digest}")
    return 0


def verify(path: str, digest: str | None, folder: str | None) -> int:
    """Verify an archive, and extract it to a folder if there is one; returns the exit status."""
    try:
        with warnings_as_lines(), waiting("verifying"):
            if folder is not None:
                extract_archive(path, folder, digest=digest)
            record = check_archive(path, digest=digest)
    except OSError as error:
        raise StoreError(f"{path} cannot be read: {error.strerror}.") from error
    _print(record)
    print(f"all {len(record.files)} files of {path} match their checksums")
    if folder is not None:
        print(f"store  {os.path.join(folder, 'store')}")
    return 0


def _title(result: Dispersion, name: str) -> str:
    try:
        return stored_scene(result).title
    except (SceneError, InputError):
        return str(result.attributes.get("title", name))


def _print(record: ArchiveRecord) -> None:
    there = record.campaign
    versions = ", ".join(f"{k} {v}" for k, v in dict(there.get("versions") or {}).items())
    print(
        f"{there.get('title') or 'campaign'}: {there.get('planned_runs')} runs, "
        f"seed {there.get('seed', 'in the store')}"
    )
    print(f"versions {versions}")
    print(f"SHA-256  {record.digest}")
