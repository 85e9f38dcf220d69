"""`jaxspace map`: the files that it writes, and a campaign without a place on the map."""

import json
from xml.etree import ElementTree

import pytest
from test_cli import CHEAP
from test_landings import SCENE, campaign

from jaxspace.cli import _map, main
from jaxspace.io import load


def test_map_writes_both_files(tmp_path, capsys, monkeypatch):
    file = load(SCENE)
    monkeypatch.setattr(_map, "open_store", lambda path: campaign())
    monkeypatch.setattr(_map, "stored_scene", lambda result, modules: file)
    out = tmp_path / "out"
    assert main(["map", str(tmp_path / "landing.zarr"), "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    for name in ("landing.kml", "landing.geojson"):
        assert str(out / name) in printed
    root = ElementTree.parse(out / "landing.kml").getroot()
    assert root[0][0].text == file.title
    features = json.loads((out / "landing.geojson").read_text())["features"]
    assert len(features) == 4000 - 40 + 6
    # Nothing is written to a path that is taken by a folder.
    (tmp_path / "landing.kml").mkdir()
    assert main(["map", str(tmp_path / "landing.zarr")]) == 2
    assert "landing.kml cannot be written" in capsys.readouterr().err


def test_map_refuses_a_scene_without_a_site(tmp_path, capsys, monkeypatch):
    (tmp_path / "coast.toml").write_text(CHEAP)
    file = load(tmp_path / "coast.toml")
    monkeypatch.setattr(_map, "open_store", lambda path: campaign())
    monkeypatch.setattr(_map, "stored_scene", lambda result, modules: file)
    assert main(["map", str(tmp_path / "coast.zarr")]) == 2
    assert "the scene has no launch site" in capsys.readouterr().err
    assert not list(tmp_path.glob("*.kml"))


@pytest.mark.usefixtures("settings_stay")
def test_map_writes_the_tracks_of_a_scene_and_of_runs(tmp_path, capsys):
    path = tmp_path / "coast.toml"
    path.write_text(CHEAP)
    assert main(["map", str(path), "--out", str(tmp_path / "out"), "--angle", "10 deg"]) == 0
    names = {"coast_tracks.gpx", "coast_tracks.kml", "coast.czml"}
    assert {p.name for p in (tmp_path / "out").iterdir()} == names
    assert main(["disperse", str(path), "--runs", "8", "--out", str(tmp_path / "all")]) == 0
    capsys.readouterr()
    words = ["map", str(tmp_path / "all" / "coast.zarr"), "--tracks", "2"]
    assert main([*words, "--epoch", "2026-03-01T12:00:00Z"]) == 0
    packets = json.loads((tmp_path / "all" / "coast.czml").read_text())
    assert [x["name"] for x in packets] == ["A coast", "nominal run", "run 0", "run 1"]
    capsys.readouterr()
    assert main([*words, "--epoch", "soon"]) == 2
    assert "epoch is 'soon'" in capsys.readouterr().err
    path.write_text(CHEAP.replace("398600.4418", "42828.37"))
    assert main(["map", str(path)]) == 2
    assert "tracks are drawn on the Earth" in capsys.readouterr().err
