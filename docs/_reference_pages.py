"""Writes the reference of the command line and of scene files from what the package declares."""

import argparse
import re

from _parameter_tables import unit as _unit
from mkdocs.structure.files import File

from jaxspace import cli, io
from jaxspace.verification import CASES


def on_files(files, config):
    """Add the generated pages to the site."""
    pages = {
        "reference/command_line.md": command_line(),
        "reference/scene_files.md": scene_files(),
        "reference/hard_cases.md": hard_cases(),
    }
    for name, text in pages.items():
        files.append(File.generated(config, name, content=text))
    return files


def hard_cases() -> str:
    """The page of the hard cases: what each one allows, and why."""
    rows = [
        f"| {case.name} | {_roundings(case.roundings)} | "
        f"{_roundings(case.slope_roundings) if case.truth()[1] else '-'} | "
        f"{_escaped(case.why)} | {_escaped(case.single or '-')} |"
        for case in CASES
    ]
    return "\n".join([HARD_CASES, *rows]) + "\n"


def _roundings(number: float) -> str:
    """Whole below a hundred thousand, such as 4096, and a power of ten such as 1e6 above."""
    return (
        f"{number:.0f}" if number < 1e5 else f"{number:.0e}".replace("+0", "")
    )


def _escaped(text: str) -> str:
    """Text in a cell of a table, where a bar would end the cell."""
    return text.replace("|", "\\|")


def command_line() -> str:
    """The page of the command line."""
    parser = cli.parser()
    commands = next(
        a
        for a in parser._actions
        if isinstance(a, argparse._SubParsersAction)
    )
    parts = [
        "# Command line",
        parser.description or "",
        'The command is installed with the extra `app`: `pip install "jaxspace[app]"`. It\n'
        "uses double precision and stores compiled programs between runs.",
        "| Command | Action |\n|---|---|",
    ]
    parts[-1] += "".join(
        f"\n| [`{parser.prog} {entry.dest}`](#{entry.dest}) | {entry.help} |"
        for entry in commands._choices_actions
    )
    for entry in commands._choices_actions:
        parts.append(
            _command(parser.prog, entry, commands.choices[entry.dest])
        )
    parts.append(
        "## Exit status\n\n| Status | Meaning |\n|---|---|\n| 0 | success |\n"
        "| 1 | runs or edge cases failed |\n"
        "| 2 | invalid input; the message states the file, the key and the allowed values |"
        "\n| 130 | stopped by Ctrl-C or SIGTERM; the message reports the saved results |"
    )
    return "\n\n".join(parts) + "\n"


def _command(prog: str, entry, command: argparse.ArgumentParser) -> str:
    # On one line, whatever the width of the terminal.
    usage = " ".join(command.format_usage().removeprefix("usage: ").split())
    rows = [
        f"| {_name(action)} | {_help(action)} |"
        for action in command._actions
        if action.dest != "help"
    ]
    head = "| Argument | Meaning |\n|---|---|"
    text = f"## {entry.dest}\n\n{entry.help[0].upper()}{entry.help[1:]}.\n\n```sh\n{usage}\n```"
    return text + ("\n\n" + "\n".join([head, *rows]) if rows else "")


def _name(action: argparse.Action) -> str:
    if not action.option_strings:
        return f"`{action.metavar or action.dest}`"
    # The value is code of its own, so that a narrow column breaks before it.
    value = f" `{action.metavar or action.dest.upper()}`"
    return f"`{action.option_strings[-1]}`" + (
        "" if action.nargs == 0 else value
    )


def _help(action: argparse.Action) -> str:
    choices = ", ".join(f"`{c}`" for c in action.choices or ())
    text = _escaped(action.help or "")
    return f"{text}; one of {choices}" if choices else text


def scene_files() -> str:
    """The page of scene files: their tables, and everything that they may name."""
    schema = io.schema()
    parts = [SCENE_FILES, _tables(schema), *_fixed_tables(schema)]
    for group in io.listing().split("\n\n"):
        title, *lines = group.split("\n")
        parts.append(f"## {title[0].upper()}{title[1:]}")
        parts += _group(lines)
    return "\n\n".join(parts) + "\n"


def _tables(schema: dict) -> str:
    """What stands at the top of a file, and in the tables of the four kinds of files."""
    forms = schema["anyOf"]
    rows = {}
    for form in forms:
        for key, entry in form["properties"].items():
            kinds = rows.setdefault(key, (_meaning(entry), []))[1]
            kinds += [kind for kind in [_kind(form)] if kind not in kinds]
    lines = [
        f"| `{key}` | {meaning} | {', '.join(kinds) if len(kinds) < 4 else 'all'} |"
        for key, (meaning, kinds) in rows.items()
    ]
    return "\n".join(
        ["| Key or table | Meaning | Files |", "|---|---|---|", *lines]
    )


def _fixed_tables(schema: dict) -> list[str]:
    """The keys of the tables that are the same in every file."""
    parts = []
    for name in (
        "planet",
        "times",
        "phase",
        "branch",
        "waiting",
        "dispersion",
    ):
        form = next(f for f in schema["anyOf"] if name in f["properties"])
        entry = form["properties"][name]
        # A phase is one of a list of tables, a branch one of those by a name.
        named = entry.get("additionalProperties") or {}
        table = entry.get("items", named or entry)
        required = table.get("required", ())
        rows = [
            [f"`{key}`", _meaning(value), "yes" if key in required else ""]
            for key, value in table["properties"].items()
        ]
        rows = [["Key", "Meaning", "Required"], ["---"] * 3, *rows]
        # Where nothing is required, the column would be empty.
        lines = [" | ".join(row[: 3 if required else 2]) for row in rows]
        title = f"[{name}.NAME]" if named else f"[{name}]"
        title = f"[[{name}]]" if "items" in entry else title
        parts += [
            f"## `{title}`",
            "\n".join(f"| {line} |" for line in lines),
        ]
    return parts


