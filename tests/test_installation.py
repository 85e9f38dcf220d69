"""What an installation brings: names of the packages, libraries that are declared, and what is said
where an extra is missing."""

import ast
import importlib
import subprocess
import sys
import tomllib
import types
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

import jaxspace
from jaxspace.core import MissingExtra
from jaxspace.core.extras import extra

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "jaxspace"
PACKAGES = ["jaxspace"] + sorted(
    f"jaxspace.{p.stem}"
    for p in PACKAGE.iterdir()
    if not p.name.startswith("_") and (p.suffix == ".py" or (p / "__init__.py").is_file())
)
# Of typing and jaxtyping, and public: what a shape, a state, a flag is.
# The hook that checks shapes in tests adds jaxtyping to every file.
ALIASES = {
    "jaxtyping",
    "Flag",
    "Matrix",
    "NumberField",
    "OptionalNumberField",
    "OrbitState",
    "Progress",
    "REQUIRED",
    "Scalar",
    "SingleNumberField",
    "State",
    "Vector",
}


@pytest.mark.parametrize("name", PACKAGES)
def test_dir_shows_the_names_of_the_package_alone(name):
    package = importlib.import_module(name)
    strange = set()
    for public in (n for n in dir(package) if not n.startswith("_")):
        thing = getattr(package, public)
        home = thing.__name__ if isinstance(thing, types.ModuleType) else _home(thing)
        if home.partition(".")[0] != "jaxspace" and public not in ALIASES:
            strange.add(public)
    assert not strange


def test_the_package_gives_what_type_checkers_read():
    """Each name of the imports for type checkers is there, is listed, and is the same thing."""
    tree = ast.parse((PACKAGE / "__init__.py").read_text())
    read = {
        alias.name: importlib.import_module(f"jaxspace.{node.module or alias.name}")
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.level
        for alias in node.names
    }
    assert set(read) == set(jaxspace.__all__) <= set(dir(jaxspace))
    for name, module in read.items():
        assert getattr(jaxspace, name) is getattr(module, name, module)
    with pytest.raises(AttributeError, match="module 'jaxspace' has no attribute 'orbit'"):
        jaxspace.orbit  # noqa: B018  # pyright: ignore[reportAttributeAccessIssue]
    with pytest.raises(ImportError, match="cannot import name 'orbit'"):
        exec("from jaxspace import orbit")


def _home(thing):
    return getattr(thing, "__module__", None) or "jaxspace"


def test_every_library_that_is_imported_is_declared():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    lines = [*project["dependencies"], *sum(project["optional-dependencies"].values(), [])]
    declared = {_plain(line) for line in lines}
    owners = packages_distributions()
    imported = {
        name.partition(".")[0]
        for file in PACKAGE.rglob("*.py")
        for node in ast.walk(ast.parse(file.read_text()))
        for name in _imported(node)
    }
    # pandas comes with xarray, lineax with diffrax; cloudpickle and dask with distributed.
    brought = {"pandas", "lineax", "cloudpickle", "dask", "jaxspace"}
    outside = imported - set(sys.stdlib_module_names) - brought
    of = {name: {_plain(d) for d in owners.get(name, [name])} for name in outside}
    assert not {name for name, owned in of.items() if not owned & declared}


def _plain(requirement):
    name = requirement.partition(";")[0]
    for sign in "[<>=!~ ":
        name = name.partition(sign)[0]
    return name.lower().replace("_", "-")


def _imported(node):
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    return [node.module] if isinstance(node, ast.ImportFrom) and not node.level else []


def test_a_missing_library_names_its_extra():
    with pytest.raises(MissingExtra, match=r'nosuch is not installed.*"jaxspace\[app\]"'):
        with extra("app"):
            import nosuch.inner  # noqa: F401  # pyright: ignore[reportMissingImports]
    # A file of the library itself is no extra.
    with pytest.raises(ModuleNotFoundError):
        with extra("app"):
            importlib.import_module("jaxspace.nosuch")


ARGUMENTS_ALONE = """
import sys
from jaxspace.cli import main
for arguments in (["--help"], ["run", "--help"], ["run"], ["disperse", "a.toml", "--runs", "0"]):
    try:
        main(arguments)
    except SystemExit as ending:
        print("status", ending.code)
print("loaded", sorted({"jax", "numpy", "jaxspace.core"} & set(sys.modules)))
"""


def test_help_and_a_wrong_option_load_no_jax():
    done = subprocess.run([sys.executable, "-c", ARGUMENTS_ALONE], capture_output=True, text=True)
    said = [line for line in done.stdout.splitlines() if line.startswith(("status", "loaded"))]
    assert said == ["status 0", "status 0", "status 2", "status 2", "loaded []"], done.stderr


