"""Campaigns on Dask, on several processes of jax, and within bounded memory: each test starts
processes of its own, so that all of them are left to the sweeps."""

import contextlib
import json
import multiprocessing
import os
import signal
import socket
import subprocess
import sys
import time
import uuid
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from test_campaigns import (  # noqa: F401
    CAMPAIGN,
    CHUNK,
    INPUTS,
    SEED,
    Killed,
    child,
    files_of,
    fly,
    last,
    resumed,
    swing,
    whole,
)
from test_dispersion_ending import fly as fly_ending

from jaxspace.dispersion import Campaign, DaskCluster, ProcessPool, StoreError, open_store
from jaxspace.engines._process_pool import _come
from jaxspace.engines.named import InProcess
from jaxspace.stores.writer import StoreWriter

pytestmark = pytest.mark.sweep


def free_port() -> int:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


@contextlib.contextmanager
def cluster(workers: int):
    """A scheduler and workers as processes: its address, and the processes."""
    pytest.importorskip("distributed")
    port = free_port()
    address = f"tcp://127.0.0.1:{port}"
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    program = [sys.executable, "-W", "ignore", "-m"]
    where = ["--host", "127.0.0.1"]
    commands = [
        ["distributed.cli.dask_scheduler", *where, "--port", str(port), "--no-dashboard"],
        *[["distributed.cli.dask_worker", address, *where, "--no-nanny", "--nthreads", "1"]]
        * workers,
    ]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "env": env}
    processes = [subprocess.Popen([*program, *command], **quiet) for command in commands]
    try:
        yield address, processes
    finally:
        for process in processes:
            process.kill()
            process.wait()


# Dask's own sockets and loops are closed by Dask, later than a test ends.
@pytest.mark.filterwarnings("ignore")
def test_dask_on_this_machine_computes_the_same_bits(whole, tmp_path):  # noqa: F811
    fly(tmp_path / "s.zarr", engine=DaskCluster(workers=1))
    assert files_of(tmp_path / "s.zarr") == files_of(whole)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.filterwarnings("ignore")
def test_a_client_of_the_user_is_an_engine_and_remains_open(whole, tmp_path):  # noqa: F811
    distributed = pytest.importorskip("distributed")
    options = {"host": "127.0.0.1", "dashboard_address": None, "threads_per_worker": 1}
    with distributed.LocalCluster(1, **options) as local, distributed.Client(local) as client:
        fly(tmp_path / "s.zarr", engine=client)
        assert client.submit(abs, -1).result() == 1
    assert files_of(tmp_path / "s.zarr") == files_of(whole)


def test_dask_on_this_machine_listens_to_it_alone():
    """Whatever of this process and of its workers waits for connections: it runs what is sent."""
    pytest.importorskip("distributed")
    import psutil

    def listening():
        own = psutil.Process()
        found = [c for p in (own, *own.children(recursive=True)) for c in p.net_connections()]
        return {c.laddr for c in found if c.status == psutil.CONN_LISTEN}

    before = listening()
    with DaskCluster(workers=1)._client() as client:
        client.wait_for_workers(1, timeout=60)
        assert client.scheduler.address.startswith("tcp://127.0.0.1:")
        opened = listening() - before
    # At least the scheduler, the worker and its nanny.
    assert len(opened) >= 3 and {address.ip for address in opened} == {"127.0.0.1"}


@pytest.mark.filterwarnings("ignore")
def test_a_dask_worker_that_is_killed_costs_no_run(whole, tmp_path):  # noqa: F811
    with cluster(2) as (address, processes):
        seen = []

        def strike(done, total):
            seen.append(done)
            if len(seen) == 1:
                processes[1].send_signal(signal.SIGKILL)

        fly(tmp_path / "s.zarr", engine=address, progress=strike)
    assert files_of(tmp_path / "s.zarr") == files_of(whole)


@pytest.mark.filterwarnings("ignore")
def test_a_dask_scheduler_that_is_killed_leaves_a_store_that_resumes(whole, tmp_path):  # noqa: F811
    store = tmp_path / "s.zarr"
    with cluster(1) as (address, processes):

        def strike(done, total):
            processes[0].send_signal(signal.SIGKILL)
            processes[0].wait()

        with pytest.raises(StoreError, match="The Dask cluster at tcp://.* failed"):
            fly(store, engine=address, progress=strike)
    assert 0 < open_store(store).runs < 2200
    resumed(store)
    assert files_of(store) == files_of(whole)


@pytest.mark.filterwarnings("ignore")
def test_a_scheduler_that_is_not_there_is_an_error_in_a_sentence(tmp_path):
    pytest.importorskip("distributed")
    with pytest.raises(StoreError, match="The Dask cluster at tcp://127.0.0.1"):
        fly(tmp_path / "s.zarr", engine=f"tcp://127.0.0.1:{free_port()}")


