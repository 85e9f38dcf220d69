"""The end of a command by Ctrl-C or by SIGTERM: a sentence, and what was stored stays."""

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType


class Stopped(Exception):
    """A command was stopped; the message says what is left of it."""


@contextlib.contextmanager
def stopped_by_signals() -> Iterator[None]:
    """SIGTERM, with which systems end a process, is met like Ctrl-C."""

    def stop(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    # Elsewhere signals are not ours to handle.
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
