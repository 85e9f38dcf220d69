"""Every command with every kind of bad file: code 2 and sentences, whatever the file."""

import argparse
import json
import os
import re
import shutil

import numpy as np
import pytest

from jaxspace.cli import main
from jaxspace.cli._parser import parser
from jaxspace.core import files as named_files
from jaxspace.io import _text

# The command line settles JAX for its own process.
pytestmark = pytest.mark.usefixtures("settings_stay")

SCENE = """
title = "A coast"

[planet]
mu = "398600.4418 km^3/s^2"
radius = "6378.137 km"

[effects.point_gravity]

[initial]
position = ["7000 km", 0.0, 0.0]
velocity = [0.0, "7.5 km/s", 0.0]

[times]
end = "10 min"

[dispersion]
runs = 4
outputs = ["speed"]

[dispersion.inputs]
"initial.position.0" = { deviation = "1 km" }

[optimize]
minimise = "speed"

[optimize.free]
"initial.velocity.1" = { low = "7 km/s", high = "8 km/s" }
"""
# What stands in another line in place of one of the scene, by what is then wrong.
WRONG = {
    "table": ("[times]\nend = ", "times = 3\n# "),
    "list of tables": ("[planet]", "[[planet]]"),
    "type": ('end = "10 min"', "end = [1.0]"),
    "kind of text": ('end = "10 min"', 'end = "soon"'),
    "unit": ('"398600.4418 km^3/s^2"', '"398600 kg"'),
    "unit that is none": ('"6378.137 km"', '"6378 parsnip"'),
    "sign": ('"398600.4418 km^3/s^2"', '"-1 km^3/s^2"'),
    "size": ('"6378.137 km"', "1e400"),
    "count": ('"7.5 km/s", 0.0]', '"7.5 km/s"]'),
    "key": ("runs = 4", "rums = 4"),
    "name": ("[effects.point_gravity]", "[effects.point_levity]"),
    "text": ('"A coast"', '"\\u001b[31m"'),
    "nothing": ("[initial]", "[other]"),
}
# Options that a command cannot do without.
NEEDED = {
    "replay": ["--run", "0"],
    "reweight": ["initial.position.0.deviation=1.0"],
    "compare": ["log.csv"],
}
# Commands without a file; `new`, whose file is one that it writes; `diff`, which has two
# (`test_cli_diff.py`); and `archive`, which runs no modules.
WITHOUT = {"examples", "new", "list", "schema", "programs", "verify", "diff", "archive"}


def commands():
    """The commands that read a scene, and those that read a store."""
    (choices,) = [
        action.choices
        for action in parser()._actions
        if isinstance(action, argparse._SubParsersAction)
    ]
    kinds = {
        name: action.metavar
        for name, command in choices.items()
        for action in command._actions
        if action.dest == "file"
    }
    assert set(kinds) | WITHOUT == set(choices)
    scenes = sorted(name for name, kind in kinds.items() if kind == "FILE")
    return scenes, sorted(set(kinds) - set(scenes)), sorted(choices)


SCENES, STORES, EVERY = commands()
SEEDS = [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(1, 6))]


def refused(capsys, *words, of_python=False):
    """The sentences with which a command ends with code 2.

    `of_python`: whether they may name an error of Python, that of the user's own file."""
    what = " ".join(words)
    code = main(words)
    printed, said = capsys.readouterr()
    lines = said.splitlines()
    assert code == 2 and lines, f"{what}: code {code}, {said or printed}"
    for line in lines:
        ends = of_python or line[-1] in ".?"
        sentence = line.isprintable() and ends and len(line) < 2000
        # No error of Python or of a library by its name, and no traceback.
        raw = re.search(r"Traceback|\b\w+(Error|Exception)\b", line)
        assert sentence and (of_python or not raw), f"{what}: {line}"
    return lines


