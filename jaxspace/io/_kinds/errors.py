"""Errors of a scene file: messages that name the key, the value, the allowed values and the closest
valid name."""

import json
from collections.abc import Iterable

from ...core import InputError
from ...core.text import printable


class SceneError(ValueError):
    """A scene file that cannot be used; the message has one line for each error."""

    def __init__(self, file: object, errors: str | Iterable[str]):
        lines = [errors] if isinstance(errors, str) else without_repetition(list(errors))
        super().__init__("\n".join(printable(f"{file}: {line}") for line in lines))


def without_repetition(lines: list[str]) -> list[str]:
    """The lines without those that report the same error again.

    A misspelt key is reported as unknown; that its right name is missing is then no news."""
    named = {
        line.rpartition(" Did you mean ")[2].rstrip("?") for line in lines if line.endswith("?")
    }
    first: dict[str, str] = {}
    for line in lines:
        key, gap, _ = line.partition(" is missing: ")
        if not (gap and named & set(key.split("."))):
            first.setdefault(key if gap else line, line)
    return list(first.values())


def shown(value: object) -> str:
    """A value as a file writes it, cut short when it is long."""
    # JSON writes lists and text as TOML does; `default=str` handles dates, which JSON does not
    # have.
    text = printable(json.dumps(value, ensure_ascii=False, default=str))
    # Shortened, because a whole table may be in the place of a number.
    return text if len(text) <= 60 else text[:57] + "..."


hint = InputError.hint


def wrong(key: str, value: object, expected: str) -> str:
    """The message for a value that is not allowed."""
    return f"{key} is {shown(value)}: it must be {expected}."


def unknown(key: str, name: object, names: Iterable[str], what: str = "key") -> str:
    """The message for a name that is not among `names`."""
    names = list(names)
    listed = f"it must be one of {', '.join(names)}" if names else "there is none"
    return f"{key} is not a known {what}: {listed}.{hint(name, names)}"


def missing(key: str, expected: str) -> str:
    """The message for a required key that is missing."""
    return f"{key} is missing: it must be {expected}."
