"""Writes the table of a class's parameters where a page has `<!-- parameters: PACKAGE.CLASS -->`.

Unit, range and meaning stand where the class declares them, and nowhere else.
"""

import importlib
import operator
import re

from jaxspace.core.quantities import Quantity, quantities

MARK = re.compile(r"<!-- parameters: (\w+)\.([\w.]+) -->")


def table(cls: type) -> str:
    """The parameters of a class as a Markdown table; empty where it declares none."""
    declared = quantities(cls)
    if not declared:
        return ""
    rows = [
        f"| `{name}` | {unit(q.unit)} | {_allowed(q)} | {q.doc} |"
        for name, q in declared.items()
    ]
    return "\n".join(
        [
            "| Parameter | Unit | Must be | Meaning |",
            "|---|---|---|---|",
            *rows,
        ]
    )


SUPERSCRIPT = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")


def unit(text: str) -> str:
    """A unit as it is printed: `kg m^2` as kg m²; a pure number has the unit 1."""
    # A product of units stays on one line.
    text = re.sub(r"\b(kg|N) ", "\\1\u00a0", text or "1")
    return re.sub(
        r"\^(-?\d+)", lambda match: match[1].translate(SUPERSCRIPT), text
    )


def _allowed(declared: Quantity) -> str:
    return declared.allowed() + (", or absent" if declared.optional else "")


def on_page_markdown(markdown, page, config, files):
    del page, config, files

    def written(match: re.Match[str]) -> str:
        package, name = match[1], match[2]
        cls = operator.attrgetter(name)(
            importlib.import_module(f"jaxspace.{package}")
        )
        # A page has several of these tables: each says whose it is.
        link = f"../api/{package}.md#jaxspace.{package}.{name}"
        return f"[`{package}.{name}`]({link}):\n\n{table(cls)}"

    return MARK.sub(written, markdown)
