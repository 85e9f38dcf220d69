"""Writes the reference by task: at the top of each package's page its names in groups, each with
one line and a link, and one page that leads to all groups."""

from _tasks import TASKS
from _uses import anchor, first_line, packages, public_names
from mkdocs.structure.files import File

BY_TASK = """\
---
hide: [toc]
---
# Reference by task

Each entry links to a group of names on the page of its package, where each name has a one-line
description, a link to its docstring and the examples that use it. The search function finds every
name.
"""


def on_files(files, config):
    """Add the generated page to the site."""
    files.append(
        File.generated(config, "reference/by_task.md", content=by_task())
    )
    return files


def on_page_markdown(markdown, page, **kwargs):
    """Put the groups on the page of a package, before what its docstrings say."""
    del kwargs
    folder, _, name = page.file.src_uri.removesuffix(".md").rpartition("/")
    if folder != "api" or name not in packages():
        return markdown
    head, mark, rest = markdown.partition("\n::: ")
    lists = [
        f"### {task}\n\n| Name | Description |\n|---|---|\n" + "\n".join(rows)
        for task, rows in groups(name).items()
    ]
    return "\n\n".join([head, *lists, f"## {name}"]) + "\n" + mark + rest


def groups(package: str) -> dict[str, list[str]]:
    """The lines of each task of a package."""
    modules = public_names(package)
    left = {name: [(name, x)] for name, x in modules[""].items()}
    for module, names in modules.items():
        # A module may share its name with what it computes.
        if module:
            entries = [(f"{module}.{name}", x) for name, x in names.items()]
            left[module] = left.get(module, []) + entries
    found = {}
    for task, words in TASKS.get(package, {}).items():
        found[task] = [
            row for word in words.split() for row in left.pop(word)
        ]
    found["More" if found else "All names"] = [
        x for some in left.values() for x in some
    ]
    return {
        task: [_row(package, *entry) for entry in entries]
        for task, entries in found.items()
        if entries
    }


def _row(package: str, path: str, thing: object) -> str:
    line = first_line(thing.__doc__ or "").replace("|", "\\|")
    return f"| [`{path}`][jaxspace.{package}.{path}] | {line} |"


def by_task() -> str:
    """The page of all tasks."""
    parts = [BY_TASK, "| Package | Tasks |\n|---|---|"]
    for package in sorted(packages()):
        tasks = groups(package)
        links = [
            f"[{x[0].lower() + x[1:]}](../api/{package}.md#{anchor(x)})"
            for x in tasks
        ]
        parts[-1] += (
            f"\n| [`{package}`](../api/{package}.md) | {' · '.join(links)} |"
        )
    return "\n\n".join(parts) + "\n"
