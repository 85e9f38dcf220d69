"""Writes what assistants read: `llms.txt`, in the format of llmstxt.org, and in plain Markdown one
page for each section of "How do I ...?", whose code can be copied as a whole."""

import ast
import re
from pathlib import Path

from _uses import DOCS, anchor

SITE = "https://jaxspace.github.io/jaxspace/latest"
ROWS = re.compile(r"^\| (.*?) ?\| `(.*)` \|$", re.MULTILINE)
SUMMARY = """\
> Differentiable simulation of orbits, attitude, gyroscopes, mechanisms and rockets in JAX, with
> Monte Carlo campaigns, optimisation and estimation. Install it with `pip install "jaxspace[app]"`.

Units are SI, angles are radians, quaternions have the scalar first, and batch axes come last.
`jaxspace.enable_x64()` selects double precision and must be called before the first computation.
Unknown names and invalid values raise errors that state what is allowed.
"""
SECTIONS = ("Tutorials", "How-to", "Explanation", "Reference")


def on_post_build(config):
    """Write the files into the site."""
    site = Path(config["site_dir"])
    (site / "llms").mkdir(exist_ok=True)
    for title, text in tasks().items():
        (site / "llms" / f"{anchor(title)}.md").write_text(text)
    (site / "llms.txt").write_text(index(config["nav"]))


def index(nav: list) -> str:
    """The text of `llms.txt`: the pages of the tasks, then those of the manual."""
    parts = ["# jaxspace", SUMMARY, "## Tasks"]
    parts.append(
        "\n".join(
            f"- [{title}]({SITE}/llms/{anchor(title)}.md): code for "
            f"{len(code_of(title))} questions"
            for title in tasks()
        )
    )
    for section in SECTIONS:
        pages = next(entry[section] for entry in nav if section in entry)
        lines = [
            f"- [{title}]({SITE}/{address(page)}){about(page)}"
            for title, page in flat(pages)
        ]
        parts += [f"## {section}", "\n".join(lines)]
    return "\n\n".join(part.strip() for part in parts) + "\n"


def flat(pages: list) -> list[tuple[str, str]]:
    """The pages of a section of the navigation with their titles."""
    found = []
    for entry in pages:
        if isinstance(entry, str):
            found.append((Path(entry).stem.replace("_", " "), entry))
            continue
        for title, inner in entry.items():
            found += (
                flat(inner) if isinstance(inner, list) else [(title, inner)]
            )
    return found


def address(page: str) -> str:
    """The address of a page from the root of the manual."""
    return page.removesuffix("index.md").removesuffix(".md").rstrip("/") + "/"


def about(page: str) -> str:
    """The first sentence of a page; nothing for one that is generated."""
    path = DOCS / page
    if not path.exists():
        return ""
    prose = re.search(
        r"^# .*\n\n((?:[A-Z].*\n)(?:.+\n)*)", path.read_text(), re.MULTILINE
    )
    if prose is None:
        return ""
    words = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", " ".join(prose[1].split()))
    sentence = re.split(r"(?<=[a-z)`])[.:](?: |$)", words)[0]
    return f": {sentence}"


def tasks() -> dict[str, str]:
    """The page of each section."""
    return {title: page(title, rows) for title, rows in _sections().items()}


def code_of(title: str) -> list[str]:
    """The lines of a section."""
    return [line for _, line in _sections()[title]]


def _sections() -> dict[str, list[tuple[str, str]]]:
    text = (DOCS / "howto" / "how_do_i.md").read_text()
    groups = [g.partition("\n")[::2] for g in text.split("\n## ")[1:]]
    return {title: ROWS.findall(body) for title, body in groups}


def page(title: str, rows: list[tuple[str, str]]) -> str:
    """The page of a section: what its lines need, the lines, and the commands."""
    lines = [row for row in rows if not row[1].startswith("$ ")]
    commands = [row for row in rows if row[1].startswith("$ ")]
    body = "\n".join(f"{line}  # {question}" for question, line in lines)
    parts = [f"# jaxspace: {title[0].lower()}{title[1:]}"]
    parts.append(
        "> Each line answers the question in its comment. They run in order."
    )
    parts.append(f"```python\n{preamble(body)}\n\n{body}\n```")
    if commands:
        text = "\n".join(f"{line[2:]}  # {q}" for q, line in commands)
        parts.append(f"```sh\n{text}\n```")
    return "\n\n".join(parts) + "\n"


def preamble(body: str) -> str:
    """The imports and definitions of "How do I ...?" that some code needs."""
    text = (DOCS / "howto" / "how_do_i.md").read_text()
    block = ast.parse(re.search(r"```python\n(.*?)```", text, re.DOTALL)[1])
    names = {
        n.id for n in ast.walk(ast.parse(body)) if isinstance(n, ast.Name)
    }
    names.add("jaxspace")
    kept = []
    # Backwards, because each statement may need those before it.
    for node in reversed(block.body):
        if isinstance(node, ast.Import | ast.ImportFrom):
            node.names = [
                a for a in node.names if (a.asname or a.name) in names
            ]
            if not node.names:
                continue
        elif isinstance(node, ast.Assign):
            given = {
                n.id
                for n in ast.walk(node.targets[0])
                if isinstance(n, ast.Name)
            }
            if not given & names:
                continue
            names |= {
                n.id for n in ast.walk(node.value) if isinstance(n, ast.Name)
            }
        kept.append(ast.unparse(node))
    return "\n".join(reversed(kept))
