"""The paper: its form, its references, and its numbers, which stand in the committed results; and
the claims of the README, which do, too."""

import json
import re
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[1]
PAPER = (ROOT / "docs" / "paper.md").read_text()
RESULTS = {
    "Two-body motion, closed form": "kepler",
    "Lambert's problem": "lambert",
    "Low orbit under oblateness": "low_orbits",
    "Orbit of eccentricity 0.95": "eccentric_orbit",
    "256 orbits of eccentricity 0.7": "eccentric_orbits",
    "Model rocket": "model_rocket",
}
NUMBER = re.compile(r"([\d.,]*\d(?:e-?\d+)?)( million| ms)?")
SCALE = {" million": 1e6, " ms": 1e-3}


def measured(name, instructions="avx512"):
    """All numbers of a benchmark, by default on the processor that the paper names."""
    file = ROOT / "benchmarks" / "results" / instructions / f"{name}.json"
    return leaves(json.loads(file.read_text()))


def leaves(tree):
    if isinstance(tree, dict):
        return [x for value in tree.values() for x in leaves(value)]
    return [tree] if isinstance(tree, int | float) else []


# What the README says of speed and accuracy, by the table that it links.
CLAIMS = {
    ("low_orbits", "avx512"): ("77,800", "2.2e-11", "43,200", "2.0e-9"),
    ("low_orbits", "avx2"): ("47,500", "2.1e-11", "24,500", "2.0e-9"),
    ("model_rocket", "avx512"): ("15,700", "2.9e-6", "3.6", "2.6e-5"),
    ("gradients", "avx512"): ("3.8",),
}


@pytest.mark.parametrize("name, instructions", CLAIMS)
def test_the_claims_of_the_readme_are_measured(name, instructions):
    text = (ROOT / "README.md").read_text()
    numbers = measured(name, instructions)
    for claim in CLAIMS[name, instructions]:
        assert re.search(rf"[\s\[]{re.escape(claim)}", text), claim
        number = float(claim.replace(",", ""))
        digits = len(re.sub(r"e.*|[.,]|0+$", "", claim))
        assert any(float(f"{x:.{max(digits, 2) - 1}e}") == number for x in numbers), claim


@pytest.mark.parametrize("task", RESULTS)
def test_the_numbers_of_the_paper_are_measured(task):
    (row,) = re.findall(rf"^\| {re.escape(task)}.*$", PAPER, re.MULTILINE)
    numbers = measured(RESULTS[task])
    # A time is shown for the rate of a single run.
    numbers += [1.0 / x for x in numbers if x]
    # What the columns say, without names such as DOP853.
    for text, unit in NUMBER.findall(re.sub(r"[A-Z]+\d+", "", row.split("|", 2)[2])):
        number = float(text.replace(",", "")) * SCALE.get(unit, 1.0)
        digits = len(text.partition("e")[0].replace(".", "").replace(",", "").strip("0"))
        rounded = [float(f"{x:.{digits - 1}e}") for x in numbers]
        # The rest is the rounding of the units.
        assert any(abs(x / number - 1.0) < 1e-12 for x in rounded), (text, unit)


def test_the_paper_has_the_form_and_its_references():
    _, head, text = PAPER.split("---\n", 2)
    assert {"title", "tags", "authors", "affiliations", "date", "bibliography"} <= set(
        yaml.safe_load(head)
    )
    for part in ("Summary", "Statement of need", "State of the field", "References"):
        assert f"\n# {part}\n" in text
    known = set(re.findall(r"^@\w+\{(\w+),$", (ROOT / "docs/paper.bib").read_text(), re.MULTILINE))
    assert set(re.findall(r"\[@(\w+)\]", text)) == known
    for picture in re.findall(r"\]\((figures/[^)]+)\)", text):
        assert (ROOT / "docs" / picture).is_file()
