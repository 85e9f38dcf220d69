"""Keeps a number such as 1.6e-14 in a table on one line: browsers break it behind the sign."""

import re

CELL = re.compile(r"(<td[^>]*>)([^<]+)")
NUMBER = re.compile(r"[\d.]+e-\d+")


def on_page_content(html, page, config, files):
    del page, config, files
    return CELL.sub(
        lambda cell: (
            cell[1]
            + NUMBER.sub(r'<span class="number">\g<0></span>', cell[2])
        ),
        html,
    )
