"""Puts every page of docs/physics into the navigation, so that a new one appears without a list to
edit."""

from pathlib import Path


def on_config(config):
    docs = Path(config["docs_dir"])
    pages = [
        page.relative_to(docs).as_posix()
        for page in sorted(docs.glob("physics/*.md"))
    ]
    reference = next(
        entry["Reference"] for entry in config["nav"] if "Reference" in entry
    )
    reference.append({"Physics": pages})
    return config