class Counting(eqx.Module):
    """The outputs of `CAMPAIGN`; the runs of which they are read leave their input in a file."""

    folder: str = eqx.field(static=True)

    def __call__(self, result, samples):
        w = samples["w"]
        w = jax.pure_callback(self.noted, jax.ShapeDtypeStruct(w.shape, w.dtype), w)
        return {**last(result, samples), "noted": w}

    def noted(self, w):
        file = Path(self.folder, uuid.uuid4().hex)
        file.write_bytes(np.asarray(w).tobytes())
        # Whole under this name, for who reads it meanwhile.
        file.rename(file.with_suffix(".seen"))
        return w

    def chunks(self, runs):
        """The chunks whose runs have been computed, or are about to be."""
        drawn = CAMPAIGN.samples(jax.random.key(SEED), jnp.arange(runs, dtype=jnp.uint32))["w"]
        files = Path(self.folder).glob("*.seen")
        seen = np.concatenate([np.frombuffer(file.read_bytes()) for file in files])
        return {int(number) // CHUNK for number in np.flatnonzero(np.isin(drawn, seen))}


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    "engine", [InProcess(), ProcessPool(2), DaskCluster(workers=2)], ids=lambda e: type(e).__name__
)
def test_a_kill_costs_one_chunk_for_each_worker(engine, tmp_path, monkeypatch):
    """This process ends before it commits its third chunk, after the others have had the time to
    begin whatever they were given: of ten chunks no more than one for each of them is lost."""
    if isinstance(engine, DaskCluster):
        pytest.importorskip("distributed")
    (tmp_path / "seen").mkdir()
    counting, runs, store = Counting(str(tmp_path / "seen")), 10 * CHUNK, tmp_path / "s.zarr"
    commit, committed, lost = StoreWriter.commit, set(), []

    def dying(writer, chunk, *more):
        if len(committed) == 2:
            end = time.monotonic() + 120.0
            while len(counting.chunks(runs) - committed) < engine.workers:
                assert time.monotonic() < end, "a worker has not begun"
                time.sleep(0.1)
            # A chunk takes them some 20 ms.
            time.sleep(1.0)
            lost.extend(counting.chunks(runs) - committed)
            raise Killed
        commit(writer, chunk, *more)
        committed.add(chunk)

    monkeypatch.setattr(StoreWriter, "commit", dying)
    campaign = Campaign(swing, INPUTS, counting)
    with pytest.raises(Killed):
        fly(store, campaign, runs, engine=engine)
    assert open_store(store).runs == 2 * CHUNK
    assert len(lost) == engine.workers


WAIT = """
import sys, time
import numpy as np, jax
from test_campaigns import *
from jaxspace.dispersion import ProcessPool, disperse, StoreError

def slow(w):
    # In workers alone, and only in the third chunk, whose run 1029 draws this.
    import os
    if os.getpid() != int(os.environ["FIRST"]) and np.any(w == float(os.environ["RARE"])):
        time.sleep(1000)
    return w

def build(samples):
    w = jax.pure_callback(slow, jax.ShapeDtypeStruct(samples["w"].shape, samples["w"].dtype),
        samples["w"])
    return swing({**samples, "w": w})

if __name__ == "__main__":
    import os
    os.environ["FIRST"] = str(os.getpid())
    campaign = Campaign(build, INPUTS, last, CAMPAIGN.units)
    samples = campaign.samples(jax.random.key(SEED), np.arange(1029, 1030, dtype=np.uint32))
    os.environ["RARE"] = repr(float(samples["w"][0]))
    try:
        fly(sys.argv[1], campaign, engine=ProcessPool(1, limit=60.0, retries=1))
    except StoreError as error:
        print(error, "kept:", open_store(sys.argv[1]).runs)
    # In this process, where it returns; then the same without a disturbance.
    fly(sys.argv[1], campaign, resume=True)
    fly(sys.argv[2], campaign)
"""


def test_a_process_that_is_killed_is_replaced(whole, tmp_path):  # noqa: F811
    """Its chunks are computed again, by whichever process comes next."""
    seen = []

    def kill_one(done, total):
        if not seen:
            multiprocessing.active_children()[0].kill()
        seen.append(done)

    fly(tmp_path / "s.zarr", engine=ProcessPool(2), progress=kill_one)
    assert files_of(tmp_path / "s.zarr") == files_of(whole)
    # No chunk came twice.
    assert seen == sorted(set(seen))


def test_what_has_come_is_kept_when_a_process_dies():
    """One future of the same moment is done, the other lost."""
    done, lost = Future(), Future()
    done.set_result("a chunk")
    lost.set_exception(BrokenProcessPool())
    assert _come([done, lost, Future()]) == [done]


def test_a_chunk_that_never_returns_is_named_and_the_others_kept(tmp_path):
    process = child(WAIT, tmp_path / "s.zarr", tmp_path / "undisturbed.zarr")
    told, errors = process.communicate(timeout=600)
    assert "Chunk 2 (runs 1024 to 1535) was lost 2 times" in told, errors
    assert "kept: 1688" in told, errors
    assert files_of(tmp_path / "s.zarr") == files_of(tmp_path / "undisturbed.zarr")


