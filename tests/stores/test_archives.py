"""Archives of campaigns: equal bytes, complete contents, and every change found."""

import hashlib
import json
import os
import shutil
import stat
import zipfile

import numpy as np
import pytest
from test_dispersion import drifts, last

from jaxspace.cli import main
from jaxspace.dispersion import Campaign, Normal, disperse, open_store
from jaxspace.stores import StoreError
from jaxspace.stores.archive import archive_store, check_archive, extract_archive


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """A store of 48 runs, with a foreign file in its folder."""
    path = tmp_path_factory.mktemp("store") / "drift.zarr"
    inputs = {"x0": Normal(1.0, 2.0), "v0": Normal(1.0, 0.5)}
    campaign = Campaign(drifts, inputs, last, {"x": "m"})
    notes = {"scene_file": "../a/drift.toml", "title": "Drift"}
    disperse(campaign, 48, seed=3, store=path, notes=notes)
    (path / "note.txt").write_text("of the user")
    return path


@pytest.fixture(scope="module")
def archive(store, tmp_path_factory):
    path = tmp_path_factory.mktemp("archive") / "drift.zip"
    archive_store(store, path)
    return path


def test_an_archive_has_the_whole_campaign_and_equal_bytes(store, archive, tmp_path):
    record = check_archive(archive)
    assert record.digest == hashlib.sha256(archive.read_bytes()).hexdigest()
    assert record.campaign["planned_runs"] == 48 and record.campaign["title"] == "Drift"
    assert {"results/runs.csv", "scene/drift.toml", "store/zarr.json"} <= set(record.files)
    assert not any("note.txt" in name for name in record.files)
    # Other times and permissions of the files do not matter.
    copy = tmp_path / "other.zarr"
    shutil.copytree(store, copy)
    os.utime(copy / "zarr.json", (1e9, 1e9))
    (copy / "zarr.json").chmod(0o600)
    assert archive_store(copy, tmp_path / "again.zip").digest == record.digest
    # Programs for archives of this kind read it.
    with zipfile.ZipFile(archive) as file:
        assert file.testzip() is None
        lines = file.read("results/runs.csv").decode().splitlines()
    assert len(lines) == 48 + 1


def test_an_archive_is_extracted_to_a_new_folder(store, archive, tmp_path):
    found = extract_archive(archive, tmp_path / "new")
    there = open_store(store)
    np.testing.assert_array_equal(found.outputs["x"], there.outputs["x"])
    np.testing.assert_array_equal(found.inputs["v0"], there.inputs["v0"])
    assert sorted(p.name for p in (tmp_path / "new").iterdir()) == ["results", "scene", "store"]
    with pytest.raises(StoreError, match="exists: an archive is extracted to a new folder"):
        extract_archive(archive, tmp_path / "new")
    with pytest.raises(StoreError, match="it must be 0000"):
        extract_archive(archive, tmp_path / "other", digest="0" * 64)
    assert [p.name for p in tmp_path.iterdir()] == ["new"]


def rewritten(archive, path, change):
    """A copy of an archive, whose entries `change` maps to others."""
    with zipfile.ZipFile(archive) as old, zipfile.ZipFile(path, "w") as new:
        for info in old.infolist():
            for name, data, how in change(info.filename, old.read(info)):
                entry = zipfile.ZipInfo(name)
                entry.external_attr = how.get("attributes", 0)
                new.writestr(entry, data, how.get("compression", zipfile.ZIP_STORED))
    return path


def changed_byte(name, data):
    if name == "results/runs.csv":
        data = data[:-2] + bytes([data[-2] ^ 1]) + data[-1:]
    return [(name, data, {})]


def left_out(name, data):
    return [] if name == "results/runs.csv" else [(name, data, {})]


def listed_as(path):
    """A file under another name, listed in the manifest with its checksum."""

    def change(name, data):
        if name == "results/runs.csv":
            return [(path, data, {})]
        if name == "manifest.json":
            manifest = json.loads(data)
            manifest["files"][path] = manifest["files"].pop("results/runs.csv")
            data = json.dumps(manifest).encode()
        return [(name, data, {})]

    return change


def with_new_checksum(name, data):
    """A changed number of the store with its new checksum in the manifest, but not in the store."""
    if name == "store/x/c/0":
        data = bytes(8) + data[8:]
    if name == "manifest.json":
        manifest = json.loads(data)
        size = manifest["files"]["store/x/c/0"][0]
        with_new_checksum.size = size
        manifest["files"]["store/x/c/0"] = [size, with_new_checksum.sha]
        data = json.dumps(manifest).encode()
    return [(name, data, {})]