BASE = """
import sys
from importlib.metadata import distribution, packages_distributions
from packaging.requirements import Requirement

def plain(name):
    return name.lower().replace("_", "-")

def closure(name, found):
    if plain(name) not in found:
        found.add(plain(name))
        for line in distribution(name).requires or ():
            requirement = Requirement(line)
            if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
                closure(requirement.name, found)
    return found

BARE = set()
for line in %r:
    closure(Requirement(line).name, BARE)
OF_EXTRAS = {
    name
    for name, owners in packages_distributions().items()
    if not {plain(owner) for owner in owners} & BARE
}

class Bare:
    "Finds nothing that an installation without extras does not bring."
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in OF_EXTRAS - {"jaxspace", "packaging"}:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

for name in list(sys.modules):
    if name.partition(".")[0] in OF_EXTRAS:
        del sys.modules[name]
sys.meta_path.insert(0, Bare())
"""
CALLS = (
    BASE
    + """
import jax.numpy as jnp
import jaxspace
from jaxspace import plots
from jaxspace.core import MissingExtra
from jaxspace.cli import main, parser
from jaxspace.bodies import BodyState
from jaxspace.dispersion import DaskCluster, Dispersion
from jaxspace.io.mean_elements import read_omm, read_tle
import numpy as np
scene, out = %r, %r
print("plain", main(["examples"]), main(["schema"]), main(["new", "top", out + "/new.toml"]))
for command in ("run", "disperse", "explain", "cost", "budget", "optimize"):
    main([command, scene])
ts = jnp.arange(3.0)
y0 = BodyState(position=jnp.array([1.0, 0.0, 0.0]), velocity=jnp.array([0.0, 1.0, 0.0]))
run = jaxspace.simulate(jaxspace.orbits.TwoBody(1.0), y0, ts)
whole = np.zeros(2, int)
table = Dispersion({"a": np.zeros(2)}, {"b": np.zeros(2)}, whole, whole, {}, 0)
for call in (
    lambda: jaxspace.load(scene),
    run.plot,
    lambda: plots.trajectory_figure(run),
    run.to_xarray,
    table.to_dataset,
    lambda: table.to_csv("table.csv"),
    lambda: table.to_parquet("table.parquet"),
    lambda: plots.dispersion_figure(table),
    lambda: read_tle(chr(10)),
    lambda: read_omm("{}"),
    DaskCluster()._client().__enter__,
):
    try:
        call()
    except MissingExtra as error:
        print(error, file=sys.stderr)
    else:
        print("no sentence", file=sys.stderr)
"""
)
# What each call of `CALLS` lacks first, and the extra that brings it.
LIBRARIES = [
    ("pint", "app"),
    ("matplotlib", "app"),
    ("matplotlib", "app"),
    ("xarray", "app"),
    ("xarray", "app"),
    ("pandas", "app"),
    ("pyarrow", "parquet"),
    ("matplotlib", "app"),
    ("sgp4", "ephemerides"),
    ("sgp4", "ephemerides"),
    ("distributed", "cluster"),
]


def test_a_base_installation_names_the_extra(tmp_path):
    """At every entry point, with all that the extras bring hidden from the import."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    # A unit that is not common.
    top = (ROOT / "examples" / "scenes" / "top.toml").read_text()
    scene = str(tmp_path / "top.toml")
    Path(scene).write_text(top.replace('"30 deg"', '"0.1 turn"'))
    code = CALLS % (project["dependencies"], scene, str(tmp_path))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    # These need no extra.
    assert "plain 0 0 0" in done.stdout
    wanted = [(f"{scene}: {library}", "app") for library in ["pint"] * 6] + LIBRARIES
    said = done.stderr.splitlines()
    assert len(said) == len(wanted), said
    for line, (library, name) in zip(said, wanted, strict=True):
        sentence = f'comes with the extra {name} (pip install "jaxspace[{name}]").'
        assert line == f"{library} is not installed: it {sentence}"


def test_what_an_extra_brings_is_imported_under_its_name():
    """Every import of it stands within `extra`, or in a file after one that does; those of the
    command line stand within that of `carry_out`. An `ImportError` that is caught has a way out."""
    # lineax comes with diffrax.
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    base = {_plain(line).replace("-", "_") for line in project["dependencies"]} | {
        "lineax"
    }  # lineax comes with diffrax.
    known = base | set(sys.stdlib_module_names) | {"jaxspace"}
    bare = set()
    for file in PACKAGE.rglob("*.py"):
        tree = ast.parse(file.read_text())
        guarded = {
            name.partition(".")[0]
            for outer in ast.walk(tree)
            if _is_guard(outer)
            for node in ast.walk(outer)
            for name in _imported(node)
        }
        if file.is_relative_to(PACKAGE / "cli"):
            continue
        bare |= {
            (file.name, name)
            for node in ast.walk(tree)
            for name in _imported(node)
            if name.partition(".")[0] not in known | guarded
        }
    assert not bare


def _is_guard(node):
    if isinstance(node, ast.If):
        return ast.unparse(node.test) == "TYPE_CHECKING"
    if isinstance(node, ast.Try):
        return any(ast.unparse(h.type or h) == "ImportError" for h in node.handlers)
    return isinstance(node, ast.With) and any(
        ast.unparse(item.context_expr).startswith("extra(") for item in node.items
    )


def test_the_lowest_releases_that_are_tried_are_the_floors():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    tried = dict(
        line.split("==")
        for line in (ROOT / ".ci" / "lowest.txt").read_text().splitlines()
        if line and not line.startswith("#")
    )
    floors = [*project["dependencies"], *extras["app"], *extras["cluster"], *extras["parquet"]]
    for floor in floors:
        name, _, version = floor.partition(">=")
        # A patch release more where the first one has no file for the oldest Python.
        assert f"{tried[name]}.".startswith(f"{version}."), floor
    # The tests can be installed with them too.
    for floor in [*extras["docs"], *extras["test"]]:
        name, _, version = floor.partition(">=")
        assert f"{tried.get(name, version)}.".startswith(f"{version}."), floor