MEMORY = """
import resource, sys
import numpy as np
import test_campaigns as t
from jaxspace.dispersion import disperse

def used():
    lines = open("/proc/self/status").read().splitlines()
    return next(1024 * int(line.split()[1]) for line in lines if line.startswith("VmData"))

options = {"seed": 1, "chunk": 512, "samples": 400}
# Compiles, and starts the threads that stay.
disperse(t.CAMPAIGN, 512, store=sys.argv[1] + "/small", **options)
resource.setrlimit(resource.RLIMIT_DATA, (used() + int(sys.argv[2]),) * 2)
kept = disperse(t.CAMPAIGN, 120 * 512, store=sys.argv[1] + "/large", **options)
mean = kept.table()[0].mean
try:
    whole = np.ones(120 * 512 * 3 * 400)
except MemoryError:
    print(kept.runs, mean, "no room for the whole")
"""


@pytest.mark.skipif(sys.platform != "linux", reason="reads what Linux tells of a process")
def test_memory_is_bounded_by_the_chunk(tmp_path):
    """Three numbers at 400 times of 61,440 runs are 590 MB, and ten times what the system gives
    the process beyond that which it used for a campaign of a single chunk, of 5 MB."""
    allowance = 59_000_000
    process = child(MEMORY, tmp_path, allowance)
    told, errors = process.communicate()
    assert process.returncode == 0, errors
    runs, mean, words = told.split(maxsplit=2)
    size = sum(p.stat().st_size for p in (tmp_path / "large").rglob("*") if p.is_file())
    assert int(runs) == 61_440 and size >= 10 * allowance
    # The limit is one: at once the numbers would not fit.
    assert words.strip() == "no room for the whole"
    # x0 cos(w t), of mean 1 and exp(-(0.1 t)^2/2) cos(2 t): 0.918 to a few 1e-3 of sampling.
    assert float(mean) == pytest.approx(0.9179, abs=0.01)


HOSTS = """
import sys
import jax
jax.distributed.initialize(sys.argv[2], 2, int(sys.argv[3]))
from test_campaigns import fly
from jaxspace.dispersion import open_store
from jaxspace.stores.writer import StoreWriter
commit, seen, old = StoreWriter.commit, [], []
def watched(writer, *given):
    # Until each process has written a chunk, readers see the old store.
    if not old:
        old.append(open_store(sys.argv[1]).runs)
    commit(writer, *given)
StoreWriter.commit = watched
progress = lambda done, total: seen.append(done)
kept = fly(sys.argv[1], engine="hosts", overwrite=True, progress=progress)
print(*old, kept.runs, len(seen))
"""


def test_two_processes_of_jax_share_a_campaign(whole, tmp_path):  # noqa: F811
    """And replace the store of another one, of a single chunk."""
    fly(tmp_path / "s.zarr", runs=7)
    address = f"127.0.0.1:{free_port()}"
    processes = [child(HOSTS, tmp_path / "s.zarr", address, k) for k in range(2)]
    told = [process.communicate(timeout=600) for process in processes]
    # Five chunks: three for the first process, two for the second.
    # Before that the library of the exchange says that it is connected.
    expected = [["7", "2200", "3"], ["7", "2200", "2"]]
    assert [out.split()[-3:] for out, _ in told] == expected, told
    entries = [json.loads(p.read_text()) for p in (tmp_path / "s.zarr/.manifest").glob("*.json")]
    hosts = [sum(e["seconds"] for e in entries if e["host"] == k) for k in range(2)]
    kept = open_store(tmp_path / "s.zarr")
    # They compute at one time, so that the longer one counts.
    assert kept.seconds - kept.attributes["preparation_seconds"] == pytest.approx(max(hosts))
    assert files_of(tmp_path / "s.zarr") == files_of(whole)


ENDING_HOSTS = """
import sys
import jax
jax.distributed.initialize(sys.argv[2], 2, int(sys.argv[3]))
import test_dispersion_ending as t
kept = t.fly(sys.argv[1], engine="hosts")
print(kept.runs, kept.enough)
"""


def test_two_processes_of_jax_end_a_campaign_with_the_same_run(tmp_path):
    """A rule that is met: both see it, and the store is that of a single process."""
    fly_ending(tmp_path / "alone.zarr")
    address = f"127.0.0.1:{free_port()}"
    processes = [child(ENDING_HOSTS, tmp_path / "s.zarr", address, k) for k in range(2)]
    told = [process.communicate(timeout=600) for process in processes]
    runs = str(open_store(tmp_path / "alone.zarr").runs)
    assert [out.split()[-2:] for out, _ in told] == [[runs, runs]] * 2, told
    assert files_of(tmp_path / "s.zarr") == files_of(tmp_path / "alone.zarr")
