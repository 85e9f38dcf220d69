"""The benchmark for accelerators runs on any device, and its errors are those of the precision."""

import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks import accelerator  # noqa: E402


def test_wide_batches_run_on_the_processor(monkeypatch):
    monkeypatch.setattr(accelerator, "CHECKED", 4)
    monkeypatch.setattr(accelerator.kepler, "STATES", 64)
    rows = accelerator.measure("cpu", widths=(8,), names=("kepler",))
    assert list(rows) == ["kepler, 8 runs, float64", "kepler, 8 runs, float32"]
    double, single = rows.values()
    # Of ten radians of motion, in roundings of each precision.
    assert double["worst_relative_error"] < 1e-12 < single["worst_relative_error"] < 1e-3
    assert all(row["runs_per_second"] > 0.0 for row in rows.values())


def test_steps_of_environments_run_in_both_precisions():
    """And are held against adaptive steps in double precision: 5e-9 is what ten steps of order 5
    leave of a tumble of some radians, single precision rounds it to 1e-7."""
    rows = accelerator.measure("cpu", widths=(8,), names=("environment_steps",))
    errors = [row["worst_relative_error"] for row in rows.values()]
    assert 1e-10 < errors[0] < 1e-7 and 1e-8 < errors[1] < 1e-5


@pytest.mark.sweep
@pytest.mark.parametrize("name", sorted(set(accelerator.WORKS) - {"kepler", "environment_steps"}))
def test_every_work_runs_on_the_processor(name):
    """To the tolerances of the works, of which that of model rockets is 1e-5, and in single
    precision to some hundredths: a day enlarges the roundings of steps of order 12."""
    double, single = accelerator.measure("cpu", widths=(8,), names=(name,)).values()
    assert double["worst_relative_error"] < 1e-4 and single["worst_relative_error"] < 5e-2


def test_as_many_runs_as_asked_of_what_has_runs():
    tree = {"r": jnp.arange(12.0).reshape(3, 4), "mu": jnp.ones(()), "table": jnp.zeros(2), "n": 3}
    wide = accelerator.in_precision(accelerator.cut(tree, 6), "float32")
    assert wide["r"].shape == (3, 6) and wide["r"].dtype == jnp.float32 and wide["n"] == 3
    assert wide["r"][0].tolist() == [0.0, 1.0, 2.0, 3.0, 0.0, 1.0]
    assert wide["mu"].shape == () and wide["table"].shape == (2,)


def test_a_width_that_the_memory_does_not_hold_has_no_row(monkeypatch, capsys):
    def row(work, program, whole, width, precision, place):
        if width > 8:
            raise jax.errors.JaxRuntimeError("RESOURCE_EXHAUSTED: Out of memory")
        return {"runs_per_second": 1e9}

    monkeypatch.setattr(accelerator, "row", row)
    monkeypatch.setattr(accelerator, "compiled", lambda *_: None)
    monkeypatch.setattr(accelerator.kepler, "STATES", 64)
    rows = accelerator.measure("cpu", widths=(8, 16, 32), names=("kepler",))
    assert list(rows) == ["kepler, 8 runs, float64", "kepler, 8 runs, float32"]
    assert "kepler, 16 runs, float64: the memory" in capsys.readouterr().err


def test_a_width_whose_call_would_take_too_long_has_no_row(monkeypatch, capsys):
    monkeypatch.setattr(accelerator, "row", lambda *_: {"runs_per_second": 1.0})
    monkeypatch.setattr(accelerator, "compiled", lambda *_: None)
    monkeypatch.setattr(accelerator.kepler, "STATES", 64)
    rows = accelerator.measure("cpu", widths=(8, 16), names=("kepler",))
    assert list(rows) == ["kepler, 8 runs, float64", "kepler, 8 runs, float32"]
    assert "kepler, 16 runs, float64: a call would take too long" in capsys.readouterr().err


def test_a_device_that_is_not_there_is_named():
    if any(device.platform == "tpu" for device in jax.devices()):
        pytest.skip("there is one")
    with pytest.raises(RuntimeError, match="tpu"):
        accelerator.measure("tpu", widths=(8,), names=("kepler",))
