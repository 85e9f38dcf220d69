"""Compiled programs that are kept from one process to the next."""

import os
import subprocess
import sys

import pytest

import jaxspace
from jaxspace._jax_settings import _limit_of
from jaxspace.core import InputError

# The first program is compiled before the call: a folder that is given late counts as well.
PROCESS = """
import sys
import jax
import jax.numpy as jnp
import jaxspace

jnp.ones(3) + 1.0
folder = jaxspace.keep_programs(*sys.argv[1:])
hits = []
jax.monitoring.register_event_listener(
    lambda name, **more: hits.append(name) if name.endswith("/cache_hits") else None
)
print(jax.jit(lambda x: jnp.sin(x) * 2.0)(1.0))
print(folder, len(hits))
"""


def run(*folder, **environment):
    """The answer, the folder and how many programs were read, of a new process."""
    left = {
        k: x for k, x in os.environ.items() if not k.startswith(("JAX_COMP", "JAX_PERS", "XDG"))
    }
    done = subprocess.run(
        [sys.executable, "-c", PROCESS, *map(str, folder)],
        env={**left, **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    answer, rest = done.stdout.splitlines()
    return answer, *rest.rsplit(" ", 1)


def test_the_next_process_reads_what_this_one_compiled(tmp_path):
    folder = tmp_path / "programs"
    first, second = run(folder), run(folder)
    assert first[0] == second[0]
    assert first[1] == second[1] == str(folder)
    assert first[2] == "0"
    assert int(second[2]) >= 1
    assert any(folder.iterdir())


def test_without_a_folder_it_is_that_of_the_user(tmp_path):
    name = "LOCALAPPDATA" if sys.platform == "win32" else "XDG_CACHE_HOME"
    if sys.platform != "darwin":
        assert run(**{name: str(tmp_path)})[1] == str(tmp_path / "jaxspace")
    assert run(JAX_COMPILATION_CACHE_DIR=str(tmp_path / "own"))[1] == str(tmp_path / "own")


def test_a_file_is_no_folder(tmp_path):
    path = tmp_path / "file"
    path.write_text("")
    with pytest.raises(InputError, match="folder is .*: it must be a folder"):
        jaxspace.keep_programs(path)


@pytest.mark.parametrize("limit", [-1, 0.5, "many"])
def test_a_limit_is_a_number_of_bytes(limit):
    # Below the check of the annotation, which tests may add.
    with pytest.raises(InputError, match="limit is .*: it must be a number of bytes, 0 or more"):
        unchecked(_limit_of)(limit)


def unchecked(function):
    """A function without the checks of its annotations."""
    while hasattr(function, "__wrapped__"):
        function = function.__wrapped__
    return function


def test_the_environment_gives_the_limit(tmp_path, monkeypatch):
    monkeypatch.setenv("JAXSPACE_PROGRAMS_LIMIT", "2 GB")
    with pytest.raises(InputError, match="JAXSPACE_PROGRAMS_LIMIT is '2 GB': it must be"):
        jaxspace.keep_programs(tmp_path)
