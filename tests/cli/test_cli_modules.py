"""Own physics from the command line: a Python file runs where the command names it, and nowhere
else; the store keeps its text, and goes on with the same."""

import re
from pathlib import Path

import numpy as np
import pytest
from test_campaigns import child

from jaxspace import load
from jaxspace.cli import main
from jaxspace.core import InputError
from jaxspace.dispersion import open_store
from jaxspace.io import SceneError, stored_scene

# The command line settles JAX for its own process.
pytestmark = pytest.mark.usefixtures("settings_stay")

MODULE = '''
from typing import final

from jaxspace import BodyState
from jaxspace.bodies import AbstractEffect, Load
from jaxspace.core import NumberField, Scalar, output, quantity
from jaxspace.core.vectors import axis


@final
class Push(AbstractEffect):
    """A constant acceleration along x."""

    size: NumberField = quantity("m/s^2", doc="of the acceleration")

    def load(self, t: Scalar, y: BodyState, body) -> Load:
        return Load(acceleration_N=self.size * axis(0, y.position[0]))


@output("m")
def advance(y: BodyState) -> Scalar:
    """How far the body has come along x."""
    return y.position[0]
'''
SCENE = """
modules = ["push.py"]

[effects.push]
size = "2 m/s^2"

[initial]
position = [0.0, 0.0, 0.0]
velocity = [0.0, 1.0, 0.0]

[[phase]]
name = "drive"
effects = ["push"]
duration = "10 s"

[dispersion]
runs = 40
outputs = ["advance"]

[dispersion.inputs]
"effects.push.size" = { deviation = "10 %" }
"""
RUN = "import sys; from jaxspace.cli import main; sys.exit(main(sys.argv[1:]))"


@pytest.fixture
def scene(tmp_path) -> Path:
    (tmp_path / "push.py").write_text(MODULE)
    (tmp_path / "drive.toml").write_text(SCENE)
    return tmp_path / "drive.toml"


@pytest.fixture(scope="module")
def flown(tmp_path_factory) -> Path:
    """A campaign with own physics, by workers in processes of their own that unpickle its classes.
    Runs are not of this process, whose checked types cannot be sent."""
    folder = tmp_path_factory.mktemp("drive")
    (folder / "push.py").write_text(MODULE)
    (folder / "drive.toml").write_text(SCENE)
    given = [str(folder / "drive.toml"), "--with", str(folder / "push.py"), "--out", str(folder)]
    process = child(RUN, "disperse", *given, "--engine", "processes")
    _, errors = process.communicate(timeout=600)
    assert process.returncode == 0, errors
    return folder


def test_a_file_alone_runs_nothing(scene, capsys):
    """Neither the key of the file nor a module beside it: the mark that it would leave is not
    there."""
    mark = scene.with_name("mark")
    scene.with_name("push.py").write_text(
        f"import pathlib\npathlib.Path({str(mark)!r}).touch()\n{MODULE}"
    )
    assert main(["run", str(scene), "--out", str(scene.parent)]) == 2
    told = capsys.readouterr().err
    assert 'modules.0 is "push.py", which is code' in told and "--with push.py" in told
    with pytest.raises(SceneError, match="a scene file alone never runs code"):
        load(scene)
    assert not mark.exists()
    load(scene, modules=[scene.with_name("push.py")])
    assert mark.exists()


def test_the_files_of_the_manual_work_together(tmp_path, capsys):
    page = (Path(__file__).parents[2] / "docs" / "howto" / "extending.md").read_text()
    blocks = re.findall(r'^```{.\w+ title="(.*?)"}\n(.*?)^```$', page, re.MULTILINE | re.DOTALL)
    for name, text in blocks:
        (tmp_path / name).write_text(text)
    given = [str(tmp_path / "decay.toml"), "--with", str(tmp_path / "my_effects.py")]
    assert main(["explain", *given]) == 0
    assert re.search(r"linear_drag +velocity +acceleration", capsys.readouterr().out)
    assert set(load(given[0], modules=given[2:]).campaign().units) >= {"distance"}


