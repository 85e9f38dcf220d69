"""The command that lists and removes stored programs."""

import os

from jaxspace._jax_settings import STORED
from jaxspace.cli import main
from jaxspace.core.program_folder import ProgramFolder


def test_programs_are_listed_and_removed(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", str(tmp_path))
    assert main(["programs"]) == 0
    assert capsys.readouterr().out == f"0 stored programs, 0.0 MB, in {tmp_path / STORED}\n"
    folder = ProgramFolder(tmp_path / STORED, 10**7)
    for name, size in (("run-1", 10**6), ("run-2", 10**6), ("turns-1", 10**5)):
        folder.write(name, bytes(size))
    (tmp_path / "entry-of-jax").write_text("kept")
    old = folder.folder / "turns-1.program"
    os.utime(old, (old.stat().st_atime, old.stat().st_mtime - 3.2 * 86400.0))
    assert main(["programs"]) == 0
    machine, run, turns, _, total = capsys.readouterr().out.splitlines()
    assert machine == folder.folder.name
    assert run.split() == ["run", "2", "2.0", "MB", "last", "used", "today"]
    assert turns.split()[:2] == ["turns", "1"] and turns.endswith("last used 3 days ago")
    assert total == f"3 stored programs, 2.1 MB, in {tmp_path / STORED}"
    assert main(["programs", "--clear"]) == 0
    assert capsys.readouterr().out == f"3 stored programs removed from {tmp_path / STORED}\n"
    assert list(folder.folder.iterdir()) == []
    assert (tmp_path / "entry-of-jax").exists()


def test_a_file_in_place_of_the_folder_is_a_sentence(tmp_path, monkeypatch, capsys):
    path = tmp_path / "file"
    path.write_text("")
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", str(path))
    assert main(["programs"]) == 2
    assert "it must be a folder" in capsys.readouterr().err
