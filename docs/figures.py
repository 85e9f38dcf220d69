"""Draws the pictures of the manual with the library: `python docs/figures.py [NAME ...]` writes
docs/figures/NAME.png and, for `nutation`, the animation of the README."""

import re
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from _animation import nutation, save
from _figures_of_physics import (
    gravity_gradient,
    optimization,
    rockets,
    top,
    torque_free_body,
    transfers,
    two_body,
    two_gimbal_gyro,
)
from _figures_of_runs import (
    closed_loops,
    estimation,
    hybrid,
    kick_stage,
    missions,
    rocket_to_the_ground,
    what_accuracy_costs,
    which_effects_matter,
)
from PIL import Image

import jaxspace

HERE = Path(__file__).parent / "figures"


def orbit():
    """The figure that the first Python block of the README draws."""
    readme = (HERE.parents[1] / "README.md").read_text()
    block = re.search(r"^```python\n(.*?)^```$", readme, re.M | re.S)[1]
    exec(re.sub(r"^plt\.savefig.*$", "", block, flags=re.M), {})
    axes = plt.gca()
    axes.set(xlabel="x, m", ylabel="y, m", aspect="equal")
    return axes.figure


def dark(picture):
    """The dark version of a picture, as `manual.css` makes it in the browser: light and dark change
    places, hues stay, and white becomes the dark of the page that GitHub shows."""
    page = np.array([13, 17, 23]) / 255.0
    # Half a turn of the hue in the matrix of the CSS filter, after the inversion.
    luminance = np.array([0.213, 0.715, 0.072])
    rgb = 1.0 - np.asarray(picture.convert("RGB")) / 255.0
    rgb = np.clip(2.0 * (rgb @ luminance)[..., None] - rgb, 0.0, 1.0)
    screen = 1.0 - (1.0 - rgb) * (1.0 - page)
    return Image.fromarray(np.round(255.0 * screen).astype(np.uint8))


DRAWN = {
    f.__name__: f
    for f in (
        orbit,
        top,
        two_body,
        transfers,
        torque_free_body,
        gravity_gradient,
        rockets,
        two_gimbal_gyro,
        optimization,
        missions,
        kick_stage,
        rocket_to_the_ground,
        closed_loops,
        what_accuracy_costs,
        which_effects_matter,
        hybrid,
        estimation,
    )
}

if __name__ == "__main__":
    jaxspace.enable_x64()
    plt.switch_backend("agg")
    HERE.mkdir(exist_ok=True)
    for name in sys.argv[1:] or [*DRAWN, "nutation"]:
        if name == "nutation":
            save(nutation(), HERE / "nutation.gif")
            continue
        DRAWN[name]().savefig(HERE / f"{name}.png", dpi=110)
        plt.close("all")
        # A page of GitHub does not use the style sheet of the manual.
        if name == "kick_stage":
            light = Image.open(HERE / "kick_stage.png")
            dark(light).quantize(256).save(HERE / "kick_stage_dark.png")
