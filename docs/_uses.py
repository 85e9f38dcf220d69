"""Which public objects the examples and the pages of the manual use, and where each of them is
described: for the links from one to the other."""

import ast
import functools
import importlib
import inspect
import pkgutil
import re
from pathlib import Path
from typing import NamedTuple

import jaxspace

DOCS = Path(__file__).resolve().parent
EXAMPLES = DOCS.parent / "examples"
SOURCES = "https://github.com/jaxspace/jaxspace/blob/main/examples"
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)
# A line of code in the last column of a table, as "How do I ...?" has them.
ROW = re.compile(r"^\|.*\| `(.*)` \|$", re.MULTILINE)


class Example(NamedTuple):
    """What a reader is sent to: its title, and its address from the root of the manual."""

    title: str
    address: str


def packages() -> list[str]:
    """The packages that a user imports, in alphabetical order."""
    found = [
        p.name for p in pkgutil.iter_modules(jaxspace.__path__) if p.ispkg
    ]
    return [name for name in found if (DOCS / "api" / f"{name}.md").exists()]


@functools.cache
def public_names(package: str) -> dict[str, dict[str, object]]:
    """The public names of a package: those of its root at "", and those of each module."""
    root = importlib.import_module(f"jaxspace.{package}")
    files = [file.name for file in pkgutil.iter_modules(root.__path__)]
    found = {"": _ours(vars(root))}
    for file in sorted(name for name in files if not name.startswith("_")):
        module = importlib.import_module(f"{root.__name__}.{file}")
        names = getattr(module, "__all__", ())
        found[file] = _ours({name: getattr(module, name) for name in names})
    return found


def _ours(names: dict[str, object]) -> dict[str, object]:
    # An alias of a shape, such as `Scalar`, belongs to jaxtyping.
    return {
        name: thing
        for name, thing in names.items()
        if not name.startswith("_")
        and not inspect.ismodule(thing)
        and getattr(thing, "__module__", "").startswith("jaxspace")
    }


@functools.cache
def homes() -> dict[int, str]:
    """The public path of each object, such as `orbits.lambert.lambert`, by its identity."""
    found = {}
    for package in packages():
        for module, names in public_names(package).items():
            for name, thing in names.items():
                path = ".".join(filter(None, (package, module, name)))
                # A name that another package gives on is at home where it is defined.
                if package in thing.__module__.split("."):
                    found.setdefault(id(thing), path)
    return found


def used(*codes: str) -> list[str]:
    """The public paths of the objects that pieces of code use, which share their imports."""
    names, found = {}, {}
    trees = [ast.parse(code) for code in codes]
    nodes = [node for tree in trees for node in ast.walk(tree)]
    for node in nodes:
        if isinstance(node, ast.Import):
            names |= {
                a.asname or "jaxspace": importlib.import_module(a.name)
                if a.asname
                else jaxspace
                for a in node.names
                if a.name.split(".")[0] == "jaxspace"
            }
        elif isinstance(node, ast.ImportFrom):
            if (node.module or "").split(".")[0] == "jaxspace":
                module = importlib.import_module(node.module)
                for a in node.names:
                    names[a.asname or a.name] = getattr(module, a.name)
    for node in nodes:
        if isinstance(node, ast.Name | ast.Attribute):
            first, *rest = ast.unparse(node).split(".")
            thing = names.get(first)
            for part in rest:
                thing = getattr(thing, part, None)
            if id(thing) in homes():
                found[homes()[id(thing)]] = None
    return sorted(found)


def first_line(text: str) -> str:
    """The first sentence of a docstring, without its full stop."""
    paragraph = " ".join(inspect.cleandoc(text).partition("\n\n")[0].split())
    # Neither the dot of a product, "r . v", nor that of "U.S." ends a sentence.
    return re.split(r"(?<=[^.\s])(?<!U\.S)\.(?: |$)|:$", paragraph)[0]


def anchor(title: str) -> str:
    """The anchor that the site gives to a heading."""
    words = re.sub(r"[^\w\s-]", "", title.lower())
    return re.sub(r"[\s-]+", "-", words.strip())


@functools.cache
def examples() -> dict[str, list[Example]]:
    """The examples of each object, by its public path: those of the gallery, then the scripts,
    then the pages."""
    found: dict[str, list[Example]] = {}

    def enter(example: Example, *codes: str) -> None:
        for path in used(*codes):
            found.setdefault(path, []).append(example)

    for script in sorted(EXAMPLES.glob("gallery/*/*.py")):
        code = script.read_text()
        title = (ast.get_docstring(ast.parse(code)) or "").partition("\n")[0]
        page = f"gallery/{script.parent.name}/#{anchor(title)}"
        enter(Example(title, page), code)
    for script in sorted(EXAMPLES.glob("[0-9]*.py")):
        title = script.stem.partition("_")[2].replace("_", " ")
        example = Example(title, f"{SOURCES}/{script.name}")
        enter(example, script.read_text())
    for folder in ("tutorials", "howto", "physics"):
        for page in sorted((DOCS / folder).glob("*.md")):
            text = page.read_text()
            title = re.search(r"^# (.*)", text, re.MULTILINE)[1]
            lines = ROW.findall(text) if page.stem == "how_do_i" else []
            code = [x for x in lines if not x.startswith("$")]
            example = Example(title, f"{folder}/{page.stem}/")
            enter(example, *BLOCK.findall(text), *code)
    return found
