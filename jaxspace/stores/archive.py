"""Archives of campaigns: one file with a store, its scene, its results and checksums of all.

    manifest.json        format, record of the campaign, size and SHA-256 of every other file
    store/...            the store, as `open_store` reads it
    scene/...            the scene file, the files that it names, and the modules of the user
    results/...          the runs as a table, and the page

It is a ZIP file without compression: compressed bytes differ between versions of the library that
makes them, and those of an archive are the same on every machine. Its only times and permissions
are constants. So two archives of a store are equal, and the SHA-256 of the file identifies it.

The checksums in the manifest reveal damage. A person who changes a file on purpose can change its
checksum, too: that is revealed by the SHA-256 of the archive, which must come from elsewhere, such
as a publication.
"""

__all__ = ["ArchiveRecord", "archive_store", "check_archive", "extract_archive"]

import hashlib
import json
import os
import shutil
import stat
import struct
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO, NamedTuple

from ..core.file_names import file_name_fault
from ..core.printing import printed
from ..core.record import Record
from ..core.text import printable
from ..statistics import Dispersion
from ._errors import StoreError
from ._files import read_plain
from ._head import HEAD
from ._replacement import MANIFEST, array_names
from .store import Store
from .stored_runs import open_store

FORM = 1
MANIFEST_FILE = "manifest.json"
STORE, SCENE, RESULTS = "store", "scene", "results"
CHUNK = 1 << 20
LARGEST_MANIFEST = 64_000_000
# The earliest time of the format.
TIME = (1980, 1, 1, 0, 0, 0)
MODE = (stat.S_IFREG | 0o644) << 16
LISTED = ("title", "planned_runs", "seed", "versions", "rtol", "atol", "method", "description")
"""Entries of the record of a campaign that the manifest repeats."""


@printed(files="", digest="", campaign="")
class ArchiveRecord(NamedTuple):
    """What an archive contains.

    - `digest`: SHA-256 of the whole file, by which a publication can identify it.
    - `files`: size in bytes and SHA-256 of each file in it, by name.
    - `campaign`: the main entries of the record of the campaign, such as its `seed`, `versions` and
      `planned_runs`."""

    digest: str
    files: dict[str, tuple[int, str]]
    campaign: Record


def archive_store(
    store: str | os.PathLike[str],
    path: str | os.PathLike[str],
    *,
    results: Mapping[str, str | os.PathLike[str]] | None = None,
) -> ArchiveRecord:
    """Write a complete store, its scene and its results to one file.

    **Arguments**

    - `store`: of a complete campaign.
    - `path`: of the archive; an existing file is replaced.
    - `results`: paths of further files, such as the page, by their names in the archive. The runs
      are always there as `runs.csv`.

    **Raises** `StoreError` for a store that is damaged or not complete, and for a name that is not
    one of a file."""
    there = Store(store).read()
    _check_complete(there)
    for name in results or {}:
        if fault := file_name_fault(name):
            raise StoreError(f"results has the name {printable(name)!r}: it must be {fault}.")
    with tempfile.TemporaryDirectory() as folder:
        table = Path(folder) / "runs.csv"
        open_store(store).to_csv(table)
        files: dict[str, Path | bytes] = {
            f"{RESULTS}/{name}": Path(file)
            for name, file in {"runs.csv": table, **(results or {})}.items()
        }
        files |= {f"{STORE}/{name}": there.folder / name for name in _names_of(there)}
        files |= {f"{SCENE}/{name}": text for name, text in _scene_of(there).items()}
        return _write(Path(path), files, there)


def check_archive(path: str | os.PathLike[str], *, digest: str | None = None) -> ArchiveRecord:
    """Verify an archive: the checksum of every file, and the runs of its store.

    **Arguments**

    - `digest`: the SHA-256 that the whole file must have, such as that in a publication.

    **Raises** `StoreError` for a file that is no archive, is damaged, or contains anything else
    than its manifest lists; `OSError` for one that cannot be opened."""
    with tempfile.TemporaryDirectory() as folder:
        record = _extract(Path(path), Path(folder), digest)
        _check_complete(Store(Path(folder) / STORE).read())
        return record


