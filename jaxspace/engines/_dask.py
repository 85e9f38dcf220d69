"""The engine of Dask distributed."""

import contextlib
import logging
import queue
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, final

from ..core import InputError
from ..core.extras import extra
from ..stores import StoreError
from ._interface import (
    RETRIES,
    AbstractEngine,
    AbstractRunner,
    Computed,
    Extent,
    workers_or_cores,
)
from ._transfer import compute_chunk, payload_of, without_main

if TYPE_CHECKING:
    from distributed import Client

# The kinds of connection that Dask knows.
SCHEMES = ("tcp", "tls", "ws", "wss", "ucx", "inproc")
# Its logs of broken connections repeat the error of the engine.
LIBRARIES = ("distributed", "tornado")
# Interval of the checks that the scheduler is alive, s.
PULSE = 2.0


@final
class DaskCluster(AbstractEngine):
    """Engine on the workers of Dask distributed, which requires the extra `cluster`. Each computes
    one chunk at a time, and gets the next one when its last one is committed: if this process dies,
    at most one chunk of each is lost.

    **Arguments**

    - `address`: of a scheduler, such as "tcp://10.0.0.5:8786", or a `distributed.Client`, for
      clusters that need credentials or are started by another library; it remains open. By default
      a cluster on this machine is started, which listens on the local machine only.
    - `workers`: of the cluster that is started.
    - `retries`: maximum number of failures of a chunk, or losses with its worker.

    **Raises** `InputError` for an address that is none, and for less than one worker."""

    def __init__(
        self,
        address: "str | Client | None" = None,
        *,
        workers: int | None = None,
        retries: int = RETRIES,
    ):
        if address is not None and not is_client(address):
            _check_address(address)
        self.address = address
        self._workers = workers_or_cores("DaskCluster", workers)
        self.retries = retries

    @property
    def workers(self) -> int:
        return self._workers

    def compute(self, runner: AbstractRunner, extents: Sequence[Extent]) -> Computed:
        payload = payload_of(runner)
        waiting = list(extents)
        started = set()
        finished = queue.SimpleQueue()
        with self._client() as client:
            while waiting or started:
                # Queried each time, because workers come and go; at least one, to wait for the
                # first.
                self._workers = max(len(client.scheduler_info()["workers"]), 1)
                # One for each worker, which gets its next chunk when the last one is committed: so
                # whatever ends this process costs each of them one chunk.
                while waiting and len(started) < self._workers:
                    # Not pure: to reuse an answer, Dask would hash the payload for each chunk.
                    future = client.submit(
                        compute_chunk, payload, waiting.pop(0), retries=self.retries, pure=False
                    )
                    future.add_done_callback(finished.put)
                    started.add(future)
                try:
                    future = finished.get(timeout=PULSE)
                except queue.Empty:
                    future = None
                # A scheduler that is gone does not answer, or cancels its tasks.
                if client.status != "running" or (future and future.cancelled()):
                    raise ConnectionError("the scheduler does not answer")
                if future is not None:
                    yield future.result()
                    # The caller comes back for the next one when it has committed this one.
                    started.discard(future)

    @contextlib.contextmanager
    def _client(self) -> Iterator[Any]:
        with extra("cluster"):
            from distributed import Client, LocalCluster
            from distributed.scheduler import KilledWorker

        where = "of this machine" if self.address is None else f"at {_place(self.address)}"
        with contextlib.ExitStack() as stack:
            # Dask's log of broken connections is silenced, because the error below reports them.
            stack.enter_context(_quiet())
            try:
                target = self.address
                # The user closes it.
                if isinstance(target, Client):
                    yield target
                    return
                if target is None:
                    # For as long as the cluster lives, which replaces workers that die.
                    stack.enter_context(without_main())
                    # Without the dashboard, which would open a port.
                    options = {"host": "127.0.0.1", "dashboard_address": None}
                    target = LocalCluster(self._workers, threads_per_worker=1, **options)
                    stack.enter_context(target)
                # Not the default: the user may have a client of their own.
                client = Client(target, set_as_default=False, timeout=30)
                stack.callback(_closed, client)
                yield client
            except (OSError, KilledWorker) as error:
                raise StoreError(
                    f"The Dask cluster {where} failed ({type(error).__name__}: {error}). All "
                    "finished chunks are stored."
                ) from error


def is_client(engine: object) -> bool:
    """Whether an object is a client of Dask, without importing Dask for any other one."""
    module = type(engine).__module__.partition(".")[0]
    return module == "distributed" and hasattr(engine, "submit")


def _place(address: object) -> str:
    """The address of a scheduler, or that of a client's."""
    return address if isinstance(address, str) else str(getattr(address, "scheduler", address))


def _check_address(address: object) -> None:
    """Raise `InputError` for an invalid address of a scheduler."""
    kind, _, rest = str(address).partition("://")
    host, _, port = rest.rpartition(":")
    # A ticket of a process has a path in the place of the port.
    known = kind in SCHEMES and (kind == "inproc" or host and port.isdecimal())
    if not isinstance(address, str) or not known or kind != "inproc" and int(port) > 65535:
        raise InputError(
            f"engine is {address!r}: the address of a Dask scheduler must be "
            f'{" or ".join(SCHEMES)}, its host and its port, such as "tcp://10.0.0.5:8786".'
        )


def _closed(client: Any) -> None:
    """Close a client whose scheduler may be gone."""
    with contextlib.suppress(Exception):
        client.close(timeout=2)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Silence the logs of Dask, whose components have separate levels."""
    names = [name for name in logging.root.manager.loggerDict if name.startswith(LIBRARIES)]
    loggers = [logging.getLogger(name) for name in names]
    before = [logger.level for logger in loggers]
    # Permanent, because leftover objects of Dask fail later during garbage collection.
    logging.getLogger("asyncio").addFilter(_is_of_others)
    try:
        for logger in loggers:
            logger.setLevel(logging.CRITICAL + 1)
        yield
    finally:
        for logger, level in zip(loggers, before, strict=True):
            logger.setLevel(level)


def _is_of_others(record: logging.LogRecord) -> bool:
    """Whether a message about a task is not one of Dask."""
    kind = record.exc_info[0] if record.exc_info else None
    texts = (record.getMessage(), "" if kind is None else kind.__module__)
    return not any(library in text for library in LIBRARIES for text in texts)
