"""The end of a command by Ctrl-C or by SIGTERM: a sentence, and what was stored stays."""

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Iterator
from types import FrameType

STOPPED = 130
"""The exit status, as a shell reports a command that SIGINT has ended."""


class Stopped(Exception):
    """A command was stopped; the message says what it has stored."""


def is_stop(error: BaseException) -> bool:
    """Whether an error is an interruption, or what a library has made of one that it met while it
    called back: an error of its own, whose text ends with the name."""
    return isinstance(error, KeyboardInterrupt) or "KeyboardInterrupt" in str(error)


def clear_interruption() -> None:
    """Tell Python that an interruption was dealt with.

    One that passed through text run by `exec`, as dataclasses are made, leaves a mark, and under
    `python -m` Python 3.13 ends a marked process by SIGINT in place of its exit status. Text that
    ends well takes the mark away."""
    exec("")


@contextlib.contextmanager
def stopped_by_signals() -> Iterator[None]:
    """SIGTERM, with which systems end a process, is met like Ctrl-C."""

    def stop(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    # Elsewhere signals are not ours to handle.
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def again(what: "sys.UnraisableHookArgs") -> None:
        # Met where Python can only print it, as in a callback of its collector: raised again later.
        if issubclass(what.exc_type, KeyboardInterrupt):
            timers.append(threading.Timer(0.05, os.kill, (os.getpid(), signal.SIGINT)))
            timers[-1].start()
        else:
            hook(what)

    timers: list[threading.Timer] = []
    before = signal.signal(signal.SIGTERM, stop)
    hook = sys.unraisablehook
    sys.unraisablehook = again
    try:
        yield
    finally:
        # The command has ended: a late one would kill the process in place of its status.
        for timer in timers:
            timer.cancel()
        sys.unraisablehook = hook
        signal.signal(signal.SIGTERM, before)
