"""The amount of compilation of first calls does not grow (`compilation.py`)."""

import json
import os
import subprocess
import sys
from pathlib import Path

import compilation

# In a new process, because what another test has traced would not be traced again.
PROCESS = "import compilation, json; print(json.dumps(compilation.measured()))"
MOST = 1.1
# Only the instructions, which are not compared, depend on the optimisations of the compiler.
ENVIRONMENT = {"JAX_DISABLE_MOST_OPTIMIZATIONS": "1", "JAXSPACE_PROGRAMS_LIMIT": "0"}


def test_first_calls_compile_no_more_than_in_the_table():
    done = subprocess.run(
        [sys.executable, "-c", PROCESS],
        cwd=Path(__file__).parent,
        env=os.environ | ENVIRONMENT,
        capture_output=True,
        text=True,
        check=True,
    )
    found, table = json.loads(done.stdout.splitlines()[-1]), compilation.read()
    assert list(found) == list(table)
    grown = [
        f"{call}: {found[call][name]} {name} instead of {row[name]}"
        for call, row in table.items()
        # The instructions of the optimised programs depend on the processor.
        for name in compilation.COLUMNS[:-1]
        if found[call][name] > MOST * row[name]
    ]
    assert not grown, "\n".join([*grown, "renew tests/compilation.csv, and give the reason there"])
