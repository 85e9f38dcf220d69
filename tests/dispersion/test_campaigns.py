"""Campaigns that are kept: whatever ends, damages or splits one, its runs come out the same, to the
last bit."""

import contextlib
import errno
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
import warnings
from pathlib import Path
from typing import final

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace.core import AbstractSystem, InputError, Scalar, quantity
from jaxspace.dispersion import (
    Campaign,
    Constant,
    Correlated,
    DamagedStore,
    LatinHypercube,
    MultivariateNormal,
    Normal,
    ProcessPool,
    Sobol,
    StoreError,
    Uniform,
    _program,
    disperse,
    open_store,
)
from jaxspace.simulation import Accuracy, Mission, Phase, SimulationError, Status, simulate_mission
from jaxspace.stores import writer as _store_writer
from jaxspace.stores._head import sealed
from jaxspace.stores._lock import Lock
from jaxspace.stores.columns import columns_of
from jaxspace.stores.results import RunResults
from jaxspace.stores.writer import StoreWriter

RUNS, CHUNK, SEED = 2200, 512, 11  # four chunks and a shorter one
DURATION = 3.0


@final
class Swinging(AbstractSystem):
    """x'' = -w^2 x"""

    w: Scalar = quantity("rad/s", doc="angular frequency")

    def vector_field(self, t, y):
        return {"x": y["v"], "v": -self.w * self.w * y["x"]}

    def invariants(self, t, y):
        return {}


def swing(samples):
    y0 = {"x": samples["x0"], "v": 0.0 * samples["x0"]}
    return Mission([Phase(Swinging(samples["w"]), DURATION, name="swing")]), y0


def last(result, samples):
    return {"x": result.final["x"], "v": result.final["v"]}


INPUTS = {"w": Normal(2.0, 0.1), "x0": Uniform(0.9, 1.1)}
CAMPAIGN = Campaign(swing, INPUTS, last, {"w": "rad/s", "x0": "m", "x": "m", "v": "m/s"})


def fly(store=None, campaign=CAMPAIGN, runs=RUNS, **options):
    return disperse(campaign, runs, seed=SEED, chunk=CHUNK, store=store, **options)


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Path:
    """The store of a campaign that nothing has disturbed."""
    path = tmp_path_factory.mktemp("whole") / "campaign.zarr"
    fly(path)
    return path


@pytest.fixture
def copy(whole, tmp_path) -> Path:
    """A copy of it to damage."""
    path = tmp_path / "copy.zarr"
    subprocess.run(["cp", "-r", whole, path], check=True)
    return path


def files_of(store: Path) -> dict[str, bytes]:
    """Every file with numbers of a store."""
    return {
        str(p.relative_to(store)): p.read_bytes()
        for p in sorted(store.glob("*/c/**/*"))
        if p.is_file()
    }


def resumed(store: Path, **options) -> int:
    """Complete the store, and return how many runs that took."""
    seen = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DamagedStore)
        fly(store, resume=True, progress=lambda done, total: seen.append(done), **options)
    return len(seen)


# ------------------------------------------------------------------ what is there, and what is not


def test_a_store_holds_what_the_campaign_returns(whole):
    kept, flown = open_store(whole), fly()
    for name in CAMPAIGN.units:
        np.testing.assert_array_equal(kept.values(name), flown.values(name))
    np.testing.assert_array_equal(kept.numbers, np.arange(RUNS))
    for name in ("versions", "machine", "digest", "rtol", "planned_runs", "cpu_seconds"):
        assert name in kept.attributes
    assert kept.seconds > kept.attributes["preparation_seconds"] > 0.0


@pytest.mark.parametrize("form", [0, 2, "2b"])
def test_a_store_of_another_form_is_refused_with_the_way_forward(copy, form):
    """Nothing in it is read or changed; by leave it is replaced."""
    head = json.loads((copy / "zarr.json").read_bytes())
    assert head["attributes"]["form"] == 1
    head["attributes"] |= {"form": form, "versions": {"jaxspace": "9.1"}}
    data = json.dumps(head).encode()
    (copy / ".manifest" / "head").write_bytes(sealed(data))
    (copy / "zarr.json").write_bytes(data)
    sentence = (
        f"format {form!r}, written by jaxspace 9.1, .* reads format 1: read it with the version"
    )
    for use in (open_store, lambda store: fly(store, resume=True)):
        with pytest.raises(StoreError, match=sentence):
            use(copy)
    assert (copy / "zarr.json").read_bytes() == data
    assert fly(copy, overwrite=True).runs == RUNS and open_store(copy).runs == RUNS


