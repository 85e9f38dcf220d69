"""The benchmark for accelerators runs on any device, and its errors are those of the precision."""

import sys
from pathlib import Path

import jax
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


def test_a_device_that_is_not_there_is_named():
    if any(device.platform == "tpu" for device in jax.devices()):
        pytest.skip("there is one")
    with pytest.raises(RuntimeError, match="tpu"):
        accelerator.measure("tpu", widths=(8,), names=("kepler",))
