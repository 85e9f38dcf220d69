"""Engines: where the chunks of a campaign are computed. Behind one interface stand this process,
other processes of this machine, and a Dask cluster; every one of them gives the same bits."""

import contextlib
import functools
import io
import multiprocessing
import pickle
import queue
import signal
import sys
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any, NamedTuple, TypeAlias, final

import jax

from ..core import InputError
from ._batch_runner import BatchRunner, PlannedCampaign, RunResults, cores
from ._lock import StoreError

RETRIES = 3
# Between two looks at whether the scheduler is still there, s.
PULSE = 2.0
# Of a program and of its results; where programs are kept.
SETTINGS = (
    "jax_enable_x64",
    "jax_numpy_dtype_promotion",
    "jax_disable_most_optimizations",
    "jax_compilation_cache_dir",
    "jax_persistent_cache_min_compile_time_secs",
    "jax_persistent_cache_min_entry_size_bytes",
)


class Extent(NamedTuple):
    """A chunk by its number, its first run and the number of its runs."""

    chunk: int
    first: int
    runs: int


class Done(NamedTuple):
    """A chunk that has been computed, its results, and the processor time that it took, s."""

    chunk: int
    results: RunResults
    cpu: float


Computed: TypeAlias = Generator[Done, None, None]


class AbstractEngine(ABC):
    """Computes chunks, in any order."""

    @abstractmethod
    def compute(self, runner: BatchRunner, extents: Sequence[Extent]) -> Computed:
        """The chunks, each as soon as it is there.

        **Raises** `StoreError` where a chunk cannot be computed after all retries."""

    @property
    @abstractmethod
    def workers(self) -> int:
        """How many chunks are computed at a time."""

    @property
    def leads(self) -> bool:
        """Whether this process makes the store; one of several that share a campaign does."""
        return True

    @property
    def shares(self) -> bool:
        """Whether several processes share a campaign, each of which computes a part."""
        return False

    def share(self, extents: Sequence[Extent]) -> list[Extent]:
        """What this process computes of the chunks."""
        return list(extents)

    def sync(self, stage: str) -> None:
        """Wait until all processes that share a campaign have come to this stage."""
        del stage


@final
class InProcess(AbstractEngine):
    """In this process: all cores of its CPU, or all of its accelerators, share every chunk."""

    @property
    def workers(self) -> int:
        return 1

    def compute(self, runner: BatchRunner, extents: Sequence[Extent]) -> Computed:
        for extent in extents:
            yield _timed(runner, extent)


def _timed(runner: BatchRunner, extent: Extent) -> Done:
    before = time.process_time()
    results = runner.run(extent.first, extent.runs)
    return Done(extent.chunk, results, time.process_time() - before)


@final
class ProcessPool(AbstractEngine):
    """In other processes of this machine, each on one core. A process that dies, whatever kills it,
    is replaced, and the chunks that were lost are computed again.

    **Arguments**

    - `workers`: how many; as many as cores by default.
    - `limit`: after how many seconds a chunk that has not returned counts as lost; never by
      default. It includes the start of a process, which compiles or loads the program.
    - `retries`: how often a chunk may be lost."""

    def __init__(
        self, workers: int | None = None, *, limit: float | None = None, retries: int = RETRIES
    ):
        self._workers = cores() if workers is None else workers
        if self._workers < 1:
            raise InputError(f"ProcessPool.workers is {workers}: it must be at least 1.")
        self.limit = limit
        self.retries = retries

    @property
    def workers(self) -> int:
        return self._workers

    def compute(self, runner: BatchRunner, extents: Sequence[Extent]) -> Computed:
        payload, losses = payload_of(runner.planned), dict.fromkeys(extents, 0)
        # Two for each process, so that none waits for the next one; memory is bounded by them.
        width, hopeless = 2 * self._workers, []
        while losses:
            started: dict[Future[Done], Extent] = {}
            # What was lost comes last, so that it keeps nothing else waiting.
            order = sorted(losses, key=lambda extent: (losses[extent], extent.chunk))
            for done in self._round(payload, order, width, started):
                losses = {e: n for e, n in losses.items() if e.chunk != done.chunk}
                yield done
            for extent in started.values():
                losses[extent] += 1
                if losses[extent] > self.retries:
                    hopeless.append((extent, losses.pop(extent)))
            # One for each from now on, so that a chunk is lost through itself alone.
            width = self._workers
        for extent, times in hopeless:
            raise StoreError(
                f"Chunk {extent.chunk} (runs {extent.first} to {extent.first + extent.runs - 1}) "
                f"was lost {times} times: its process ended or took too long. All other chunks "
                f"that could be computed are kept."
            )

    def _round(
        self,
        payload: bytes,
        waiting: list[Extent],
        width: int,
        started: dict["Future[Done]", Extent],
    ) -> Computed:
        """The chunks, until a process is lost; `started` then holds those that were under way."""
        # Not forked: a fork of a process that has threads, as jax has, may hang.
        context = multiprocessing.get_context("spawn")
        pool = ProcessPoolExecutor(self._workers, context, _ignore_interrupts)
        try:
            while waiting or started:
                while waiting and len(started) < width:
                    with _without_main():
                        future = pool.submit(compute_chunk, payload, waiting[0])
                    started[future] = waiting.pop(0)
                for future in _first_done(started, self.limit):
                    done = future.result()
                    del started[future]
                    yield done
        except (BrokenProcessPool, TimeoutError):
            return
        finally:
            _stop(pool)