def test_other_libraries_read_it(whole):
    import xarray

    # Consolidated: one file says all, which matters where files are far away.
    with xarray.open_zarr(whole, consolidated=True) as data:
        np.testing.assert_array_equal(data["x"], open_store(whole).outputs["x"])
        assert data["x"].attrs["units"] == "m" and data["run"].size == RUNS


def test_a_finished_store_is_not_computed_again(copy):
    before = files_of(copy)
    assert resumed(copy) == 0
    assert files_of(copy) == before


def test_nothing_is_overwritten_unasked(copy):
    with pytest.raises(StoreError, match=f"already contains {RUNS} of {RUNS} runs"):
        fly(copy)
    fly(copy, runs=100, overwrite=True)
    assert open_store(copy).runs == 100


def test_hosts_replace_a_store_with_their_first_chunks(copy, monkeypatch):
    """A campaign that ends before leaves the old store, which readers see until then."""
    before = files_of(copy)
    commit = StoreWriter.commit
    seen = []

    def refused(writer, *given):
        raise StoreError("no space is left")

    def watched(writer, *given):
        with warnings.catch_warnings():
            # A store of which a part is there.
            warnings.simplefilter("ignore")
            seen.append(open_store(copy).runs)
        commit(writer, *given)

    monkeypatch.setattr(StoreWriter, "commit", refused)
    with pytest.raises(StoreError, match="no space is left"):
        fly(copy, engine="hosts", overwrite=True)
    assert files_of(copy) == before and open_store(copy).runs == RUNS
    monkeypatch.setattr(StoreWriter, "commit", watched)
    assert fly(copy, runs=CHUNK + 1, engine="hosts", overwrite=True).runs == CHUNK + 1
    assert seen == [RUNS, CHUNK] and open_store(copy).runs == CHUNK + 1


def test_a_folder_of_something_else_is_left_alone(tmp_path):
    letter = tmp_path / "letter.txt"
    letter.write_text("dear")
    for options in ({}, {"overwrite": True}, {"resume": True}):
        with pytest.raises(StoreError, match=r"letter\.txt"):
            fly(tmp_path, **options)
    assert letter.read_text() == "dear"


def other(**changed):
    return {"campaign": CAMPAIGN, "runs": RUNS, "seed": SEED, "chunk": CHUNK, **changed}


def faster(samples):
    mission, y0 = swing(samples)
    return Mission([Phase(mission.phases[0].system, 1.01 * DURATION, name="swing")]), y0


@pytest.mark.parametrize(
    "changed, named",
    [
        ({"seed": 12}, "the seed: 11 in the store, 12 here"),
        ({"runs": 2000}, "the number of runs: 2200 in the store, 2000 here"),
        ({"accuracy": 1e-8}, "the relative tolerance: 1e-09 in the store, 1e-08 here"),
        (
            {"campaign": Campaign(swing, INPUTS | {"w": Normal(2.0, 0.2)}, last, CAMPAIGN.units)},
            r"deviation 0.1 in the store, w \[rad/s\]: normal, mean 2, deviation 0.2 here",
        ),
        ({"campaign": Campaign(faster, INPUTS, last, CAMPAIGN.units)}, "functions must have"),
    ],
)
def test_a_store_refuses_another_campaign_and_names_the_difference(copy, changed, named):
    given = other(**changed)
    with pytest.raises(StoreError, match=named):
        disperse(given.pop("campaign"), given.pop("runs"), store=copy, resume=True, **given)
    assert files_of(copy)


