"""Rows of text as tables: aligned columns for a terminal, HTML for a notebook. Characters that a
terminal shows."""

import html
import unicodedata
from collections.abc import Sequence

AXES = "xyz"


def in_words(name: str) -> str:
    """The name of a quantity in words: `apoapsis_altitude` is "apoapsis altitude", and
    `final.position.2`, a number of the last state, "position z at the end"."""
    words = name.replace("_", " ")
    if not words.startswith("final."):
        return words
    block, *components = words.removeprefix("final.").split(".")
    axes = [AXES[int(c)] if c in ("0", "1", "2") else c for c in components]
    return " ".join([block, *axes, "at the end"])


def aligned(rows: Sequence[Sequence[str]], left: int = 1) -> str:
    """The rows with their first `left` columns flush left, the others flush right."""
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    lines = []
    for row in rows:
        cells = [
            c.ljust(w) if k < left else c.rjust(w)
            for k, (c, w) in enumerate(zip(row, widths, strict=True))
        ]
        lines.append("  ".join(cells).rstrip())
    return "\n".join(lines)


def html_table(rows: Sequence[Sequence[str]], left: int = 1, head: bool = True) -> str:
    """The rows as an HTML table, aligned as by `aligned`; with `head`, the first row is one."""
    lines = []
    for number, row in enumerate(rows):
        tag = "th" if head and number == 0 else "td"
        cells = (
            f'<{tag} style="text-align:{"left" if k < left else "right"}">{html.escape(c)}</{tag}>'
            for k, c in enumerate(row)
        )
        lines.append(f"<tr>{''.join(cells)}</tr>")
    return f"<table>{''.join(lines)}</table>"


def is_printable(text: str) -> bool:
    """Whether a terminal shows each character of the text, and acts on none of them."""
    # Spaces of other widths than the usual one can be printed, too.
    return all(c.isprintable() or unicodedata.category(c) == "Zs" for c in text)


def printable(text: str) -> str:
    """The text with the codes of the characters that a terminal would act on."""
    return "".join(c if is_printable(c) else ascii(c)[1:-1] for c in text)
