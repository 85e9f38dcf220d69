"""Campaigns that several tasks compute in parts, without knowing of each other."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from test_campaign_commands import COAST
from test_campaigns import CAMPAIGN, CHUNK, RUNS, SEED, fly

from jaxspace.cli import main
from jaxspace.core import InputError
from jaxspace.dispersion import Part, StopRule, StoreError, disperse, open_store
from jaxspace.stores.part_writer import PartWriter, unfinished_parts
from jaxspace.stores.store import Store
from jaxspace.stores.writer import StoreWriter

ROOT = Path(__file__).resolve().parents[2]


def part(store, number, parts=3, **options):
    return fly(store, engine=Part(number, parts), **options)


def same(a, b):
    """Two campaigns have the same runs, to the last bit."""
    np.testing.assert_array_equal(a.run_numbers, b.run_numbers)
    for name in ("w", "x0", "x", "v"):
        np.testing.assert_array_equal(a.values(name), b.values(name))


def test_parts_in_any_order_give_the_runs_of_one_campaign(tmp_path):
    """The last one returns all of them; no part computes a chunk of another one."""
    store = tmp_path / "parts.zarr"
    first = part(store, 2)
    # Chunks 1 and 4 of five.
    np.testing.assert_array_equal(first.run_numbers, [*range(512, 1024), *range(2048, RUNS)])
    assert unfinished_parts(Store(store).read(), 3) == [1, 3]
    assert part(store, 3).runs == first.runs + CHUNK
    same(part(store, 1), fly())
    same(open_store(store), fly())
    # Nothing is left to compute, and a plain campaign may continue with the store.
    before = sorted((p, p.stat().st_mtime_ns) for p in store.rglob("*/c/*") if p.is_file())
    same(part(store, 2), fly())
    same(fly(store, resume=True), fly())
    assert before == sorted((p, p.stat().st_mtime_ns) for p in store.rglob("*/c/*") if p.is_file())


def test_each_part_has_a_chunk(tmp_path):
    assert Part(1, 40).chunk(20_000, 8192) == 500 and Part(1, 2).chunk(200_000, 8192) == 8192
    # A part without a chunk, as of more tasks than there are calls of 512 runs.
    assert part(tmp_path / "few.zarr", 9, 9, runs=600).runs == 0


def test_a_damaged_chunk_is_computed_again_by_its_part(tmp_path):
    store = tmp_path / "parts.zarr"
    for number in (1, 2, 3):
        part(store, number)
    (store / "x" / "c" / "1").write_bytes(b"nothing")
    with pytest.warns(UserWarning, match="Chunk 1"):
        same(part(store, 2), fly())


def test_two_tasks_do_not_compute_the_same_part(tmp_path):
    """Nor does another process write the store meanwhile; tasks of other parts do."""
    store = tmp_path / "parts.zarr"
    part(store, 1)
    with PartWriter(store, 2, 3):
        with pytest.raises(StoreError, match=r"^Part 2 of 3 of .*parts\.zarr is in use by process"):
            part(store, 2)
        for how in ({"resume": True}, {"overwrite": True}):
            with pytest.raises(StoreError, match="is in use"):
                fly(store, **how)
        part(store, 3)
    with StoreWriter(store, resume=True), pytest.raises(StoreError, match="is in use by process"):
        part(store, 2)
    same(part(store, 2), fly())


def test_what_concerns_the_whole_campaign_is_rejected(tmp_path):
    store = tmp_path / "parts.zarr"
    with pytest.raises(InputError, match="^store is missing: several processes share"):
        fly(engine=Part(1, 2))
    with pytest.raises(InputError, match="^until is given, and the campaign is computed in parts"):
        part(store, 1, until=StopRule("x"))
    for name in ("overwrite", "resume"):
        with pytest.raises(InputError, match=f"^{name} is True, and the campaign is computed in p"):
            part(store, 1, **{name: True})
    for numbers in ((0, 3), (4, 3), (True, 3), (1, 0)):
        with pytest.raises(InputError, match="^part is .* of .*: it must be a whole number from 1"):
            Part(*numbers)
    assert not store.exists()


def test_a_part_of_another_campaign_is_rejected(tmp_path):
    store = tmp_path / "parts.zarr"
    part(store, 1)
    there = sorted(store.rglob("*"))
    with pytest.raises(StoreError, match="is the store of another campaign: the number of runs"):
        part(store, 2, runs=RUNS + 100)
    with pytest.raises(StoreError, match="is the store of another campaign: the seed: 11 in the"):
        disperse(CAMPAIGN, RUNS, seed=SEED + 1, chunk=CHUNK, store=store, engine=Part(2, 3))
    assert sorted(store.rglob("*")) == there
    other = tmp_path / "other"
    other.mkdir()
    (other / "notes.txt").write_text("mine")
    with pytest.raises(StoreError, match="contains 'notes.txt' and is not the store of a disp"):
        part(other, 1)
    assert (other / "notes.txt").read_text() == "mine"


# Without a run that is rejected for a negative eccentricity.
SCENE = (
    COAST.partition("[dispersion]")[0]
    + """
[dispersion]
runs = 2000
seed = 3
outputs = ["periapsis_altitude"]

