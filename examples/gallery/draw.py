"""Draws the manual's gallery: `python examples/gallery/draw.py [NAME ...]`.

Each script of the folders beside this file makes one figure; the pictures go
to `docs/figures/gallery`."""

import io
import runpy
import sys
from pathlib import Path

import matplotlib
from PIL import Image

HERE = Path(__file__).parent
STYLE = HERE / "gallery.mplstyle"
PICTURES = HERE.parents[1] / "docs" / "figures" / "gallery"


def scripts() -> dict[str, Path]:
    """Every script of the gallery by its name."""
    return {path.stem: path for path in sorted(HERE.glob("*/*.py"))}


def draw(script: Path) -> Image.Image:
    """The figure of a script, in the style of the gallery."""
    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    picture = io.BytesIO()
    with plt.style.context(STYLE):
        # The colours of the style are looked up when it is saved.
        runpy.run_path(str(script))["figure"].savefig(picture, format="png")
    plt.close("all")
    # Lines on white need few colours, and a third of the size.
    return Image.open(picture).convert("RGB").quantize(64)


if __name__ == "__main__":
    PICTURES.mkdir(exist_ok=True)
    found = scripts()
    for name in sys.argv[1:] or found:
        draw(found[name]).save(PICTURES / f"{name}.png", optimize=True)
        print(name, flush=True)
