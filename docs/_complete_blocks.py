"""Makes each Python block of a page run when it is copied alone: its copy button also copies the
statements of earlier blocks that it needs, and writes the scene files of the page that it loads."""

import ast
import builtins
import html
import re
import symtable
from typing import NamedTuple

FENCE = re.compile(
    r"^```(python|\{\.python[^}\n]*\})\n(.*?)^```$", re.MULTILINE | re.DOTALL
)
# A block of TOML whose title is the name of a file.
SCENE = re.compile(
    r'^```\{\.toml title="([^"\n]+\.toml)"\}\n(.*?)^```$',
    re.MULTILINE | re.DOTALL,
)
FILE = re.compile(r"[\w./-]+\.(?:bin|toml|zarr)")
HIGHLIGHTED = '<div class="language-python highlight">'
NOTE = """

*The copy button of a code block also copies the lines of earlier blocks that it needs.*
"""
# These have an effect on everything that follows, and define no name.
SETTINGS = re.compile(r"jaxspace\.(enable_x64|keep_programs)\(|jax\.config\.")


class Statement(NamedTuple):
    """A statement of a page.

    - `source`: its text.
    - `defines`, `reads`: the names that it binds or changes, and those that it reads; a file that
      it writes or reads counts as such a name.
    - `deferred`: whether it is a function or a class, which reads its names when it is called."""

    source: str
    defines: frozenset[str]
    reads: frozenset[str]
    deferred: bool = False


def on_page_markdown(markdown, page, **kwargs):
    """Explain the copy button under the heading of a page with blocks that need earlier ones."""
    del kwargs
    # Each block of the home page is a program of its own.
    if page.file.src_uri == "index.md":
        return markdown
    if programs(markdown) == [
        source for _, source in FENCE.findall(markdown)
    ]:
        return markdown
    page.meta["complete_blocks"] = True
    heading, _, rest = markdown.partition("\n")
    return f"{heading}{NOTE}{rest}"


def on_page_content(html_text, page, **kwargs):
    """Attach to the blocks of a page what their copy buttons copy."""
    del kwargs
    if not page.meta.get("complete_blocks"):
        return html_text
    found = programs(page.markdown)
    first, *parts = html_text.split(HIGHLIGHTED)
    if len(parts) != len(found):
        raise ValueError(
            f"{page.file.src_uri} has {len(found)} Python blocks and {len(parts)} in its HTML."
        )
    opening = f'{HIGHLIGHTED[:-1]} data-complete="%s">'
    blocks = [
        opening % html.escape(program) + part
        for program, part in zip(found, parts, strict=True)
    ]
    return "".join([first, *blocks])


def programs(markdown: str) -> list[str]:
    """For each Python block of a page the program that its copy button copies."""
    earlier = [
        f'from pathlib import Path\n\nPath("{name}").write_text("""\n{text}""")\n'
        for name, text in SCENE.findall(markdown)
    ]
    found = []
    for fence, source in FENCE.findall(markdown):
        found.append(complete([*earlier, source]))
        # A block with a title may belong to another library, whose names are others, unless it
        # writes a file.
        if fence == "python" or "jaxspace" in source or _writes_file(source):
            earlier.append(source)
    return found


def _writes_file(block: str) -> bool:
    return any(
        FILE.fullmatch(name) for s in statements(block) for name in s.defines
    )


def complete(blocks: list[str]) -> str:
    """The last of the blocks of a page, after the statements of the others that it needs."""
    *earlier, last = blocks
    there = [s for block in earlier for s in statements(block)]
    later: frozenset[str] = frozenset()
    while True:
        needed = _needs(last) | later
        kept: list[Statement] = []
        for statement in reversed(there):
            if statement.defines & needed or SETTINGS.match(statement.source):
                # A name that is defined anew from itself needs its earlier definition as well.
                needed = (needed - statement.defines) | statement.reads
                kept.append(statement)
        # A function reads what its names are when it is called: after the whole page.
        read = frozenset[str]().union(*(s.reads for s in kept if s.deferred))
        if read <= later:
            break
        later |= read
    if not kept:
        return last
    sources = [s.source for s in reversed(kept)]
    once = [
        source
        for place, source in enumerate(sources)
        if not SETTINGS.match(source) or source not in sources[:place]
    ]
    return "\n".join([*_spaced(once), last])


