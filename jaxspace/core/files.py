"""Text files that a user names: their content, up to a limit of its size, and numbers in them."""

import math
import os
import re
import stat
from pathlib import Path

from .checks import InputError

LARGEST = 64_000_000
"""Maximum number of bytes of a file: a campaign saves the text of its files in its store."""
# `float` also reads "1_000", "infinity" and the digits of other scripts.
NUMBER = re.compile(r"[-+]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?")
LONGEST = 1000
"""Maximum number of characters of a number: the time to parse one grows as the square of its
length."""
UTF_16 = (b"\xff\xfe", b"\xfe\xff")


def finite_number(text: str) -> float | None:
    """The decimal number that a text is, with blanks around it; `None` for any other text, and for
    a number beyond the range of a float, such as 1e999."""
    text = text.strip()
    if len(text) > LONGEST or not NUMBER.fullmatch(text):
        return None
    value = float(text)
    return value if math.isfinite(value) else None


def read_text(path: str | os.PathLike[str]) -> str:
    """The text of a file in UTF-8, in UTF-16 with its byte order mark, or else in Windows-1252,
    which contains Latin-1; without the byte order mark that spreadsheets write.

    A path that a scene file gives has its `text`, which may be that of a store, and is not opened.

    **Raises** `OSError` for a file that cannot be opened, and `InputError` for one that is not a
    regular file, such as a device or a pipe, which may be endless, and for one of more than 64
    MB."""
    known = getattr(path, "text", None)
    if known is not None:
        return known
    path = Path(path)
    result = path.stat()
    # Opening a folder raises a clear `OSError` itself.
    if not stat.S_ISREG(result.st_mode) and not stat.S_ISDIR(result.st_mode):
        raise InputError(f"{path} cannot be read: it is not a regular file.")
    if result.st_size > LARGEST:
        raise InputError(
            f"{path} cannot be read: it has {result.st_size / 1e6:.0f} MB, and at most "
            f"{LARGEST / 1e6:.0f} MB are read."
        )
    content = path.read_bytes()
    if content.startswith(UTF_16):
        return content.decode("utf-16", errors="replace")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("cp1252", errors="replace")