def test_the_planned_runs_choose_the_program_of_all(tmp_path, monkeypatch):
    """Once: workers and resumed stores keep the program that was chosen first."""
    monkeypatch.setattr(_program, "rolls_stages", lambda kind, operations, runs: runs < 1000)
    stores = {runs: tmp_path / f"{runs}.zarr" for runs in (600, 900, 1100)}
    few, more, many = (fly(store, runs=runs).outputs["x"] for runs, store in stores.items())
    apart = fly(runs=900, engine="processes").outputs["x"]
    np.testing.assert_array_equal(few, more[:600])
    np.testing.assert_array_equal(more, apart)
    # Their first steps differ, and so do all others: both to 1e-9 a step, in some twenty steps.
    np.testing.assert_allclose(more, many[:900], rtol=0.0, atol=2e-8)
    kinds = [open_store(s).attributes.get("rolled_stages") for s in stores.values()]
    assert kinds == [True, True, None]
    # A store keeps the program of its runs when it is resumed or extended.
    np.testing.assert_array_equal(fly(stores[600], runs=1100, resume=True).outputs["x"][:900], more)


def correlated(factor):
    joint = Correlated.of((Normal(2.0, 0.1), Uniform(0.9, 1.1)), [[1.0, factor], [factor, 1.0]])
    return Campaign(swing, joint.inputs("w", "x0"), last, CAMPAIGN.units)


def normal_pair(mean, covariance):
    joint = MultivariateNormal([2.0, mean], np.diag([0.01, covariance]))
    return Campaign(swing, joint.inputs("w", "x0"), last, CAMPAIGN.units)


@pytest.mark.parametrize(
    "there, here, told",
    [
        (correlated(0.3), correlated(-0.25), ("[[1, 0.3], [0.3, 1]]", "[[1, -0.25], [-0.25, 1]]")),
        (normal_pair(1.0, 0.01), normal_pair(1.5, 0.01), ("mean [2, 1]", "mean [2, 1.5]")),
        (normal_pair(1.0, 0.01), normal_pair(1.0, 0.04), ("[0, 0.1]]", "[0, 0.2]]")),
    ],
)
def test_a_store_of_inputs_that_scatter_together_otherwise_is_refused(there, here, told, tmp_path):
    fly(tmp_path / "s", there, 8)
    was, now = map(re.escape, told)
    words = f"campaign: the inputs: .*{was}.* in the store, .*{now}.* here"
    with pytest.raises(StoreError, match=words):
        fly(tmp_path / "s", here, 8, resume=True)


def test_hosts_at_one_time_count_by_the_longest(tmp_path):
    """Of the seconds in which a store was computed; those of the processors add up."""
    names = ("rtol", "atol", "method", "description", "inputs", "digest", "samples")
    attributes = dict.fromkeys(names, 0) | {"seed": 0, "planned_runs": 40, "chunk": 10}
    with StoreWriter(tmp_path / "s") as writer:
        attributes |= {"preparation_seconds": 1.0, "machine": {"cores": 3}}
        writer.prepare(columns_of(synthetic(0, 1), {}), attributes)
        for chunk, (host, seconds) in enumerate([(0, 2.0), (1, 7.0), (0, 3.0), (None, 4.0)]):
            writer.host = host
            writer.commit(chunk, synthetic(10 * chunk, 10), seconds, 1.5)
    kept = open_store(tmp_path / "s")
    # One process alone came before them, or behind.
    assert kept.seconds == 1.0 + max(2.0 + 3.0, 7.0) + 4.0
    assert kept.attributes["cpu_seconds"] == 4 * 1.5
    # Two hosts of three cores each.
    assert kept.cores == 6 and kept.utilisation == 4 * 1.5 / (11.0 * 6)


def test_a_folder_that_cannot_be_written_is_refused_before_anything_is_computed(
    tmp_path, monkeypatch
):
    def read_only(*_):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    monkeypatch.setattr(Lock, "acquire", read_only)
    monkeypatch.setattr("jaxspace.dispersion._engine.BatchRunner", None)
    with pytest.raises(StoreError, match="cannot be written .Read-only file system."):
        fly(tmp_path / "s.zarr")


def test_a_disk_that_is_too_small_is_refused_before_a_run(tmp_path, monkeypatch):
    monkeypatch.setattr(_store_writer.shutil, "disk_usage", lambda path: os.terminal_size((0, 0)))
    monkeypatch.setattr(
        _store_writer.shutil, "disk_usage", lambda path: type("Usage", (), {"free": 10**6})
    )
    with pytest.raises(StoreError, match="its disk has 1 MB"):
        fly(tmp_path / "s.zarr")