def statements(block: str) -> list[Statement]:
    """The statements of a block at the top level, with imports split by name."""
    found = []
    for node in ast.parse(block).body:
        if isinstance(node, ast.Import | ast.ImportFrom):
            found += [_import(node, alias) for alias in node.names]
        else:
            source = ast.get_source_segment(block, node) or ""
            decorators = getattr(node, "decorator_list", [])
            if decorators:
                lines = block.splitlines()[
                    decorators[0].lineno - 1 : node.end_lineno
                ]
                source = "\n".join(lines)
            deferred = isinstance(node, ast.FunctionDef | ast.ClassDef)
            written, read = _files(node)
            found.append(
                Statement(
                    source,
                    _defines(node) | written,
                    _reads(node) | read,
                    deferred,
                )
            )
    return found


def _files(node: ast.stmt) -> tuple[frozenset[str], frozenset[str]]:
    """The files and stores that a statement writes, and those that it reads."""
    named = frozenset(
        x.value
        for x in ast.walk(node)
        if isinstance(x, ast.Constant)
        and isinstance(x.value, str)
        and FILE.fullmatch(x.value)
    )
    options = {
        x.arg: x.value for x in ast.walk(node) if isinstance(x, ast.keyword)
    }
    writes = "store" in options or any(
        isinstance(x, ast.Attribute) and x.attr.startswith("write_")
        for x in ast.walk(node)
    )
    # A campaign is resumed from a store that exists.
    resumed = getattr(options.get("resume"), "value", False)
    return (
        named if writes else frozenset(),
        named if resumed or not writes else frozenset(),
    )


def _import(node: ast.Import | ast.ImportFrom, alias: ast.alias) -> Statement:
    one = type(node)(**{**vars(node), "names": [alias]})
    name = alias.asname or alias.name.partition(".")[0]
    return Statement(ast.unparse(one), frozenset([name]), frozenset())


def _defines(node: ast.stmt) -> frozenset[str]:
    """The names that a statement binds or changes at the top level."""
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        return frozenset([node.name])
    names = {
        x.id
        for x in ast.walk(node)
        if isinstance(x, ast.Name) and isinstance(x.ctx, ast.Store)
    }
    # `data["x"] = ...` and `self.x = ...` change a name that exists.
    targets = getattr(node, "targets", [getattr(node, "target", None)])
    for target in targets:
        while isinstance(target, ast.Subscript | ast.Attribute):
            target = target.value
        if isinstance(target, ast.Name):
            names.add(target.id)
    return frozenset(names)


def _reads(node: ast.stmt) -> frozenset[str]:
    """The names of the page that a statement reads, also within its functions."""
    names = set()
    tables = [symtable.symtable(ast.unparse(node), "page", "exec")]
    top = tables[0]
    while tables:
        table = tables.pop()
        tables += table.get_children()
        names |= {
            x.get_name()
            for x in table.get_symbols()
            if x.is_referenced() and (table is top or x.is_global())
        }
    if isinstance(node, ast.AugAssign) and isinstance(node.target, ast.Name):
        names.add(node.target.id)
    return frozenset(names - set(dir(builtins)))


def _needs(block: str) -> frozenset[str]:
    """The names that a block reads before it defines them itself."""
    needed: set[str] = set()
    defined: set[str] = set()
    for statement in statements(block):
        needed |= statement.reads - defined
        defined |= statement.defines
    return frozenset(needed)


def _spaced(sources: list[str]) -> list[str]:
    """Statements with imports first, one line for each module, and blank lines around functions and
    classes."""
    imports: dict[str, list[str]] = {}
    lines = []
    for source in sources:
        if source.startswith("from "):
            module, _, name = source.partition(" import ")
            imports.setdefault(module, []).append(name)
        elif source.startswith("import "):
            imports[source] = []
        elif source.startswith(("def ", "class ", "@")):
            lines += ["", "", source, "", ""]
        else:
            lines.append(source)
    begin = [
        f"{module} import {', '.join(sorted(set(names)))}"
        if names
        else module
        for module, names in sorted(
            imports.items(), key=lambda x: (x[1] != [], x[0])
        )
    ]
    text = "\n".join([*begin, *[""][: len(begin)], *lines, ""])
    # At most two blank lines between two functions.
    return [
        re.sub(r"\n{4,}", "\n\n\n", text).rstrip("\n"),
        "" if not lines else "\n",
    ]
