"""The choice between linear covariance, sigma points and runs by the second-order term of an
output, which is known in closed form."""

import dataclasses
import math
import re
from typing import final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array
from test_campaign_commands import COAST
from test_campaigns import swing

from jaxspace.cli import main
from jaxspace.core import InputError
from jaxspace.dispersion import Campaign, Normal, disperse
from jaxspace.dispersion.automatic import choose_method


@final
class Bent(eqx.Module):
    """y = u + c u^2 of a standard normal number u, and a constant."""

    c: Array

    def __call__(self, result, samples):
        u = samples["w"]
        return {"y": u + self.c * u**2, "none": 0.0 * u}


def campaign(c, inputs=None):
    inputs = {"w": Normal(0.0, 1.0), "x0": Normal(1.0, 0.1)} if inputs is None else inputs
    return Campaign(swing, inputs, Bent(jnp.asarray(c)))


def term(c):
    """The mean is c and the variance 1 + 2 c^2, without the curvature 0 and 1."""
    spread = math.sqrt(1.0 + 2.0 * c * c)
    return max(c / spread, spread - 1.0)


@pytest.mark.parametrize(
    "c, method, words",
    [
        (0.005, "lincov", "^linear covariance, because .* below 1 %, the sampling error of 10000"),
        (
            0.05,
            "unscented",
            "^sigma points, because the second-order term of y is 5 % of its standard",
        ),
        (0.5, "monte_carlo", "^runs, because the second-order term of y is 41 % of its standard"),
    ],
)
def test_the_second_order_term_decides(c, method, words):
    found = choose_method(campaign(c), 10_000)
    assert found.method == method and found.second_order == pytest.approx(term(c), rel=1e-9)
    assert re.match(words, found.reason)
    result = disperse(campaign(c), 10_000, method="auto", seed=2)
    if method == "monte_carlo":
        assert result.runs == 10_000 and result.attributes["method_choice"] == found.reason
        assert np.mean(result.values("y")) == pytest.approx(c, abs=0.06)
    else:
        assert result.method == method and result.reason == found.reason
        # To the requested error, which is that of so many runs.
        k = result.names.index("y")
        assert result.mean[k] == pytest.approx(c, abs=0.01)
        assert result.std("y") == pytest.approx(math.sqrt(1.0 + 2.0 * c * c), rel=0.01)


def test_fewer_runs_allow_a_cheaper_method():
    assert choose_method(campaign(0.05), 100).method == "lincov"
    assert choose_method(campaign(0.05), 1_000_000).method == "monte_carlo"


def test_runs_where_nothing_else_serves():
    plain = campaign(0.0)
    required = dataclasses.replace(plain, requirements={"y": (None, 3.0)})
    found = choose_method(required)
    assert found.method == "monte_carlo" and "requirement needs them (y)" in found.reason
    assert "has a sweep" in choose_method(plain.at({"w": [0.0, 1.0]})).reason

    def folded(result, samples):
        return {"size": jnp.abs(samples["w"])}

    rough = choose_method(dataclasses.replace(plain, outputs=folded))
    assert rough.method == "monte_carlo" and "size is not smooth" in rough.reason
    with pytest.raises(InputError, match="^resume is True, and a store has the runs"):
        disperse(plain, 10, method="auto", resume=True)
    with pytest.raises(InputError, match="^runs is 0"):
        choose_method(plain, 0)


@pytest.mark.usefixtures("settings_stay")
def test_a_file_and_the_command_choose(tmp_path, capsys):
    """The inclination of an orbit about a point is its own: linear."""
    path = tmp_path / "coast.toml"
    text = COAST.replace("runs = 1200", 'runs = 1200\nmethod = "auto"')
    path.write_text(text.replace("deviation = 0.05", "deviation = 1e-6"))
    assert main(["disperse", str(path), "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("method: linear covariance, because the second-order term of")
    assert "apoapsis_altitude" in printed and not (tmp_path / "coast.zarr").exists()
