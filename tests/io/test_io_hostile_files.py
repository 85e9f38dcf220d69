"""Files that no author writes: each is refused in a sentence, at once, or read as it is meant."""

import os
import time
from pathlib import Path

import pytest

from jaxspace.core import InputError
from jaxspace.core import files as _files
from jaxspace.io import SceneError, _text, load
from jaxspace.io.ephemeris import read_oem
from jaxspace.io.mean_elements import read_omm, read_tle
from jaxspace.rockets import read_motor

SCENES = Path(__file__).resolve().parents[2] / "examples" / "scenes"
TOP = (SCENES / "top.toml").read_text()
DRIFT = """
[initial]
position = [0.0, 0.0, 0.0]
velocity = [1.0, 0.0, 0.0]

[times]
end = 10.0

[dispersion]
outputs = ["speed"]

[dispersion.inputs]
"initial.velocity.0" = { distribution = "samples", file = "NAMED" }
"""


def refusal(path, text):
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SceneError) as refused:
        load(path)
    assert str(refused.value).startswith(str(path))
    return str(refused.value)


def test_a_byte_order_mark_is_no_statement(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(TOP, encoding="utf-8-sig")
    file = load(path)
    assert file.text == TOP and load(path, text="\ufeff" + TOP).text == TOP


@pytest.mark.parametrize(
    "line, words",
    [
        ("spare = " + "9" * 5000, "more than 307 digits"),
        # Python reads any number of hexadecimal digits, but writes none of them.
        ("spare = 0x" + "f" * 5000, "more than 307 digits"),
        ("spare = " + "9" * 400, "more than 307 digits"),
        ("spare = " + "[" * 3000 + "]" * 3000, "nested too deeply"),
        ("spare = " + "[" * 100 + "]" * 100, "nested too deeply"),
        ("a." * 3000 + "b = 1", "nested too deeply"),
    ],
)
def test_numbers_and_lists_without_end(tmp_path, line, words):
    assert words in refusal(tmp_path / "scene.toml", f"{line}\n{TOP}")


def test_the_format_of_a_file(tmp_path):
    """Without a format it is the first one; a later one is refused alone, with the way forward."""
    path = tmp_path / "scene.toml"
    assert "format = 1\n" in TOP
    without = TOP.replace("format = 1\n", "")
    assert load(path, text=without).values["format"] == 1
    later = refusal(path, f"format = 2\nunheard_of = 3\n{without}")
    assert (
        "format is 2: jaxspace" in later and "reads formats up to 1" in later and "upgrade" in later
    )
    assert len(later.splitlines()) == 1
    for wrong in ("0", "true", '"1"', "1.0"):
        assert "it must be a whole number above zero" in refusal(
            path, f"format = {wrong}\n{without}"
        )


def test_many_unknown_keys_are_refused_at_once(tmp_path):
    """The nearest name of each of them takes a minute; a second is far more than twenty take."""
    keys = "".join(f"k{k} = 1\n" for k in range(200_000))
    start = time.perf_counter()
    words = refusal(tmp_path / "scene.toml", keys + TOP)
    assert time.perf_counter() - start < 10.0
    assert "k0 is not a known key" in words and "199980 more unknown keys" in words
    assert "longer than 4,000,000 characters" in refusal(tmp_path / "scene.toml", 3 * keys + TOP)


def test_files_without_end_are_not_read(tmp_path, monkeypatch):
    """A device and a pipe, and files beyond the limit: named by a scene, and the scene itself."""
    scene, named = tmp_path / "scene.toml", tmp_path / "values.txt"
    os.mkfifo(tmp_path / "pipe")
    for name in ("/dev/zero", "pipe"):
        assert "it is not a regular file" in refusal(scene, DRIFT.replace("NAMED", name))
    named.write_text("1.0\n" * 100)
    monkeypatch.setattr(_files, "LARGEST", 100)
    assert "at most 0 MB are read" in refusal(scene, DRIFT.replace("NAMED", named.name))
    monkeypatch.setattr(_text, "LONGEST", 1000)
    with pytest.raises(SceneError, match="longer than 1,000 characters"):
        load("/dev/zero")


@pytest.mark.parametrize(
    "read, ending",
    [(read_motor, ".eng"), (read_oem, ".oem"), (read_tle, ".tle"), (read_omm, ".csv")],
)
def test_files_without_end_are_not_read_from_python(tmp_path, monkeypatch, read, ending):
    long, pipe, zero = (tmp_path / f"{name}{ending}" for name in ("long", "pipe", "zero"))
    os.mkfifo(pipe)
    zero.symlink_to("/dev/zero")
    for path in (pipe, zero):
        with pytest.raises(InputError, match=f"{path} cannot be read: it is not a regular file"):
            read(path)
    long.write_text("1.0\n" * 100)
    monkeypatch.setattr(_files, "LARGEST", 100)
    with pytest.raises(InputError, match="long.* cannot be read: .* at most 0 MB are read"):
        read(long)
    with pytest.raises(FileNotFoundError):
        read(tmp_path / f"none{ending}")
