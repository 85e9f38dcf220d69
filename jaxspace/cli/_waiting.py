"""Progress of a command on the terminal: its stage, and the seconds since it began."""

import contextlib
import sys
import threading
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tqdm import tqdm

PATIENCE = 3.0
"""Seconds after which a command reports its current activity."""
PAUSE = 1.0
"""Seconds from one line to the next."""


@contextlib.contextmanager
def waiting(words: str) -> Iterator[None]:
    """Show `words` with the elapsed seconds on stderr, after more than three seconds, including the
    compilation time of JAX.

    Nothing is shown where stderr is not a terminal: a changing line is useless in a log."""
    if not sys.stderr.isatty():
        yield
        return
    # Late: the parser refers to the commands, and `--help` does not wait for JAX.
    import jax.monitoring

    compiled: list[float] = []

    def listen(event: str, duration_secs: float, **kwargs: str | int) -> None:
        del kwargs
        if event.endswith("backend_compile_duration"):
            compiled.append(duration_secs)

    started = time.monotonic()

    def line() -> str:
        part = f", of which {sum(compiled):.0f} s to compile" if sum(compiled) >= 1.0 else ""
        return f"{words}: {time.monotonic() - started:.0f} s{part}"

    def show(end: str = "") -> None:
        # To the end of the line, so that nothing of a longer one stays.
        print(f"\r{line()}\x1b[K", end=end, file=sys.stderr, flush=True)

    jax.monitoring.register_event_duration_secs_listener(listen)
    try:
        with _repeated(show, PATIENCE):
            yield
    finally:
        jax.monitoring.unregister_event_duration_listener(listen)
        if time.monotonic() - started > PATIENCE:
            show("\n")


@contextlib.contextmanager
def progress(words: str, **options: Any) -> Iterator["tqdm"]:
    """A progress bar on stderr, `options` as for tqdm, which shows `words` and counts the seconds
    even while no step is completed.

    Nothing is shown where stderr is not a terminal."""
    # Late: commands that draw no bar do not wait for the import.
    from tqdm import tqdm

    with tqdm(desc=words, file=sys.stderr, disable=None, **options) as bar:
        with _repeated(bar.refresh, PAUSE):
            yield bar
        bar.set_description_str(refresh=False)


@contextlib.contextmanager
def _repeated(show: Callable[[], None], first: float) -> Iterator[None]:
    """Call `show` in another thread, after `first` seconds and then after each pause."""
    done = threading.Event()

    def go() -> None:
        pause = first
        while not done.wait(pause):
            show()
            pause = PAUSE

    thread = threading.Thread(target=go, daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()
