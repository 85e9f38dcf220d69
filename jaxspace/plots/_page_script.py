"""The script of a page: its `data`, and the script files that draw them."""

import json
from pathlib import Path

from ..core.record import Record

HERE = Path(__file__).parent


def page_script(data: Record, *files: str) -> str:
    """An element of a page. `files` are names of scripts without their end; they see each other's
    functions, and the last one begins to draw."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    # A name in the data must not end the script, as `</script` does, nor hide its end from the
    # browser, as `<!--<script` does. In JSON this character is in texts alone.
    text = text.replace("<", "\\u003c")
    parts = ((HERE / f"{file}.js").read_text(encoding="utf-8") for file in files)
    return f"<script>const data = {text};\n{''.join(parts)}</script>"
