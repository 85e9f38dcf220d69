"""`jaxspace examples` and `jaxspace new`: every scene is listed once, and its copy stands alone."""

import re
import tomllib
from pathlib import Path

import pytest

import jaxspace
from jaxspace.cli import main
from jaxspace.cli._examples import GOALS, scenes

NAMES = [name for group in GOALS.values() for name in group]


def test_every_scene_is_listed_once(capsys):
    assert sorted(NAMES) == sorted(path.stem for path in scenes().glob("*.toml"))
    assert main(["examples"]) == 0
    listed = capsys.readouterr().out
    for name in NAMES:
        title = tomllib.loads((scenes() / f"{name}.toml").read_text())["title"]
        assert len(re.findall(rf"^  {name} .*{re.escape(title)} \(run", listed, re.MULTILINE)) == 1
    # The largest file is 5 kB; the wheel carries them all.
    assert sum(path.stat().st_size for path in scenes().iterdir()) < 200_000


def test_a_copy_is_the_scene_and_needs_nothing_beside_it(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["new", "kick_stage"]) == 0
    assert "next   jaxspace disperse kick_stage.toml\n" in capsys.readouterr().out
    assert Path("kick_stage.toml").read_text() == (scenes() / "kick_stage.toml").read_text()
    assert main(["new", "top", "mine.toml"]) == 0
    assert jaxspace.load("mine.toml").title == "Heavy top"
    # What a scene names is copied with it.
    assert main(["new", "landing"]) == 0
    assert "file   cesaroni_m1670.eng" in capsys.readouterr().out
    copied = jaxspace.load("landing.toml")
    assert list(copied.files.texts) == ["cesaroni_m1670.eng"]
    # Any other file that a scene names would be missed.
    for name in NAMES:
        text = (scenes() / f"{name}.toml").read_text()
        named = set(re.findall(r'"([^"]*\.\w{3})"', text))
        assert all(file.endswith((".eng", ".csv")) for file in named), name


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["new", "kick_stge"], "kick_stge is not a bundled example.* Did you mean kick_stage?"),
        (["new", "top", "there.toml"], "there.toml exists already: give a path"),
        (["new", "top", "no/such.toml"], "no/such.toml: cannot be written or read"),
    ],
)
def test_what_cannot_be_copied_is_a_sentence(arguments, sentence, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("there.toml").write_text("mine")
    assert main(arguments) == 2
    assert re.search(sentence, capsys.readouterr().err)
    assert Path("there.toml").read_text() == "mine"


def test_the_version_is_that_of_the_installation(capsys):
    with pytest.raises(SystemExit) as ending:
        main(["--version"])
    assert ending.value.code == 0
    assert capsys.readouterr().out == f"jaxspace {jaxspace.__version__}\n"
    # A number as PEP 440 has it: three parts at a tag, with `.devN` between two.
    assert re.match(r"\d+\.\d+", jaxspace.__version__) or jaxspace.__version__ == "0+unknown"
