"""Writes the reference of the command line and of scene files from what the package declares."""

import argparse
import inspect
from unittest import mock

from _parameter_tables import table
from mkdocs.structure.files import File

import jaxspace
from jaxspace import cli


def on_files(files, config):
    """Add the generated pages to the site."""
    pages = {
        "reference/command_line.md": command_line(),
        "reference/scene_files.md": scene_files(),
    }
    for name, text in pages.items():
        files.append(File.generated(config, name, content=text))
    return files


class _Parser(Exception):
    """Carries the parser of the command line out of `main`."""


def _parser() -> argparse.ArgumentParser:
    # `main` parses before it does anything else: its first act hands over the parser.
    def hand_over(self, *args, **kwargs):
        raise _Parser(self)

    with mock.patch.object(argparse.ArgumentParser, "parse_args", hand_over):
        try:
            cli.main([])
        except _Parser as found:
            return found.args[0]
    raise RuntimeError(
        "jaxspace.cli.main does not parse its arguments by argparse."
    )


def command_line() -> str:
    """The page of the command line."""
    parser = _parser()
    commands = next(
        a
        for a in parser._actions
        if isinstance(a, argparse._SubParsersAction)
    )
    parts = [
        "# Command line",
        parser.description or "",
        'The command comes with the extra `app`: `pip install ".[app]"`. It computes in double\n'
        "precision and keeps compiled programs between runs.",
        "| Command | What it does |\n|---|---|",
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
        "## Exit status\n\n| Status | Meaning |\n|---|---|\n| 0 | done |\n| 1 | runs failed |\n"
        "| 2 | input that cannot be used; the message names the file, the key and what is allowed |"
    )
    return "\n\n".join(parts) + "\n"


def _command(prog: str, entry, command: argparse.ArgumentParser) -> str:
    usage = " ".join(command.format_usage().removeprefix("usage: ").split())
    rows = [
        f"| `{_name(action)}` | {(action.help or '').replace('|', '/')} |"
        for action in command._actions
        if action.dest != "help"
    ]
    head = "| Argument | Meaning |\n|---|---|"
    text = f"## {entry.dest}\n\n{entry.help[0].upper()}{entry.help[1:]}.\n\n```sh\n{usage}\n```"
    return text + ("\n\n" + "\n".join([head, *rows]) if rows else "")


def _name(action: argparse.Action) -> str:
    if not action.option_strings:
        return str(action.metavar or action.dest)
    value = action.metavar or (
        "{" + ",".join(action.choices) + "}"
        if action.choices
        else action.dest.upper()
    )
    return action.option_strings[-1] + (
        "" if action.nargs == 0 else f" {value}"
    )


def scene_files() -> str:
    """The page of scene files: the parameters of every public system and effect."""
    parts = ["# Scene files", SCENE_FILES]
    kinds = (
        ("Systems", "AbstractSystem", jaxspace.core.AbstractSystem),
        ("Effects", "AbstractEffect", jaxspace.bodies.AbstractEffect),
        ("Bodies", "AbstractBody", jaxspace.bodies.AbstractBody),
        (
            "Distributions",
            "AbstractDistribution",
            jaxspace.dispersion.AbstractDistribution,
        ),
    )
    for title, _, base in kinds:
        parts.append(f"## {title}")
        for room, cls in _classes(base):
            parameters = table(cls)
            if parameters:
                parts.append(
                    f"### {cls.__name__}\n\n`jaxspace.{room}.{cls.__name__}`: {_first(cls)}"
                )
                parts.append(parameters)
    return "\n\n".join(parts) + "\n"


def _classes(base: type):
    """The public final classes of a kind, with the room that each belongs to."""
    for room in (
        "bodies",
        "orbits",
        "attitude",
        "gyros",
        "rockets",
        "scene",
        "dispersion",
    ):
        module = getattr(jaxspace, room)
        for name, value in vars(module).items():
            public = not name.startswith("_") and inspect.isclass(value)
            if (
                public
                and issubclass(value, base)
                and not inspect.isabstract(value)
            ):
                yield room, value


def _first(cls: type) -> str:
    """The first sentence of a docstring."""
    return inspect.getdoc(cls).split("\n\n")[0].replace("\n", " ")


SCENE_FILES = """\
A scene file is TOML. [Write a scene file](../howto/writing_scene_files.md) explains it by example;
this page lists its keys."""
