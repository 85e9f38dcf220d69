"""`jaxspace map`: the files that it writes, and a campaign without a place on the map."""

import json
from xml.etree import ElementTree

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