CHANGES = {
    "a byte": (changed_byte, "'results/runs.csv' does not match its checksum"),
    "a file less": (left_out, "'results/runs.csv' is missing"),
    "a file more": (
        lambda n, d: [(n, d, {}), *([("results/a", b"", {})] * (n == "manifest.json"))],
        "'results/a' is not listed",
    ),
    "a parent": (listed_as("results/../../evil"), "must be text that does not begin with a dot"),
    "a root": (listed_as("/tmp/evil"), "its files are in store, scene or results"),
    "a drive": (listed_as("results/C:evil"), "must be one component of a path"),
    "a backslash": (listed_as("results\\..\\evil"), "its files are in store, scene or results"),
    "a hidden file": (listed_as("scene/.bashrc"), "must be text that does not begin with a dot"),
    "a device": (listed_as("scene/nul.txt"), "a name other than that of a Windows device"),
    "a link": (
        lambda n, d: [(n, d, {"attributes": (stat.S_IFLNK | 0o777) << 16})],
        "which is not a plain file",
    ),
    "compression": (
        lambda n, d: [(n, d, {"compression": zipfile.ZIP_DEFLATED})],
        "which is compressed or encrypted",
    ),
    "a manifest of lists": (
        lambda n, d: [(n, b"[]" if n == "manifest.json" else d, {})],
        "manifest.json cannot be read",
    ),
    "another form": (
        lambda n, d: [(n, d.replace(b'"archive": 1', b'"archive": 9'), {})],
        "has the format 9: this version reads format 1",
    ),
    "no manifest": (
        lambda n, d: [] if n == "manifest.json" else [(n, d, {})],
        "has no manifest.json",
    ),
}


@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.parametrize("what", CHANGES)
def test_changed_archives_are_refused_and_nothing_is_left(archive, tmp_path, what):
    change, sentence = CHANGES[what]
    path = rewritten(archive, tmp_path / "changed.zip", change)
    with pytest.raises(StoreError, match=sentence):
        check_archive(path)
    with pytest.raises(StoreError, match=sentence):
        extract_archive(path, tmp_path / "new")
    assert [p.name for p in tmp_path.iterdir()] == ["changed.zip"]


def test_a_change_with_a_new_checksum_is_found_in_the_store(archive, tmp_path):
    with zipfile.ZipFile(archive) as file:
        data = file.read("store/x/c/0")
    with_new_checksum.sha = hashlib.sha256(bytes(8) + data[8:]).hexdigest()
    path = rewritten(archive, tmp_path / "changed.zip", with_new_checksum)
    with pytest.raises(StoreError, match="x/c/0 does not match its checksum"):
        check_archive(path)


def test_files_that_are_no_archives(store, tmp_path):
    for name, data in (("empty", b""), ("text", b"PK\x03\x04 text"), ("cut", None)):
        path = tmp_path / name
        if data is None:
            archive_store(store, path)
            data = path.read_bytes()[:-40]
        path.write_bytes(data)
        with pytest.raises(StoreError, match="it must be an archive of a campaign"):
            check_archive(path)
    with pytest.raises(OSError, match="none"):
        check_archive(tmp_path / "none")


def test_stores_that_are_damaged_or_not_complete_are_not_archived(store, tmp_path):
    copy = tmp_path / "copy.zarr"
    shutil.copytree(store, copy)
    (copy / ".manifest" / "0.json").unlink()
    with pytest.raises(StoreError, match="has 0 of 1 chunks: the campaign must be complete"):
        archive_store(copy, tmp_path / "a.zip")
    shutil.copy(store / ".manifest" / "0.json", copy / ".manifest")
    data = bytearray((copy / "x" / "c" / "0").read_bytes())
    data[3] ^= 1
    (copy / "x" / "c" / "0").write_bytes(data)
    with pytest.raises(StoreError, match="does not match its checksum"):
        archive_store(copy, tmp_path / "a.zip")
    with pytest.raises(StoreError, match="results has the name"):
        archive_store(store, tmp_path / "a.zip", results={"../page.html": store / "note.txt"})
    assert not (tmp_path / "a.zip").exists()


@pytest.mark.usefixtures("settings_stay")
def test_the_command_writes_verifies_and_extracts(store, tmp_path, capsys):
    path = tmp_path / "drift.zip"
    assert main(["archive", str(store), "--out", str(path)]) == 0
    printed = capsys.readouterr().out
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    assert digest in printed and "Drift: 48 runs, seed 3" in printed
    words = ["archive", str(path), "--digest", digest, "--extract", str(tmp_path / "new")]
    assert main(words) == 0
    assert "match their checksums" in capsys.readouterr().out
    assert (tmp_path / "new" / "results" / "page.html").stat().st_size > 1000
    assert main(["archive", str(path), "--digest", "0" * 64]) == 2
    assert "it must be 0000" in capsys.readouterr().err
    assert main(["archive", str(tmp_path / "none.zip"), "--verify"]) == 2
    assert "none.zip cannot be read" in capsys.readouterr().err
    assert main(["archive", str(store), "--out", str(tmp_path / "no" / "a.zip")]) == 2
    assert "cannot be written" in capsys.readouterr().err
