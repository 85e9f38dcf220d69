"""Writes the pages of the gallery from the scripts of `examples/gallery`: a picture, what it shows,
what it uses, and the code that made it; and one page of all pictures by goal.

The docstring of a script begins with the goal of its reader, and the name of the figure."""

import ast
import csv
import functools
import re
from pathlib import Path
from typing import NamedTuple

from _uses import anchor, used
from mkdocs.structure.files import File

ROOT = Path(__file__).resolve().parents[1]
SCRIPTS = ROOT / "examples" / "gallery"
SECONDS = SCRIPTS / "seconds.csv"
PAGES = {
    "orbits": "Orbits (chapters 1 to 4, H 5)",
    "rotation": "Rotation (chapter 5, H 4)",
    "instruments": "Instruments and mechanics (chapters 6 and 9)",
    "vehicles": "Vehicles (chapter 7)",
    "launch": "Launch (chapter 8)",
}
START = """\
# {title}

Figures of Thomson, *Introduction to Space Dynamics*, and of Harrison and Nettleton, *Advanced
Engineering Dynamics* (H), and figures of problems that they describe. Each script is
self-contained; `python examples/gallery/draw.py` draws all figures in the style of this page."""


# What takes a derivative of a run or of a formula, or searches by them.
DERIVATIVE = re.compile(
    r"jax\.(grad|value_and_grad|jac\w+|jvp|vjp|hessian)\b|\b(minimi|optimi)se\w*\("
)

BY_GOAL = """\
---
hide: [toc]
---
# Gallery

Each picture links to the code that draws it and to the functions that it uses. The captions give
the figure numbers of the books, which are listed in [From the
textbook](../reference/from_the_textbook.md). The line below each caption states the lines of code
and the CPU time when `python examples/gallery/draw.py` draws all figures in one process, including
the compilation of programs that no earlier figure had compiled.
"""
GOALS = {
    "Orbit transfers": (
        "porkchop low_thrust_transfer fig_4_11_2 coaxial_ellipses fig_4_16_1 "
        "fig_4_16_2 fig_4_16_3"
    ),
    "Ascent": (
        "gimballed_ascent dispersed_ascent transfer_payload flexible_gains "
        "fig_8_5_1 fig_8_3_1 fig_8_1_2 fig_8_4_2 fig_8_4_3 fig_8_4_4"
    ),
    "Landing and recovery": (
        "windy_landing upright_landing branches booster_return air_brake "
        "roll_control fig_4_17_2 envelope"
    ),
    "Spinning stages": (
        "epicycle converging_spiral fig_7_9_3 fig_7_8_2 fig_7_3_2 fig_7_4_3"
    ),
    "Satellite stabilisation and despin": (
        "stability_map fig_7_5_3 swing_out_arms fig_7_6_4 fig_9_8_3"
    ),
    "Orbits": (
        "fig_4_9_2 fig_4_10_1 fig_4_13_2 fig_4_13_4 fig_4_18_1 ground_track "
        "rosettes h_5_6 h_5_7"
    ),
    "Free rotation": (
        "fig_5_10_5 fig_5_10_3 fig_5_10_4 fig_5_11_1 h_4_14 fig_5_8_2 fig_5_9_1 "
        "thrown_disk"
    ),
    "Tops and precession": (
        "fig_5_13_3 h_4_21 fig_5_13_2 h_4_19 fig_5_14_2 h_4_20 h_4_25 "
        "gyro_on_a_string spherical_pendulum shaft_pendulum coin_rattle "
        "earth_precession"
    ),
    "Gyroscopic instruments and navigation": (
        "gyrocompass_paths navigation_errors rate_gyro_response fig_6_8_3 "
        "fig_6_2_2 fig_6_2_3 gimbal_walk"
    ),
    "Mechanisms": (
        "double_pendulum hoop_bifurcation resonance_curve mode_shapes "
        "trailer_roots rolling_cycloid centrodes"
    ),
}
"""The scripts by what a reader wants, those of most use first."""


class Script(NamedTuple):
    """A script of the gallery: where it stands, and what its docstring and its code say."""

    path: Path
    goal: str
    name: str
    caption: str
    code: str


@functools.cache
def scripts() -> dict[str, Script]:
    """Every script by its stem."""
    return {path.stem: _script(path) for path in SCRIPTS.glob("*/*.py")}


def _script(path: Path) -> Script:
    code = path.read_text()
    words = ast.get_docstring(ast.parse(code)) or ""
    head, _, caption = words.partition("\n\n")
    goal, name = head.split("\n")
    return Script(path, goal, name, caption, code.split('"""', 2)[2].strip())


def on_files(files, config):
    """Add the generated pages to the site."""
    files.append(
        File.generated(config, "gallery/index.md", content=by_goal())
    )
    for name, title in PAGES.items():
        text = gallery(name, title)
        files.append(
            File.generated(config, f"gallery/{name}.md", content=text)
        )
    return files


def by_goal() -> str:
    """The page of all pictures."""
    parts = [BY_GOAL]
    for goal, stems in GOALS.items():
        cards = "\n".join(_card(scripts()[stem]) for stem in stems.split())
        parts.append(
            f'## {goal}\n\n<div class="pictures" markdown>\n{cards}\n</div>'
        )
    return "\n\n".join(parts) + "\n"


def _card(script: Script) -> str:
    page = f"{script.path.parent.name}.md#{anchor(script.goal)}"
    picture = f"../figures/gallery/{script.path.stem}.png"
    return (
        f"<div markdown>\n[![{script.name}]({picture}){{loading=lazy}}]({page})\n"
        f"[{script.goal}]({page})<br><small>{script.name}<br>{_size(script)}"
        f"{_derivatives(script)}</small>\n</div>"
    )


def gallery(name: str, title: str) -> str:
    """The page of a folder of scripts."""
    here = [s for s in scripts().values() if s.path.parent.name == name]
    here.sort(key=lambda script: _place(script.path))
    return "\n\n".join([START.format(title=title), *map(_figure, here)]) + (
        "\n"
    )


def _place(script: Path):
    # Figures by their numbers, Harrison and Nettleton's after Thomson's, then those without.
    rank = next(
        (
            k
            for k, s in enumerate(("fig", "h"))
            if script.stem.startswith(f"{s}_")
        ),
        2,
    )
    return (
        rank,
        [int(n) for n in re.findall(r"\d+", script.stem)],
        script.stem,
    )


def _figure(script: Script) -> str:
    whole = script.path.read_text()
    uses = ", ".join(f"[`{path}`][jaxspace.{path}]" for path in used(whole))
    # The page says the docstring in its own words above the code.
    return (
        f"## {script.goal}\n\n*{script.name}*\n\n"
        f"![{script.name}](../figures/gallery/{script.path.stem}.png)\n\n"
        f"{script.caption}\n\n"
        f"<small>`python examples/gallery/draw.py {script.path.stem}`: "
        f"{_size(script)} of CPU time{_derivatives(script)}. Uses {uses}"
        "</small>\n\n"
        f"```python\n{script.code}\n```"
    )


def _size(script: Script) -> str:
    """Lines of a script, and the seconds that it takes to draw."""
    lines = len(script.path.read_text().splitlines())
    return f"{lines} lines, {_seconds()[script.path.stem]}&nbsp;s"


def _derivatives(script: Script) -> str:
    """Says that a script differentiates, where its code does."""
    return ", with derivatives" if DERIVATIVE.search(script.code) else ""


@functools.cache
def _seconds() -> dict[str, str]:
    """Seconds of processor time of each script, as `draw.py` measured them."""
    return dict(csv.reader(SECONDS.read_text().splitlines()))