def bad_scenes(folder, draw):
    """Files that no command can use, by what is wrong with them."""
    (folder / "folder.toml").mkdir()
    (folder / "empty.toml").write_text("")
    (folder / "binary.toml").write_bytes(draw.bytes(2000))
    (folder / "nul.toml").write_text('title = "a\x00b"')
    (folder / "line.toml").write_text(SCENE.replace("\n", " "))
    whole = SCENE.encode()
    for k in range(4):
        # Within a table: a file may end after one.
        place = int(draw.integers(1, SCENE.index("[dispersion.inputs]")))
        (folder / f"cut_{k}.toml").write_bytes(whole[:place])
    for what, (old, new) in WRONG.items():
        assert old in SCENE, old
        (folder / f"wrong {what}.toml").write_text(SCENE.replace(old, new, 1))
    (folder / "huge.toml").write_text(SCENE + "#" * 5000)
    os.mkfifo(folder / "pipe.toml")
    (folder / "circle.toml").symlink_to(folder / "circle.toml")
    return ["none.toml", *sorted(path.name for path in folder.glob("*.toml"))]


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """A store of four runs."""
    folder = tmp_path_factory.mktemp("store")
    (folder / "coast.toml").write_text(SCENE)
    here = os.getcwd()
    os.chdir(folder)
    try:
        assert main(["disperse", "coast.toml"]) == 0
    finally:
        os.chdir(here)
    return folder / "out" / "coast.zarr"


def bad_stores(folder, store, draw):
    """Stores that no command can use, by what is wrong with them."""
    head = (store / "zarr.json").read_bytes()
    record = json.loads(head)
    threes = {**record, "attributes": dict.fromkeys(record["attributes"], 3)}
    heads = {
        "empty": b"",
        "binary": draw.bytes(500),
        "cut": head[: int(draw.integers(1, len(head) - 2))],
        "list": b"[]",
        "number": b"3",
        "null": b'{"attributes": null}',
        "other": b'{"zarr_format": 3, "node_type": "group", "attributes": {}}',
        "types": json.dumps(threes).encode(),
        "huge": b"[" * 10**6,
    }
    for name, text in heads.items():
        shutil.copytree(store, folder / f"{name}.zarr")
        # With its copy, which is read in place of a damaged one.
        for path in ("zarr.json", ".manifest/head"):
            (folder / f"{name}.zarr" / path).write_bytes(text)
    (folder / "nothing.zarr").mkdir()
    (folder / "file.zarr").write_text("x")
    os.mkfifo(folder / "pipe.zarr")
    return ["none.zarr", *sorted(path.name for path in folder.glob("*.zarr"))]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="Windows has no such pipes")
@pytest.mark.parametrize("seed", SEEDS)
def test_every_command_refuses_every_bad_scene(tmp_path, capsys, monkeypatch, seed):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(_text, "PATIENCE", 0.01)
    monkeypatch.setattr(_text, "LONGEST", 4000)
    names = bad_scenes(tmp_path, np.random.default_rng(seed))
    tried = 0
    for command in SCENES:
        for name in names:
            refused(capsys, command, name, *NEEDED.get(command, []))
            tried += 1
    assert tried > 150
    # Nothing is begun that is not carried out.
    assert not list(tmp_path.rglob("*.zarr"))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="Windows has no such pipes")
@pytest.mark.parametrize("seed", SEEDS)
def test_every_command_refuses_every_bad_store(tmp_path, capsys, monkeypatch, store, seed):
    monkeypatch.chdir(tmp_path)
    for name in bad_stores(tmp_path, store, np.random.default_rng(seed)):
        for command in STORES:
            refused(capsys, command, name, *NEEDED.get(command, []))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="Windows has no such pipes")
def test_every_command_refuses_every_bad_module(tmp_path, capsys, monkeypatch, store):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(named_files, "LARGEST", 10**6)
    (tmp_path / "coast.toml").write_text(SCENE)
    (tmp_path / "folder.py").mkdir()
    (tmp_path / "binary.py").write_bytes(np.random.default_rng(0).bytes(300))
    (tmp_path / "cut.py").write_text("def f(")
    (tmp_path / "raises.py").write_text("1 / 0")
    (tmp_path / "leaves.py").write_text("raise SystemExit(0)")
    (tmp_path / "huge.py").write_text("#" * 2 * 10**6)
    os.mkfifo(tmp_path / "pipe.py")
    modules = ["none.py", *sorted(path.name for path in tmp_path.glob("*.py"))]
    for command in EVERY:
        if command in WITHOUT - {"list", "schema"}:
            continue
        file = {"list": [], "schema": []}.get(command, ["coast.toml"])
        file = [str(store)] if command in STORES else file
        for module in modules:
            words = (command, *file, *NEEDED.get(command, []), "--with", module)
            lines = refused(capsys, *words, of_python=True)
            assert module in "\n".join(lines)
