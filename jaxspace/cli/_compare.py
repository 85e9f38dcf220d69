"""The comparison of a flight log with the nominal run of a scene file: tables and a figure."""

import functools
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from ..core import InputError
from ..io import load
from ..io.flight_logs import read_log
from ..io.log_comparison import LogComparison, compare_log
from ..plots.flight_log import log_figure
from ._output import make_folder
from ._report import attempt
from ._waiting import waiting
from ._warning_lines import warnings_as_lines

STATES = 1000
"""States of each phase of the nominal run, between which its channels are interpolated."""


def compare(
    path: str,
    log: str,
    channels: Mapping[str, str],
    align: str,
    runs: int | None,
    folder: str,
    modules: Sequence[str] = (),
) -> int:
    """Print the residuals of a log and draw them; returns the exit status."""
    file = load(path, modules=modules)
    table = read_log(log)
    offset = _offset(align)
    if runs is not None and file.values.get("dispersion") is None:
        raise InputError(f"--runs is {runs}, and {path} has no [dispersion] for these runs.")
    with warnings_as_lines(), waiting("simulating the nominal run"):
        nominal = file.nominal_mission(samples=STATES)
    campaign = None
    if runs is not None:
        campaign = file.campaign(nominal, warn=False)
    compared = functools.partial(
        compare_log, nominal, table, channels or None, scene=file, align=offset
    )
    with warnings_as_lines(), waiting("comparing"):
        if campaign is None or runs is None:
            found = compared()
        else:
            found = compared(campaign=campaign, runs=runs, seed=file.seed)
    print(found)
    make_folder(folder)
    figure = os.path.join(folder, f"{file.path.stem}_{Path(log).stem}.png")
    return attempt("figure", figure, lambda path: _draw(found, file.title, path))


def _offset(align: str) -> str | float:
    try:
        return float(align)
    except ValueError:
        return align


def _draw(found: LogComparison, title: str, path: str) -> None:
    log_figure(found, title).savefig(path, dpi=150)
