"""Every data file, and every file of others, has its row in the page of licences."""

import re
from fnmatch import fnmatch
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "licences.md").read_text()
# Sources, and pages and figures of the manual, are under the licence of the whole.
OURS = {".gif", ".md", ".pyc", ".png", ".py"}
FOLDERS = ("benchmarks", "docs", "examples", "jaxspace", "tests", "validation")
# Without content, or settings of tools.
PLAIN = {"py.typed", "ruff.toml"}


def data_files():
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*")):
            hidden = any(part.startswith((".", "__")) for part in path.relative_to(ROOT).parts)
            if path.is_file() and path.suffix not in OURS and path.name not in PLAIN | {"LICENSE"}:
                if not hidden:
                    yield path.relative_to(ROOT).as_posix()


def patterns():
    listed, _, _ = PAGE.partition("Numerical values in programs")
    rows = re.findall(r"^\| (`[^|]*) \|", listed, re.MULTILINE)
    return [name for cell in rows for name in re.findall(r"`([^`]+)`", cell)]


def test_every_data_file_has_one_row():
    files = list(data_files())
    assert len(files) > 80
    for file in files:
        assert sum(fnmatch(file, pattern) for pattern in patterns()) == 1, file


def test_every_row_is_of_a_file_and_names_texts_that_are_there():
    files = list(data_files())
    for pattern in patterns():
        assert any(fnmatch(file, pattern) for file in files), pattern
    for text in re.findall(r"`([^`]*/LICENSE)`", PAGE):
        assert "MIT License" in (ROOT / text).read_text() or "MIT)" in (ROOT / text).read_text()
    for name in re.findall(r"`((?:examples|tests)/[^`*]*\.py)`", PAGE):
        assert (ROOT / name).is_file(), name
