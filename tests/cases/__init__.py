"""Reference cases of the textbooks as tables, a module for each chapter: `CASES` lists its rows.

`tests/test_cases.py` computes every row; the manual lists them on its page of cases."""

from types import ModuleType

from . import (
    thomson_1,
    thomson_4,
    thomson_5,
    thomson_5_rolling,
    thomson_6,
    thomson_7,
    thomson_7_despin,
    thomson_8,
    thomson_9,
    thomson_9_systems,
)

CHAPTERS: dict[str, ModuleType] = {
    "Vectors, kinematics, orientation (Thomson 1 to 3)": thomson_1,
    "Gravity and orbits (Thomson 4)": thomson_4,
    "Rotation of rigid bodies (Thomson 5, Harrison and Nettleton)": thomson_5,
    "Tops, rolling disks and the Earth (Thomson 5.13 to 5.16)": thomson_5_rolling,
    "Gyroscopic instruments (Thomson 6)": thomson_6,
    "Spinning bodies (Thomson 7.1 to 7.4)": thomson_7,
    "Despin, drift and lost mass (Thomson 7.5 to 7.11)": thomson_7_despin,
    "Flight of rockets (Thomson 8)": thomson_8,
    "Instruments and pendulums (Thomson 6 and 9)": thomson_9,
    "Systems by their Lagrangian (Thomson 9, appendices)": thomson_9_systems,
}
