"""Makes the whole addresses of pages relative, so that links lead to pages of the same version.

A page that is written when the site is built is no file of the repository: its address is written
in full in the sources, which lead there from a clone and on GitHub, too."""

import posixpath
import re

ADDRESS = re.compile(
    r"\]\(https://jaxspace\.github\.io/jaxspace/latest/([\w/]*?)/?(#[\w-]+)?\)"
)


def on_page_markdown(markdown, page, config, files):
    """Replace the addresses of a page by relative links, which the strict build checks."""
    del config
    folder = posixpath.dirname(page.file.src_uri)
    known = {file.src_uri for file in files.documentation_pages()}

    def relative(match: re.Match[str]) -> str:
        path, place = match[1], match[2] or ""
        # Without a page the link stays a relative one, and the build refuses it.
        index = f"{path}/index.md".lstrip("/")
        target = index if index in known else f"{path}.md"
        return f"]({posixpath.relpath(target, folder or '.')}{place})"

    return ADDRESS.sub(relative, markdown)
