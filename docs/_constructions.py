"""How a public class is constructed, for its entry in the reference: its arguments with units,
ranges and defaults, from what the class declares, and an example from docs/constructions."""

import ast
import dataclasses
import functools
import inspect
import re
from pathlib import Path

import equinox as eqx
import jax
import numpy as np
from _parameter_tables import unit
from _uses import packages, public_names

from jaxspace.core.quantities import quantities

FILES = Path(__file__).resolve().parent / "constructions"
# An entry of a docstring for arguments, "- `mass`, `length`: meaning." or "- `force`, kg m/s^2:
# meaning."
ENTRY = re.compile(
    r"^- (`\w+`(?:, `\w+`)*)(?:, ([^\s:,`]+(?: [^\s:,`]+)*))?: (.*(?:\n  \S.*)*)\n?",
    re.MULTILINE,
)
# A bar would end the cell of a table.
BAR = r"\|"
HEAD = (
    "| Argument | Unit | Allowed | Default | Meaning |\n|---|---|---|---|---|"
)


@functools.cache
def classes() -> dict[type, str]:
    """The public modules and dataclasses with their public paths, without abstract classes."""
    found = {}
    for package in packages():
        for module, names in public_names(package).items():
            for name, thing in names.items():
                if _is_constructible(thing):
                    path = ".".join(filter(None, (package, module, name)))
                    found.setdefault(thing, path)
    return found


def _is_constructible(thing: object) -> bool:
    return (
        inspect.isclass(thing)
        and (issubclass(thing, eqx.Module) or dataclasses.is_dataclass(thing))
        and not thing.__name__.startswith("Abstract")
    )


@functools.cache
def results() -> set[type]:
    """The classes that users receive and do not construct: without an example and without declared
    quantities, they are returned by a public function or method, or are part of such a result."""
    candidates = {
        cls
        for cls in classes()
        if cls not in examples() and not quantities(cls)
    }
    returned = " ".join(_return_annotations())
    found = {cls for cls in candidates if _names(returned, cls)}
    parts = " ".join(
        str(f.type) for cls in found for f in dataclasses.fields(cls)
    )
    return found | {cls for cls in candidates if _names(parts, cls)}


def _names(text: str, cls: type) -> bool:
    return re.search(rf"\b{cls.__name__}\b", text) is not None


def _return_annotations() -> list[str]:
    found = []
    for package in packages():
        for names in public_names(package).values():
            for thing in names.values():
                members = (
                    vars(thing).values() if inspect.isclass(thing) else ()
                )
                for member in (thing, *members):
                    function = getattr(member, "fget", None) or getattr(
                        member, "__func__", member
                    )
                    hints = getattr(
                        inspect.unwrap(function), "__annotations__", {}
                    )
                    found.append(str(hints.get("return", "")))
    return found


@functools.cache
def examples() -> dict[type, str]:
    """A program that constructs each class, with its imports."""
    found = {}
    for file in sorted(FILES.glob("*.py")):
        found |= {
            cls: code
            for cls, code in of_file(file).items()
            if cls not in found
        }
    return found


def of_file(file: Path) -> dict[type, str]:
    """The programs of one file."""
    text = file.read_text()
    known = {cls.__name__: cls for cls in classes()}
    imports: dict[str, str] = {}
    defined: dict[str, ast.stmt] = {}
    found = {}
    for node in ast.parse(text).body:
        if isinstance(node, ast.ImportFrom):
            for a in node.names:
                imports[a.name] = node.module
        elif isinstance(node, ast.Import):
            for a in node.names:
                own = f" as {a.asname}" if a.asname else ""
                imports[a.asname or a.name] = f"import {a.name}{own}"
        elif isinstance(node, ast.FunctionDef):
            defined[node.name] = node
        elif isinstance(node, ast.Assign | ast.Expr):
            if isinstance(node, ast.Assign):
                for target in node.targets:
                    defined[target.id] = node
            # The class itself, or one of its named constructors.
            if isinstance(node.value, ast.Call):
                name = ast.unparse(node.value.func).partition(".")[0]
                if name in known:
                    code = _program(text, node, imports, defined)
                    found.setdefault(known[name], code)
    return found


