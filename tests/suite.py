"""Which tests are fast, and where the compiled programs of the tests are stored.

Plugins of pytest select by marks and split by elapsed time. Here the measured processor time
selects, basic tests of each package are always fast, and a long list of cases is sampled.

A test leaves the part that runs after every change (`--part quick`) only by its measured cost: the
file `costs.csv` holds the processor time of each test that took long, and `make costs` writes it
anew. A test that is not in the file is quick. A row without a case stands for all cases of a test:
those that share a program, which whichever of them runs first compiles.
"""

import csv
import hashlib
import os
import platform
from importlib.metadata import version
from pathlib import Path

from suite_basics import BASICS

COSTS = Path(__file__).with_name("costs.csv")
PROGRAMS = Path(__file__).resolve().parents[1] / ".programs"

# Of a test marked `slow` every fifth case is run.
SAMPLE = 5

# A test that takes more processor time than this, in seconds, leaves the quick part.
MOST_SECONDS = 0.6
# What a case takes beyond this, alone but not beside the others, is the program that they share.
SHARED_SECONDS = 2.0 * MOST_SECONDS

# Starts of the names of files whose tests look at commands, files, pages and pictures, where no
# digit decides: they compile as quickly as may be also where the others compile as users do.
WITHOUT_DIGITS = (
    *("campaign", "cli", "dispersion_page", "examples", "gallery", "hostile", "installation", "io"),
    *("keep_programs", "layers", "manual", "mutated", "optimize_file", "paper", "plots"),
    *("public_files", "scene", "types", "wrong"),
)

# All cases of a test that is named without one.
BASIC_TESTS = tuple(test for tests in BASICS.values() for test in tests.values())

# Costs below this are not written down: so many rows would change with each measurement.
LEAST_SECONDS = 0.5


def selected(items, part: str, sweep: str) -> list:
    """The tests of one part: the fast ones ("quick"), the others ("rest") or both ("all"). `sweep`
    selects a sample of the long sweeps, or all of their cases."""
    kept = list(items) if sweep == "all" else list(sample(items))
    if part == "all":
        return kept
    costs = read_costs()
    return [item for item in kept if is_quick(item.nodeid, costs) is (part == "quick")]


def is_quick(test: str, costs: dict[str, float]) -> bool:
    """Whether a test runs after every change: it is cheap, or one of the basics."""
    # No two files of tests have one name, whichever folder they are in.
    basic = test[test.partition("::")[0].rfind("/") + 1 :].startswith(BASIC_TESTS)
    return basic or cost(test, costs) <= MOST_SECONDS


def cost(test: str, costs: dict[str, float]) -> float:
    """What a test takes, s: a row without a case stands for all of its cases."""
    return max(costs.get(x, 0.0) for x in (test, all_cases(test)))


def looks_at_digits(path: Path) -> bool:
    """Whether a file of tests compares numbers, which the compiler's optimisations change."""
    return not path.stem.removeprefix("test_").startswith(WITHOUT_DIGITS)


def all_cases(test: str) -> str:
    """The name of a test without that of its case."""
    return test.partition("[")[0]


def sample(items):
    """Of every test marked `slow` each fifth case, the first included: a fixed sample, the same in
    every process. None of a test marked `sweep`."""
    seen = {}
    for item in items:
        if item.get_closest_marker("sweep") is not None:
            continue
        if item.get_closest_marker("slow") is not None:
            test = (item.path, item.cls, item.originalname)
            seen[test] = seen.get(test, -1) + 1
            if seen[test] % SAMPLE > 0:
                continue
        yield item


def read_costs() -> dict[str, float]:
    """The processor time of each test that took long, s."""
    with COSTS.open(newline="") as file:
        return {test: float(seconds) for test, seconds in csv.reader(file)}


def write_costs(measured: dict[str, float], part: str) -> None:
    """Write the costs of the tests that took long. What is measured of the quick part alone adds to
    the file: its tests now compile what those that left it compiled for them before, and where this
    is a program that the cases of a test share, all of them leave."""
    costs = measured
    if part == "quick":
        known = read_costs()
        dear = {t: s for t, s in measured.items() if s > SHARED_SECONDS >= known.get(t, 0.0)}
        costs = known | measured | {all_cases(t): s for t, s in dear.items()}
    rows = sorted((t, round(s, 1)) for t, s in costs.items() if s >= LEAST_SECONDS)
    with COSTS.open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(rows)


def processor_time() -> float:
    """Processor time of this process and of the children that have ended, s."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def program_folder() -> Path:
    """The folder of the compiled programs: one for each set of versions, kind of processor and
    flags of the compiler, because a program holds instructions of the processor that it was
    compiled for. Programs with and without the compiler's optimisations share a folder: JAX names
    them apart."""
    versions = [f"{name} {version(name)}" for name in ("jax", "jaxlib")]
    flags = os.environ.get("XLA_FLAGS", "")
    what = [platform.python_version(), platform.machine(), *versions, processor_features(), flags]
    return PROGRAMS / hashlib.sha256("\n".join(what).encode()).hexdigest()[:16]


def processor_features() -> str:
    """The instruction sets of the processor, as Linux lists them; elsewhere its name."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    # x86 says "flags", ARM "Features".
    features = [line for line in lines if line.startswith(("flags", "Features"))]
    return features[0] if features else platform.processor()
