"""`jaxspace compare`: the tables and the figure of a flight log, and logs that it refuses."""

import numpy as np
import pytest
from test_cli import CHEAP

from jaxspace.cli import main
from jaxspace.io import load

# The command line settles JAX for its own process.
pytestmark = pytest.mark.usefixtures("settings_stay")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A scene, and the log of its own nominal run, a minute late and 2 m/s too fast."""
    folder = tmp_path_factory.mktemp("log")
    (folder / "coast.toml").write_text(CHEAP)
    (phase,) = load(folder / "coast.toml").nominal_mission(samples=30).phases
    speed = np.linalg.norm(np.asarray(phase.states.velocity), axis=0)
    rows = [
        f"{t + 60.0},{1e-3 * v + 2e-3},1"
        for t, v in zip(phase.ts.tolist(), speed.tolist(), strict=True)
    ]
    (folder / "flight.csv").write_text("\n".join(["# Time (s),Speed (km/s),state", *rows]))
    return folder


def test_compare_prints_residuals_and_draws_them(folder, tmp_path, capsys):
    words = ["compare", str(folder / "coast.toml"), str(folder / "flight.csv")]
    assert main([*words, "--align", "-60", "--runs", "40", "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "t(run) = t(log) -60 s (given)" in printed
    # Also a sample whose time is rounded beyond the end of the run may be left out.
    assert "Speed    coast  km/s" in printed and "0.002" in printed
    assert "chi-square" in printed
    assert (tmp_path / "coast_flight.png").stat().st_size > 1000


def test_compare_refuses_bad_requests(folder, tmp_path, capsys):
    words = ["compare", str(folder / "coast.toml"), str(folder / "flight.csv")]
    for given, sentence in (
        (["--channel", "Height=speed"], "has no column 'Height': it has Speed, state."),
        (["--channel", "Speed=sped"], "channels['Speed'] is \"sped\""),
        (["--align", "1e6"], "they have no time in common"),
        (["--align", "apogee"], "it must be a number of seconds"),
    ):
        assert main([*words, *given, "--out", str(tmp_path)]) == 2
        assert sentence in capsys.readouterr().err
    assert main(["compare", str(folder / "coast.toml"), str(folder / "none.csv")]) == 2
    assert "none.csv" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main([*words, "--channel", "Speed"])
    (folder / "plain.toml").write_text(CHEAP[: CHEAP.index("[dispersion]")])
    words[1] = str(folder / "plain.toml")
    assert main([*words, "--runs", "40", "--out", str(tmp_path)]) == 2
    assert "has no [dispersion]" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
