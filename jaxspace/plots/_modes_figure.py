"""Figures of small motions: Bode's plots of transfer functions, and root loci."""

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import ArrayLike

from ..core.extras import extra
from ._style import COLOURS, MUTED, dress

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def _new_figure(width: float, height: float) -> "Figure":
    with extra("app"):
        from matplotlib.figure import Figure
    return Figure(figsize=(width, height), layout="constrained")


def bode_figure(
    frequency: ArrayLike,
    magnitude: ArrayLike,
    phase: ArrayLike,
    labels: tuple[str, ...] = (),
    *,
    title: str = "",
) -> "Figure":
    """Magnitude and phase of transfer functions over the frequency, one curve each.

    **Arguments**

    - `frequency`: rad/s, (frequencies,).
    - `magnitude`, `phase`: dB and rad, (curves, frequencies).
    - `labels`: of the curves.
    - `title`: of the figure.

    **Raises** `ImportError` where matplotlib is not installed.
    """
    w = np.asarray(frequency)
    figure = _new_figure(7.4, 5.2)
    above, below = figure.subplots(2, 1, sharex=True)
    for i, (size, angle) in enumerate(
        zip(np.asarray(magnitude), np.degrees(np.asarray(phase)), strict=True)
    ):
        colour = COLOURS[i % len(COLOURS)]
        above.semilogx(w, size, color=colour, label=labels[i] if labels else None)
        below.semilogx(w, angle, color=colour)
    dress(above, title or "Transfer functions", "", "magnitude [dB]")
    dress(below, "", "frequency [rad/s]", "phase [deg]")
    # Ticks at which lags and leads are read.
    below.yaxis.set_major_locator(_quarters())
    if labels:
        above.legend(fontsize=8, frameon=False)
    return figure


def _quarters():  # noqa: ANN202
    from matplotlib.ticker import MaxNLocator

    return MaxNLocator(nbins=6, steps=[1.5, 3.0, 4.5, 9.0])


def root_locus_figure(gains: ArrayLike, roots: ArrayLike, *, title: str = "") -> "Figure":
    """Roots in the complex plane as a gain, or any parameter, moves: crosses at its first value.

    **Arguments**

    - `gains`: (gains,).
    - `roots`: 1/s, (n, gains), as of `studies.Modes.root_locus`; or (n, runs) of a batch.
    - `title`: of the figure.

    **Raises** `ImportError` where matplotlib is not installed.
    """
    k, values = np.asarray(gains), np.asarray(roots)
    x = np.real(values)
    y = np.imag(values)
    figure = _new_figure(6.4, 5.2)
    axes = figure.subplots()
    axes.axvline(0.0, color=MUTED, linewidth=0.9)
    axes.axhline(0.0, color=MUTED, linewidth=0.5)
    # Dots and no lines, which could join roots of different branches.
    dots = axes.scatter(x.ravel(), y.ravel(), c=np.tile(k, len(x)), s=6, cmap="viridis")
    axes.plot(x[:, 0], y[:, 0], "x", color=COLOURS[1], markersize=7)
    figure.colorbar(dots, ax=axes, label="gain")
    dress(axes, title or "Root locus", "real part [1/s]", "imaginary part [rad/s]")
    return figure