def _meaning(entry: dict) -> str:
    default = (
        f" (by default {entry['default']})" if "default" in entry else ""
    )
    meaning = entry.get("description", "")
    return re.sub(r"\(in .*?\)$", lambda m: _unit(m[0]), meaning) + default


def _kind(form: dict) -> str:
    keys = form["properties"]
    return (
        "system"
        if "system" in keys
        else "flight"
        if "vehicle" in keys
        else "mission"
        if "phase" in keys
        else "scene"
    )


def _group(lines: list[str]) -> list[str]:
    """The entries of a group of the listing: a table of names, or for each name one of its keys."""
    entries: list[tuple[str, list[str]]] = []
    for line in lines:
        if line.startswith("    "):
            entries[-1][1].append(line[4:])
        else:
            entries.append((line.strip(), []))
    if not any(keys for _, keys in entries):
        rows = [_cells(text) for text, _ in entries]
        head = ["| Name | Unit | Meaning |", "|---|---|---|"]
        if not any(unit or meaning for _, unit, meaning in rows):
            return [", ".join(f"`{name}`" for name, _, _ in rows)]
        return [
            "\n".join(
                [
                    *head,
                    *(f"| `{n}` | {_unit(u)} | {m} |" for n, u, m in rows),
                ]
            )
        ]
    parts = []
    for text, keys in entries:
        if not keys:
            parts.append(_listed(text))
            continue
        name, _, meaning = _cells(text)
        parts.append(f"### {name}")
        parts += [f"{meaning}."] if meaning else []
        parts += _ways(keys)
    return parts


def _ways(keys: list[str]) -> list[str]:
    """A table for each of the ways to give an entry."""
    parts, rows = [], []
    for line in [*keys, "or"]:
        depth = (len(line) - len(line.lstrip())) // 2
        if line.startswith("initial: "):
            parts.append(_table(rows))
            rows = []
            parts.append(
                "Its initial state: "
                + _listed(line.removeprefix("initial: "))
            )
        elif line.strip().startswith("as in "):
            place = line.strip().removeprefix("as in ")
            rows.append(f"| {'&emsp;' * depth}*as in* `{place}` | | |")
        elif line.strip() != "or":
            name, unit, meaning = _cells(line.strip())
            mark = "&emsp;" * depth
            rows.append(f"| {mark}`{name}` | {_unit(unit)} | {meaning} |")
        elif depth:
            rows.append("| &emsp;*or* | | |")
        else:
            parts += [_table(rows), "*or*"]
            rows = []
    return [part for part in parts[:-1] if part]


def _table(rows: list[str]) -> str:
    return (
        "\n".join(["| Key | Unit | Meaning |", "|---|---|---|", *rows])
        if rows
        else ""
    )


def _listed(text: str) -> str:
    """Keys in a row, each as code."""
    return re.sub(r"(\w+)( \[[^]]*\])?(, |; |$)", r"`\1`\2\3", text)


def _cells(text: str) -> tuple[str, str, str]:
    """Name, unit and meaning of a line such as "mass [kg]: of the body"."""
    match = re.fullmatch(
        r"([\w.]+)(?: \[(.*?)\]| \((.*?)\))?(?:: (.*))?", text
    )
    if match is None:
        raise ValueError(
            f"The listing has a line that is not known here: {text!r}."
        )
    name, unit, names, meaning = match.groups()
    return name, unit or names or "", (meaning or "").replace("|", "\\|")


SCENE_FILES = """\
# Scene files

Scene files are in TOML format. [The guide](../howto/writing_scene_files.md) explains them by
example; this page lists all tables, keys and names. `jaxspace list` prints the names and
`jaxspace list NAME` the keys of one of them; `jaxspace schema` writes a schema for editors.

There are four kinds of files. A *system* file defines one system in `[system]`. A *scene* combines
a body and effects. A *mission* has `[[phase]]` tables. A *flight* simulates a rocket, its
`[vehicle]`, from rail to landing. Values are numbers in SI units, or strings with a unit. The name
of a second effect of the same type has a numeric suffix: `[effects.drag_2]`."""

HARD_CASES = """\
# Edge cases

`jaxspace verify` evaluates these cases on your machine, for the value and both differentiation
modes, prints the errors, and returns exit status 1 if a case fails. `--precision float32` does the
same in single precision, and lists the excluded cases; `--device gpu` uses a GPU. In Python, use
`jaxspace.verification.run_cases()`; `verify(system, y0, span)` in the same package checks the laws
of motion for user-defined systems and scenes. [Fuzz testing](../explanation/fuzz_testing.md)
searches for further critical inputs.

The table lists the allowed errors in units of the rounding error. The error of a value is divided
by the condition number of the case, so that 1 is the effect of rounding the inputs; the error of a
derivative is relative to the largest one of the same output. The reference values are closed forms,
or computed from other formulas with sixty digits. The last column is the reason for excluding a
case from `--precision float32`.

| Case | Value | Derivatives | Reason | Excluded from float32 |
|---|---|---|---|---|"""
