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
from jaxspace.core import MissingExtra, extra

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
    "OrbitState",
    "Progress",
    "REQUIRED",
    "Scalar",
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
APP = "matplotlib pint plotly tomlkit tqdm xarray zarr google_crc32c pandas sgp4 pyarrow".split()
for name in APP:
    sys.modules[name] = None
import jax.numpy as jnp
import jaxspace
from jaxspace.core import MissingExtra
from jaxspace.cli import main
from jaxspace.bodies import BodyState
from jaxspace.dispersion import Dispersion
import numpy as np
scene = %r
print(main(["run", scene, "--out", %r]))
print(main(["optimize", scene, "--out", %r]))
ts = jnp.arange(3.0)
y0 = BodyState(position=jnp.array([1.0, 0.0, 0.0]), velocity=jnp.array([0.0, 1.0, 0.0]))
run = jaxspace.simulate(jaxspace.orbits.TwoBody(1.0), y0, ts)
whole = np.zeros(2, int)
table = Dispersion({"a": np.zeros(2)}, {"b": np.zeros(2)}, whole, whole, {}, 0)
from jaxspace.io import read_tle
for call in (
    lambda: jaxspace.load(scene),
    run.plot,
    run.to_xarray,
    table.to_dataset,
    lambda: table.to_csv("table.csv"),
    lambda: read_tle(chr(10)),
):
    try:
        call()
    except MissingExtra as error:
        print(error)
"""


def test_a_base_installation_names_the_extra(tmp_path):
    """At every entry point, with the libraries of the extras hidden from the import."""
    scene = str(ROOT / "examples" / "scenes" / "top.toml")
    code = BASE % (scene, str(tmp_path), str(tmp_path))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    said = [*done.stderr.splitlines(), *done.stdout.splitlines()]
    assert len(said) == 2 + 2 + 6, said
    assert done.stdout.splitlines()[:2] == ["2", "2"]
    for line, library in zip(said[:2], ("pint", "tqdm"), strict=True):
        assert line.startswith(f"{scene}: {library} is not installed: it comes with the extra app")
    libraries = ("pint", "matplotlib", "xarray", "xarray", "pandas", "sgp4")
    for line, library in zip(said[4:], libraries, strict=True):
        assert line.startswith(f"{library} is not installed: it comes with the extra "), line