# ---------------------------------------------------------------------------------------- damage


def flip(path):
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


DAMAGES = {
    "a flipped bit": ("x/c/2", flip, "x/c/2 does not match its checksum"),
    "a truncated file": (
        "v/c/1",
        lambda path: os.truncate(path, 100),
        "v/c/1 has 100 bytes instead of 4100",
    ),
    "a lost file": ("status/c/0", Path.unlink, "status/c/0 cannot be read"),
}


@pytest.mark.parametrize("kind", DAMAGES)
def test_damage_is_named_left_out_and_computed_again(whole, copy, kind):
    name, damage, sentence = DAMAGES[kind]
    damage(copy / name)
    with pytest.warns(DamagedStore, match=sentence):
        kept = open_store(copy)
    chunk = int(name[-1])
    assert kept.runs == RUNS - CHUNK
    assert not set(kept.numbers) & set(range(chunk * CHUNK, (chunk + 1) * CHUNK))
    with pytest.warns(DamagedStore, match=f"{sentence}.*computed again"):
        fly(copy, resume=True)
    assert files_of(copy) == files_of(whole)


def test_an_unfinished_store_says_so(tmp_path):
    """Of a campaign under way or interrupted: when it is opened, and when it is asked."""
    place = tmp_path / "s.zarr"
    write(place)
    assert open_store(place).missing_runs == ""
    (place / ".manifest" / "1.json").unlink()
    told = r"15 of 25 planned runs are in the store: `disperse\(\.\.\., resume=True\)` computes"
    with pytest.warns(UserWarning, match=told):
        kept = open_store(place)
    assert kept.store == str(place) and kept.warnings == (kept.missing_runs,)
    write(place, resume=True)
    assert open_store(place).warnings == ()


