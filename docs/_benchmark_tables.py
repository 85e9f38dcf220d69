"""Writes the table of a benchmark where a page has `<!-- benchmark: NAME -->`, from its stored
results."""

import re
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks import page, result_files  # noqa: E402

MARK = re.compile(r"<!-- benchmark: (\w+) -->")


def on_page_markdown(markdown, page, config, files):
    del page, config, files
    return MARK.sub(lambda match: table(match[1]), markdown)


def table(name: str) -> str:
    """The rows of a benchmark as a Markdown table, of the first set of instructions measured."""
    seen, *_ = result_files.read(name).values()
    return page.table(seen["rows"])
