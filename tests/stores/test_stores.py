"""Stores whose files are not those that a campaign has written: of another place, another content,
another kind, or another program. None is read as what it is not, and nothing outside is touched."""

import errno
import hashlib
import json
import os
import shutil
import socket
import warnings
from pathlib import Path

import numpy as np
import pytest
from test_campaigns import Killed, files_of, synthetic

from jaxspace.core.file_names import file_name_fault
from jaxspace.dispersion import DamagedStore, StoreError, open_store
from jaxspace.stores import _lock, writer
from jaxspace.stores._head import sealed
from jaxspace.stores.columns import columns_of
from jaxspace.stores.results import RunResults
from jaxspace.stores.writer import StoreWriter

RUNS, CHUNK = 45, 10
NAMES = ("rtol", "atol", "method", "description", "inputs", "samples")


def results(first, count, offset=0.0):
    """Runs whose values follow from their numbers, with a trajectory of two times."""
    a, b, status, evaluations, _ = synthetic(first, count)
    path = np.stack([a["a"], 2.0 * a["a"]])
    return RunResults({"a": a["a"] + offset}, b, status, evaluations, {"coast.x": path})


def complete(path, resume=False, chunks=None, offset=0.0, runs=RUNS, **options):
    """Write the missing chunks, or these, without anything that computes."""
    attributes = dict.fromkeys(NAMES, 0) | {"seed": 0, "planned_runs": runs, "chunk": CHUNK}
    attributes |= {"preparation_seconds": 1.0, "digest": str(offset)}
    with StoreWriter(path, resume=resume, **options) as open_writer:
        store = open_writer.prepare(columns_of(results(0, 1), {}), attributes)
        missing = open_writer.missing()[0]
        for chunk in missing if chunks is None else chunks:
            open_writer.commit(chunk, results(*store.extent(chunk), offset), 0.1, 0.1)
    return missing


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    path = tmp_path_factory.mktemp("whole") / "s.zarr"
    complete(path)
    return path


@pytest.fixture
def store(whole, tmp_path):
    """A copy of a store, to be damaged."""
    return Path(shutil.copytree(whole, tmp_path / "s.zarr"))


def snapshot(folder):
    """Every entry of a folder with its content, or with the end of a link."""
    found = {}
    for path in sorted(folder.rglob("*")):
        name = str(path.relative_to(folder))
        if path.is_symlink():
            found[name] = os.readlink(path)
        elif path.is_file():
            found[name] = path.read_bytes()
        else:
            found[name] = None
    return found


