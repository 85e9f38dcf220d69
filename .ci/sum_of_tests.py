"""Prints the sum of the tests of a log, as "N passed, N failed, N skipped".

The log has the closing lines of two calls of pytest: the quick tests and the others.
"""

import re
import sys
from pathlib import Path

CLOSING = re.compile(r"=+ (.*\d+ (?:passed|failed|error|skipped).*) in [\d.]+s.* =+")
KEYS = {"passed": "passed", "failed": "failed", "error": "failed", "errors": "failed"}

lines = Path(sys.argv[1]).read_text(errors="replace").splitlines()
counts = {"passed": 0, "failed": 0, "skipped": 0}
closings = [found.group(1) for found in map(CLOSING.fullmatch, lines) if found]
for closing in closings:
    for count, word in re.findall(r"(\d+) (passed|failed|errors?|skipped)", closing):
        counts[KEYS.get(word, word)] += int(count)
print(", ".join(f"{count} {word}" for word, count in counts.items()))
