"""Files that a scene names: a campaign keeps them in its store, and needs none of them again."""

import shutil

import numpy as np
import pytest
from test_campaign_commands import COAST

import jaxspace
from jaxspace.cli import main
from jaxspace.dispersion import StoreError, disperse, open_store
from jaxspace.io import stored_scene

pytestmark = pytest.mark.usefixtures("settings_stay")

SAMPLED = COAST.replace("{ deviation = 0.05 }", '{ distribution = "samples", file = "e.csv" }')
VALUES = "0.05\r\n0.1\r\n0.15\r\n"


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """A store that the command line made of a file beside a table, which are gone since."""
    folder = tmp_path_factory.mktemp("sampled")
    (folder / "coast.toml").write_text(SAMPLED)
    (folder / "e.csv").write_bytes(VALUES.encode())
    given = ["--runs", "600", "--chunk", "512", "--out", str(folder)]
    assert main(["disperse", str(folder / "coast.toml"), *given]) == 0
    for name in ("coast.toml", "e.csv"):
        (folder / name).unlink()
    return folder / "coast.zarr"


@pytest.fixture
def store(flown, tmp_path, monkeypatch):
    """The store at another place, seen from another folder."""
    store = shutil.copytree(flown, tmp_path / "moved.zarr")
    (tmp_path / "else").mkdir()
    monkeypatch.chdir(tmp_path / "else")
    # Of the same name, and of other numbers.
    (tmp_path / "else/e.csv").write_text("0.3\n")
    (tmp_path / "e.csv").write_text("0.3\n")
    return store


def test_a_store_keeps_the_files_of_its_scene(store):
    kept = open_store(store)
    assert kept.attributes["files"] == {"e.csv": VALUES}
    values = [0.05, 0.1, 0.15]
    np.testing.assert_array_equal(np.unique(kept.inputs["initial.orbit.eccentricity"]), values)
    assert stored_scene(kept).files.texts == {"e.csv": VALUES}


# The scene that all of them read is in the test above; those of a store without a table are in
# `test_campaign_commands.py`.
@pytest.mark.sweep
def test_commands_of_a_store_need_no_file_beside_it(store, flown, capsys):
    before = open_store(store).outputs["apoapsis_altitude"]
    (store / ".manifest/1.json").unlink()
    assert main(["resume", str(store)]) == 0
    np.testing.assert_array_equal(open_store(store).outputs["apoapsis_altitude"], before)
    assert main(["failures", str(store)]) == 0
    capsys.readouterr()
    assert main(["replay", str(store), "--run", "7"]) == 0
    (line,) = [x for x in capsys.readouterr().out.splitlines() if x.startswith("apoapsis")]
    # In the store and here: the same run to the tolerance.
    there, here = (float(x) for x in line.split()[-2:])
    assert here == pytest.approx(there, rel=1e-5)
    assert main(["report", str(store)]) == 0
    told = capsys.readouterr()
    assert "apoapsis_altitude" in told.out and "nominal" in told.out
    assert "No nominal run" not in told.err
    page = store.with_name("moved.html").read_text()
    assert "e.csv" in page and VALUES not in page


def test_a_store_of_another_file_is_another_campaign(tmp_path):
    def fly(text, **options):
        (tmp_path / "coast.toml").write_text(SAMPLED)
        (tmp_path / "e.csv").write_text(text)
        file = jaxspace.load(tmp_path / "coast.toml")
        store = tmp_path / "coast.zarr"
        return disperse(file.campaign(), 64, accuracy=file.accuracy, store=store, **options)

    fly("0.05\n0.1\n0.15\n")
    # The same moments and count, so that the text of the inputs is the same.
    words = "the file e.csv of the scene: 0.05 in the store, 0.15 here"
    with pytest.raises(StoreError, match=words):
        fly("0.15\n0.1\n0.05\n", resume=True)
    assert fly("0.05\n0.1\n0.15\n", resume=True).runs == 64


def test_files_given_for_one_campaign_are_its_own(tmp_path):
    (tmp_path / "coast.toml").write_text(COAST)
    (tmp_path / "e.csv").write_bytes(VALUES.encode())
    file = jaxspace.load(tmp_path / "coast.toml")
    given = {"initial.orbit.eccentricity": {"distribution": "samples", "file": "e.csv"}}
    assert dict(file.campaign(inputs=given).files) == {"e.csv": VALUES}
    assert file.campaign(warn=False).files == ()