def read(store):
    """The runs that can be read, each checked, and the warnings of damage."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        kept = open_store(store)
        np.testing.assert_array_equal(kept.inputs["a"], kept.numbers)
        np.testing.assert_array_equal(kept.outputs["b"], 2.0 * kept.numbers)
    return kept, [str(w.message) for w in told if w.category is DamagedStore]


def head_of(store, change):
    """Write a head, and its copy with a right checksum, that `change` made of the one there."""
    root = json.loads((store / "zarr.json").read_bytes())
    root = change(root) or root
    data = json.dumps(root).encode()
    (store / "zarr.json").write_bytes(data)
    (store / ".manifest/head").write_bytes(sealed(data))


# ----------------------------------------------------------------------------- files out of place


def swapped(store, first, second):
    """Exchange two chunks, with their entries."""
    arrays = [p.parent / "c" for p in store.glob("*/zarr.json")]
    pairs = [(folder / str(first), folder / str(second)) for folder in arrays]
    pairs += [(store / f".manifest/{first}.json", store / f".manifest/{second}.json")]
    for one, other in pairs:
        one.rename(store / "aside")
        other.rename(one)
        (store / "aside").rename(other)


def test_swapped_chunks_are_not_read_into_each_other_s_rows(whole, store):
    swapped(store, 1, 3)
    kept, told = read(store)
    np.testing.assert_array_equal(kept.numbers, [*range(10), *range(20, 30), *range(40, 45)])
    assert ["Chunk 1 (runs 10 to 19)" in told[0], "Chunk 3 (runs 30 to 39)" in told[1]] == [
        True
    ] * 2
    assert "the entry of runs 30 to 39" in told[0]
    with pytest.warns(DamagedStore, match="the entry of runs"):
        assert complete_with_warnings(store) == [1, 3]
    assert files_of(store) == files_of(whole)


def complete_with_warnings(store):
    """As `disperse` does, which warns of each damage."""
    with StoreWriter(store, resume=True) as open_writer:
        for damage in open_writer.store.read() and open_writer.missing()[1]:
            warnings.warn(damage, DamagedStore, stacklevel=1)
    return complete(store, resume=True)


def duplicated(store):
    for array in store.glob("*/zarr.json"):
        shutil.rmtree(array.parent / "c/2", ignore_errors=True)
        source = array.parent / "c/1"
        copy = shutil.copytree if source.is_dir() else shutil.copyfile
        copy(source, array.parent / "c/2")
    shutil.copyfile(store / ".manifest/1.json", store / ".manifest/2.json")


def relabelled(store):
    """A chunk in the place of another one, with an entry that claims its runs."""
    duplicated(store)
    entry = json.loads((store / ".manifest/2.json").read_text())
    (store / ".manifest/2.json").write_text(json.dumps(entry | {"first": 20}))


def short(store):
    """The last chunk, which has fewer runs, in the place of another one."""
    swapped(store, 2, 4)


def one_array(store):
    """The file of one array in the place of another chunk, with its part of the entry."""
    shutil.copyfile(store / "b/c/1", store / "b/c/2")
    shutil.copyfile(store / "run/c/1", store / "run/c/2")
    one, two = (json.loads((store / f".manifest/{k}.json").read_text()) for k in (1, 2))
    two["files"] |= {name: one["files"][name] for name in ("b", "run")}
    (store / ".manifest/2.json").write_text(json.dumps(two))


def of_another_campaign(store):
    complete(store.parent / "other.zarr", offset=0.5)
    for name in ("a", "b", "run", "status", "evaluations", "coast.x"):
        source = store.parent / "other.zarr" / name / "c/2"
        target = store / name / "c/2"
        shutil.rmtree(target) if target.is_dir() else target.unlink()
        (shutil.copytree if source.is_dir() else shutil.copyfile)(source, target)
    shutil.copyfile(store.parent / "other.zarr/.manifest/2.json", store / ".manifest/2.json")


def truncated(store):
    """With an entry that agrees with what is left."""
    entry = json.loads((store / ".manifest/2.json").read_text())
    data = (store / "b/c/2").read_bytes()[:-8]
    (store / "b/c/2").write_bytes(data)
    entry["files"]["b"] = [len(data), hashlib.sha256(data).hexdigest()]
    (store / ".manifest/2.json").write_text(json.dumps(entry))


@pytest.mark.parametrize(
    "change", [duplicated, relabelled, short, one_array, of_another_campaign, truncated]
)
def test_a_chunk_counts_in_its_own_place_alone(change, whole, store):
    change(store)
    kept, told = read(store)
    assert told and not set(kept.numbers) & set(range(20, 30))
    assert 2 in complete(store, resume=True)
    assert files_of(store) == files_of(whole)
    assert read(store)[1] == []


# ---------------------------------------------------------------------------- JSON of other shapes

SHAPES = {
    "a list": "[]",
    "null": "null",
    "a number": "7",
    "a text": '"text"',
    "true": "true",
    "an empty object": "{}",
    "a list of objects": "[{}]",
    "deeply nested": "[" * 100_000,
    "objects in objects": '{"a":' * 100_000,
    "not JSON": "{,",
    "empty": "",
    "not UTF-8": b"\xff\xfe\x00",
    "not a number": "NaN",
    "a number without end": "9" * 10_000,
}
VALUES = [None, [], {}, "x", -1, 0.5, True, 10**400, float("nan"), [[[]]], {"a": {"b": []}}]


def content(shape):
    return SHAPES[shape] if isinstance(SHAPES[shape], bytes) else SHAPES[shape].encode()


@pytest.mark.parametrize("shape", SHAPES)
def test_an_entry_of_another_shape_does_not_count(shape, whole, store):
    (store / ".manifest/1.json").write_bytes(content(shape))
    assert read(store)[0].runs == RUNS - CHUNK
    assert complete(store, resume=True) == [1]
    assert files_of(store) == files_of(whole)


def test_an_entry_with_values_of_another_shape_does_not_count(store):
    path = store / ".manifest/1.json"
    entry = json.loads(path.read_text())
    changes = [(name, x) for name in entry if name not in ("pid",) for x in VALUES]
    changes = [(name, x) for name, x in changes if (name, x) != ("host", None)]
    changes += [("files", entry["files"] | {"b": x}) for x in VALUES]
    for name, x in changes:
        path.write_text(json.dumps(entry | {name: x}))
        kept, _ = read(store)
        # A number of seconds may be any.
        assert kept.runs == (RUNS if name.endswith("seconds") and x == 0.5 else RUNS - CHUNK)
    for name in entry:
        path.write_text(json.dumps({k: x for k, x in entry.items() if k != name}))
        assert read(store)[0].runs == (RUNS if name == "pid" else RUNS - CHUNK)


@pytest.mark.parametrize("shape", SHAPES)
def test_a_head_of_another_shape_is_refused(shape, store):
    data = content(shape)
    (store / "zarr.json").write_bytes(data)
    (store / ".manifest/head").write_bytes(sealed(data))
    before = snapshot(store)
    for use in (open_store, lambda s: complete(s, True), complete):
        with pytest.raises(StoreError, match="it must be the Zarr store of a dispersion"):
            use(store)
    with pytest.raises(StoreError, match="is not the store of a dispersion"):
        complete(store, overwrite=True)
    assert snapshot(store) == before


def test_a_head_with_values_of_another_shape_is_refused(store):
    """Whatever the library reads from it."""
    root = json.loads((store / "zarr.json").read_bytes())
    known = root["attributes"] | {"until": {"output": "b"}, "nominal": {"b": 1.0}, "times": [1.0]}
    known |= {"requirements": {"b": [None, 1.0]}, "by_purpose": {}, "versions": {"jax": "1"}}
    known |= {"machine": {"cores": 2}, "files": {"a": "b"}, "modules": {}, "enough_runs": 45}
    known |= {"numerical_errors": {"b": 1.0}, "scene_file": "x", "title": "x"}
    free = ("description", "inputs", "atol", "method", "digest", "form")
    for name in set(known) - set(free):
        for x in VALUES:
            head_of(store, lambda root, name=name, x=x: root["attributes"].update({name: x}))
            try:
                with warnings.catch_warnings():
                    # Some of them make another campaign, whose chunks these are not.
                    warnings.simplefilter("ignore", DamagedStore)
                    kept = open_store(store)
            except StoreError as error:
                assert "that no campaign writes" in str(error) or "enough_runs" in str(error)
            else:
                # Then nothing that is made of it fails.
                assert str(kept) and kept.warnings is not None and kept.ending is not None
                assert kept.requirements is not None and kept.cores >= 0
                assert kept.purpose is None or kept.purpose.sentence
            head_of(store, lambda _: json.loads(json.dumps(root)))
    for path in (["attributes"], ["consolidated_metadata"], ["consolidated_metadata", "metadata"]):
        for x in VALUES:

            def put(root, path=path, x=x):
                inner = root
                for key in path[:-1]:
                    inner = inner[key]
                inner[path[-1]] = x

            head_of(store, put)
            with pytest.raises(StoreError, match="its head"):
                open_store(store)
            head_of(store, lambda _: json.loads(json.dumps(root)))
    array = root["consolidated_metadata"]["metadata"]["b"]
    for key in ("shape", "data_type", "dimension_names", "attributes"):
        for x in (*VALUES, [1, 2], ["run"] * 3, [-1], [10**30], "object", "V9", "S9", "complex128"):

            def change(root, key=key, x=x):
                root["consolidated_metadata"]["metadata"]["b"] = array | {key: x}

            head_of(store, change)
            with pytest.raises(StoreError, match="an array 'b' that no campaign writes"):
                open_store(store)
            head_of(store, lambda _: json.loads(json.dumps(root)))


@pytest.mark.parametrize("shape", SHAPES)
def test_a_lock_of_another_shape_is_nobody_s(shape, store):
    (store / ".lock").write_bytes(content(shape))
    assert complete(store, resume=True) == []
    assert (store / ".lock").read_bytes() == b""


def test_a_lock_with_values_of_another_shape_is_nobody_s(store):
    owner = {"pid": 1, "host": socket.gethostname(), "since": "yesterday"}
    for name in owner:
        for x in [x for x in (*VALUES, "\x1b[31m") if type(x) is not type(owner[name]) or x != "x"]:
            if name == "pid" and isinstance(x, int) and not isinstance(x, bool):
                continue
            (store / ".lock").write_text(json.dumps(owner | {name: x}))
            with StoreWriter(store, resume=True) as opened:
                assert not opened.lock.stale or name != "host"


# ------------------------------------------------------------------------------ names and links

BAD_NAMES = [
    *(
        "../../home",
        "..",
        ".",
        "",
        "/abs",
        "a/b",
        "a/../../../x",
        "./a",
        "a/",
        ".manifest",
        ".lock",
    ),
    *("..\\..\\home", "C:\\x", "C:x", "a\\b", "a:b", "NUL", "con", "Aux.x", "com1", "LPT9.txt"),
    *("a\0b", "a\nb", "\x1b[31m", "x" * 256, "é" * 128, "a.", "a ", "\ud800", "zarr.json/x"),
]


def test_names_are_one_component_of_a_path():
    for name in (*BAD_NAMES, None, 3, ["a"]):
        assert file_name_fault(name), name
    for name in (
        "b",
        "initial.orbit.eccentricity",
        "Höhe über Grund",
        "P(x < 3)",
        "context",
        "x" * 255,
    ):
        assert file_name_fault(name) == "", name


@pytest.mark.parametrize("name", BAD_NAMES)
def test_a_forged_name_is_refused_before_anything_is_written(name, store, tmp_path):
    """Also an absolute path in the folder of the test, where it can be seen."""
    for named in (name, str(tmp_path / "victim")):

        def forge(root, named=named):
            arrays = root["consolidated_metadata"]["metadata"]
            arrays[named] = arrays["b"]

        head_of(store, forge)
        before = snapshot(tmp_path)
        for use in (open_store, lambda s: complete(s, True), complete):
            with pytest.raises(StoreError, match="has an array named"):
                use(store)
        assert snapshot(tmp_path) == before
    # It may be replaced: nothing but what a store has is removed for it.
    (tmp_path / "home").mkdir()
    (tmp_path / "home/zarr.json").write_text("mine")
    complete(store, overwrite=True)
    assert (tmp_path / "home/zarr.json").read_text() == "mine"
    assert open_store(store).runs == RUNS


@pytest.mark.parametrize("name", BAD_NAMES)
def test_a_store_with_such_a_name_is_not_written(name, tmp_path):
    given = results(0, 1)._replace(outputs={name: np.zeros(1)})
    with pytest.raises(StoreError, match="cannot be stored"):
        columns_of(given, {})


LINKS = ["zarr.json", ".manifest", ".manifest/head", ".manifest/2.json", "b", "b/zarr.json", "b/c"]
LINKS += ["b/c/2", "coast.x/c/2", "coast.x/c/2/0", ".lock", "extra", ".unfinished-7-x", "b/extra"]


@pytest.mark.parametrize("name", LINKS)
@pytest.mark.parametrize("target", ["its copy", "a victim", "nothing", "a folder"])
def test_nothing_is_written_through_a_link(name, target, store, tmp_path):
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "victim").write_text("precious")
    (outside / "folder").mkdir()
    (outside / "folder/2").write_text("precious")
    path, end = store / name, outside / "victim"
    if target == "its copy" and path.exists():
        end = outside / "moved"
        path.rename(end)
    elif path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
    end = {"nothing": outside / "none", "a folder": outside / "folder"}.get(target, end)
    path.symlink_to(end)
    before = snapshot(outside)
    for options in ({"resume": True}, {"overwrite": True}, {}):
        with pytest.raises(StoreError):
            complete(store, **options)
        assert snapshot(outside) == before
        assert path.is_symlink()
    # Nor is it read: what lies behind it does not count.
    if name not in ("zarr.json", ".manifest", ".manifest/head"):
        kept, _ = read(store)
        assert kept.runs in (RUNS, RUNS - CHUNK, 0)
    assert snapshot(outside) == before


def test_the_path_of_a_store_may_be_a_link(store, tmp_path):
    """It is the user's: a store often lies on another disk."""
    (tmp_path / "link.zarr").symlink_to(store)
    (store / ".manifest/1.json").unlink()
    assert complete(tmp_path / "link.zarr", resume=True) == [1]
    assert open_store(tmp_path / "link.zarr").runs == RUNS
    complete(tmp_path / "link.zarr", overwrite=True, chunks=[0])
    assert open_store(store).runs == CHUNK and (tmp_path / "link.zarr").is_symlink()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="Windows has no such pipes")
