"""The engine of several processes on one machine."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Collection, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import final

from ..stores import StoreError
from ._interface import (
    RETRIES,
    AbstractEngine,
    AbstractRunner,
    Computed,
    Done,
    Extent,
    workers_or_cores,
)
from ._transfer import compute_chunk, payload_of, without_main


@final
class ProcessPool(AbstractEngine):
    """Engine in other processes of this machine, each on one core. A process that dies, whatever
    kills it, is replaced, and the chunks that were lost are computed again. Each gets its next
    chunk when its last one is committed: if this process dies, at most one chunk of each is lost.

    **Arguments**

    - `workers`: number of processes; by default the number of cores.
    - `limit`: seconds after which an unfinished chunk counts as lost; never by default. It includes
      the start of a process, which compiles or loads the program.
    - `retries`: maximum number of losses of a chunk.

    **Raises** `InputError` for less than one worker."""

    def __init__(
        self, workers: int | None = None, *, limit: float | None = None, retries: int = RETRIES
    ):
        self._workers = workers_or_cores("ProcessPool", workers)
        self.limit = limit
        self.retries = retries

    @property
    def workers(self) -> int:
        return self._workers

    def compute(self, runner: AbstractRunner, extents: Sequence[Extent]) -> Computed:
        payload = payload_of(runner)
        losses = dict.fromkeys(extents, 0)
        hopeless = []
        while losses:
            started: dict[Future[Done], Extent] = {}
            # Lost chunks come last, so that they do not delay the others.
            order = sorted(losses, key=lambda extent: (losses[extent], extent.chunk))
            for done in self._round(payload, order, started):
                losses = {e: n for e, n in losses.items() if e.chunk != done.chunk}
                yield done
            for extent in started.values():
                losses[extent] += 1
                if losses[extent] > self.retries:
                    hopeless.append((extent, losses.pop(extent)))
        for extent, times in hopeless:
            raise StoreError(
                f"Chunk {extent.chunk} (runs {extent.first} to {extent.first + extent.runs - 1}) "
                f"was lost {times} times: its process ended or timed out. All other computed "
                "chunks are stored."
            )

    def _round(
        self, payload: bytes, waiting: list[Extent], started: dict["Future[Done]", Extent]
    ) -> Computed:
        """The chunks, until a process is lost; `started` then contains the unfinished ones."""
        # Not forked: a fork of a process that has threads, as jax has, may hang.
        context = multiprocessing.get_context("spawn")
        pool = ProcessPoolExecutor(self._workers, context, _begin)
        try:
            while waiting or started:
                # One for each process: it gets its next chunk when the last one is committed. So
                # whatever ends this process costs each of them one chunk, and memory is bounded.
                while waiting and len(started) < self._workers:
                    with without_main():
                        future = pool.submit(compute_chunk, payload, waiting[0])
                    started[future] = waiting.pop(0)
                future = _first_done(started, self.limit)
                yield future.result()
                # The caller comes back for the next one when it has committed this one.
                del started[future]
        # The caller finds in `started` what is lost, and begins another round.
        except (BrokenProcessPool, TimeoutError):
            # Finished chunks first, so that a process that dies costs no chunk of another one.
            for future in _come(started):
                yield future.result()
                del started[future]
        finally:
            _stop(pool)


def _first_done(started: Collection["Future[Done]"], limit: float | None) -> "Future[Done]":
    """A finished future. Raises `TimeoutError` if none finishes within the limit."""
    done, _ = wait(started, limit, FIRST_COMPLETED)
    if not done:
        raise TimeoutError
    return done.pop()


def _come(started: Collection["Future[Done]"]) -> list["Future[Done]"]:
    """The futures that have a result, where others were lost with their process."""
    return [future for future in started if future.done() and not future.exception()]


def _stop(pool: ProcessPoolExecutor) -> None:
    """End the pool and all of its processes."""
    processes = list((pool._processes or {}).values())
    pool.shutdown(wait=False, cancel_futures=True)
    for process in processes:
        # Killed, because a process that hangs would not end on request.
        process.kill()
    for process in processes:
        process.join()


def _begin() -> None:
    """Called in each process of the pool, as the first."""
    # Ctrl-C and the end of a terminal reach all of its processes: the first one ends the others.
    for name in ("SIGINT", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End this process when its parent has ended for any reason: otherwise it would wait for chunks
    forever, and keep the shared output open."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
    # At once, also from within a chunk.
    os._exit(1)
