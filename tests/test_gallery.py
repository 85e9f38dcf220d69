"""The gallery: every script has its picture, stands on one screen, and draws."""

import ast
import importlib
import sys
from pathlib import Path

import jax
import pytest

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "examples" / "gallery"))

from draw import PICTURES, draw, scripts, seconds  # noqa: E402

SCRIPTS = scripts()
# One of each page; the others compile for long.
CHEAP = ("fig_7_5_3", "h_4_19", "h_5_6")


def test_every_script_has_its_picture():
    assert {path.stem for path in PICTURES.glob("*.png")} == set(SCRIPTS)
    for picture in PICTURES.glob("*.png"):
        assert 2_000 < picture.stat().st_size < 60_000, picture.name


def test_every_script_was_timed():
    assert list(seconds()) == list(SCRIPTS)
    # What a reader waits for a picture: that of the flexible gains compiles two searches.
    assert all(0.0 < float(x) < 150.0 for x in seconds().values())


def test_every_script_has_a_goal(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "docs")
    pages = importlib.import_module("_gallery_pages")
    named = [stem for stems in pages.GOALS.values() for stem in stems.split()]
    assert sorted(named) == sorted(SCRIPTS)
    # A heading leads to one figure.
    assert len({script.goal for script in pages.scripts().values()}) == len(SCRIPTS)


@pytest.mark.parametrize("name", SCRIPTS)
def test_script_stands_on_one_screen(name):
    code = SCRIPTS[name].read_text()
    head, _, caption = ast.get_docstring(ast.parse(code)).partition("\n\n")
    goal, figure = head.split("\n")
    assert goal and figure and caption
    assert len(code.splitlines()) <= 80


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=() if n in CHEAP else pytest.mark.sweep) for n in SCRIPTS]
)
def test_script_draws(name, settings_stay):
    with jax.numpy_dtype_promotion("standard"):
        picture = draw(SCRIPTS[name])
    # Paper, axes and lines.
    assert picture.width > 300 and len(picture.getcolors()) > 8