@pytest.mark.parametrize("name", [*LINKS[:1], *LINKS[2:4], *LINKS[5:6], "b/c/2", ".lock", "extra"])
def test_a_pipe_in_a_store_is_not_waited_for(name, store):
    (store / name).unlink(missing_ok=True)
    os.mkfifo(store / name)
    with pytest.raises(StoreError, match="neither a file nor a folder|pipe or device"):
        complete(store, resume=True)
    assert read(store)[0].runs in (RUNS, RUNS - CHUNK)


def test_a_lock_that_is_a_second_name_of_a_file_is_left_alone(store, tmp_path):
    (tmp_path / "victim").write_text("precious")
    (store / ".lock").unlink()
    os.link(tmp_path / "victim", store / ".lock")
    with pytest.raises(StoreError, match="hard link to another file"):
        complete(store, resume=True)
    assert (tmp_path / "victim").read_text() == "precious"


def test_nothing_is_repaired_in_the_store_of_another_campaign(store):
    head = json.loads((store / "b/zarr.json").read_bytes())
    (store / "b/zarr.json").write_text(json.dumps(head | {"shape": [7]}))
    (store / "zarr.json").write_text("{}")
    (store / ".unfinished-7-x").write_text("")
    before = snapshot(store)
    with pytest.raises(StoreError, match="another campaign"):
        complete(store, resume=True, offset=0.5)
    assert snapshot(store) == before
    with pytest.warns(DamagedStore):
        complete(store, resume=True)
    assert read(store)[1] == [] and not (store / ".unfinished-7-x").exists()


