"""Puts every page of docs/kernels into the navigation, so that a new one appears without a list to
edit."""

from pathlib import Path


def on_config(config):
    docs = Path(config["docs_dir"])
    pages = [page.relative_to(docs).as_posix() for page in sorted(docs.glob("kernels/*.md"))]
    if pages:
        config["nav"].append({"Kernels": pages})
    return config
