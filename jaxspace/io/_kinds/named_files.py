"""The files that a scene file names, such as tables of measured values: their texts are stored with
a campaign, which then does not need the files."""

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ...core import InputError
from ...core.files import read_text

# A text in quotation marks, as Python or JSON write it.
QUOTED = re.compile(r"""'(?:[^'\\]|\\.)*'|"(?:[^"\\]|\\.)*\"""")
NOT_SHOWN = "not shown (the file is outside the folder of the scene)"


@dataclass(frozen=True)
class NamedFile(os.PathLike[str]):
    """The path of a file whose text is known, so that it is not opened."""

    path: Path
    text: str

    def __fspath__(self) -> str:
        return str(self.path)

    def __str__(self) -> str:
        return str(self.path)

    def read_text(self, encoding: str | None = None, errors: str | None = None) -> str:
        """The text, as `Path.read_text` has it."""
        del encoding, errors
        return self.text


class NamedFiles:
    """The files that a scene file names, by the name that it gives them.

    All of them are read through this object, so that a campaign can store their texts and read them
    from its store.

    - `folder`: the folder of the scene file, to which names are relative.
    - `texts`: of the files that have been read, or that a store contains.
    - `closed`: whether these are all files, so that none is read from disk.
    - `entries`: of the scene file that name a file, by their path."""

    def __init__(
        self,
        folder: Path | None = None,
        texts: Mapping[str, str] | None = None,
        closed: bool = False,
    ):
        self.folder = Path() if folder is None else folder
        self.texts = dict(texts or {})
        self.closed = closed
        self.entries: dict[str, NamedFile] = {}

    def text(self, name: str) -> str:
        """The text of a file. Raises `ValueError` with the path of one that cannot be read."""
        if name not in self.texts and self.closed:
            raise ValueError(f"{name} cannot be read: its text is not in the store.")
        if name not in self.texts:
            path = self.path(name)
            try:
                self.texts[name] = read_text(path)
            except InputError:
                raise
            except (OSError, ValueError) as error:
                # A name with a zero byte is a `ValueError`.
                reason = error.strerror if isinstance(error, OSError) else error
                raise ValueError(f"{path} cannot be read: {reason}.") from None
        return self.texts[name]

    def file(self, name: str, entry: str) -> NamedFile:
        """The file that this entry of the scene names. Raises `ValueError` as `text` does."""
        self.entries[entry] = NamedFile(self.path(name), self.text(name))
        return self.entries[entry]

    def discreet(self, sentence: str) -> str:
        """The message without quotations from a file outside the folder of the scene: the sender of
        a scene must not learn the content of other files from an error."""
        for name in self.texts:
            where = str(self.path(name))
            start, found, rest = sentence.partition(where)
            if found and not self._is_beside(name):
                sentence = start + found + QUOTED.sub(NOT_SHOWN, rest)
        return sentence

    def _is_beside(self, name: str) -> bool:
        """Whether a file is in the folder of the scene, or below it."""
        return self.path(name).resolve().is_relative_to(self.folder.resolve())

    def path(self, name: str) -> Path:
        """Location of a file."""
        # Absolute, because the working directory may change.
        return (self.folder / name).absolute()