def test_arrays_of_another_type_are_another_campaign(store):
    """They would take the runs that are written next in another precision."""

    def halved(root):
        root["consolidated_metadata"]["metadata"]["b"]["data_type"] = "float16"

    head_of(store, halved)
    with pytest.raises(StoreError, match="its array 'b' differs"):
        complete(store, resume=True)


# ------------------------------------------------------------------------------------ replacement


def group(path):
    """A Zarr group of another program, with a folder that has no array."""
    import zarr

    root = zarr.create_group(path, attributes={"seed": 1, "chunk": 2, "form": "x"})
    root.create_array("b", shape=(3,), dtype="f8")[:] = 1.0
    (path / "notes").mkdir()
    (path / "notes/letter.txt").write_text("dear")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        zarr.consolidate_metadata(path)


def unreadable(path):
    """A store whose head cannot be read, nor its copy."""
    complete(path)
    (path / "zarr.json").write_text("{}")
    (path / ".manifest/head").write_text("{}")


def hidden(path):
    """A folder with what other programs leave."""
    (path / ".git").mkdir(parents=True)
    (path / ".git/config").write_text("precious")
    (path / ".lock").write_text("of another program")
    (path / ".unfinished-symphony").write_text("precious")


@pytest.mark.parametrize("make", [group, unreadable, hidden])
@pytest.mark.parametrize("options", [{}, {"overwrite": True}, {"resume": True}])
def test_what_is_not_a_store_is_left_alone(make, options, tmp_path):
    path = tmp_path / "s.zarr"
    make(path)
    before = snapshot(tmp_path)
    with pytest.raises(StoreError):
        complete(path, **options)
    assert snapshot(tmp_path) == before