def extract_archive(
    path: str | os.PathLike[str], folder: str | os.PathLike[str], *, digest: str | None = None
) -> Dispersion:
    """Verify an archive, and put its files into a new folder.

    **Arguments**

    - `folder`: that is made; nothing in an existing one is changed.
    - `digest`: as in `check_archive`.

    **Returns** the campaign, whose store is `store` in the folder.

    **Raises** as `check_archive`, and `StoreError` for an existing folder."""
    folder = Path(folder)
    if os.path.lexists(folder):
        raise StoreError(f"{folder} exists: an archive is extracted to a new folder.")
    folder.parent.mkdir(parents=True, exist_ok=True)
    # In place as a whole, or not at all.
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=".unfinished-") as unfinished:
        _extract(Path(path), Path(unfinished), digest)
        _check_complete(Store(Path(unfinished) / STORE).read())
        made = Path(unfinished) / "all"
        made.mkdir()
        for entry in list(Path(unfinished).iterdir()):
            if entry != made:
                shutil.move(entry, made / entry.name)
        os.rename(made, folder)
    return open_store(folder / STORE)


def _check_complete(there: Store) -> None:
    """Raise `StoreError` for a store with damage, or without all of its chunks."""
    damages = there.metadata_damages()
    if damages:
        raise StoreError(f"{there.path}: {damages[0]}")
    finished = there.finished()
    if len(finished) < there.count:
        raise StoreError(
            f"{there.path} has {len(finished)} of {there.count} chunks: the campaign must be "
            "complete."
        )
    for chunk in finished:
        if damage := there.damage(chunk):
            raise StoreError(f"{there.path}: {damage}")


def _names_of(there: Store) -> list[str]:
    """The files of a store, without those of others in its folder, with `/` between folders."""
    names = [HEAD, *(f"{name}/{HEAD}" for name in array_names(there.folder))]
    names += [f"{MANIFEST}/{chunk}.json" for chunk in range(there.count)] + [f"{MANIFEST}/head"]
    for name in there.columns:
        for chunk in range(there.count):
            names.append(there.file(name, chunk).relative_to(there.folder).as_posix())
    return names


def _scene_of(there: Store) -> dict[str, bytes]:
    """The texts of the scene, its files and its modules, under names without folders."""
    attributes = there.attributes
    texts: list[tuple[str, str]] = []
    if attributes.get("scene_file"):
        texts.append((str(attributes["scene_file"]), str(attributes.get("description", ""))))
    texts += [(str(name), str(text)) for name, text in (attributes.get("files") or {}).items()]
    for name, module in (attributes.get("modules") or {}).items():
        texts.append((f"{str(name).removesuffix('.py')}.py", str(module.get("text", ""))))
    found: dict[str, bytes] = {}
    for path, text in texts:
        name = path.replace("\\", "/").rpartition("/")[2]
        # Two files in different folders may have one name.
        if file_name_fault(name) or name in found:
            name = f"{len(found)}_{name}" if not file_name_fault(f"0_{name}") else str(len(found))
        found[name] = text.encode()
    return found


def _write(path: Path, files: Mapping[str, Path | bytes], there: Store) -> ArchiveRecord:
    unfinished = path.with_name(f".unfinished-{os.getpid()}-{path.name}")
    listed: dict[str, tuple[int, str]] = {}
    campaign = {name: there.attributes[name] for name in LISTED if name in there.attributes}
    try:
        with zipfile.ZipFile(unfinished, "x", zipfile.ZIP_STORED) as archive:
            for name in sorted(files):
                data = files[name]
                if isinstance(data, Path):
                    top = there.folder if name.startswith(f"{STORE}/") else data.parent
                    data = read_plain(data, top)
                listed[name] = len(data), hashlib.sha256(data).hexdigest()
                archive.writestr(_entry(name), data)
            manifest = {"archive": FORM, "campaign": campaign, "files": listed}
            text = json.dumps(manifest, indent=1, sort_keys=True)
            archive.writestr(_entry(MANIFEST_FILE), text + "\n")
        digest = _digest(unfinished)
        os.replace(unfinished, path)
    finally:
        unfinished.unlink(missing_ok=True)
    return ArchiveRecord(digest, listed, campaign)


def _entry(name: str) -> zipfile.ZipInfo:
    entry = zipfile.ZipInfo(name, TIME)
    entry.external_attr = MODE
    # Otherwise that of the system.
    entry.create_system = 3
    return entry


