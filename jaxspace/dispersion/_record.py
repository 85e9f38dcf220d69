"""The record in a store of how its runs were computed."""

import importlib.metadata
import platform
from pathlib import Path

import jax
import numpy as np

from ..core.processors import cores
from ..core.user_code import text_hash
from ..integration.accuracy import Accuracy
from ..statistics.requirements import requirement_of
from ._campaign import Campaign

LIBRARIES = ("jaxspace", "jax", "jaxlib", "equinox", "diffrax", "numpy", "xarray", "zarr")


def versions() -> dict[str, str]:
    """The versions of Python and of the libraries on which the numbers depend."""
    result = {"python": platform.python_version()}
    for name in LIBRARIES:
        try:
            result[name] = importlib.metadata.version(name)
        # A library that is not needed for this campaign may be absent.
        except importlib.metadata.PackageNotFoundError:
            result[name] = "not installed"
    return result


def machine() -> dict[str, str | int]:
    """The machine on which the numbers depend."""
    device = jax.local_devices()[0]
    return {
        "processor": _processor(),
        "system": f"{platform.system()} {platform.machine()}",
        "device": device.device_kind,
        "cores": cores(),
    }


def _processor() -> str:
    """Name of the model of the processor."""
    known = Path("/proc/cpuinfo")
    if known.exists():
        for line in known.read_text(errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def record(campaign: Campaign, accuracy: Accuracy, runs: int) -> dict[str, object]:
    """Record of the campaign, its accuracy, the versions and the machine."""
    # Resolved values, not those given: defaults may change between versions of the library.
    method = accuracy.method
    modules = {name: {"sha256": text_hash(text), "text": text} for name, text in campaign.modules}
    rtol = float(np.asarray(accuracy.rtol))
    return {
        "description": campaign.description,
        # Omitted if empty, so that a store of an earlier version can be resumed.
        **({"files": dict(campaign.files)} if campaign.files else {}),
        **({"modules": modules} if modules else {}),
        "inputs": campaign.text(),
        **(
            {"sweep": {"rows": campaign.rows, "inputs": list(campaign.sweep.columns)}}
            if campaign.sweep is not None
            else {}
        ),
        "requirements": {
            name: requirement_of(limits).record for name, limits in campaign.requirements
        },
        "planned_runs": runs,
        "rtol": rtol,
        "atol": 1e-3 * rtol if accuracy.atol is None else float(np.asarray(accuracy.atol)),
        "method": method if isinstance(method, str) else type(method).__name__,
        "versions": versions(),
        "machine": machine(),
    }
