"""The end of a command by a signal: Ctrl-C, the end of its terminal, or the system. It ends with a
message, and stored results are preserved.

A signal raises `KeyboardInterrupt` once. More of them, as of an impatient Ctrl-C, are left aside
while the command tidies up: each would interrupt that in turn. Where it lasts, one counts again.
"""

import contextlib
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Any

STOPPED = 130
"""The exit status, as a shell reports a command that SIGINT has ended."""
SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")
"""Signals that stop a command; Windows has fewer. SIGHUP comes when a terminal is closed."""
PATIENCE = 10.0
"""Seconds after one of them in which further ones are left aside."""


class Stopped(Exception):
    """A command was stopped; the message reports the stored results."""


def is_stop(error: BaseException) -> bool:
    """Whether an error is an interruption, or the error of a library that was interrupted during a
    callback, whose text ends with the name."""
    return isinstance(error, KeyboardInterrupt) or "KeyboardInterrupt" in str(error)


def clear_interruption() -> None:
    """Tell Python that an interruption was dealt with.

    One that passed through text run by `exec`, as dataclasses are made, leaves a mark, and under
    `python -m` Python 3.13 ends a marked process by SIGINT in place of its exit status. Text that
    ends well takes the mark away."""
    exec("")


@contextlib.contextmanager
def _handled(handler: Callable[[int, FrameType | None], None]) -> Iterator[None]:
    """While signals that stop a command call this handler."""
    before: dict[int, Any] = {}
    # Elsewhere signals are not ours to handle.
    if threading.current_thread() is threading.main_thread():
        for name in SIGNALS:
            number = getattr(signal, name, None)
            # `nohup` and the background of a shell ignore some of them on purpose.
            if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
                before[number] = signal.signal(number, handler)
    try:
        yield
    finally:
        for number, earlier in before.items():
            # `None` means a handler that Python has not set.
            signal.signal(number, earlier or signal.SIG_DFL)


@contextlib.contextmanager
def stopped_by_signals() -> Iterator[None]:
    """Meet each of the `SIGNALS` like Ctrl-C, once."""
    last = -PATIENCE

    def stop(number: int, frame: FrameType | None) -> None:
        nonlocal last
        now = time.monotonic()
        if now - last >= PATIENCE:
            last = now
            raise KeyboardInterrupt

    def again(what: "sys.UnraisableHookArgs") -> None:
        nonlocal last
        # Met where Python can only print it, as in a callback of its collector: raised again later.
        if issubclass(what.exc_type, KeyboardInterrupt):
            last = -PATIENCE
            timers.append(threading.Timer(0.05, os.kill, (os.getpid(), signal.SIGINT)))
            timers[-1].start()
        else:
            hook(what)

    timers: list[threading.Timer] = []
    hook = sys.unraisablehook
    sys.unraisablehook = again
    with _handled(stop):
        try:
            yield
        finally:
            # The command has ended: a late one would kill the process in place of its status.
            for timer in timers:
                timer.cancel()
            sys.unraisablehook = hook


@contextlib.contextmanager
def stopped_afterwards() -> Iterator[list[int]]:
    """Put off the signals that stop a command, while modules are imported: an interruption would
    leave them incomplete. The signals that came."""
    came: list[int] = []
    with _handled(lambda number, frame: came.append(number)):
        yield came


def ignore_signals() -> None:
    """Leave further signals aside, in a process that only has to return its exit status."""
    if threading.current_thread() is threading.main_thread():
        for name in SIGNALS:
            if hasattr(signal, name):
                signal.signal(getattr(signal, name), signal.SIG_IGN)