def _digest(path: Path) -> str:
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _extract(path: Path, folder: Path, digest: str | None) -> ArchiveRecord:
    """Put the verified files of an archive into an empty folder."""
    found = _digest(path)
    if digest is not None and digest.strip().lower() != found:
        raise StoreError(f"{path} has the SHA-256 {found}: it must be {digest.strip().lower()}.")
    try:
        with zipfile.ZipFile(path) as archive:
            entries = _entries(path, archive)
            manifest = _manifest(path, archive, entries)
            files = _listed(path, manifest, entries)
            for name, (size, sha) in files.items():
                _extract_one(path, archive, entries[name], folder / name, size, sha)
    except (zipfile.BadZipFile, EOFError, NotImplementedError, RuntimeError, struct.error) as error:
        raise StoreError(f"{path} cannot be read: it must be an archive of a campaign.") from error
    return ArchiveRecord(found, files, manifest["campaign"])


def _entries(path: Path, archive: zipfile.ZipFile) -> dict[str, zipfile.ZipInfo]:
    """The entries by name, each a plain file within the folder."""
    entries: dict[str, zipfile.ZipInfo] = {}
    for entry in archive.infolist():
        name = entry.orig_filename
        if fault := _fault(name):
            raise StoreError(f"{path} contains {printable(name)[:80]!r}: {fault}.")
        if name in entries:
            raise StoreError(f"{path} contains {name!r} twice.")
        kind = stat.S_IFMT(entry.external_attr >> 16)
        if kind not in (0, stat.S_IFREG) or entry.is_dir():
            raise StoreError(f"{path} contains {name!r}, which is not a plain file.")
        # Of an archive that is not compressed no small file becomes a large one.
        stored = entry.compress_type == zipfile.ZIP_STORED and not entry.flag_bits & 0x1
        if not stored or entry.file_size != entry.compress_size:
            raise StoreError(f"{path} contains {name!r}, which is compressed or encrypted.")
        entries[name] = entry
    return entries


def _fault(name: str) -> str:
    """Why a name in an archive is rejected; empty if it is not."""
    parts = name.split("/")
    if name == MANIFEST_FILE:
        return ""
    if parts[0] not in (STORE, SCENE, RESULTS) or len(parts) < 2:
        return "its files are in store, scene or results"
    for part in parts[1:]:
        # The only hidden folder is that of a store.
        hidden = parts[0] == STORE and part == MANIFEST
        if not hidden and (fault := file_name_fault(part)):
            return f"each part of its name must be {fault}"
    return ""


def _manifest(
    path: Path, archive: zipfile.ZipFile, entries: Mapping[str, zipfile.ZipInfo]
) -> Record:
    entry = entries.get(MANIFEST_FILE)
    if entry is None or entry.file_size > LARGEST_MANIFEST:
        raise StoreError(f"{path} has no {MANIFEST_FILE}: it must be an archive of a campaign.")
    try:
        manifest = json.loads(archive.read(entry))
        form, campaign, files = (manifest[name] for name in ("archive", "campaign", "files"))
        good = isinstance(campaign, dict) and isinstance(files, dict)
    except (ValueError, LookupError, TypeError, RecursionError):
        form, good = None, False
    if not good:
        raise StoreError(f"{path}: {MANIFEST_FILE} cannot be read.")
    if form != FORM:
        raise StoreError(f"{path} has the format {form!r}: this version reads format {FORM}.")
    return manifest


def _listed(
    path: Path, manifest: Record, entries: Mapping[str, zipfile.ZipInfo]
) -> dict[str, tuple[int, str]]:
    """Size and checksum of each file, for exactly the files that are there."""
    files: dict[str, tuple[int, str]] = {}
    for name, entry in manifest["files"].items():
        match entry:
            case [int(size), str(sha)]:
                files[name] = size, sha
            case _:
                raise StoreError(f"{path}: {MANIFEST_FILE} has no checksum of {printable(name)!r}.")
    for name in sorted(set(files) ^ (set(entries) - {MANIFEST_FILE})):
        where = "is missing" if name in files else f"is not listed in {MANIFEST_FILE}"
        raise StoreError(f"{path}: {printable(name)!r} {where}.")
    return files


def _extract_one(
    path: Path, archive: zipfile.ZipFile, entry: zipfile.ZipInfo, target: Path, size: int, sha: str
) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    checksum = hashlib.sha256()
    written = 0
    with archive.open(entry) as source, open(target, "xb") as out:
        for data in _chunks(source):
            checksum.update(data)
            written += len(data)
            out.write(data)
    if written != size or checksum.hexdigest() != sha:
        raise StoreError(f"{path}: {entry.filename!r} does not match its checksum.")


def _chunks(source: IO[bytes]) -> Iterator[bytes]:
    while data := source.read(CHUNK):
        yield data