def _first_done(started: dict["Future[Done]", Extent], limit: float | None) -> set["Future[Done]"]:
    """Those that are done. Raises `TimeoutError` when nothing came within the limit."""
    done, _ = wait(started, limit, FIRST_COMPLETED)
    if not done:
        raise TimeoutError
    return done


def _stop(pool: ProcessPoolExecutor) -> None:
    """End the pool with all of its processes, whatever they do."""
    processes = list((pool._processes or {}).values())
    pool.shutdown(wait=False, cancel_futures=True)
    for process in processes:
        process.kill()
    for process in processes:
        process.join()


@contextlib.contextmanager
def _without_main() -> Iterator[None]:
    """While processes start: they do not import the script of the user, who would have to guard it,
    for what it defines travels with the campaign."""
    main = sys.modules["__main__"]
    kept = {name: main.__dict__.pop(name) for name in ("__file__",) if name in main.__dict__}
    spec, main.__spec__ = getattr(main, "__spec__", None), None
    try:
        yield
    finally:
        main.__dict__.update(kept)
        main.__spec__ = spec


def _ignore_interrupts() -> None:
    # Ctrl-C reaches all processes of a terminal: the first one tells the others to end.
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@final
class MultiHost(AbstractEngine):
    """On the processes of `jax.distributed`, on one machine or many, each with its own accelerators
    or cores. Every one of them makes the same call of `disperse` after
    `jax.distributed.initialize`; the store lies where all of them see it, and is needed."""

    @property
    def workers(self) -> int:
        return jax.process_count()

    @property
    def leads(self) -> bool:
        return jax.process_index() == 0

    @property
    def shares(self) -> bool:
        return True

    def share(self, extents: Sequence[Extent]) -> list[Extent]:
        # In turn, so that all of them come to the end together.
        return list(extents[jax.process_index() :: jax.process_count()])

    def sync(self, stage: str) -> None:
        from jax.experimental.multihost_utils import sync_global_devices

        sync_global_devices(f"jaxspace campaign {stage}")

    def compute(self, runner: BatchRunner, extents: Sequence[Extent]) -> Computed:
        return InProcess().compute(runner, extents)


