"""Draws the manual's gallery: `python examples/gallery/draw.py [NAME ...]`.

Each script of the folders beside this file makes one figure; the pictures go
to `docs/figures/gallery`, and the seconds of processor time that each takes
to `seconds.csv`. They include compilation, but for programs that an earlier
script has compiled: let those that are compared be drawn in one process."""

import csv
import io
import runpy
import sys
import time
from pathlib import Path

import matplotlib
from PIL import Image

HERE = Path(__file__).parent
STYLE = HERE / "gallery.mplstyle"
PICTURES = HERE.parents[1] / "docs" / "figures" / "gallery"
SECONDS = HERE / "seconds.csv"


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


def seconds() -> dict[str, str]:
    """Seconds of processor time of each script, by its name, as they were
    measured when it was last drawn."""
    with SECONDS.open() as file:
        return dict(csv.reader(file))


def keep_seconds(measured: dict[str, str]) -> None:
    """Write the seconds of the scripts that there are."""
    with SECONDS.open("w", newline="") as file:
        rows = (
            (name, measured[name]) for name in scripts() if name in measured
        )
        csv.writer(file, lineterminator="\n").writerows(rows)


if __name__ == "__main__":
    # Every script imports these: the first of them is not to pay for all.
    import matplotlib.pyplot  # noqa: F401

    import jaxspace  # noqa: F401

    PICTURES.mkdir(exist_ok=True)
    known = scripts()
    measured = seconds() if SECONDS.exists() else {}
    for name in sys.argv[1:] or known:
        started = time.process_time()
        picture = draw(known[name])
        measured[name] = f"{time.process_time() - started:.1f}"
        picture.save(PICTURES / f"{name}.png", optimize=True)
        keep_seconds(measured)
        print(name, measured[name], flush=True)
