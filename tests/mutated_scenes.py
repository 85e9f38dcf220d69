"""Scene files with one thing wrong, drawn from the examples: a law for what reads them."""

import copy
import tomllib
from collections.abc import Iterator
from pathlib import Path

import numpy as np

SCENES = Path(__file__).resolve().parents[1] / "examples" / "scenes"
# What takes the place of a value: of another type, sign, size or unit, or that nobody writes.
VALUES = (
    *(-1, 0, 1e308, -1e308, 10**30, float("nan"), float("inf"), True, 0.5, 1e-320),
    *("", "x", "1 parsec", "-1 m", "nan m", "1e400 m", "5 %", "\x00", "../x", "1 m 2 s", "2 m"),
    *([], [1.0], ["a", 1], [[1.0]], [1.0] * 4, {}, {"a": 1}, {"": {}}, [{}], [None]),
)
KEYS = ("", "x", "a.b", "mass", "=x", "\x1b[31m", "..", "0", "phase", "\u0000")


def places(tree, path=()) -> Iterator[tuple]:
    """The path of every value of a file."""
    items = tree.items() if isinstance(tree, dict) else enumerate(tree)
    for key, value in items:
        yield (*path, key)
        if isinstance(value, dict | list):
            yield from places(value, (*path, key))


def mutated(tree, draw: np.random.Generator):
    """A copy of a file with one value replaced, removed, doubled, or under another key."""
    tree = copy.deepcopy(tree)
    every = list(places(tree))
    path = every[draw.integers(len(every))]
    owner = tree
    for step in path[:-1]:
        owner = owner[step]
    kind = draw.choice(["value", "value", "value", "value", "gone", "key", "moved"])
    if kind == "gone":
        del owner[path[-1]]
    elif kind == "key" and isinstance(owner, dict):
        owner[KEYS[draw.integers(len(KEYS))]] = owner.pop(path[-1])
    elif kind == "moved":
        other = every[draw.integers(len(every))]
        tree[str(other[-1])] = owner[path[-1]]
    else:
        owner[path[-1]] = VALUES[draw.integers(len(VALUES))]
    return tree, f"{'.'.join(map(str, path))}: {kind}"


def examples() -> dict[Path, dict]:
    """The example scenes, by their paths."""
    return {path: tomllib.loads(path.read_text()) for path in sorted(SCENES.glob("*.toml"))}