@final
class DaskCluster(AbstractEngine):
    """On the workers of Dask distributed, which needs the extra `cluster`.

    **Arguments**

    - `address`: of a scheduler, such as "tcp://10.0.0.5:8786"; by default a cluster of this
      machine's own is started, which listens to this machine alone.
    - `workers`: of the cluster that is started.
    - `retries`: how often a chunk may fail or be lost with its worker."""

    def __init__(
        self, address: str | None = None, *, workers: int | None = None, retries: int = RETRIES
    ):
        self.address = address
        self._workers = cores() if workers is None else workers
        self.retries = retries

    @property
    def workers(self) -> int:
        return self._workers

    def compute(self, runner: BatchRunner, extents: Sequence[Extent]) -> Computed:
        payload, waiting = payload_of(runner.planned), list(extents)
        started, finished = set(), queue.SimpleQueue()
        with self._client() as client:
            while waiting or started:
                self._workers = max(len(client.scheduler_info()["workers"]), 1)
                while waiting and len(started) < 2 * self._workers:
                    future = client.submit(
                        compute_chunk, payload, waiting.pop(0), retries=self.retries, pure=False
                    )
                    future.add_done_callback(finished.put)
                    started.add(future)
                try:
                    future = finished.get(timeout=PULSE)
                except queue.Empty:
                    future = None
                # A scheduler that is gone sends no word, or cancels whatever it knew of.
                if client.status != "running" or (future and future.cancelled()):
                    raise ConnectionError("the scheduler does not answer")
                if future is not None:
                    started.discard(future)
                    yield future.result()

    @contextlib.contextmanager
    def _client(self) -> Iterator[Any]:
        try:
            from distributed import Client, LocalCluster
        except ImportError as error:
            raise InputError(
                'engine is "dask": it needs the extra `cluster` (pip install "jaxspace[cluster]").'
            ) from error
        from distributed.scheduler import KilledWorker

        where = "of this machine" if self.address is None else f"at {self.address}"
        with contextlib.ExitStack() as stack:
            # What Dask says of broken connections is said once, by the error below.
            stack.enter_context(_quiet("distributed"))
            try:
                target = self.address
                if target is None:
                    # For as long as the cluster lives, which replaces workers that die.
                    stack.enter_context(_without_main())
                    options = {"host": "127.0.0.1", "dashboard_address": None}
                    target = LocalCluster(self._workers, threads_per_worker=1, **options)
                    stack.enter_context(target)
                client = Client(target, set_as_default=False, timeout=30)
                stack.callback(_closed, client)
                yield client
            except (OSError, KilledWorker) as error:
                raise StoreError(
                    f"The Dask cluster {where} failed ({type(error).__name__}: {error}). All "
                    f"chunks that had been finished are kept."
                ) from error


def _closed(client: Any) -> None:
    """Close a client whose scheduler may be gone."""
    with contextlib.suppress(Exception):
        client.close(timeout=2)


@contextlib.contextmanager
def _quiet(name: str) -> Iterator[None]:
    import logging

    logger = logging.getLogger(name)
    before = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        logger.setLevel(before)


ENGINES: dict[str, Callable[[], AbstractEngine]] = {
    "local": InProcess,
    "processes": ProcessPool,
    "dask": DaskCluster,
    "hosts": MultiHost,
}


def as_engine(engine: str | AbstractEngine) -> AbstractEngine:
    """An engine by its name or by the address of a Dask scheduler; an engine passes.

    Raises `InputError` for anything else."""
    if isinstance(engine, AbstractEngine):
        return engine
    if engine in ENGINES:
        return ENGINES[engine]()
    if "://" in engine:
        return DaskCluster(engine)
    raise InputError(
        f"engine is {engine!r}: it must be one of {', '.join(ENGINES)}, or the address of a Dask "
        f'scheduler, such as "tcp://10.0.0.5:8786".'
    )


def payload_of(planned: PlannedCampaign) -> bytes:
    """The campaign with the settings of jax, for another process.

    Raises `InputError` where it holds what cannot be sent."""
    settings = {name: jax.config.values[name] for name in SETTINGS}
    arrays, buffer = jax.device_get(planned), io.BytesIO()
    try:
        # Sends functions by what they do, also those of the script that is run.
        import cloudpickle as pickler
    except ImportError:
        pickler = pickle
    try:
        pickler.dump((settings, arrays), buffer)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise InputError(
            f"The campaign cannot be sent to another process ({error}): install cloudpickle, or "
            f"define its functions in a module."
        ) from error
    return buffer.getvalue()


# One is enough: a worker serves one campaign after the other, each for a long time.
@functools.lru_cache(maxsize=1)
def _runner(payload: bytes) -> BatchRunner:
    settings, planned = pickle.loads(payload)
    for name, value in settings.items():
        jax.config.update(name, value)
    return BatchRunner(planned, jax.local_devices(), in_flight=1)


def compute_chunk(payload: bytes, extent: Extent) -> Done:
    """A chunk, in a worker."""
    return _timed(_runner(payload), extent)
