"""The results that are stored beside this file: a folder for each set of instructions, because
what a processor can do in one step decides most figures."""

import json
import os
import platform
import re
from pathlib import Path

RESULTS = Path(__file__).parent / "results"
# In the order in which the manual shows them.
SETS = {"avx512": "AVX-512", "avx2": "AVX2", "sse4_2": "SSE4.2", "neon": "NEON", "gpu": "GPU"}
# From the widest to the narrowest.
WIDTHS = ("avx512", "avx2", "sse4_2")
ALLOWED = re.compile(r"--xla_cpu_max_isa=(\w+)")


def instructions() -> str:
    """The widest vectors that compiled programs use on this processor, a name of `SETS`, or that of
    its kind where it is none of these. `--xla_cpu_max_isa` in XLA_FLAGS narrows them."""
    limit = ALLOWED.search(os.environ.get("XLA_FLAGS", ""))
    widest = _widest()
    below = WIDTHS[WIDTHS.index(widest) :] if widest in WIDTHS else ()
    return limit[1].lower() if limit and limit[1].lower() in below else widest


def described() -> str:
    """The set of instructions, and whether it is narrower than what the processor has."""
    used, widest = instructions(), _widest()
    return used if used == widest else f"{used} of {widest}"


def _widest() -> str:
    """The widest vectors of this processor."""
    kind = platform.machine().lower()
    if kind in ("arm64", "aarch64"):
        return "neon"
    names = {"avx512f": "avx512", "avx2": "avx2", "sse4_2": "sse4_2"}
    return next((name for flag, name in names.items() if flag in _flags()), kind)


def _flags() -> set[str]:
    """What the processor says that it can do; nothing where the system does not tell."""
    try:
        (line, *_) = re.findall(r"^flags\s*:(.*)$", Path("/proc/cpuinfo").read_text(), re.M)
    except (OSError, ValueError):
        return set()
    return set(line.split())


def read(name: str) -> dict[str, dict]:
    """The results of a benchmark by the set of instructions, in the order of `SETS`."""
    files = {kind: RESULTS / kind / f"{name}.json" for kind in SETS}
    return {kind: json.loads(file.read_text()) for kind, file in files.items() if file.exists()}


def write(name: str, kind: str, seen: dict) -> None:
    """Store what was seen of one benchmark."""
    file = RESULTS / kind / f"{name}.json"
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(seen, indent=1) + "\n")
