"""What assistants read of the manual: `llms.txt` and its pages, from "How do I ...?"."""

import ast
import builtins
import importlib
import re
from pathlib import Path

import pytest
import yaml

DOCS = Path(__file__).parents[1] / "docs"


@pytest.fixture
def llms(monkeypatch):
    monkeypatch.syspath_prepend(DOCS)
    return importlib.import_module("_llms")


def _nav():
    """The navigation, whose file names a class of a plugin."""
    text = (DOCS.parent / "mkdocs.yml").read_text()
    return yaml.load(text, yaml.BaseLoader)["nav"]


def test_the_index_has_the_format_and_lists_pages(llms):
    text = llms.index(_nav())
    title, summary, *_ = text.split("\n\n")
    assert title == "# jaxspace" and summary.startswith("> ")
    lines = [x for x in text.splitlines() if x.startswith("- ")]
    links = [re.fullmatch(r"- \[[^]]+\]\((https:[^)]+)\)(: .+)?", x) for x in lines]
    assert len(lines) > 80 and all(links)
    listed = {link[1].removeprefix(llms.SITE + "/") for link in links}
    assert {f"llms/{llms.anchor(t)}.md" for t in llms.tasks()} <= listed
    generated = {page for page in listed if page.startswith(("reference/", "gallery/"))}
    generated |= {"explanation/equations/"}
    for page in listed - generated:
        exists = (DOCS / (page.rstrip("/") + ".md")).exists()
        assert exists or page.startswith("llms/"), page


def test_pages_of_tasks_have_the_lines_of_the_manual(llms):
    """Each line of "How do I ...?" once, after the definitions that it needs, on one screen."""
    manual = (DOCS / "howto" / "how_do_i.md").read_text()
    rows = re.findall(r"^\| (.*?) ?\| `(.*)` \|$", manual, re.MULTILINE)
    pages = llms.tasks()
    for question, line in rows:
        shown = f"{line.removeprefix('$ ')}  # {question}"
        assert sum(shown in page.splitlines() for page in pages.values()) == 1, question
    for title, page in pages.items():
        assert len(page.splitlines()) <= 70, title
        code = ast.parse(re.search(r"```python\n(.*?)```", page, re.DOTALL)[1])
        names = [n for n in ast.walk(code) if isinstance(n, ast.Name)]
        known = {n.id for n in names if isinstance(n.ctx, ast.Store)}
        imports = [n for n in ast.walk(code) if isinstance(n, ast.Import | ast.ImportFrom)]
        known |= {a.asname or a.name for node in imports for a in node.names}
        known |= {a.arg for n in ast.walk(code) if isinstance(n, ast.arguments) for a in n.args}
        assert {n.id for n in names} <= known | set(dir(builtins)), title
