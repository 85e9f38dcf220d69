"""Every example with one thing wrong: a sentence for each error, or a file that is read."""

import warnings

import numpy as np
import pytest
from mutated_scenes import examples, mutated

from jaxspace.io import SceneError, _load, load

EXAMPLES = examples()
# Cases of each sample: a few files of every kind, in a second or two.
CASES = 40


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(1, 20))]
)
def test_a_file_with_one_thing_wrong_is_read_or_refused_in_sentences(seed, monkeypatch):
    draw = np.random.default_rng(seed)
    read = refused = 0
    for _ in range(CASES):
        path = list(EXAMPLES)[draw.integers(len(EXAMPLES))]
        tree, what = mutated(EXAMPLES[path], draw)
        monkeypatch.setattr(_load, "read_toml", lambda *_, tree=tree: (tree, ""))
        try:
            with warnings.catch_warnings(action="error", category=RuntimeWarning):
                load(path)
            read += 1
        except SceneError as error:
            refused += 1
            for line in str(error).splitlines():
                assert line.startswith(f"{path}: ") and line.isprintable(), f"{what}: {line}"
        except Exception as error:
            pytest.fail(f"{path.name}, {what}: {type(error).__name__}: {error}")
    # Most are refused; an optional entry may be absent, and a number another one.
    assert refused > CASES / 2 and read > 0


@pytest.mark.parametrize(
    ("name", "old", "new", "words"),
    [
        (
            *(
                "kick_stage.toml",
                'distribution = "truncated_normal"',
                'distribution = ["truncated_normal"]',
            ),
            'distribution is ["truncated_normal"]: it must be one of',
        ),
        (
            *("sampled_slew.toml", "command = [0.0, 0.0, 0.0]", "command = [0.0, 0.0]"),
            "motor has 2 commands: it must have one for each of the 3 wheels",
        ),
    ],
)
def test_what_the_law_has_found(name, old, new, words):
    """In ten thousand files."""
    path = next(path for path in EXAMPLES if path.name == name)
    assert old in path.read_text()
    with pytest.raises(SceneError) as refused:
        load(path, text=path.read_text().replace(old, new, 1))
    assert words in str(refused.value)