def test_run_and_budget_name_own_effects_and_outputs(scene, capsys):
    """x = a t^2 / 2, and without the push nothing."""
    given = [str(scene), "--with", str(scene.with_name("push.py")), "--out", str(scene.parent)]
    assert main(["run", *given]) == 0
    printed = capsys.readouterr().out
    assert re.search(r"advance \[m\] +100\b", printed)
    assert f"next   jaxspace disperse {scene} --with {scene.with_name('push.py')}\n" in printed
    assert main(["budget", *given, "--output", "advance", "--tolerance", "1 cm"]) == 0
    printed = capsys.readouterr().out
    assert re.search(r"push +drive +100 +100 +100", printed) and "final advance" in printed
    assert "within 0.01 m: every effect is needed" in printed
    assert main(["list", "advance", "--with", str(scene.with_name("push.py"))]) == 0
    assert "  advance [m]: How far the body has come along x" in capsys.readouterr().out


def test_workers_run_the_module_and_the_store_keeps_it(flown):
    kept = open_store(flown / "drive.zarr")
    np.testing.assert_allclose(
        kept.outputs["advance"], 50.0 * kept.inputs["effects.push.size"], rtol=1e-9
    )
    module = kept.attributes["modules"]["push.py"]
    assert module["text"] == MODULE and re.fullmatch("[0-9a-f]{64}", module["sha256"])
    with pytest.raises(InputError, match="The module push.py is not given: it must be the one of"):
        stored_scene(kept)
    file = stored_scene(kept, modules=[flown / "push.py"])
    assert float(file.simulate().final.position[0]) == pytest.approx(100.0, rel=1e-9)


def test_resume_asks_for_the_same_module(flown, tmp_path, capsys):
    store, other = str(flown / "drive.zarr"), tmp_path / "push.py"
    other.write_text(MODULE.replace("constant", "steady"))
    assert main(["resume", store]) == 2
    told = capsys.readouterr().err
    assert "The module push.py is not given: it must be the one of the store" in told
    assert main(["resume", store, "--with", str(other)]) == 2
    assert re.search(r"push.py is SHA-256 \w+\.\.\.: it must be", capsys.readouterr().err)
    assert main(["resume", store, "--with", str(flown / "push.py")]) == 0
    assert "40 of 40 runs succeeded" in capsys.readouterr().out


BAD = [
    ("x = 1\ny = x / 0\n", "bad.py cannot be run: line 2 raises ZeroDivisionError: division by"),
    ("x = (\n", "bad.py cannot be run: line 1 raises SyntaxError"),
    ("import sys\nsys.exit()\n", "bad.py cannot be run: line 2 raises SystemExit"),
    (
        "x = 1\n",
        "bad.py defines nothing that a scene file can use: it must contain declared functions",
    ),
    (MODULE, "bad.py defines push: this name is already in use"),
]


@pytest.mark.parametrize("text, sentence", BAD)
def test_a_module_that_cannot_serve_is_a_sentence(text, sentence, scene, capsys):
    scene.with_name("bad.py").write_text(text)
    modules = [str(scene.with_name(name)) for name in ("push.py", "bad.py")]
    given = [part for path in modules for part in ("--with", path)]
    assert main(["explain", str(scene), *given]) == 2
    assert sentence in capsys.readouterr().err


def test_files_that_are_not_there_or_share_a_name_are_sentences(scene, tmp_path):
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "push.py").write_text("x = 1\n")
    with pytest.raises(InputError, match="gone.py cannot be read: No such file"):
        load(scene, modules=["gone.py"])
    with pytest.raises(InputError, match="has the name of another module"):
        load(scene, modules=[scene.with_name("push.py"), tmp_path / "other" / "push.py"])
