"""Figures in the text of the manual: those beside a link to a benchmark are in its stored results,
and those that no file stores are not written down."""

import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "benchmarks" / "results"
# Written by programs, or tested with the results of one processor.
OTHERS = {"benchmarks.md", "paper.md"}
LINKED = re.compile(r"benchmarks\.md#([\w-]+)")
CODE = re.compile(r"\]\([^)]*\)|`[^`]*`|\$[^$]*\$")
# With a comma, a point or an exponent: whole numbers are mostly sizes of the task. "1.5 times" is
# the ratio of two of them.
NUMBER = re.compile(
    r"(?<![\w.,^-])(\d+(?:,\d{3})+|\d+\.\d+(?:e-?\d+)?|\d+e-?\d+)( million| ms| mm)?"
    r"(?![\w,(]*\d| times)"
)
SCALE = {" million": 1e6, " ms": 1e-3, " mm": 1e-3}
SETTING = re.compile(r"1e-?\d+")


def _numbers(tree):
    """All numbers of a file of results, those in the names of its rows included."""
    if isinstance(tree, dict):
        return [x for key, value in tree.items() for x in _numbers(key) + _numbers(value)]
    if isinstance(tree, list):
        return [x for value in tree for x in _numbers(value)]
    if isinstance(tree, str):
        return [float(x) for x in re.findall(r"\d+\.?\d*(?:e[-+]?\d+)?", tree.replace(",", ""))]
    return [tree] if isinstance(tree, int | float) else []


def _blocks(text):
    """Paragraphs, entries of lists and rows of tables, without programs; with the benchmarks to
    which each links, a row also to those of the paragraph above its table."""
    above = []
    for block in re.split(r"\n\s*\n", re.sub(r"^```.*?^```", "", text, flags=re.M | re.S)):
        table = block.lstrip().startswith("|")
        parts = block.splitlines() if table else re.split(r"\n(?=- )", block)
        for part in parts:
            yield part, LINKED.findall(part) + (above if table else [])
        above = LINKED.findall(block)


def _is_stored(text, unit, stored):
    number = float(text.replace(",", ""))
    digits = len(re.sub(r"e.*|[.,]", "", text).strip("0"))
    rounded = [float(f"{x:.{max(digits, 1) - 1}e}") for x in stored]
    # Some files have the unit of the text.
    wanted = (number, number * SCALE.get(unit, 1.0))
    return any(abs(x / y - 1.0) < 1e-9 for x in rounded for y in wanted)


PAGES = [ROOT / "README.md", *sorted(ROOT.glob("docs/**/*.md"))]


@pytest.mark.parametrize(
    "page",
    [p for p in PAGES if p.name not in OTHERS and LINKED.search(p.read_text())],
    ids=lambda page: page.stem,
)
def test_figures_beside_a_benchmark_are_measured(page):
    for block, names in _blocks(page.read_text()):
        files = [f for x in names for f in RESULTS.glob(f"*/{x.replace('-', '_')}.json")]
        assert len(files) >= len(names), names
        stored = [x for file in files for x in _numbers(json.loads(file.read_text()))]
        # A time is shown for the rate of a single run.
        stored += [1.0 / x for x in stored if x]
        for text, unit in NUMBER.findall(CODE.sub("", block)) if names else ():
            known = SETTING.fullmatch(text) or _is_stored(text, unit, stored)
            assert known, f"{page.name}: {text}{unit} is not in {names}"


def test_the_readme_has_the_counts_of_the_validation():
    page = (ROOT / "docs/explanation/validation.md").read_text()
    rows, agree, differ = re.search(r"Of (\d+) rows (\d+) agree .* and (\d+) differ", page).groups()
    readme = " ".join((ROOT / "README.md").read_text().split())
    claimed = re.search(r"Of (\d+) quantities .*? \[(\d+) agree\].*? the other (\w+)\.", readme)
    words = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
    assert claimed.groups() == (rows, agree, words[int(differ)])
