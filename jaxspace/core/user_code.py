"""Python files with user-defined physics, executed from their text."""

import functools
import hashlib
import linecache
import re
import sys
import traceback
from pathlib import Path
from types import ModuleType

from .checks import InputError


def text_hash(text: str) -> str:
    """The SHA-256 of a text in UTF-8, in hexadecimal digits."""
    return hashlib.sha256(text.encode()).hexdigest()


# Cached, so that a class of the file is the same one wherever the file is named.
@functools.cache
def run_module(name: str, text: str) -> ModuleType:
    """The module of a Python file, which is run.

    **Arguments**

    - `name`: of the file, such as "my_effects.py".
    - `text`: of the file.

    **Returns** the module. Its name follows from the arguments, so that its definitions can be sent
    to a process that has executed the same text.

    **Raises** `InputError` with the line where the text raises an error."""
    # With the hash: a worker may process campaigns of two versions of the file in turn.
    title = re.sub(r"\W", "_", Path(name).stem)
    module = ModuleType(f"jaxspace_module_{title}_{text_hash(text)[:16]}")
    module.__file__ = name
    # Registered before it runs, because dataclasses look their module up by its name.
    sys.modules[module.__name__] = module
    # Tracebacks show lines of a file that a worker does not have.
    linecache.cache[name] = (len(text), None, text.splitlines(keepends=True), name)
    try:
        exec(compile(text, name, "exec"), module.__dict__)
    # Any exception: only an interruption is not an error of the file.
    except BaseException as error:
        del sys.modules[module.__name__]
        lines = [
            frame.lineno
            for frame in traceback.extract_tb(error.__traceback__)
            if frame.filename == name
        ]
        if isinstance(error, KeyboardInterrupt):
            raise
        wrong = isinstance(error, SyntaxError)
        # A text with a zero byte has no line where it is wrong.
        number = error.lineno if wrong else lines[-1]
        where = f"line {number} raises " if number else ""
        said = error.msg if wrong else error
        raise InputError(f"{name} cannot be run: {where}{type(error).__name__}: {said}") from error
    return module
