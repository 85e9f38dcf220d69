"""Computes the groups of comparisons named, or all, and writes the page: `python -m validation
[GROUP ...]`. `asked` is the page of errors beside tolerances; `page` computes nothing and writes
both pages from the record."""

import sys

import jax

jax.config.update("jax_enable_x64", True)
# As the tests run: the compiler's optimisations change no result, and take most of the time.
jax.config.update("jax_disable_most_optimizations", True)

from . import page, requested  # noqa: E402
from .groups import ABOUT, rows_of  # noqa: E402


def main() -> None:
    """The record of each group, then the page; status 1 where a row that fails is not explained."""
    every = [*ABOUT, "asked"]
    names = sys.argv[1:] or every
    if unknown := set(names) - {*every, "page"}:
        allowed = ", ".join((*every, "page"))
        sys.exit(f"There is no group {', '.join(sorted(unknown))}: choose from {allowed}.")
    if "asked" in names:
        requested.keep(requested.measure())
        requested.keep_drawn(requested.measure_drawn())
    if {"asked", "page"} & set(names):
        requested.write()
    unexplained = []
    for name in (name for name in names if name in ABOUT):
        rows = rows_of(name)
        page.keep(name, rows)
        unexplained += [row for row in rows if not row.agrees and not row.note]
        print(f"{name}: {sum(row.agrees for row in rows)} of {len(rows)} agree", flush=True)
    page.write(ABOUT)
    for row in unexplained:
        print(f"differs, and nothing explains it: {row}", file=sys.stderr)
    sys.exit(bool(unexplained))


if __name__ == "__main__":
    main()
