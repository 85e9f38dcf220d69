"""Progress of a command on the terminal: its stage, and the seconds since it began."""

import contextlib
import sys
import threading
import time
from collections.abc import Iterator

PATIENCE = 3.0
"""Seconds after which a command says what it is at."""


@contextlib.contextmanager
def waiting(words: str) -> Iterator[None]:
    """Show `words` with the seconds so far on the error output, once they are more than three; and
    with what of them JAX has compiled.

    Nothing where the error output is no terminal: a log has no use for a line that changes."""
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
    done = threading.Event()

    def line() -> str:
        part = f", of which {sum(compiled):.0f} s to compile" if sum(compiled) >= 1.0 else ""
        return f"{words}: {time.monotonic() - started:.0f} s{part}"

    def show() -> None:
        pause = PATIENCE
        while not done.wait(pause):
            # To the end of the line, so that nothing of a longer one stays.
            print(f"\r{line()}\x1b[K", end="", file=sys.stderr, flush=True)
            pause = 1.0

    jax.monitoring.register_event_duration_secs_listener(listen)
    thread = threading.Thread(target=show, daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()
        jax.monitoring.unregister_event_duration_listener(listen)
        if time.monotonic() - started > PATIENCE:
            print(f"\r{line()}\x1b[K", file=sys.stderr, flush=True)
