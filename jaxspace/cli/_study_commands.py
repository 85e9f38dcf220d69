"""The commands that ask questions about a run: what its accuracy costs, which of its effects
matter."""

import os
from typing import Any

from ..core import InputError
from ..io import Quantity, SceneError, SceneFile
from ..simulation import Mission
from ..studies import AccuracyCost, accuracy_cost, effect_budget
from ._settings import settle

TOLERANCES = tuple(10.0**-k for k in range(4, 13))
# What the size of an output is told in.
SIZES = {
    "position": Quantity("length", "m", "10 m", "positive"),
    "velocity": Quantity("speed", "m/s", "1 cm/s", "positive"),
    "attitude": Quantity("angle", "rad", "0.1 deg", "positive"),
    "omega": Quantity("angular velocity", "rad/s", "0.1 deg/s", "positive"),
    "mass": Quantity("mass", "kg", "1 g", "positive"),
}


def cost(file: SceneFile, error: float | None, gradient: bool, folder: str) -> int:
    """Print what accuracy costs, recommend a setting, and draw the diagram."""
    settle()
    system, y0, ts = file.nominal()
    ts = _start(file) if isinstance(system, Mission) else ts
    table = accuracy_cost(
        system,
        y0,
        ts,
        tolerances=sorted({*TOLERANCES, file.accuracy}, reverse=True),
        gradient=gradient,
    )
    print(f"{file.title}: what accuracy costs")
    print(table)
    print(f"\n{_recommendation(table, file.accuracy if error is None else error)}")
    _draw(table, file, folder, "_cost.png")
    return 0


def _recommendation(table: AccuracyCost, error: float) -> str:
    """The cheapest setting for a relative error of the final state, in words."""
    try:
        row = table.cheapest_row(error)
    except InputError as problem:
        return f"no setting is good enough: {problem}"
    how = (
        "the closed form"
        if row.tolerance is None
        else f"accuracy = {row.tolerance:.3g} with {row.method}"
    )
    reached = f"which reaches {row.error:.1g} in {1e3 * row.seconds:.3g} ms"
    return f"for a relative error of {error:.1g} in the final state: {how}, {reached}"


def budget(file: SceneFile, output: str | None, tolerance: str | None, folder: str) -> int:
    """Print what each effect does to the output and which of them may go, and draw it."""
    if file.kind == "system":
        raise SceneError(
            file.path,
            f"{file.values['system']['name']} is a textbook system: it must be a scene, with effects.",
        )
    settle()
    system, y0, ts = file.nominal()
    ts = _start(file) if isinstance(system, Mission) else ts
    output = next(name for name in SIZES if name in y0.present()) if output is None else output
    size = None if tolerance is None else _size(tolerance, SIZES[output])
    table = effect_budget(
        system, y0, ts, output=output, tolerance=size, accuracy=min(file.accuracy, 1e-9)
    )
    print(f"{file.title}: which effects matter")
    print(table)
    _draw(table, file, folder, "_budget.png")
    return 0


def _size(text: str, quantity: Quantity) -> float:
    """A tolerance with its unit. Raises `InputError` for another kind of number."""
    try:
        value = float(text)
    except ValueError:
        value = text
    try:
        return float(quantity.read(value))
    except ValueError as error:
        raise InputError(f'--tolerance is "{text}": it must be {error}.') from error


def _start(file: SceneFile) -> float:
    return 0.0 if file.kind == "mission" else file.values["times"]["start"]


def _draw(table: Any, file: SceneFile, folder: str, ending: str) -> None:
    import matplotlib

    matplotlib.use("Agg")
    path = os.path.join(folder, file.path.stem + ending)
    table.plot().savefig(path)
    print(f"figure {path}")
