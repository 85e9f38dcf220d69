"""Faults as they happen, and not as a test would imitate them: a disk that is full or read-only,
two processes on one store, signals at random moments. After each the store is completed, and equals
that of a campaign that nothing has disturbed, to the last bit."""

import contextlib
import os
import random
import shutil
import signal
import subprocess
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from test_campaign_commands import COAST, LONG, LONG_CHUNK, stopped
from test_campaigns import (
    CAMPAIGN,
    RUNS,
    child,
    files_of,
    fly,
    resumed,
    whole,  # noqa: F401
)

from jaxspace.dispersion import DamagedStore, StoreError, disperse, open_store
from jaxspace.io import load

FOUND: list[int] = []
"""The runs in the stores of campaigns that a signal met in flight."""


@contextlib.contextmanager
def small_disk(path: Path, size: str) -> Iterator[Path]:
    """A disk of this size at the path; the test is skipped where none may be mounted."""
    path.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(path)]
    try:
        done = subprocess.run(command, capture_output=True)
    except FileNotFoundError:
        pytest.skip("there is no command to mount a disk")
    if done.returncode:
        pytest.skip("no disk may be mounted here")
    try:
        yield path
    finally:
        subprocess.run(["umount", "-l", str(path)], check=True)


def fill(path: Path) -> None:
    """Write until nothing more fits."""
    with open(path, "wb", buffering=0) as file, contextlib.suppress(OSError):
        while True:
            file.write(bytes(4096))


@pytest.mark.parametrize("after", [1, pytest.param(2, marks=pytest.mark.sweep), 3])
def test_a_disk_that_is_full(whole, tmp_path, after):  # noqa: F811
    with small_disk(tmp_path / "disk", "24m") as disk:
        seen = []

        def filled(done, total):
            seen.append(done)
            if len(seen) == after:
                fill(disk / "ballast")

        with pytest.raises(StoreError, match=r"No space left on device.*runs are stored"):
            fly(disk / "s.zarr", progress=filled)
        kept = open_store(disk / "s.zarr").runs
        assert kept == seen[after - 1]
        # As long as it is full nothing is lost by a further attempt.
        with pytest.raises(StoreError, match="needs|cannot be written"):
            fly(disk / "s.zarr", resume=True)
        (disk / "ballast").unlink()
        assert resumed(disk / "s.zarr") == 5 - after
        assert files_of(disk / "s.zarr") == files_of(whole)


def test_a_disk_that_is_read_only(whole, tmp_path):  # noqa: F811
    with small_disk(tmp_path / "disk", "24m") as disk:

        def stop(done, total):
            raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            fly(disk / "s.zarr", progress=stop)
        subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)
        for store, options in (("s.zarr", {"resume": True}), ("other.zarr", {})):
            with pytest.raises(StoreError, match="cannot be written .Read-only file system."):
                fly(disk / store, **options)
        # Reading needs no lock.
        assert open_store(disk / "s.zarr").runs == 512
        subprocess.run(["mount", "-o", "remount,rw", str(disk)], check=True)
        assert resumed(disk / "s.zarr") == 4
        assert files_of(disk / "s.zarr") == files_of(whole)


LIMITED = """
import resource, sys
from test_campaigns import fly
from jaxspace.dispersion import StoreError
# Arrays of a chunk are 4100 bytes, the head of the store is larger.
def seen(done, total):
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, resource.RLIM_INFINITY))
try:
    fly(sys.argv[1], progress=seen)
except StoreError as error:
    print(error)
"""


@pytest.mark.sweep
def test_a_file_that_may_not_grow(whole, tmp_path):  # noqa: F811
    """As of a quota, also where no disk can be mounted."""
    process = child(LIMITED, tmp_path / "s.zarr")
    told, errors = process.communicate()
    assert "File too large" in told and "512 of 2200 runs are stored" in told, errors
    assert resumed(tmp_path / "s.zarr") == 4
    assert files_of(tmp_path / "s.zarr") == files_of(whole)


@pytest.mark.sweep
@pytest.mark.parametrize("part", range(3))
def test_two_campaigns_at_once(whole, tmp_path, part):  # noqa: F811
    """One of them writes the store, the other is told whose it is; which is left to chance."""
    code = """
import sys
from test_campaigns import fly
from jaxspace.dispersion import StoreError
try:
    print(fly(sys.argv[1]).runs)
except StoreError as error:
    print(error)
"""
    processes = [child(code, tmp_path / "s.zarr") for _ in range(2)]
    told = [process.communicate()[0] for process in processes]
    winners = [text for text in told if text.strip() == str(RUNS)]
    (loser,) = [text for text in told if text.strip() != str(RUNS)]
    pids = {str(process.pid) for process in processes}
    assert len(winners) == 1 and (
        any(f"in use by process {pid}" in loser for pid in pids) or "already contains" in loser
    )
    assert files_of(tmp_path / "s.zarr") == files_of(whole)