def _program(
    text: str,
    last: ast.stmt,
    imports: dict[str, str],
    defined: dict[str, ast.stmt],
) -> str:
    """A statement, after the imports and statements that it needs."""
    needed: dict[ast.stmt, None] = {}
    names: set[str] = set()

    def need(node: ast.stmt) -> None:
        for part in ast.walk(node):
            if isinstance(part, ast.Name):
                names.add(part.id)
                before = defined.get(part.id)
                if before is not None and before not in (node, *needed):
                    need(before)
        needed[node] = None

    need(last)
    lines = sorted(
        {imports[n] for n in names & set(imports) if " " in imports[n]}
    )
    modules = {
        imports[n] for n in names & set(imports) if " " not in imports[n]
    }
    own = [
        f"from {module} import "
        + ", ".join(sorted(n for n in names if imports.get(n) == module))
        for module in sorted(modules)
    ]
    parts = ["\n".join(lines), "\n".join(own)]
    before = None
    for node in sorted(needed, key=lambda node: node.lineno):
        code = ast.get_source_segment(text, node)
        if isinstance(node, ast.FunctionDef):
            parts.append(f"\n{code}\n")
        elif before is None or isinstance(before, ast.FunctionDef):
            parts.append(code)
        else:
            parts[-1] += f"\n{code}"
        before = node
    return "\n\n".join(filter(None, parts))


def statements(code: str) -> list[str]:
    """The statements of a program; of the last one the expression that constructs the object."""
    nodes = ast.parse(code).body
    return [ast.unparse(n) for n in [*nodes[:-1], nodes[-1].value]]


def parameters(cls: type) -> list[inspect.Parameter]:
    """The arguments of the constructor."""
    return list(inspect.signature(cls).parameters.values())


def default(cls: type, parameter: inspect.Parameter) -> str:
    """The default of an argument as code; empty where it is required."""
    value = parameter.default
    if value is parameter.empty:
        return ""
    for field in dataclasses.fields(cls):
        if (
            field.name == parameter.name
            and field.default_factory is not dataclasses.MISSING
        ):
            value = field.default_factory()
    if isinstance(value, np.ndarray | jax.Array):
        return repr(np.asarray(value).tolist())
    if inspect.isfunction(value) or inspect.isclass(value):
        return value.__name__
    text = " ".join(repr(value).split())
    return text if len(text) < 40 else f"{type(value).__name__}(...)"


def kind(annotation: object) -> str:
    """The type of an argument, without the modules of its names."""
    if annotation is inspect.Parameter.empty:
        return ""
    text = (
        annotation
        if isinstance(annotation, str)
        else inspect.formatannotation(annotation)
    )
    text = re.sub(r"\b(?:[A-Za-z_]\w*\.)+(?=\w)", "", text)
    # As the sources and signatures abbreviate them.
    text = text.replace("Float[Array, '*#runs'] | float", "Scalar")
    return text.replace("PyTree[Float[Array, '...']]", "State")


def describe(cls: type, text: str) -> str:
    """A docstring with the table of the arguments, into which its own entries move, and the
    example."""
    names = {p.name for p in parameters(cls)}
    entries: dict[str, tuple[str, str]] = {}

    def move(match: re.Match[str]) -> str:
        named = re.findall(r"`(\w+)`", match[1])
        if not names.issuperset(named):
            return match[0]
        words = " ".join(match[3].split()).rstrip(".")
        entries.update({n: (match[2] or "", words) for n in named})
        return ""

    # An entry with a paragraph of its own does not fit into a cell.
    if not re.search(r"^- .*(?:\n  .*)*\n\n  \S", text, re.MULTILINE):
        text = ENTRY.sub(move, text)
        text = re.sub(r"\n\*\*Arguments\*\*\n\s*(?=\n|\Z)", "\n", text)
    parts = [re.sub(r"\n{3,}", "\n\n", text).strip()]
    if names:
        parts.append(table(cls, entries))
    if cls in examples():
        parts.append(f"```python\n{examples()[cls]}\n```")
    return "\n\n".join(parts)


def table(cls: type, entries: dict[str, tuple[str, str]]) -> str:
    """The arguments of a constructor as a Markdown table; `entries` has the unit and the meaning of
    those that the docstring describes."""
    declared = quantities(cls)
    fields = {field.name: field for field in dataclasses.fields(cls)}
    printed = getattr(cls, "_printed_units", {})
    rows = [HEAD]
    for parameter in parameters(cls):
        name = parameter.name
        measure, meaning = entries.get(name, ("", ""))
        if name in declared:
            q = declared[name]
            measure, allowed = unit(q.unit), q.allowed()
            allowed += f"; shape `{q.form()}`" if q.shape else ""
            allowed += ", or absent" if q.optional else ""
            meaning = meaning or q.doc
        else:
            field = fields.get(name)
            known = printed.get(name, "")
            measure = measure or (known if isinstance(known, str) else "")
            measure = unit(measure) if measure else ""
            # A converter hides the type of its field.
            allowed = kind(field.type if field else parameter.annotation)
            allowed = f"`{allowed}`" if allowed else ""
            meaning = meaning or (
                field.metadata.get("doc", "") if field else ""
            )
        value = default(cls, parameter)
        value = f"`{value}`" if value else "required"
        cells = (f"`{name}`", measure, allowed, value, meaning)
        rows.append(
            f"| {' | '.join(cell.replace('|', BAR) for cell in cells)} |"
        )
    return "\n".join(rows)
