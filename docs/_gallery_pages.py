"""Writes the pages of the gallery from the scripts of `examples/gallery`: a picture, what it shows,
and the code that made it."""

import ast
import re
from pathlib import Path

from mkdocs.structure.files import File

SCRIPTS = Path(__file__).resolve().parents[1] / "examples" / "gallery"
PAGES = {
    "orbits": "Orbits (chapters 1 to 4, H 5)",
    "rotation": "Rotation (chapter 5, H 4)",
    "instruments": "Instruments and mechanics (chapters 6 and 9)",
    "vehicles": "Vehicles (chapter 7)",
    "launch": "Launch (chapter 8)",
}
START = """\
# {title}

Figures of Thomson, *Introduction to Space Dynamics*, and of Harrison and
Nettleton, *Advanced Engineering Dynamics* (H), and some that they only
describe. Each script stands alone; `python examples/gallery/draw.py` draws
them all in the style of this page."""


def on_files(files, config):
    """Add the generated pages to the site."""
    for name, title in PAGES.items():
        text = gallery(name, title)
        files.append(
            File.generated(config, f"gallery/{name}.md", content=text)
        )
    return files


def gallery(name: str, title: str) -> str:
    """The page of a folder of scripts."""
    scripts = sorted((SCRIPTS / name).glob("*.py"), key=_place)
    return "\n\n".join(
        [START.format(title=title), *map(_figure, scripts)]
    ) + ("\n")


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


def _figure(script: Path) -> str:
    code = script.read_text()
    title, _, caption = (ast.get_docstring(ast.parse(code)) or "").partition(
        "\n\n"
    )
    # The page says it in its own words above the code.
    body = code.split('"""', 2)[2].strip()
    return (
        f"## {title}\n\n![{title}](../figures/gallery/{script.stem}.png)\n\n{caption}\n\n"
        f"```python\n{body}\n```"
    )
