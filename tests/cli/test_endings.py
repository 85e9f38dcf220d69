"""The ends of commands that the world brings about: signals, killed processes, disks and outputs on
which nothing more fits. Each leaves a sentence, the right status, no process and no half file."""

import contextlib
import io
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from test_campaign_commands import COAST, ROOT, stopped
from test_campaign_faults import fill, small_disk

from jaxspace.cli import _main, _output, _stopping, main
from jaxspace.dispersion import Campaign, Dispersion, Normal, StoreError, disperse, open_store
from jaxspace.io import SceneError, load
from jaxspace.plots import dispersion_page
from jaxspace.plots._page_script import page_script
from jaxspace.simulation import Mission, Phase

# The command line settles JAX for its own process.
pytestmark = pytest.mark.usefixtures("settings_stay")

FULL = Path("/dev/full")
UNIX = pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="Windows has no such signals")


def start(folder, *words, **options):
    """A command in a process of its own, its output in pipes."""
    return subprocess.Popen(
        [sys.executable, "-m", "jaxspace.cli", *words],
        **{"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "cwd": folder}
        | options,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )


def wait_for(path, process):
    """Until a campaign has written this file of its store."""
    end = time.monotonic() + 300.0
    while not path.exists() and process.poll() is None:
        assert time.monotonic() < end
        time.sleep(0.002)


# ---------------------------------------------------------------------------------------- signals


def test_a_signal_stops_once_and_again_where_that_lasts(monkeypatch):
    clock = [100.0]
    monkeypatch.setattr(_stopping.time, "monotonic", lambda: clock[0])
    before = [signal.getsignal(getattr(signal, name)) for name in _stopping.SIGNALS]
    with _stopping.stopped_by_signals():
        for name in _stopping.SIGNALS:
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(getattr(signal, name))
            # Impatience does not interrupt what tidies up.
            for other in _stopping.SIGNALS:
                signal.raise_signal(getattr(signal, other))
            clock[0] += 11.0
    assert [signal.getsignal(getattr(signal, name)) for name in _stopping.SIGNALS] == before


@UNIX
def test_a_signal_that_is_ignored_on_purpose_stays_so():
    """As by `nohup`."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with _stopping.stopped_by_signals():
            signal.raise_signal(signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_signal_during_the_imports_stops_after_them(capsys, monkeypatch):
    """A module that is half made would fail in words of its own."""
    made = []

    def imported():
        for _ in range(9):
            signal.raise_signal(signal.SIGINT)
        made.append(True)
        return lambda given: made.append("carried out")

    monkeypatch.setattr(_main, "_imported", imported)
    assert main(["list"]) == 130 and made == [True]
    assert capsys.readouterr().err == "jaxspace: stopped.\n"


@UNIX
@pytest.mark.sweep
def test_the_end_of_the_terminal_says_what_is_kept(tmp_path):
    """`stopped` asks for the sentence, and for the status."""
    store = stopped(tmp_path, signal.SIGHUP, 2, 0.002)
    assert open_store(store).runs > 0


@UNIX
@pytest.mark.sweep
@pytest.mark.parametrize("pause", [0.0, 0.02, 0.2])
@pytest.mark.parametrize("first", [".lock", ".manifest/1.json"])
@pytest.mark.parametrize("engine", ["local", "processes"])
def test_nine_interruptions_end_in_one_sentence(tmp_path, engine, first, pause):
    (tmp_path / "coast.toml").write_text(COAST)
    words = ["disperse", "coast.toml", "--out", ".", "--runs", "2000000", "--chunk", "512"]
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    process = start(tmp_path, *words, "--engine", engine, start_new_session=True)
    signal.signal(signal.SIGINT, before)
    wait_for(tmp_path / "coast.zarr" / first, process)
    for _ in range(9):
        # To all processes of the terminal.
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGINT)
        time.sleep(pause)
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 130, errors
    (line,) = [line for line in errors.splitlines() if "will be rejected" not in line]
    assert "stopped" in line
    # What it says is so.
    assert ("resume" in line) == (tmp_path / "coast.zarr").exists()


# -------------------------------------------------------------------------------- killed processes


@UNIX
@pytest.mark.slow
@pytest.mark.parametrize("engine", ["processes", pytest.param("dask", marks=pytest.mark.sweep)])
def test_workers_end_with_the_process_that_started_them(tmp_path, engine):
    """Its output is a pipe, which ends when the last process that has it open ends."""
    if engine == "dask":
        pytest.importorskip("distributed")
    (tmp_path / "coast.toml").write_text(COAST)
    words = ["disperse", "coast.toml", "--out", ".", "--runs", "2000000", "--chunk", "512"]
    process = start(tmp_path, *words, "--engine", engine, start_new_session=True)
    wait_for(tmp_path / "coast.zarr/.manifest/1.json", process)
    assert process.poll() is None
    process.kill()
    try:
        process.communicate(timeout=60)
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    assert open_store(tmp_path / "coast.zarr").runs > 0


# ------------------------------------------------------------------------------ disks and outputs


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    folder = tmp_path_factory.mktemp("coast")
    (folder / "coast.toml").write_text(COAST)
    assert main(["disperse", str(folder / "coast.toml"), "--out", str(folder)]) == 0
    return folder


def no_space(*given, **options):
    raise OSError(28, "No space left on device")


WRITERS = {
    "run": (["run", "coast.toml"], "savefig"),
    "report": (["report", "coast.zarr"], "savefig"),
    "report page": (["report", "coast.zarr"], "write_text"),
    "disperse": (["disperse", "coast.toml", "--overwrite", "--runs", "600"], "savefig"),
    "replay": (["replay", "coast.zarr", "--run", "1"], "savefig"),
    "budget": (["budget", "coast.toml"], "savefig"),
}


@pytest.mark.parametrize("name", WRITERS)
def test_a_command_that_cannot_write_a_file_says_so(name, flown, tmp_path, capsys, monkeypatch):
    from matplotlib.figure import Figure

    folder = tmp_path / "here"
    shutil.copytree(flown, folder)
    monkeypatch.chdir(folder)
    old = {path: path.read_bytes() for path in folder.glob("*.*") if path.is_file()}
    words, function = WRITERS[name]

    def partly(self, path, *given, **options):
        """Part of a file, as on a disk that becomes full."""
        if str(path).endswith((".png", ".html")):
            Path(path).write_bytes(b"part")
            no_space()
        return write_text(self, path, *given, **options)

    write_text = Path.write_text
    if function == "savefig":
        monkeypatch.setattr(Figure, "savefig", partly)
    else:
        monkeypatch.setattr(Path, "write_text", lambda path, *more, **o: partly(path, path, *more))
    assert main([*words, *([] if words[0] == "report" else ["--out", "."])]) == 2
    told = capsys.readouterr()
    assert "No space left on device" in told.err and "Traceback" not in told.err
    # Files that are there already stay whole.
    ending = ".png" if function == "savefig" else ".html"
    assert all(path.read_bytes() == x for path, x in old.items() if path.suffix == ending)
    assert not list(folder.glob(".unfinished*"))


def test_report_on_a_full_disk(flown, tmp_path, capsys):
    with small_disk(tmp_path / "disk", "24m") as disk:
        fill(disk / "ballast")
        assert main(["report", str(flown / "coast.zarr"), "--out", str(disk)]) == 2
        told = capsys.readouterr().err
        for end in ("png", "html", "csv"):
            assert f"coast.{end} cannot be written: No space left on device." in told
        assert [path.name for path in disk.iterdir()] == ["ballast"]


def test_report_where_no_file_may_grow(flown, tmp_path, capsys):
    """As of a quota, also where no disk can be mounted."""
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, before[1]))
    try:
        status = main(["report", str(flown / "coast.zarr"), "--out", str(tmp_path)])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    told = capsys.readouterr().err
    assert status == 2
    for end in ("png", "html", "csv"):
        assert f"coast.{end} cannot be written: File too large." in told
    assert list(tmp_path.iterdir()) == []


def test_a_file_takes_the_place_of_another_when_it_is_whole(tmp_path):
    (tmp_path / "old").write_text("old")
    (tmp_path / "link").symlink_to("old")
    with pytest.raises(OSError), _output.replacing(str(tmp_path / "link")) as unfinished:
        Path(unfinished).write_text("ne")
        no_space()
    assert (tmp_path / "old").read_text() == "old"
    _output.write_text(str(tmp_path / "link"), "new")
    assert (tmp_path / "old").read_text() == "new" and (tmp_path / "link").is_symlink()
    # Devices are no files that can be replaced.
    with _output.replacing(os.devnull) as path:
        assert path == os.devnull
    assert sorted(path.name for path in tmp_path.iterdir()) == ["link", "old"]


@pytest.mark.skipif(not FULL.exists(), reason="there is no device that is always full")
def test_an_output_on_which_nothing_fits_is_an_error(tmp_path):
    with FULL.open("w") as full:
        process = start(tmp_path, "list", stdout=full)
    _, errors = process.communicate()
    assert process.returncode == 2
    assert errors == "cannot be written or read: No space left on device.\n"


def test_the_error_output_may_be_gone(monkeypatch):
    class Gone(io.StringIO):
        def write(self, text):
            raise OSError(5, "Input/output error")

    monkeypatch.setattr(sys, "stderr", Gone())
    assert main(["resume", "nowhere.zarr"]) == 2


# ------------------------------------------------------------------------------- names and texts

BAD = ["a/b", "../x", "a\\b", ".hidden", "C:x", "NUL", "x" * 101, "a ", ""]


@pytest.mark.parametrize("name", BAD)
def test_names_of_phases_are_refused_before_anything_is_computed(name, tmp_path, capsys):
    path = tmp_path / "coast.toml"
    path.write_text(COAST.replace('name = "coast"', f"name = '{name}'"))
    with pytest.raises(
        SceneError, match="phase.0.name is .*: it must be text that can be part of a file name"
    ):
        load(path)
    assert main(["run", str(path), "--out", str(tmp_path)]) == 2
    assert "phase.0.name" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["a/b", "..", "a\\b", "x" * 300])
@pytest.mark.parametrize("place", ["phase", "input"])
def test_names_for_a_store_are_refused_before_anything_is_compiled(
    name, place, tmp_path, monkeypatch
):
    from test_campaigns import DURATION, Swinging

    which = name if place == "input" else "w"

    def build(samples):
        y0 = {"x": 1.0 + 0.0 * samples[which], "v": 0.0 * samples[which]}
        phase = Phase(Swinging(samples[which]), DURATION, name=name if place == "phase" else "a")
        return Mission([phase]), y0

    monkeypatch.setattr("jaxspace.dispersion._engine.BatchRunner", None)
    if place == "input" and name.startswith("."):
        pytest.skip("a campaign has no such input")
    campaign = Campaign(build, {which: Normal(2.0, 0.1)}, lambda r, s: {"x": r.final["x"]})
    with pytest.raises(StoreError, match="cannot be stored"):
        disperse(campaign, 8, store=tmp_path / "s.zarr", samples=2)
    assert not (tmp_path / "s.zarr").exists()


def test_data_cannot_hide_the_end_of_its_script(tmp_path):
    """Behind `<!--<script` a browser takes no `</script>` for the end."""
    hostile = "<!--<script>alert(1)</script>--><![CDATA[ \u2028</SCRIPT"
    text = page_script({hostile: [hostile]})
    inner = text.removeprefix("<script>").removesuffix("</script>")
    assert "<" not in inner.partition("\n")[0]
    x = np.arange(8.0)
    zero = np.zeros(8, int)
    units = {hostile: hostile}
    runs = Dispersion({"a": x}, {hostile: x}, zero, zero, units, 0, attributes={"inputs": hostile})
    page = dispersion_page(runs, tmp_path / "p.html", title=hostile).read_text(encoding="utf-8")
    data = next(line for line in page.splitlines() if "const data = " in line)
    assert "<" not in data.partition("const data")[2] and hostile not in page


def test_text_of_others_does_not_act_on_the_terminal(capsys):
    _output.say("first \x1b[31mred\x9b\nsecond ω")
    assert capsys.readouterr().err == "first \\x1b[31mred\\x9b\nsecond ω\n"
