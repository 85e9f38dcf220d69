"""The animation at the top of the README: three heavy tops with the same spin."""

import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from PIL import Image

from jaxspace import simulate_batch
from jaxspace.attitude import Top

FRAMES = 75
POINTS = 16
"""Points of a path between two frames."""
DURATION = 1.9
"""s of motion; the animation shows it in slow motion."""
TITLES = ("wavy", "cuspidal", "looping")


def nutation():
    """The frames: the axes of three tops on the unit sphere, and the paths of their tips."""
    top = Top(
        transverse_inertia=1.0e-3, axial_inertia=6.0e-4, weight_moment=0.08
    )
    tilt = jnp.radians(35.0) * jnp.ones(3)
    push = jnp.array([1.2, 0.0, -4.0])
    start = top.state(
        [0.0 * tilt, tilt, 0.0 * tilt],
        [push, 0.0 * tilt, 60.0 - push * jnp.cos(tilt)],
    )
    ts = jnp.linspace(0.0, DURATION, FRAMES * POINTS)
    run = simulate_batch(top, start, ts)
    path = np.asarray(
        run.states.attitude.rotate(jnp.array([0.0, 0.0, 1.0])[:, None, None])
    )
    figure, lines, axles = _panels(
        np.asarray(top.nutation(start).turning_points)
    )
    frames = []
    for frame in range(FRAMES):
        now = (frame + 1) * POINTS - 1
        for k in range(3):
            lines[k].set_data_3d(*(1.002 * path[:, : now + 1, k]))
            axles[k].set_data_3d(
                *np.stack([0.0 * path[:, now, k], path[:, now, k]], axis=1)
            )
        figure.canvas.draw()
        frames.append(
            Image.fromarray(np.asarray(figure.canvas.buffer_rgba())).convert(
                "RGB"
            )
        )
    plt.close(figure)
    return frames


def _panels(turning_points):
    """A sphere with the turning points of each top; the lines that move."""
    figure = plt.figure(figsize=(8.0, 2.9), dpi=100)
    u = np.linspace(0.0, 2.0 * np.pi, 120)
    circle = np.stack([np.cos(u), np.sin(u)])
    lines, axles = [], []
    for k, title in enumerate(TITLES):
        axes = figure.add_axes(
            (k / 3.0, 0.0, 1.0 / 3.0, 0.9), projection="3d"
        )
        for angle in turning_points:
            ring = np.sin(angle[k]) * circle
            axes.plot(*ring, np.cos(angle[k]), "--", color="0.5", lw=0.8)
        (line,) = axes.plot([], [], [], color=f"C{k}", zorder=9)
        (axle,) = axes.plot(
            [], [], [], "o-", color="0.2", ms=4, lw=2.0, zorder=10
        )
        lines.append(line)
        axles.append(axle)
        axes.set(xlim=(-0.8, 0.8), ylim=(-0.8, 0.8), zlim=(0.0, 1.0))
        axes.set_box_aspect((1.6, 1.6, 1.0), zoom=1.5)
        axes.view_init(28, -60)
        axes.set_axis_off()
        axes.set_title(title)
    return figure, lines, axles


def save(frames, path):
    """Write the frames as one looping GIF with a common palette."""
    palette = frames[-1].quantize(48)
    first, *others = (
        x.quantize(palette=palette, dither=Image.Dither.NONE) for x in frames
    )
    first.save(
        path,
        save_all=True,
        append_images=others,
        duration=80,
        loop=0,
        optimize=True,
    )