def test_files_of_the_user_in_a_store_outlive_it(store):
    (store / "notes").mkdir()
    (store / "notes/letter.txt").write_text("dear")
    (store / "letter.txt").write_text("dear")
    (store / "b/letter.txt").write_text("dear")
    complete(store, overwrite=True, offset=0.0)
    for name in ("notes/letter.txt", "letter.txt", "b/letter.txt"):
        assert (store / name).read_text() == "dear"
    assert read(store)[0].runs == RUNS
    (store / "c").mkdir()
    refused = pytest.raises(StoreError, match="contains 'c'")
    with refused, StoreWriter(store, overwrite=True) as opened:
        new = results(0, 1)._replace(outputs={"c": np.zeros(1)})
        opened.prepare(columns_of(new, {}), {"planned_runs": 8, "chunk": 4, "seed": 0})
    assert read(store)[0].runs == RUNS


class Lost(Exception):
    """The scheduler, as an example."""


@pytest.mark.parametrize("resumed", [False, True])
def test_a_campaign_that_does_not_begin_leaves_the_old_store(resumed, store, monkeypatch):
    before = snapshot(store)
    with pytest.raises(Lost), StoreWriter(store, overwrite=True, resume=resumed) as opened:
        opened.prepare(columns_of(results(0, 1), {}), {"planned_runs": 8, "chunk": 4, "seed": 0})
        assert read(store)[0].runs == RUNS
        raise Lost
    assert snapshot(store) == before
    usage = type("Usage", (), {"free": 10**6})
    monkeypatch.setattr(writer.shutil, "disk_usage", lambda path: usage)
    with pytest.raises(StoreError, match="its disk has 1 MB"):
        complete(store, overwrite=True)
    monkeypatch.undo()
    assert snapshot(store) == before

    def full(path, data):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))

    monkeypatch.setattr(writer, "write_whole", full)
    with pytest.raises(StoreError, match=r"No space left on device\): the store is unchanged"):
        complete(store, overwrite=True)
    assert snapshot(store) == before


