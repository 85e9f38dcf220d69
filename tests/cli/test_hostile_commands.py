"""Commands with files and options that no author writes: code 2 and one sentence, at once."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from test_campaign_commands import COAST
from test_campaigns import CAMPAIGN

from jaxspace.cli import main
from jaxspace.core import InputError
from jaxspace.dispersion import AbstractEngine, disperse
from jaxspace.io import SceneError, _text, load
from jaxspace.scene import _explain

# The command line settles JAX for its own process.
pytestmark = pytest.mark.usefixtures("settings_stay")

DRIFT = """
[initial]
position = [0.0, 0.0, 0.0]
velocity = [1.0, 0.0, 0.0]

[times]
end = 10.0

[dispersion]
runs = 8
outputs = [OUTPUT]

[dispersion.inputs]
"initial.velocity.0" = { distribution = "samples", file = "values.txt" }
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with a drift, whose speeds stand in a file; the working folder."""
    monkeypatch.chdir(tmp_path)
    write(tmp_path)
    (tmp_path / "values.txt").write_text("1.0\n2.0\n3.0\n")
    return tmp_path


def write(folder, old="OUTPUT", new='"speed"', *, head=""):
    text = (head + DRIFT).replace(old, new).replace("OUTPUT", '"speed"')
    (folder / "drift.toml").write_text(text, encoding="utf-8")


def refusal(capsys, *arguments):
    """The sentence with which a command ends with code 2."""
    assert main(arguments) == 2
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 1, said
    # Nothing that a terminal would act on.
    assert said[0].isprintable()
    return said[0]


@pytest.mark.parametrize(
    "engine", ["ftp://x", "tcp://127.0.0.1:notaport", "tcp://x:99999", "tcp://:80", "tcp://x"]
)
def test_an_address_of_no_scheduler_is_refused_and_leaves_nothing(folder, capsys, engine):
    words = refusal(capsys, "disperse", "drift.toml", "--engine", engine)
    assert f"engine is {engine!r}: the address of a Dask scheduler must be" in words
    assert not list(folder.rglob("zarr.json"))


class Broken(AbstractEngine):
    """An engine that fails before its first run."""

    @property
    def workers(self):
        return 1

    def compute(self, runner, extents):
        yield from ()
        raise KeyboardInterrupt


def test_a_campaign_that_ends_before_its_first_run_is_in_nobody_s_way(tmp_path):
    """The corrected call runs, without a word about the store that the first one prepared."""
    store = tmp_path / "s.zarr"
    with pytest.raises(KeyboardInterrupt):
        disperse(CAMPAIGN, 8, store=store, engine=Broken())
    assert not list(store.rglob("zarr.json"))
    assert disperse(CAMPAIGN, 8, store=store).runs == 8


@pytest.mark.parametrize("numbers", [{"runs": 2**40}, {"seed": -1}, {"seed": 2**70}])
def test_numbers_beyond_those_of_files_are_refused_in_python_too(numbers):
    ((name, number),) = numbers.items()
    with pytest.raises(InputError, match=f"{name} is {number}: it must be a whole number from"):
        disperse(CAMPAIGN, **{"runs": 8, **numbers})


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('raise BaseException("x")', "line 1 raises BaseException: x"),
        ("class E(BaseException): pass\nraise E", "line 2 raises E"),
        ("a = 1\0", "cannot be run: SyntaxError: source code string cannot contain null bytes"),
        ("import sys\nsys.exit(3)", "line 2 raises SystemExit: 3"),
    ],
)
def test_a_module_that_cannot_be_run(folder, capsys, text, words):
    (folder / "own.py").write_text(text)
    assert words in refusal(capsys, "explain", "drift.toml", "--with", "own.py")


@pytest.mark.parametrize(
    ("entry", "content", "words"),
    [
        ('file = "values.txt"', "1" * 140_000, "cannot be read as CSV: field larger than"),
        # A decimal comma would cut the number at it, or shift the column.
        ('file = "values.txt"', "1\n0,5\n", "has 2 fields: it must have 1."),
        ('file = "values.txt", column = "h"', "g,h\n1,5,2\n", "has 3 fields: it must have 2."),
        ('file = "values.txt"', "1\n\nnan\n", 'is "nan": it must be a number.'),
        ('file = "values.txt"', "1e999\n", 'is "1e999": it must be a number.'),
        ('file = "values.txt"', "1_0\n", 'is "1_0": it must be a number.'),
        ('file = "values.txt", column = "h"', "h\n1\n inf\n", 'is " inf": it must be a number.'),
        ('file = "values.txt", column = ["h"]', "h\n1", 'column is ["h"]: it must be text'),
        ('file = "values.txt", unit = ["m"]', "1", 'unit is ["m"]: it must be text'),
    ],
)
def test_files_of_samples(folder, capsys, entry, content, words):
    write(folder, 'file = "values.txt"', entry)
    (folder / "values.txt").write_text(content)
    assert words in refusal(capsys, "explain", "drift.toml")


@pytest.mark.parametrize("name", ["/SECRET", "../secret.txt", "link.txt"])
def test_the_text_of_a_file_outside_is_not_shown(folder, capsys, name):
    """By an absolute path, by a way up, or through a link; in the folder it helps."""
    scene = folder / "inner"
    scene.mkdir()
    (folder / "secret.txt").write_text("user:password\n")
    (scene / "link.txt").symlink_to(folder / "secret.txt")
    (scene / "own.txt").write_text("user:password\n")
    name = name.replace("/SECRET", str(folder / "secret.txt"))
    write(scene, "values.txt", name)
    words = refusal(capsys, "explain", "inner/drift.toml")
    assert "line 1 of " in words and "not shown" in words and "password" not in words
    write(scene, "values.txt", "own.txt")
    assert 'is "user:password": it must' in refusal(capsys, "explain", "inner/drift.toml")


def test_the_text_of_a_motor_file_outside_is_not_shown(tmp_path):
    """What the effects read themselves, too."""
    rocket = (Path(__file__).parents[2] / "examples" / "scenes" / "landing.toml").read_text()
    motor = "../model_rockets/cesaroni_m1670.eng"
    assert motor in rocket
    (tmp_path / "inner").mkdir()
    (tmp_path / "secret.eng").write_text("user:password\n")
    scene = tmp_path / "inner" / "rocket.toml"
    scene.write_text(rocket.replace(motor, "../secret.eng"))
    with pytest.raises(SceneError) as refused:
        load(scene)
    assert "secret.eng, line 1 is not shown" in str(refused.value)
    assert "password" not in str(refused.value)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="Windows has no such pipes")
def test_a_pipe_is_not_waited_for_without_end(folder, capsys, monkeypatch):
    monkeypatch.setattr(_text, "PATIENCE", 0.1)
    os.mkfifo("pipe.toml")
    assert "it is a pipe without a writer" in refusal(capsys, "explain", "pipe.toml")
    # One into which somebody writes is read to its end.
    writer = "import pathlib; pathlib.Path('pipe.toml').write_text('titel')"
    with subprocess.Popen([sys.executable, "-c", writer]):
        monkeypatch.setattr(_text, "PATIENCE", 60.0)
        assert "pipe.toml: is not TOML: " in refusal(capsys, "explain", "pipe.toml")


@pytest.mark.parametrize(
    ("old", "new", "head", "words"),
    [
        ("", "", f'title = "{"x" * 10**6}"\n', "must be a single line of at most 200"),
        (
            "",
            "",
            'title = "a\\u001b[31mred"\n',
            r'title is "a\u001b[31mred": it must be a single line',
        ),
        ("", "", '"a\\u009b31m" = 1\n', r"a\x9b31m is not a known key"),
        (
            "OUTPUT",
            '{ output = "speed", name = "=1+1" }',
            "",
            "dispersion.outputs.0.name has the name '=1+1': it must be printable text that does "
            "not begin with any of = + - @",
        ),
        ("OUTPUT", '{ output = "speed", name = "@x" }', "", "does not begin with any of = + - @"),
        ("OUTPUT", '{ output = "speed", name = "a/../../x" }', "", "and is not a path"),
        (
            "OUTPUT",
            '{ output = "speed", at_least = "5 km/s", at_most = "1 km/s" }',
            "",
            'at_least is "5 km/s" and dispersion.outputs.0.at_most is "1 km/s": the lower',
        ),
    ],
)
def test_texts_names_and_limits(folder, capsys, old, new, head, words):
    write(folder, old, new, head=head)
    assert words in refusal(capsys, "explain", "drift.toml")


def test_a_periapsis_below_the_centre_is_refused_by_its_key(tmp_path, capsys):
    scene = tmp_path / "coast.toml"
    scene.write_text(COAST.replace('"400 mi"', '"-7000 km"'))
    words = refusal(capsys, "explain", str(scene))
    assert "initial.orbit.periapsis_altitude is -7e+06: it must be above -6.37814e+06 m" in words


def test_the_next_command_is_one_for_a_shell(folder, capsys):
    (folder / "drift.toml").rename("my drift.toml")
    assert main(["run", "my drift.toml"]) == 0
    assert "next   jaxspace disperse 'my drift.toml'\n" in capsys.readouterr().out


def test_numbers_beyond_the_range_of_floats_warn_of_nothing(folder, capsys):
    write(folder, "end = 10.0", "end = 1e308")
    main(["run", "drift.toml"])
    assert "Warning" not in capsys.readouterr().err


def test_scenes_of_one_structure_are_compiled_once(tmp_path, capsys, monkeypatch):
    """For the tables of many phases, which took a minute for four hundred of them."""
    compiled = []
    compile_vector_field = _explain.compile_vector_field
    monkeypatch.setattr(
        *(_explain, "compile_vector_field"),
        lambda *given: compiled.append(given) or compile_vector_field(*given),
    )
    phase = COAST[COAST.index("[[phase]]") : COAST.index("[dispersion]")]
    more = "".join(phase.replace('"coast"', f'"coast {k}"') for k in range(20))
    scene = tmp_path / "coast.toml"
    scene.write_text(COAST.replace("[dispersion]", more + "[dispersion]", 1))
    assert main(["explain", str(scene)]) == 0
    assert capsys.readouterr().out.count("point_gravity") == 21
    # The scene, and the scene without its effect.
    assert len(compiled) <= 2