def test_a_flipped_bit_of_the_metadata_is_told_and_mended(tmp_path, monkeypatch):
    """Of the head, of its copy and of the metadata of an array, all along each of them."""
    monkeypatch.setattr("jaxspace.stores._head.PATIENCE", 0.0)
    place = tmp_path / "s"
    write(place)
    files = [place / name for name in ("zarr.json", ".manifest/head", "b/zarr.json")]
    before = {file: file.read_bytes() for file in files}
    expected = open_store(place)
    for file in files:
        for k in range(0, len(before[file]), len(before[file]) // 40):
            damaged = bytearray(before[file])
            damaged[k] ^= 1 << (k % 8)
            file.write_bytes(damaged)
            with warnings.catch_warnings(record=True) as told:
                warnings.simplefilter("always")
                kept = open_store(place)
            assert [w.category for w in told] == [DamagedStore]
            assert str(file.relative_to(place)) in str(told[0].message)
            assert kept.attributes == expected.attributes and kept.units == expected.units
            np.testing.assert_array_equal(kept.outputs["b"], expected.outputs["b"])
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", DamagedStore)
                write(place, resume=True)
            assert {file: json.loads(_text(file)) for file in files} == {
                file: json.loads(_text(file, data)) for file, data in before.items()
            }


def _text(file: Path, data: bytes | None = None) -> bytes:
    """The metadata in a file, behind the checksum where it begins with one."""
    data = file.read_bytes() if data is None else data
    return data.partition(b"\n")[2] if file.name == "head" else data


def test_a_lost_head_is_found_again(copy):
    (copy / "zarr.json").unlink()
    with pytest.warns(DamagedStore, match="differs from its copy"):
        assert open_store(copy).runs == RUNS
    assert resumed(copy) == 0
    assert (copy / "zarr.json").is_file()


def test_zarr_itself_finds_a_flipped_bit(copy):
    import zarr

    flip(copy / "x" / "c" / "2")
    with pytest.raises(ValueError, match="checksum"):
        zarr.open_array(copy / "x")[:]


@pytest.mark.parametrize("text", ["", "{", '{"files": {}}'])
def test_an_entry_that_says_nothing_does_not_count(whole, copy, text):
    (copy / ".manifest" / "3.json").write_text(text)
    assert open_store(copy).runs == RUNS - CHUNK
    assert resumed(copy) == 1
    assert files_of(copy) == files_of(whole)


# ----------------------------------------------------------------------------------- interruptions


class Killed(BaseException):
    """The end of a process, simulated: nothing behind it may run."""


def synthetic(first: int, count: int) -> RunResults:
    x = np.arange(first, first + count, dtype=float)
    return RunResults({"a": x}, {"b": 2.0 * x}, np.zeros(count, np.int32), np.ones(count, int), {})


def write(path, resume=False):
    """A store of three chunks, without anything that computes."""
    names = ("rtol", "atol", "method", "description", "inputs", "digest", "samples")
    attributes = dict.fromkeys(names, 0) | {"seed": 0, "planned_runs": 25, "chunk": 10}
    attributes |= {"preparation_seconds": 1.0}
    with StoreWriter(path, resume=resume) as writer:
        store = writer.prepare(columns_of(synthetic(0, 1), {}), attributes)
        for chunk in writer.missing()[0]:
            writer.commit(chunk, synthetic(*store.extent(chunk)), 0.1, 0.1)


def test_a_store_survives_its_end_at_every_single_operation(tmp_path, monkeypatch):
    """Every file is renamed into place, so that these renames are all the moments there are."""
    write(tmp_path / "whole")
    expected = files_of(tmp_path / "whole")
    moments = len(list((tmp_path / "whole").rglob("*.json"))) + len(expected)
    replace, unlink = os.replace, Path.unlink
    for moment in range(moments):
        place, left = tmp_path / str(moment), iter(range(moment))

        def dying(source, target, left=left):
            if next(left, None) is None:
                raise Killed
            replace(source, target)

        monkeypatch.setattr(os, "replace", dying)
        # What a dead process would not have tidied stays.
        monkeypatch.setattr(
            Path, "unlink", lambda p, **o: None if ".unfin" in p.name else unlink(p, **o)
        )
        with pytest.raises(Killed):
            write(place)
        monkeypatch.undo()
        with warnings.catch_warnings():
            # Where it ended between the metadata and their copy.
            warnings.simplefilter("ignore", DamagedStore)
            try:
                kept = open_store(place)
                np.testing.assert_array_equal(kept.outputs["b"], 2.0 * kept.numbers)
                begun = True
            except StoreError:
                begun = False
            write(place, resume=begun)
        assert files_of(place) == expected, moment
        assert not list(place.rglob(".unfinished*"))


def child(code: str, *arguments: object) -> subprocess.Popen:
    """A process that computes as this one does, to the bit."""
    coarse = jax.config.values["jax_disable_most_optimizations"]
    settings = {"JAX_ENABLE_X64": "1", "JAX_DISABLE_MOST_OPTIMIZATIONS": str(int(coarse))}
    return subprocess.Popen(
        [sys.executable, "-c", code, *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, **settings, "PYTHONPATH": os.pathsep.join(sys.path)},
    )


# A chunk takes some 20 ms here, so that most moments fall into the flight.
FLY = """
import sys, time
from test_campaigns import fly
def seen(done, total):
    print(done, flush=True)
    time.sleep(0.02)
fly(sys.argv[1], progress=seen, resume=sys.argv[2] == "True")
"""


def killed_and_resumed(store: Path, delays: list[float]) -> list[int]:
    """Killed so many seconds after its first chunk, one time after the other; the runs found each
    time."""
    found = []
    for k, delay in enumerate(delays):
        process = child(FLY, store, k > 0)
        assert process.stdout is not None
        process.stdout.readline()
        time.sleep(delay)
        process.send_signal(signal.SIGKILL)
        process.communicate()
        found.append(open_store(store).runs)
    # It may have come to its end, and released the store, before the last signal came.
    held = (store / ".lock").stat().st_size > 0
    assert held or found[-1] == RUNS
    told = pytest.warns(DamagedStore, match="ended without releasing")
    with told if held else contextlib.nullcontext():
        fly(store, resume=True)
    return found


# An end at every operation is simulated above, and `test_campaign_commands.py` has one by a signal.
@pytest.mark.sweep
def test_a_campaign_that_is_killed_goes_on(whole, tmp_path):
    found = killed_and_resumed(tmp_path / "s.zarr", [0.0, 0.01])
    assert 0 < found[0] <= found[1]
    assert files_of(tmp_path / "s.zarr") == files_of(whole)


def test_a_disk_that_fills_up_keeps_what_is_finished(whole, tmp_path, monkeypatch):
    written, left = _store_writer.write_whole, iter(range(40))

    def full(path, data):
        if next(left, None) is None:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        written(path, data)

    monkeypatch.setattr(_store_writer, "write_whole", full)
    store = tmp_path / "s.zarr"
    with pytest.raises(StoreError, match=r"No space left on device.*\d+ of 2200 runs are stored"):
        fly(store)
    monkeypatch.undo()
    assert 0 < open_store(store).runs < RUNS
    resumed(store)
    assert files_of(store) == files_of(whole)


def test_a_clock_that_jumps_changes_nothing(whole, tmp_path, monkeypatch):
    """Back by a day at every look: the clock of the system tells when a lock was taken, and no
    duration."""
    looks, told = iter(range(10**6)), time.strftime
    monkeypatch.setattr(time, "time", lambda: 1e9 - 86400.0 * next(looks))
    monkeypatch.setattr(time, "strftime", lambda form, *_: told(form, time.gmtime(time.time())))
    kept = fly(tmp_path / "s.zarr")
    assert files_of(tmp_path / "s.zarr") == files_of(whole) and 0.0 < kept.seconds < 3600.0


def test_two_writers_of_one_store(copy):
    with StoreWriter(copy, resume=True):
        with pytest.raises(StoreError, match=f"in use by process {os.getpid()} on "):
            fly(copy, resume=True)
        # Readers are not in the way.
        assert open_store(copy).runs == RUNS
    assert resumed(copy) == 0


def test_the_name_of_a_writer_is_waited_for(tmp_path):
    """Who has just locked a store writes its name a moment later."""
    writer = Lock(tmp_path)
    writer.acquire()
    name = writer.path.read_text()
    writer.path.write_text("")
    late = threading.Timer(0.1, writer.path.write_text, [name])
    late.start()
    with pytest.raises(StoreError, match=f"in use by process {os.getpid()}"):
        Lock(tmp_path).acquire()
    late.join()
    writer.release()


def test_a_lock_of_another_machine_is_respected(copy):
    owner = {"pid": 1, "host": "elsewhere", "since": "yesterday"}
    (copy / ".lock").write_text(json.dumps(owner))
    with pytest.raises(StoreError, match=r"process 1 on elsewhere since yesterday.*remove \.lock"):
        fly(copy, resume=True)


def test_the_owner_of_a_stale_lock_is_named(copy):
    owner = {"pid": 10951, "host": socket.gethostname(), "since": "yesterday"}
    (copy / ".lock").write_text(json.dumps(owner))
    words = f"^The process 10951 on {owner['host']} ended without releasing the store"
    with pytest.warns(DamagedStore, match=words):
        fly(copy, resume=True)


# ------------------------------------------------------------------------------------- single runs


def calling(change):
    """`swing`, whose rates are what a function of NumPy makes of them."""

    def build(samples):
        w = samples["w"]
        w = jax.pure_callback(change, jax.ShapeDtypeStruct(w.shape, w.dtype), w)
        return swing({**samples, "w": w})

    return Campaign(build, INPUTS, last, CAMPAIGN.units)


def raising(limit):
    """`swing`, by a function that raises an error for rates above the limit."""

    def refuse(w):
        if np.any(w > limit):
            raise ValueError("too fast")
        return w

    return calling(refuse)


def replacing(rate):
    """`swing` with this rate in place of those above a limit."""
    return lambda limit: calling(lambda w: np.where(w > limit, rate, w))


def test_a_run_that_raises_costs_its_own_row(whole):
    d = fly(campaign=raising(2.2), runs=600)
    fast = d.inputs["w"] > 2.2
    # Two deviations above the mean: 2.3 % of 600 runs, 14 +- 4.
    assert 3 <= fast.sum() <= 30
    np.testing.assert_array_equal(d.status == Status.RAISED, fast)
    assert np.all(np.isnan(d.outputs["x"][fast])) and np.all(np.isfinite(d.outputs["x"][~fast]))
    # As in the campaign without the function, but for the roundings of another program: some eps in
    # each of a few dozen steps.
    there = open_store(whole).outputs["x"][:600]
    np.testing.assert_allclose(d.outputs["x"][~fast], there[~fast], rtol=0.0, atol=1e-12)


BAD_RUNS = {
    "raises": (raising, Status.RAISED),
    "is not a number": (replacing(np.nan), Status.NOT_FINITE),
    # 300 rad of an oscillation, by steps of less than a radian.
    "never ends": (replacing(100.0), Status.MAX_STEPS),
}


@pytest.mark.sweep
@pytest.mark.parametrize("kind", BAD_RUNS)
def test_runs_beside_a_bad_one_keep_their_bits(kind):
    """Wherever it is: in the first call, too."""
    make, status = BAD_RUNS[kind]
    accuracy = Accuracy(rtol=1e-9, max_steps=200)
    alone, among = (fly(campaign=make(limit), accuracy=accuracy) for limit in (np.inf, 2.2))
    fast = among.inputs["w"] > 2.2
    # Two deviations above the mean lie 2.3 % of the runs: 50 +- 7.
    assert 15 < fast.sum() < 85 and np.any(fast[:512]) and alone.good.all()
    np.testing.assert_array_equal(among.status[fast], status)
    assert among.good[~fast].all()
    for name in CAMPAIGN.units:
        np.testing.assert_array_equal(among.values(name)[~fast], alone.values(name)[~fast])
    # A bad run keeps its inputs, and has no number.
    for name in INPUTS:
        np.testing.assert_array_equal(among.inputs[name], alone.inputs[name])
    assert all(np.all(np.isnan(x[fast])) for x in among.outputs.values())


@final
class Escape(AbstractSystem):
    """x' = x^2, which has no solution beyond t = 1/x0."""

    def vector_field(self, t, y):
        return {"x": y["x"] * y["x"]}

    def invariants(self, t, y):
        return {}


def escape(samples):
    return Mission([Phase(Escape(), DURATION)]), {"x": samples["x0"]}


def test_a_run_that_never_ends_is_counted(tmp_path):
    """x = x0 / (1 - x0 t) comes to its end before t = 3 where x0 > 1/3."""
    inputs = {"x0": Uniform(0.1, 0.4), "fixed": Constant(1.0)}
    campaign = Campaign(escape, inputs, lambda r, s: {"x": r.final["x"]})
    kept = disperse(campaign, 300, store=tmp_path / "s.zarr", accuracy=1e-8)
    x0 = kept.inputs["x0"]
    np.testing.assert_array_equal(kept.good, x0 < 1.0 / 3.0)
    assert sum(f.count for f in kept.failed) == np.sum(x0 >= 1.0 / 3.0) > 0
    (row,) = kept.table()
    # Beside the singularity the error grows as 1/(1 - 3 x0)^2: here by 1e4 at most.
    far = x0 < 0.33
    exact = x0[far] / (1.0 - 3.0 * x0[far])
    np.testing.assert_allclose(kept.outputs["x"][far], exact, rtol=1e-3)
    assert np.isfinite(row.mean) and row.runs == np.sum(kept.good)


def test_runs_that_end_beside_a_singularity_take_the_steps_they_need():
    """Their numbers depend on their own number alone, whatever their neighbours take."""
    campaign = Campaign(escape, {"x0": Uniform(0.1, 0.3333)}, lambda r, s: {"x": r.final["x"]})
    kept = disperse(campaign, 1024, accuracy=1e-8)
    assert kept.good.all()
    left = 1.0 - 3.0 * kept.inputs["x0"]
    assert np.min(left) < 1e-2
    # An error on the way grows by 1/left, relative to x; a run takes some hundred steps.
    error = kept.outputs["x"] * left / kept.inputs["x0"] - 1.0
    assert np.max(np.abs(error) * left) < 1e-7
    short = disperse(campaign, 512, accuracy=1e-8)
    np.testing.assert_array_equal(short.outputs["x"], kept.outputs["x"][:512])


def test_a_replay_is_the_run_of_the_campaign(whole):
    kept = open_store(whole)
    for number in (0, 1234):
        found = CAMPAIGN.replay(number, seed=SEED, num_saved=5)
        for name, x in found.inputs.items():
            assert x == kept.inputs[name][number]
        for name, x in found.outputs.items():
            # By the same program: to the last bit.
            assert x == kept.outputs[name][number]
        # By another one, to 1e-9 a step, in some twenty steps.
        end = found.trajectory["swing"].states["x"][-1]
        assert end == pytest.approx(found.outputs["x"], abs=2e-8)
        assert found.status == Status.COMPLETED
        assert found.trajectory["swing"].states["x"].shape == (5,)
    with pytest.raises(InputError, match="number is -1"):
        CAMPAIGN.replay(-1)


def test_trajectories_are_kept_where_they_are_asked_for(tmp_path):
    import xarray

    kept = fly(tmp_path / "s.zarr", runs=600, samples=4)
    with xarray.open_zarr(tmp_path / "s.zarr") as data:
        t, x = data["swing.time"].values, data["swing.x"].values
        assert data["swing.x"].dims == ("run", "swing.sample")
    np.testing.assert_allclose(t, np.broadcast_to([0.0, 1.0, 2.0, 3.0], (600, 4)), atol=1e-15)
    w, x0 = kept.inputs["w"][:, None], kept.inputs["x0"][:, None]
    # As in `test_runs_match_the_closed_form` of `test_dispersion`.
    np.testing.assert_allclose(x, x0 * np.cos(w * t), rtol=0.0, atol=1e-8)
    with pytest.raises(InputError, match="samples is 4: it must be 0"):
        fly(samples=4)


# ----------------------------------------------------------------------------------------- engines


@pytest.mark.parametrize("workers", [pytest.param(1, marks=pytest.mark.sweep), 2])
def test_other_processes_compute_the_same_bits(whole, copy, workers):
    for chunk in (0, 3, 4):
        (copy / ".manifest" / f"{chunk}.json").unlink()
    assert resumed(copy, engine=ProcessPool(workers)) == 3
    assert files_of(copy) == files_of(whole)


@pytest.mark.parametrize("design", [LatinHypercube(1100), Sobol()])
def test_even_points_are_the_same_bits_in_any_chunks(design):
    campaign = Campaign(swing, INPUTS, last, CAMPAIGN.units, design=design)
    cut, one = (disperse(campaign, 1100, seed=SEED, chunk=chunk) for chunk in (512, 2048))
    for name in CAMPAIGN.units:
        np.testing.assert_array_equal(cut.values(name), one.values(name))


@pytest.mark.parametrize("engine, words", [("desk", "engine is 'desk'"), ("", "engine is ''")])
def test_an_unknown_engine_is_refused(engine, words):
    with pytest.raises(InputError, match=words):
        fly(engine=engine)


def test_the_limit_of_steps_holds_for_each_run():
    """What serves the nominal run serves the runs that swing as fast; the steps of those that swing
    up to twice as fast run out, in their own rows."""
    inputs = {"w": Uniform(1.0, 4.0), "x0": Uniform(0.9, 1.1)}
    campaign = Campaign(swing, inputs, last, CAMPAIGN.units)
    # A few more, because the rest is the choice of the first step.
    enough = Accuracy(rtol=1e-9, max_steps=26)
    mission, y0 = swing({name: jnp.asarray(d.mean) for name, d in inputs.items()})
    assert simulate_mission(mission, y0, 0.0, accuracy=enough).status == Status.COMPLETED
    found = disperse(campaign, 64, seed=1, accuracy=enough)
    w, x0 = found.inputs["w"], found.inputs["x0"]
    assert np.all(found.good[w < 2.5]) and not np.all(found.good)
    assert set(found.status) == {Status.COMPLETED, Status.MAX_STEPS}
    exact = np.where(found.good, x0 * np.cos(w * DURATION), np.nan)
    # Some steps of 1e-9 each.
    np.testing.assert_allclose(found.outputs["x"], exact, atol=1e-7)
    # Of the nominal run alone the steps run out: every door says so.
    few = Accuracy(rtol=1e-9, max_steps=10)
    for fly_it in (
        lambda: simulate_mission(mission, y0, 0.0, accuracy=few),
        lambda: disperse(campaign, 64, seed=1, accuracy=few),
    ):
        with pytest.raises(SimulationError, match="in a scene file the key max_steps"):
            fly_it()
