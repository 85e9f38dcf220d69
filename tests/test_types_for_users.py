"""The types that the package promises (`py.typed`) in the program of a user, under the strict modes
of pyright and mypy."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PROGRAM = ROOT / "tests" / "user_program.py"
# Strict, but for what JAX and jaxtyping leave unknown themselves: `jnp.linspace` is one of them.
PYRIGHT = {
    "typeCheckingMode": "strict",
    "pythonVersion": "3.11",
    "reportUnknownArgumentType": "none",
    "reportUnknownMemberType": "none",
    "reportUnknownVariableType": "none",
}
WRONG = """
import jaxspace
from jaxspace.orbits import TwoBody

TwoBody("large")
TwoBody(1.0, speed=2.0)
jaxspace.simulate(TwoBody(1.0))
jaxspace.simulates
"""


def pyright(folder, text):
    (folder / "program.py").write_text(text)
    (folder / "pyrightconfig.json").write_text(json.dumps(PYRIGHT | {"extraPaths": [str(ROOT)]}))
    command = ["pyright", "--pythonpath", sys.executable, "--outputjson", "-p", str(folder)]
    done = subprocess.run(
        [sys.executable, "-m", *command], capture_output=True, text=True, cwd=folder
    )
    return json.loads(done.stdout)["generalDiagnostics"]


def test_a_program_passes_pyright(tmp_path):
    assert (ROOT / "jaxspace" / "py.typed").is_file()
    assert not [x["message"] for x in pyright(tmp_path, PROGRAM.read_text())]


def test_what_is_wrong_is_seen(tmp_path):
    lines = {x["range"]["start"]["line"] for x in pyright(tmp_path, WRONG)}
    assert lines == {4, 5, 6, 7}


def test_a_program_passes_mypy(tmp_path):
    mypy = pytest.importorskip("mypy.api")
    # Of the program alone: what the package is made of, pyright checks.
    said, errors, status = mypy.run(
        ["--strict", "--follow-imports=silent", "--cache-dir", str(tmp_path), str(PROGRAM)]
    )
    assert status == 0, said + errors


@pytest.mark.sweep
def test_the_program_runs():
    done = subprocess.run([sys.executable, str(PROGRAM)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
