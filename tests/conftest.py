"""Settings of every test: double precision, no silent promotion of precision, the same draws on
every machine."""

import ctypes
import gc
import os
from pathlib import Path

import hypothesis
import jax
import pytest
from jax.experimental.compilation_cache import compilation_cache

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_dtype_promotion", "strict")

# The first call of a traced function compiles: a deadline would measure the compiler.
hypothesis.settings.register_profile("default", deadline=None, max_examples=50)
hypothesis.settings.register_profile(
    "ci", deadline=None, max_examples=50, derandomize=True, database=None
)
hypothesis.settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "default"))

SAMPLE = 5

# Each compiled program holds regions of memory, and Linux allows a process 65,530 of them: beyond,
# the compiler crashes. A single file of tests adds less than 20,000.
MAX_REGIONS = 20_000


def pytest_addoption(parser):
    parser.addoption(
        "--sweep",
        choices=("sample", "all"),
        default="sample",
        help="cases of the tests marked `slow` that run",
    )


def pytest_configure(config):
    """Compile the sample without the compiler's optimisations, which change no result and cost half
    of the time; the whole sweep and the benchmarks run what users run."""
    jax.config.update("jax_disable_most_optimizations", config.getoption("--sweep") == "sample")


def pytest_collection_modifyitems(config, items):
    """Of every test marked `slow`, keep each fifth case, the first included: a fixed sample, the
    same in every process. None of a test marked `sweep`."""
    if config.getoption("--sweep") == "all":
        return
    seen, kept, left_out = {}, [], []
    for item in items:
        leave = item.get_closest_marker("sweep") is not None
        if item.get_closest_marker("slow") is not None and not leave:
            test = (item.path, item.cls, item.originalname)
            seen[test] = seen.get(test, -1) + 1
            leave = seen[test] % SAMPLE > 0
        (left_out if leave else kept).append(item)
    if left_out:
        config.hook.pytest_deselected(items=left_out)
        items[:] = kept


@pytest.fixture(scope="module", autouse=True)
def programs_are_dropped():
    """Forget the compiled programs after a file of tests when they have become many, and give the
    memory of the compiler back."""
    yield
    regions = Path("/proc/self/maps")
    if regions.exists() and regions.read_bytes().count(b"\n") > MAX_REGIONS:
        jax.clear_caches()
        gc.collect()
    # The C library of Linux keeps what the compiler's threads have freed: with JAX 0.10 up to 15 GB
    # by the end of the suite, of which less than a tenth is in use.
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)


@pytest.fixture
def settings_stay():
    """Hand the settings of JAX back after a test that runs a page or the command line."""
    names = (
        "jax_enable_x64",
        "jax_compilation_cache_dir",
        "jax_persistent_cache_min_compile_time_secs",
        "jax_persistent_cache_min_entry_size_bytes",
    )
    before = {name: getattr(jax.config, name) for name in names}
    yield
    for name, value in before.items():
        jax.config.update(name, value)
    # JAX opens the folder of its cache once and would write there for the rest of the process.
    compilation_cache.reset_cache()


@pytest.fixture
def key():
    """The one random key of a test: split it for more."""
    return jax.random.key(20260101)
