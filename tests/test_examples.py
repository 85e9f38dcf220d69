"""The examples run."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
# An optional library that one needs.
NEEDS = {"14_forces_of_another_library.py": "astrojax"}
EXAMPLES = sorted(path.name for path in (ROOT / "examples").glob("[0-9]*.py"))
# Known optima: all but the one that the others share.
OPTIMA = sorted(
    f"{path.parent.name}/{path.name}"
    for path in (ROOT / "examples" / "known_optima").glob("*.py")
    if path.name != "known.py"
)


def test_there_are_examples():
    assert len(EXAMPLES) >= 6 and len(OPTIMA) >= 5


def test_what_is_read_as_a_recipe_is_short():
    """The examples of estimation and of layers, and every recipe of the cookbook, on one page."""
    recipes = [name for name in EXAMPLES if name[:2] in ("06", "10", "11", "12", "13")]
    assert len(recipes) == 5
    for name in recipes:
        assert len((ROOT / "examples" / name).read_text().splitlines()) < 80, name
    cookbook = (ROOT / "docs" / "howto" / "cookbook.md").read_text()
    blocks = [part.partition("```")[0] for part in cookbook.split("```python")[1:]]
    # One for the head, and one for each recipe.
    assert len(blocks) == 1 + cookbook.count("\n## ")
    assert max(len(block.splitlines()) for block in blocks) < 80


# A process of its own: an example chooses its precision, and no other test has touched JAX's
# settings before it.
@pytest.mark.parametrize(
    "name",
    [
        EXAMPLES[0],
        *(pytest.param(name, marks=pytest.mark.sweep) for name in EXAMPLES[1:] + OPTIMA),
    ],
)
def test_example_runs(name, request):
    if name in NEEDS:
        pytest.importorskip(NEEDS[name])
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    command = [sys.executable, "-W", "error", str(ROOT / "examples" / name)]
    # As the other tests of the sample: less optimised, the same results.
    light = {
        "JAX_DISABLE_MOST_OPTIMIZATIONS": str(int(request.config.getoption("--sweep") == "sample"))
    }
    done = subprocess.run(
        command,
        cwd=ROOT,
        env={**os.environ, **light, "PYTHONPATH": path},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.strip() and "nan" not in done.stdout.lower().split()
