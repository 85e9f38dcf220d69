"""Names that become one component of a path, on every system."""

import re

from .text import is_printable

LONGEST_NAME = 255
"""Bytes that file systems allow for one component of a path."""
# Windows opens a device by these names, whatever their case and extension.
DEVICES = re.compile(r"(con|prn|aux|nul|com[0-9¹²³]|lpt[0-9¹²³])\s*(\.|$)", re.IGNORECASE)
# Separators of paths; behind a colon Windows looks for a drive or for a second stream of the file.
SEPARATORS = "/\\:"


def file_name_fault(name: object, longest: int = LONGEST_NAME) -> str:
    """The reason why `name` cannot name a file or folder in a given folder, as the end of a message
    that begins with "it must be"; empty if it can.

    The answer is the same on every system, because stores move from one to another.

    `longest`: bytes that it may have."""
    if not isinstance(name, str) or not name or not is_printable(name):
        return "printable text"
    if any(c in name for c in SEPARATORS):
        return f"one component of a path, without {' '.join(SEPARATORS)}"
    if name.startswith("."):
        return "text that does not begin with a dot"
    if name.endswith((".", " ")):
        return "text that ends with neither a dot nor a space"
    if DEVICES.match(name):
        return "a name other than that of a Windows device"
    if len(name.encode(errors="replace")) > longest:
        return f"at most {longest} bytes long"
    return ""