def test_a_store_is_replaced_as_a_whole_whatever_ends_it(tmp_path, monkeypatch):
    """At every single change of the disk: one of both is there, and the next call completes it."""
    monkeypatch.setattr("jaxspace.stores._head.PATIENCE", 0.0)
    whole, runs = tmp_path / "whole", CHUNK + 1
    complete(whole, runs=runs)
    changes = (
        *((os, name) for name in ("replace", "link", "unlink", "rmdir", "mkdir")),
        *((Path, name) for name in ("unlink", "rmdir", "mkdir")),
    )
    ended = False
    seen = set()
    for moment in range(10_000):
        path = Path(shutil.copytree(whole, tmp_path / str(moment)))
        left = iter(range(moment))

        def dying(change, left=left):
            def changed(*given, **options):
                if next(left, None) is None:
                    raise Killed
                return change(*given, **options)

            return changed

        with monkeypatch.context() as context:
            for place, name in changes:
                context.setattr(place, name, dying(getattr(place, name)))
            try:
                complete(path, overwrite=True, offset=0.5, chunks=[0], runs=runs)
                ended = True
            except (Killed, StoreError):
                pass
        if ended:
            break
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DamagedStore)
            kept = open_store(path)
            (offset,) = {*(kept.inputs["a"] - kept.numbers)}
            assert kept.runs == (CHUNK if offset else runs), moment
            seen.add(offset)
            complete(path, resume=True, offset=offset, runs=runs)
        kept = open_store(path)
        assert {*(kept.inputs["a"] - kept.numbers)} == {offset} and kept.runs == runs
        assert {x.name for x in path.iterdir()} == {x.name for x in whole.iterdir()}, moment
    assert seen == {0.0, 0.5}


