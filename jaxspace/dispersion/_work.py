"""Interface of engines, which compute chunks of a campaign with the same bits anywhere; and the
transfer of a campaign to a worker in another process."""

import contextlib
import functools
import io
import pickle
import sys
import time
from abc import ABC, abstractmethod
from collections.abc import Generator, Iterator, Sequence
from typing import NamedTuple, TypeAlias

import jax

from ..core import InputError
from ..core.user_code import run_module
from ..stores.results import RunResults
from ._batch_runner import BatchRunner
from ._prepared import PreparedCampaign

RETRIES = 3
# Settings of jax that change a program or its results, or say where compiled programs are stored.
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

        The caller commits a chunk before it takes the next one. At most `workers` chunks are begun
        and not committed at any time, and have to be computed again if this process dies.

        **Raises** `StoreError` where a chunk cannot be computed after all retries."""

    @property
    @abstractmethod
    def workers(self) -> int:
        """Number of chunks that are computed at the same time."""

    @property
    def leads(self) -> bool:
        """Whether this process makes the store; one of several that share a campaign does."""
        return True

    @property
    def shares(self) -> bool:
        """Whether several processes share a campaign, each of which computes a part."""
        return False

    @property
    def host(self) -> int | None:
        """Number of this process among those that share a campaign; `None` where it is alone."""
        return None

    def share(self, extents: Sequence[Extent]) -> list[Extent]:
        """The chunks that this process computes."""
        return list(extents)

    def sync(self, stage: str) -> None:
        """Wait until all processes that share a campaign have reached this stage."""
        del stage


def timed(runner: BatchRunner, extent: Extent) -> Done:
    """The runs of a chunk, with the processor seconds that they took in this process."""
    before = time.process_time()
    results = runner.run(extent.first, extent.runs)
    return Done(extent.chunk, results, time.process_time() - before)


@contextlib.contextmanager
def without_main() -> Iterator[None]:
    """While processes start: they do not import the script of the user, who would have to guard it,
    for what it defines travels with the campaign."""
    main = sys.modules["__main__"]
    hidden = {name: main.__dict__.pop(name) for name in ("__file__",) if name in main.__dict__}
    spec = getattr(main, "__spec__", None)
    main.__spec__ = None
    try:
        yield
    finally:
        main.__dict__.update(hidden)
        main.__spec__ = spec


def payload_of(prepared: PreparedCampaign) -> bytes:
    """The campaign with the settings of jax, for another process.

    Raises `InputError` where it holds what cannot be sent."""
    settings = {name: jax.config.values[name] for name in SETTINGS}
    # Copied from the device, which another process may not have.
    arrays = jax.device_get(prepared)
    buffer = io.BytesIO()
    try:
        # cloudpickle sends the code of functions, so that those of the user's script arrive too.
        import cloudpickle as pickler
    except ImportError:
        pickler = pickle
    try:
        pickler.dump(arrays, buffer)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise InputError(
            f"The campaign cannot be sent to another process ({error}): install cloudpickle, which "
            f"comes with the extra cluster, or define its functions in a module."
        ) from error
    # The modules travel apart, because they must have run before the campaign is read.
    return pickle.dumps((settings, prepared.campaign.modules, buffer.getvalue()))


# One is enough: a worker serves one campaign after the other, each for a long time.
@functools.lru_cache(maxsize=1)
def _runner(payload: bytes) -> BatchRunner:
    settings, modules, prepared = pickle.loads(payload)
    # Before the campaign is read: its arrays would lose their double precision.
    for name, value in settings.items():
        jax.config.update(name, value)
    for name, text in modules:
        run_module(name, text)
    return BatchRunner(pickle.loads(prepared), jax.local_devices(), in_flight=1)


def compute_chunk(payload: bytes, extent: Extent) -> Done:
    """A chunk, in a worker."""
    return timed(_runner(payload), extent)
