"""The reference shows how each public class is constructed: its arguments with units, ranges and
defaults, and an example that runs."""

import importlib
from pathlib import Path

import jax
import pytest

from jaxspace.core.quantities import quantities
from jaxspace.mechanics import InclineDisk

DOCS = Path(__file__).parents[1] / "docs"
FILES = sorted((DOCS / "constructions").glob("*.py"))


@pytest.fixture
def constructions(monkeypatch):
    monkeypatch.syspath_prepend(DOCS)
    return importlib.import_module("_constructions")


def test_every_class_that_users_construct_has_an_example(constructions):
    known, have = constructions.classes(), constructions.examples()
    missing = [path for cls, path in known.items() if cls not in have]
    results = {known[cls] for cls in constructions.results()}
    assert len(have) > 200
    assert not set(missing) - results, "add it to docs/constructions"
    # The rule finds what only functions make.
    assert {"simulation.Trajectory", "estimation.Fit"} <= results


def test_the_table_lists_every_argument(constructions):
    """Of a declared quantity with its unit and range, of any other with its type."""
    for cls, path in constructions.classes().items():
        if cls in constructions.results():
            continue
        rows = constructions.describe(cls, cls.__doc__).splitlines()
        table = [row for row in rows if row.startswith("| `")]
        arguments = [p.name for p in constructions.parameters(cls)]
        assert [row.split("`")[1] for row in table] == arguments, path
        for row in table:
            name, cells = row.split("`")[1], [c.strip() for c in row.split(" | ")]
            if name in quantities(cls):
                assert cells[1] and cells[2], f"{path}.{name}"
            assert cells[3], f"{path}.{name}"


def test_every_argument_has_a_meaning(constructions):
    """From its declaration, its `doc` metadata or an entry of the docstring, also for results."""
    missing = []
    for cls, path in constructions.classes().items():
        rows = constructions.describe(cls, cls.__doc__ or "").splitlines()
        table = [row for row in rows if row.startswith("| `")]
        missing += [f"{path}.{row.split('`')[1]}" for row in table if row.endswith("|  |")]
    assert not missing, "add an entry '- `name`, unit: meaning.' to the docstring of the class"


def test_a_table_states_unit_range_and_default(constructions):
    rows = constructions.describe(InclineDisk, InclineDisk.__doc__)
    assert "| `radius` | m | positive and finite | required | r |" in rows
    assert "InclineDisk(mass=1.0, radius=0.3, slope=0.1, gravity=9.81)" in rows


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_examples_of_constructions_run(file, constructions, settings_stay):
    """Each one by itself, with its own imports, and it makes an object of its class."""
    known = {cls.__name__: cls for cls in constructions.classes()}
    with jax.numpy_dtype_promotion("standard"):
        for cls, code in constructions.of_file(file).items():
            *before, last = constructions.statements(code)
            names = {"__name__": "example"}
            exec("\n".join(before), names)
            made = eval(last, names)
            assert isinstance(made, known[cls.__name__]), code