[dispersion.inputs]
"initial.orbit.eccentricity" = { distribution = "uniform", low = 0.05, high = 0.15 }
"""
)


@pytest.mark.usefixtures("settings_stay")
def test_commands_of_an_array_job(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "coast.toml").write_text(SCENE)
    assert main(["disperse", "coast.toml", "--part", "1/2"]) == 0
    out = capsys.readouterr().out
    assert "part 1 of 2 is finished: 1024 of 2000 runs are in out/coast.zarr." in out
    assert "Unfinished parts: 2." in out and not (tmp_path / "out" / "coast.png").exists()
    assert main(["disperse", "coast.toml", "--part", "2/2"]) == 0
    assert "2000 of 2000 runs succeeded." in capsys.readouterr().out
    assert (tmp_path / "out" / "coast.html").exists()
    for text in ("0/2", "3/2", "2", "1/x", "1/2/3", "²/3"):
        with pytest.raises(SystemExit, match="2"):
            main(["disperse", "coast.toml", "--part", text])
        assert f"it is {text}: it must be the number of a part" in capsys.readouterr().err
    assert main(["disperse", "coast.toml", "--part", "1/2", "--engine", "dask"]) == 2
    assert "each part is computed by the local engine" in capsys.readouterr().err


def started(folder, number):
    command = [sys.executable, "-m", "jaxspace.cli", "disperse", "coast.toml"]
    command += ["--chunk", "512"]
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    return subprocess.Popen(
        [*command, "--part", f"{number}/2"],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": path},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.mark.slow
def test_a_task_that_is_ended_is_started_again_beside_another_one(tmp_path, capsys, monkeypatch):
    """As a scheduler does at the time limit: by SIGTERM, then by SIGKILL."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "coast.toml").write_text(SCENE.replace("runs = 2000", "runs = 2000000"))
    store = tmp_path / "out" / "coast.zarr"
    for number in (signal.SIGTERM, signal.SIGKILL):
        there = len(list(store.glob(".manifest/*.json")))
        task = started(tmp_path, 1)
        while len(list(store.glob(".manifest/*.json"))) < there + 2 and task.poll() is None:
            time.sleep(0.01)
        task.send_signal(number)
        _, error = task.communicate()
        if number == signal.SIGTERM:
            assert task.returncode == 130
            assert re.search(
                r"stopped: \d+ of 2000000 runs are stored in out/coast.zarr. The same ", error
            )
    kept = {p: p.stat().st_mtime_ns for p in store.glob(".manifest/*.json")}
    assert kept
    # Few enough runs to end: those of another campaign.
    (tmp_path / "coast.toml").write_text(SCENE.replace("runs = 2000", "runs = 30000"))
    os.rename(store, tmp_path / "other.zarr")
    tasks = [started(tmp_path, number) for number in (1, 2)]
    texts = [task.communicate()[0] for task in tasks]
    assert [task.returncode for task in tasks] == [0, 0]
    assert sum("30000 of 30000 runs succeeded" in text for text in texts) >= 1
    result = open_store(store)
    assert result.runs == 30000 and unfinished_parts(Store(store).read(), 2) == []


def has_slurm() -> bool:
    """Whether a batch system with a node that accepts jobs is on this machine."""
    if not shutil.which("sinfo"):
        return False
    nodes = subprocess.run(["sinfo", "-h", "-o", "%T"], capture_output=True, text=True)
    return "idle" in nodes.stdout


@pytest.mark.sweep
@pytest.mark.skipif(not has_slurm(), reason="no SLURM with an idle node on this machine")
def test_the_script_of_the_manual_runs_on_slurm(tmp_path):
    page = (ROOT / "docs" / "howto" / "clusters.md").read_text()
    (script,) = re.findall(r'title="campaign.sh"}\n(.*?)^```', page, re.DOTALL | re.MULTILINE)
    (tmp_path / "campaign.sh").write_text(script.replace("20000", "4000"))
    shutil.copy(ROOT / "examples" / "scenes" / "kick_stage.toml", tmp_path)
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    env = {**os.environ, "PATH": path, "PYTHONPATH": str(ROOT)}
    subprocess.run(["sbatch", "--wait", "campaign.sh"], cwd=tmp_path, env=env, check=True)
    texts = [(tmp_path / f"part_{k}.log").read_text() for k in range(1, 5)]
    assert sum("4000 of 4000 runs succeeded" in text for text in texts) == 1
    assert (tmp_path / "out" / "kick_stage.html").exists()


def test_no_folder_remains_where_nothing_is_stored(tmp_path):
    """A part that stops before its first chunk removes the files of its locks, and so does a
    campaign that finds those of an earlier part."""
    store = tmp_path / "none" / "parts.zarr"
    with PartWriter(store, 1, 2):
        with PartWriter(store, 2, 2):
            pass
        assert (store / ".lock").exists()
    assert store.parent.exists() and not store.exists()
    store.mkdir()
    for name in (".lock", ".turn"):
        (store / name).touch()
    with StoreWriter(store):
        pass
    assert not store.exists()
    # A folder with anything else is the user's.
    store.mkdir()
    (store / "letter.txt").write_text("dear")
    with pytest.raises(StoreError, match="letter.txt"), PartWriter(store, 1, 2):
        pass
    assert {x.name for x in store.iterdir()} >= {"letter.txt"}
