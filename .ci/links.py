"""Follows every link of the built manual: `python .ci/links.py site`.

A link within the site must lead to a file, and its fragment to a name on that page. Links to other
sites are counted and not opened: the machine may have no network. Exits with 1 where one is broken.
"""

import sys
from collections import Counter
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

ADDRESSES = ("href", "src")


class Page(HTMLParser):
    """The addresses that a page points to, the names on it, and where it says that it lies."""

    def __init__(self, text: str):
        super().__init__()
        self.links: list[str] = []
        self.names: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        for key, value in attrs:
            if key in ADDRESSES and value:
                self.links.append(value)
            if key == "id" or (tag == "a" and key == "name"):
                self.names.add(value or "")


def broken_links(site: Path, home: str) -> tuple[list[str], Counter]:
    """What is broken, a sentence each, and how many links there are of each kind.

    `home`: the public address of the site, for links that are written in full."""
    pages = {path: Page(path.read_text(encoding="utf-8")) for path in site.rglob("*.html")}
    broken, kinds = [], Counter()
    for path, page in pages.items():
        for link in page.links:
            parts = urlsplit(link.removeprefix(home) if link.startswith(home) else link)
            if parts.scheme or parts.netloc:
                kinds["to other sites"] += 1
                continue
            kinds["within the site"] += 1
            whole = link.startswith(home) or parts.path.startswith("/")
            # A page that is shown in place of a missing one writes the path of the site.
            below = parts.path.removeprefix(urlsplit(home).path).lstrip("/")
            target = site / unquote(below) if whole else path.parent / unquote(parts.path)
            target = path if not (parts.path or whole) else target.resolve()
            target = target / "index.html" if target.is_dir() else target
            if not target.is_file():
                broken.append(f"{path.relative_to(site)}: {link} leads nowhere.")
            # The names of a script's own are made by it.
            elif parts.fragment and target in pages and not parts.fragment.startswith("__"):
                if unquote(parts.fragment) not in pages[target].names:
                    broken.append(f"{path.relative_to(site)}: {link} names no place there.")
    return broken, kinds


def main() -> int:
    site = Path(sys.argv[1]).resolve()
    home = sys.argv[2] if len(sys.argv) > 2 else "https://jaxspace.github.io/jaxspace/"
    broken, kinds = broken_links(site, home)
    print(*broken, sep="\n", end="\n" if broken else "")
    print(", ".join(f"{count} links {kind}" for kind, count in kinds.items()))
    return 1 if broken or not kinds["within the site"] else 0


if __name__ == "__main__":
    sys.exit(main())