def test_hosts_stage_a_store_together(store):
    """The old store is there until one of them publishes the new one, with the chunks of both."""
    attributes = dict.fromkeys(NAMES, 0) | {"seed": 0, "planned_runs": 30, "chunk": CHUNK}
    given = columns_of(results(0, 1), {}), attributes | {"preparation_seconds": 1.0, "digest": "d"}
    with StoreWriter(store, overwrite=True) as first:
        first.prepare(*given)
        second = StoreWriter(store, overwrite=True)
        second.join(*given)
        first.host, second.host = 0, 1
        second.commit(1, results(10, 10), 0.1, 0.1)
        first.commit(0, results(0, 10), 0.1, 0.1)
        assert read(store)[0].runs == RUNS
        first.publish()
        second.write_to_path()
        second.commit(2, results(20, 10), 0.1, 0.1)
    assert read(store)[0].runs == 30


# ---------------------------------------------------------------------------- what is left behind


@pytest.mark.parametrize("before", ["nothing", "a lock", "an empty folder"])
def test_a_folder_that_holds_no_runs_does_not_stay(before, tmp_path):
    path = tmp_path / "s.zarr"
    if before != "nothing":
        path.mkdir()
    if before == "a lock":
        (path / ".lock").write_text("")
    with pytest.raises(Lost), StoreWriter(path) as opened:
        opened.prepare(columns_of(results(0, 1), {}), {"planned_runs": 8, "chunk": 4, "seed": 0})
        raise Lost
    # An empty folder that was there is the user's.
    assert list(tmp_path.rglob("*")) == ([path] if before == "an empty folder" else [])
    with pytest.raises(StoreError, match="there is nothing to resume"):
        complete(path, resume=True)
    assert list(tmp_path.rglob("*")) == ([path] if before == "an empty folder" else [])


def test_a_writer_that_waits_for_a_folder_that_goes_makes_its_own(tmp_path, monkeypatch):
    """Its lock is no longer at its path."""
    path = tmp_path / "s.zarr"
    lock, gone = _lock._lock, []

    def locked(handle):
        if not gone:
            gone.append(True)
            shutil.rmtree(path)
        return lock(handle)

    monkeypatch.setattr(_lock, "_lock", locked)
    complete(path)
    assert read(path)[0].runs == RUNS


@pytest.mark.parametrize("name", ["a\0b", "x" * 300, "file/s.zarr", "file"])
def test_a_path_that_cannot_be_is_refused_in_a_sentence(name, tmp_path):
    (tmp_path / "file").write_text("")
    for use in (complete, open_store):
        with pytest.raises(StoreError, match="cannot be written|is not a folder"):
            use(str(tmp_path / name))
