"""Gives every tutorial as a notebook, to be run from top to bottom: the same words and blocks,
below a cell that installs the library."""

import json
import re
from pathlib import Path

from mkdocs.structure.files import File

TUTORIALS = Path(__file__).parent / "tutorials"
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\((\.\./)?([\w/]+)\.md(#[\w-]+)?\)")
PICTURE = re.compile(r"\]\(\.\./(figures/\w+\.png)\)")
# A notebook is read away from the manual: its links lead there.
SITE = "https://jaxspace.github.io/jaxspace/latest/"
# Colab opens what lies in a repository: the branch of the published pages.
COLAB = "https://colab.research.google.com/github/jaxspace/jaxspace/blob/gh-pages/latest/tutorials/"
# From the repository until the first release is on the package index.
INSTALL = '%pip install --quiet "jaxspace[app] @ git+https://github.com/jaxspace/jaxspace"'


def on_files(files, config):
    """Add a notebook beside each tutorial."""
    for page in sorted(TUTORIALS.glob("*.md")):
        name = f"tutorials/{page.stem}.ipynb"
        files.append(
            File.generated(config, name, content=notebook(page.read_text()))
        )
    return files


def on_page_markdown(markdown, page, **kwargs):
    """Put a link to the notebook under the heading of a tutorial."""
    del kwargs
    if not page.file.src_uri.startswith("tutorials/"):
        return markdown
    heading, _, rest = markdown.partition("\n")
    name = Path(page.file.src_uri).stem
    links = f"[This page as a notebook]({name}.ipynb), [open in Colab]({COLAB}{name}.ipynb)"
    return f"{heading}\n\n{links}\n{rest}"


def notebook(text: str) -> str:
    """A page as a notebook: its blocks of Python are cells, and so is what stands between them."""
    cells = [_code("install", INSTALL)]
    # Words and code in turn.
    for k, part in enumerate(BLOCK.split(text)):
        source = part.strip("\n")
        if not source:
            continue
        if k % 2:
            cells.append(_code(f"cell-{k}", source))
        else:
            source = LINK.sub(_to_site, source)
            source = PICTURE.sub(rf"]({SITE}\1)", source)
            cells.append(_cell(f"cell-{k}", "markdown", source))
    kernel = {
        "display_name": "Python 3",
        "language": "python",
        "name": "python3",
    }
    whole = {
        "cells": cells,
        "metadata": {"kernelspec": kernel},
        "nbformat": 4,
        "nbformat_minor": 5,
    }
    return json.dumps(whole, indent=1) + "\n"


def _code(name: str, source: str) -> dict:
    """A cell of Python that has not run."""
    return _cell(name, "code", source) | {
        "execution_count": None,
        "outputs": [],
    }


def _cell(name: str, kind: str, source: str) -> dict:
    return {
        "id": name,
        "cell_type": kind,
        "metadata": {},
        "source": source.splitlines(keepends=True),
    }


def _to_site(link: re.Match) -> str:
    folder = "" if link[1] else "tutorials/"
    return f"]({SITE}{folder}{link[2]}/{link[3] or ''})"
