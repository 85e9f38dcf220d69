"""Computes the groups of comparisons named, or all, and writes the page: `python -m validation
[GROUP ...]`."""

import sys

import jax

jax.config.update("jax_enable_x64", True)
# As the tests run: the compiler's optimisations change no result, and take most of the time.
jax.config.update("jax_disable_most_optimizations", True)

from . import page  # noqa: E402
from .groups import ABOUT, rows_of  # noqa: E402


def main() -> None:
    """The record of each group, then the page; status 1 where a row that fails is not explained."""
    names = sys.argv[1:] or list(ABOUT)
    if unknown := set(names) - set(ABOUT):
        sys.exit(f"There is no group {', '.join(sorted(unknown))}: choose from {', '.join(ABOUT)}.")
    unexplained = []
    for name in names:
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