def test_chunks_that_changed_places_are_computed_again(whole, tmp_path):  # noqa: F811
    store = tmp_path / "s.zarr"
    shutil.copytree(whole, store)
    pairs = (
        [store / f".manifest/{k}.json" for k in (1, 3)],
        *(
            [folder / "c" / str(k) for k in (1, 3)]
            for folder in store.glob("[!.]*")
            if folder.is_dir()
        ),
    )
    for one, other in pairs:
        one.rename(store / "aside")
        other.rename(one)
        (store / "aside").rename(other)
    with pytest.warns(DamagedStore, match="has the entry of runs"):
        kept = open_store(store)
    np.testing.assert_array_equal(kept.outputs["x"], fly().outputs["x"][kept.numbers])
    assert kept.runs == RUNS - 2 * 512
    assert resumed(store) == 2
    assert files_of(store) == files_of(whole)


# Connecting is tried for 30 s.
@pytest.mark.sweep
@pytest.mark.filterwarnings("ignore")
def test_a_store_outlives_a_campaign_without_a_scheduler(whole, tmp_path):  # noqa: F811
    pytest.importorskip("distributed")
    store = tmp_path / "s.zarr"
    shutil.copytree(whole, store)
    for path in (store, tmp_path / "new.zarr"):
        with pytest.raises(StoreError, match="The Dask cluster at tcp://127.0.0.1:9 failed"):
            fly(path, overwrite=True, engine="tcp://127.0.0.1:9")
    assert open_store(store).runs == RUNS and files_of(store) == files_of(whole)
    assert not (tmp_path / "new.zarr").exists()


@pytest.fixture(scope="module")
def coast(tmp_path_factory):
    """The campaign of the coast, and its store, which nothing has disturbed."""
    folder = tmp_path_factory.mktemp("undisturbed")
    (folder / "coast.toml").write_text(COAST)
    file = load(folder / "coast.toml")
    campaign = file.campaign(warn=False, runs=LONG)

    def complete(store: Path, resume: bool) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DamagedStore)
            how = {"seed": 3, "chunk": LONG_CHUNK, "accuracy": file.accuracy, "resume": resume}
            disperse(campaign, LONG, store=store, **how)

    complete(folder / "coast.zarr", False)
    return complete, files_of(folder / "coast.zarr")


@pytest.mark.sweep
@pytest.mark.parametrize(
    "number, part",
    [(number, k) for number in (signal.SIGINT, signal.SIGKILL, signal.SIGTERM) for k in range(20)],
)
def test_a_signal_at_a_random_moment(coast, tmp_path, number, part):
    """Every fourth while the campaign is compiled, the others within a chunk of the flight, which
    takes a few milliseconds."""
    chance = random.Random(part)
    if part % 4 == 0:
        store = stopped(tmp_path, number, None, chance.uniform(0.0, 4.0))
    else:
        last = LONG // LONG_CHUNK // 2
        store = stopped(tmp_path, number, chance.randint(0, last), chance.uniform(0.0, 0.005))
        with warnings.catch_warnings():
            # Where it ended between the metadata and their copy.
            warnings.simplefilter("ignore", DamagedStore)
            FOUND.append(open_store(store).runs)
        assert 0 < FOUND[-1] <= LONG
    complete, expected = coast
    complete(store, (store / ".manifest" / "head").exists())
    assert files_of(store) == expected
    assert not list(store.rglob(".unfinished*"))


def test_most_signals_met_a_flight():
    """On a busy machine some come late: then the campaign has ended."""
    if len(FOUND) < 20:
        pytest.skip("too few signals were sent")
    assert sum(runs < LONG for runs in FOUND) > 0.7 * len(FOUND)


def test_a_folder_that_may_not_be_written(tmp_path):
    folder = tmp_path / "closed"
    folder.mkdir(mode=0o555)
    if os.access(folder, os.W_OK):
        pytest.skip("this user may write everywhere")
    with pytest.raises(StoreError, match="cannot be written .Permission denied."):
        disperse(CAMPAIGN, 100, store=folder / "s.zarr")
