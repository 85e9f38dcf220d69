"""The states of a run as a file for other programs: `jaxspace run --write`."""

from typing import NamedTuple

from ..core import InputError
from ..core.text import is_printable
from ..io.ephemeris import Ephemeris, check_epoch, write_oem
from ..simulation import MissionTrajectory, Trajectory
from ._output import replacing


class EphemerisOptions(NamedTuple):
    """The kind of the file of states that a run writes, if any, and what it contains besides them:
    UTC at t = 0, central body and axes."""

    kind: str | None = None
    epoch: str | None = None
    centre: str = "EARTH"
    frame: str = "EME2000"

    def check(self) -> None:
        """Raise `InputError` for options that do not go together."""
        if self.kind is None:
            if self.epoch is not None:
                raise InputError("--epoch requires --write oem.")
            return
        if self.epoch is None:
            raise InputError(
                "--write requires --epoch, UTC at t = 0, such as --epoch 2026-03-01T12:00:00."
            )
        check_epoch("--epoch", self.epoch)
        for name, text in (("--centre", self.centre), ("--frame", self.frame)):
            if not text.strip() or not is_printable(text):
                raise InputError(f"{name} is {text[:40]!r}: it must be a name on a single line.")


def write_ephemeris(
    title: str,
    run: Trajectory | MissionTrajectory,
    path: str,
    options: EphemerisOptions,
) -> None:
    """Write the states of a run as an orbit ephemeris message, each phase as a segment;
    the `title` is the name of the body."""
    assert options.epoch is not None
    # The standard has upper case, and a line for each entry.
    axes = {"centre": options.centre.upper(), "frame": options.frame.upper()}
    segments = [Ephemeris.of_run(phase, options.epoch, name=title, **axes) for phase in run.phases]
    # A phase that was not reached has no states.
    segments = [segment for segment in segments if segment.times.size]
    if not segments:
        raise InputError("--write: the run has no finite state.")
    with replacing(path) as unfinished:
        write_oem(unfinished, segments)
    print(f"ephemeris {path}")
