"""Structures of scene files: files that differ in numbers and texts only share compiled programs,
also those that an earlier process has stored."""

import dataclasses
from pathlib import Path

import jax
import numpy as np
import pytest
from test_campaign_commands import COAST

from jaxspace.cli import main
from jaxspace.core import program_folder, stored
from jaxspace.core._structure_key import NoKey, key_of
from jaxspace.dispersion import open_store
from jaxspace.dispersion._interface import for_programs
from jaxspace.io import load
from jaxspace.io._kinds.values import Known, Measure
from jaxspace.io._search.task import search_of

SCENES = sorted((Path(__file__).parents[2] / "examples/scenes").glob("*.toml"))


MILE = 1609.344
# So little that all numbers are allowed still.
LESS = 1.0 - 1e-9


def changed(values):
    """The values of a file with other numbers."""
    if isinstance(values, Measure):
        return Measure.of(LESS * values, values.quantity, values.unit)
    if isinstance(values, Known):
        return Known(LESS * values)
    if isinstance(values, dict):
        return {key: changed(x) for key, x in values.items()}
    return [changed(x) for x in values] if isinstance(values, list) else values


def program_key(tree):
    """All that a program depends on whose argument is the tree."""
    leaves, structure = jax.tree.flatten(tree)
    return key_of([None if isinstance(x, jax.Array) else x for x in leaves], structure)


@pytest.mark.parametrize("path", SCENES, ids=[path.stem for path in SCENES])
def test_numbers_are_not_part_of_a_structure(path):
    file = load(path)
    # The lengths of closed loops are parts of their programs.
    keeps = file.values.get("control") is not None or any(
        leg.phase.get("control") is not None for leg in file.parsed.legs if file.kind == "mission"
    )
    values = {**changed(file.values), "title": "other", "dispersion": None, "optimize": None}
    if keeps:
        for key in ("times", "phase", "branch"):
            values |= {key: file.values[key]} if key in file.values else {}
    other = dataclasses.replace(file.parsed, values=values, source="other")
    assert other != file.parsed
    assert other.structure == file.parsed.structure
    assert hash(other.structure) == hash(file.parsed.structure)
    try:
        key = key_of(file.parsed.structure)
    except NoKey:
        # Only those of functions that check their annotations, which users' do not.
        assert hasattr(load, "__wrapped__")
        return
    assert key_of(other.structure) == key
    assert program_key(other.numbers()) == program_key(file.parsed.numbers())
    # A number that is missing where a program is traced is an error, and not that of this file.
    with pytest.raises(TypeError):
        float(next(x for x in leaves_of(file.parsed.structure.values) if x is float))


def leaves_of(values):
    if isinstance(values, dict):
        values = list(values.values())
    return [y for x in values for y in leaves_of(x)] if isinstance(values, list) else [values]


def edited(tmp_path, *replacements, text=COAST, name="edited"):
    for old, new in replacements:
        assert old in text
        text = text.replace(old, new)
    (tmp_path / f"{name}.toml").write_text(text)
    return load(tmp_path / f"{name}.toml")


OTHER_NUMBERS = (
    ('"A coast"', '"Another title" # and a comment'),
    ("400 mi", "310 mi"),
    ("10 min", "601 s"),
    ('"2 km"', '"3 km"'),
    ("runs = 1200\nseed = 3", "runs = 700\nseed = 4"),
)
OTHER_FORMS = (
    ('["point_gravity"]', '["point_gravity", "oblateness"]'),
    ("[initial.orbit]", "[initial.orbit]\ninclination = 0.1"),
    ('"apoapsis_altitude"', '"inclination"'),
)


def campaign_key(tmp_path, *replacements):
    """The key of a campaign of the coast with these replacements."""
    return program_key(for_programs(edited(tmp_path, *replacements).campaign(warn=False)))


def test_campaigns_of_one_structure_have_one_key(tmp_path):
    first = campaign_key(tmp_path)
    assert campaign_key(tmp_path, *OTHER_NUMBERS) == first
    for limit in (1000, 900):
        limited = f'{{ output = "apoapsis_altitude", at_most = "{limit} km" }}]'
        assert campaign_key(tmp_path, ('"apoapsis_altitude"]', limited)) == first
    planet = ('radius = "6378.137 km"', 'radius = "6378.137 km"\nj2 = 1e-3')
    keys = [campaign_key(tmp_path, planet, form) for form in OTHER_FORMS]
    assert len({first, campaign_key(tmp_path, planet), *keys}) == 2 + len(keys)


def test_searches_of_one_structure_have_one_key():
    file = load(next(path for path in SCENES if path.stem == "launch"))
    values = {**changed(file.values), "dispersion": None, "optimize": None}
    other = dataclasses.replace(
        file, text="", parsed=dataclasses.replace(file.parsed, values=values, source="other")
    )
    demands = tuple(demand._replace(target=0.5 * demand.target) for demand in file.task.demands)
    task = file.task._replace(demands=demands)
    first, second = search_of(file, file.task, 40), search_of(other, task, 40)
    assert program_key(first) == program_key(second)
    assert program_key(search_of(file, file.task, 41)) != program_key(first)


@pytest.fixture
def misses(tmp_path, monkeypatch):
    """The names of the programs that the folder of the commands has not had."""
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", str(tmp_path / "programs"))
    monkeypatch.setenv("JAXSPACE_PROGRAMS_LIMIT", "1000000000")
    read, result = program_folder.ProgramFolder.read, []

    def noted(self, name):
        content = read(self, name)
        result.extend([name] if content is None else [])
        return content

    monkeypatch.setattr(program_folder.ProgramFolder, "read", noted)
    yield result
    stored.store_in(None)


@pytest.mark.usefixtures("settings_stay")
def test_an_edited_file_compiles_nothing(tmp_path, misses, capsys):
    given = ["--runs", "20", "--out", str(tmp_path)]
    for name, numbers in (("first", ()), ("second", OTHER_NUMBERS)):
        edited(tmp_path, *numbers, name=name)
        for command in ("run", "disperse"):
            words = given if command == "disperse" else given[2:]
            assert main([command, str(tmp_path / f"{name}.toml"), *words]) == 0
        if name == "first":
            assert misses
            misses.clear()
            # As in another process, which has no programs in memory.
            jax.clear_caches()
    assert misses == []
    # In a coast the apsides stay: the results are those of the edited numbers.
    runs = open_store(tmp_path / "second.zarr")
    heights = runs.inputs["initial.orbit.periapsis_altitude"] / MILE
    expected = np.where(runs.good, heights, np.nan)
    np.testing.assert_allclose(runs.outputs["periapsis_altitude"], expected, rtol=1e-5)
    assert abs(np.mean(heights) - 310.0) < 2.0
    capsys.readouterr()
