"""Settings of every test: double precision, no silent promotion of precision, the same draws on
every machine."""

import ctypes
import gc
import os
from pathlib import Path

import hypothesis
import jax
import jaxtyping._typeguard as leaf_checks
import pytest
import suite
from jax.experimental.compilation_cache import compilation_cache

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_dtype_promotion", "strict")

# The first call of a traced function compiles: a deadline would measure the compiler.
hypothesis.settings.register_profile("default", deadline=None, max_examples=50)
hypothesis.settings.register_profile(
    "ci", deadline=None, max_examples=50, derandomize=True, database=None
)
hypothesis.settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "default"))

START = pytest.StashKey[float]()

# Each compiled program holds regions of memory, and Linux allows a process 65,530 of them: beyond,
# the compiler crashes. A single file of tests adds less than 20,000.
MAX_REGIONS = 20_000


def pytest_addoption(parser):
    parser.addoption(
        "--part",
        choices=("quick", "rest", "all"),
        default="all",
        help="tests that run: the fast ones, the others, or all",
    )
    parser.addoption(
        "--sweep",
        choices=("sample", "all"),
        default="sample",
        help="cases of the tests marked `slow` that run",
    )
    parser.addoption(
        "--optimised",
        action="store_true",
        help="compile as users do, where digits are compared; the whole sweep always does",
    )
    parser.addoption(
        "--no-programs",
        action="store_true",
        help="neither read nor store compiled programs",
    )
    parser.addoption(
        "--write-costs",
        action="store_true",
        help="write what each test took into tests/costs.csv",
    )


def pytest_configure(config):
    """Compile without the compiler's optimisations where they are not asked for: they take time and
    change the last digits of results, which no bound may rest on."""
    jax.config.update("jax_disable_most_optimizations", not is_optimised(config))
    leaf_checks.typechecked = of_leaf(leaf_checks.typechecked)
    # Traces make many objects that stay: to look through all of them so often takes a thirtieth.
    gc.set_threshold(50_000, 20, 50)
    # Programs are traced, as tests expect; tests of stored ones have their own folders.
    os.environ["JAXSPACE_PROGRAMS_LIMIT"] = "0"
    if not config.getoption("--no-programs"):
        store_programs()
    if config.getoption("--write-costs") and not hasattr(config, "workerinput"):
        config.pluginmanager.register(CostWriter(config.getoption("--part")))


def is_optimised(config) -> bool:
    """Whether tests that look at digits compile as users do."""
    return config.getoption("--optimised") or config.getoption("--sweep") == "all"


def of_leaf(typechecked):
    """How jaxtyping asks whether each leaf of a `PyTree[...]` has its type, by `isinstance` where
    the type is a class: it would build a checker for every call, a twelfth of all tests' time."""

    def check(accepts):
        (leaf_type,) = accepts.__annotations__.values()
        if not isinstance(leaf_type, type):
            return typechecked(accepts)

        def accepts_leaf(x):
            if not isinstance(x, leaf_type):
                raise TypeError

        return accepts_leaf

    return check


def store_programs():
    """Store every compiled program, so that neither the other worker nor the next call compiles it
    again. The variables reach the processes that tests start."""
    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(suite.program_folder()))
    os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
    os.environ["JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES"] = "-1"
    jax.config.update("jax_compilation_cache_dir", os.environ["JAX_COMPILATION_CACHE_DIR"])
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)


class CostWriter:
    """Collects what each test took and writes it at the end."""

    def __init__(self, part):
        self.part = part
        self.costs = {}

    def pytest_runtest_logreport(self, report):
        if report.when == "teardown":
            self.costs[report.nodeid] = dict(report.user_properties)["processor_time"]

    def pytest_sessionfinish(self):
        suite.write_costs(self.costs, self.part)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item):
    item.stash[START] = suite.processor_time()
    # The long sweeps continue campaigns of other processes, whose digits have to be the same.
    every = item.config.getoption("--sweep") == "all"
    optimised = every or is_optimised(item.config) and suite.looks_at_digits(item.path)
    if jax.config.values["jax_disable_most_optimizations"] is optimised:
        # JAX would go on with the programs that it has in memory, which have other digits than the
        # processes that a test starts.
        jax.clear_caches()
    jax.config.update("jax_disable_most_optimizations", not optimised)
    return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(item):
    item.user_properties.append(("processor_time", suite.processor_time() - item.stash[START]))
    return (yield)


def pytest_collection_modifyitems(config, items):
    kept = suite.selected(items, config.getoption("--part"), config.getoption("--sweep"))
    left_out = set(items) - set(kept)
    if left_out:
        config.hook.pytest_deselected(items=[item for item in items if item in left_out])
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
def fresh_programs():
    """Traces none of which was made before the test, or is used after it, because the test changes
    a constant that a trace depends on."""
    jax.clear_caches()
    yield
    jax.clear_caches()


@pytest.fixture
def settings_stay():
    """Hand the settings of JAX back after a test that runs a page or the command line."""
    names = (
        "jax_enable_x64",
        "jax_disable_most_optimizations",
        "jax_compilation_cache_dir",
        "jax_persistent_cache_min_compile_time_secs",
        "jax_persistent_cache_min_entry_size_bytes",
    )
    before = {name: jax.config.values[name] for name in names}
    yield
    for name, value in before.items():
        jax.config.update(name, value)
    # JAX opens the folder of its cache once and would write there for the rest of the process.
    compilation_cache.reset_cache()


@pytest.fixture
def key():
    """The one random key of a test: split it for more."""
    return jax.random.key(20260101)
