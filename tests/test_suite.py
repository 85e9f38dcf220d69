"""The division of the tests: what runs after every change holds the basics of every package."""

import ast
import re
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import jax
import pytest
from jax.experimental.compilation_cache import compilation_cache
from suite import (
    MOST_SECONDS,
    WITHOUT_DIGITS,
    is_quick,
    looks_at_digits,
    program_folder,
    read_costs,
    selected,
    write_costs,
)
from suite_basics import BASICS
from test_layers import MODULES

TESTS = Path(__file__).parent


@cache
def functions(file: Path) -> set[str]:
    """The names of the functions of a file of tests."""
    return {n.name for n in ast.parse(file.read_text()).body if isinstance(n, ast.FunctionDef)}


def test_every_package_has_its_basics():
    packages = {package for tests in BASICS.values() for package in tests}
    files = {package for package in MODULES if package.startswith("_") or package == "constants"}
    assert packages == set(MODULES) - files


@pytest.mark.parametrize("kind", BASICS)
def test_the_basics_are_there_and_run_after_every_change(kind):
    costs = dict.fromkeys(read_costs(), 100.0)
    for test in BASICS[kind].values():
        file, _, name = test.partition("::")
        # A long name may be cut.
        (path,) = TESTS.rglob(file)
        assert any(f.startswith(name.partition("[")[0]) for f in functions(path)), test
        whole = f"{path.relative_to(TESTS.parent).as_posix()}::{name}"
        assert is_quick(whole, costs | {whole: 100.0})


def test_a_test_leaves_by_what_it_was_measured_to_take():
    costs = {
        "tests/test_a.py::test_b[1]": MOST_SECONDS + 1,
        "tests/test_a.py::test_b[2]": MOST_SECONDS,
    }
    found = [is_quick(f"tests/test_a.py::test_b[{k}]", costs) for k in (1, 2, 3)]
    assert found == [False, True, True]
    costs["tests/test_a.py::test_b"] = MOST_SECONDS + 1
    assert not is_quick("tests/test_a.py::test_b[3]", costs)


def test_costs_name_tests_that_exist():
    for test in read_costs():
        file, _, name = test.partition("::")
        assert name.partition("[")[0] in functions(TESTS.parent / file), f"run `make costs`: {test}"


def test_a_measurement_of_the_quick_part_adds_to_what_is_known(tmp_path, monkeypatch):
    monkeypatch.setattr("suite.COSTS", tmp_path / "costs.csv")
    write_costs({"long": 9.0, "short": 0.1, "basic[1]": 2.04}, part="all")
    assert read_costs() == {"basic[1]": 2.0, "long": 9.0}
    alone = {"short": 4.0, "basic[1]": 2.0, "case[1]": 0.7, "shares[1]": 3.0}
    write_costs(alone, part="quick")
    assert read_costs() == alone | {"long": 9.0, "shares": 3.0}


def test_tests_of_a_package_are_in_its_folder():
    """Else `make quick PACKAGE=...` leaves them out; and two files of one name, whichever folders
    they are in, are one module to the interpreter."""
    packages = [name for name in MODULES if not name.startswith("_")]
    flat = [file.stem.removeprefix("test_") for file in TESTS.glob("test_*.py")]
    assert not [f for f in flat for name in packages if f == name or f.startswith(f"{name}_")]
    files = [file.name for file in TESTS.rglob("test_*.py")]
    assert len(set(files)) == len(files)


def test_the_compiler_is_set_as_asked(pytestconfig):
    optimised = pytestconfig.getoption("--optimised") or pytestconfig.getoption("--sweep") == "all"
    assert jax.config.values["jax_disable_most_optimizations"] is not optimised


def test_files_without_digits_are_named_as_they_are():
    files = [file.stem.removeprefix("test_") for file in TESTS.rglob("test_*.py")]
    idle = [start for start in WITHOUT_DIGITS if not any(f.startswith(start) for f in files)]
    assert not idle and looks_at_digits(TESTS / "orbits/test_orbits_kepler.py")


def test_both_parts_together_are_every_test():
    """`.ci/run` calls `make test` and `make beyond`: no test may be missing from both."""
    items = [SimpleNamespace(nodeid=f"tests/test_a.py::test_{k}") for k in range(4)]
    for item in items:
        item.get_closest_marker = lambda name: None
    parts = [selected(items, part, "sample") for part in ("quick", "rest")]
    assert sum(parts, []) == selected(items, "all", "sample") == items
    script = (TESTS.parent / ".ci/run").read_text()
    called = re.findall(r"make --no-print-directory (\w+)", script)
    makefile = (TESTS.parent / "Makefile").read_text()
    parts_run = {
        part for target in reached(called, makefile) for part in parts_of(target, makefile)
    }
    assert parts_run == {"quick", "rest"}


def recipe_of(target: str, makefile: str) -> str:
    """The line of a target of the Makefile and its recipe."""
    (found,) = re.findall(rf"^({target}:.*\n(?:\t.*\n)*)", makefile, re.MULTILINE)
    return found


def reached(targets: list[str], makefile: str) -> set[str]:
    """The targets, and those that their recipes call."""
    called = set(targets)
    for target in targets:
        calls = re.findall(r"\$\(MAKE\) --no-print-directory (\w+)", recipe_of(target, makefile))
        called |= reached(calls, makefile)
    return called


def parts_of(target: str, makefile: str) -> list[str]:
    """The parts of the tests that the recipe of a target runs."""
    return re.findall(r"--part (\w+)", recipe_of(target, makefile))


@pytest.mark.parametrize("target", ["beyond", "processors", "sweep", "faults"])
def test_what_takes_longest_runs_the_programs_of_users(target):
    makefile = (TESTS.parent / "Makefile").read_text()
    recipe = recipe_of(target, makefile)
    assert "--optimised" in recipe or "--sweep all" in recipe


def test_stored_programs_with_and_without_optimisations_are_kept_apart(tmp_path, settings_stay):
    compilation_cache.reset_cache()
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    for disabled in (True, False, True):
        jax.config.update("jax_disable_most_optimizations", disabled)
        jax.jit(lambda x: 2.0 * x).lower(1.0).compile()
    assert len(list(tmp_path.glob("*-cache"))) == 2


def test_stored_programs_of_each_set_of_instructions_have_a_folder(monkeypatch):
    folders = set()
    for flags in ("", "--xla_cpu_max_isa=AVX2", "--xla_cpu_max_isa=SSE4_2"):
        monkeypatch.setenv("XLA_FLAGS", flags)
        folders.add(program_folder())
    assert len(folders) == 3
