"""Everything that a reader is shown runs: the examples, and the Python of the README and of the
manual."""

import os
import re
import subprocess
import sys
from pathlib import Path

import jax
import pytest

ROOT = Path(__file__).parents[1]
EXAMPLES = sorted(path.name for path in (ROOT / "examples").glob("[0-9]*.py"))
CODE = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)
MANUAL = ["README.md", *sorted(str(path.relative_to(ROOT)) for path in ROOT.glob("docs/**/*.md"))]
PAGES = [page for page in MANUAL if CODE.search((ROOT / page).read_text())]


def test_there_is_something_to_show():
    assert len(EXAMPLES) >= 6 and "README.md" in PAGES and len(PAGES) >= 8


# A process of its own: an example chooses its precision, and no other test has touched JAX's
# settings before it.
@pytest.mark.parametrize("name", EXAMPLES)
def test_example_runs(name, request):
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


@pytest.mark.parametrize("page", PAGES)
def test_code_of_the_page_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # a page may write a file
    names = {"__name__": "page"}
    # A reader has JAX as it comes: of the settings that tests share only double precision is kept.
    with jax.numpy_dtype_promotion("standard"):
        for block in CODE.findall((ROOT / page).read_text()):
            exec(compile(block, page, "exec"), names)


@pytest.mark.parametrize("page", MANUAL)
def test_links_of_the_page_lead_somewhere(page):
    text = (ROOT / page).read_text()
    for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", text):
        assert ((ROOT / page).parent / target).exists(), f"{page} points to {target}"
