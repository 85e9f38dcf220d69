"""Which packages may import which, and what importing costs: imports point downwards."""

import ast
import dataclasses
import functools
import importlib
import inspect
import re
import subprocess
import sys
import types
import typing
from pathlib import Path

import jax
import pytest

from jaxspace.core import AbstractParameters
from jaxspace.core.modules import public_names

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "jaxspace"

# A package may import the packages of its row, and itself. The command line may import all of them,
# and none of them the command line.
ALLOWED = {
    "core": set(),
    "_jax_settings": {"core"},
    "_load": {"io"},
    "constants": set(),
    "rotations": {"core"},
    "bodies": {"core", "rotations"},
    # The constants for a check of units only.
    "orbits": {"core", "rotations", "bodies", "constants"},
    "attitude": {"core", "rotations", "bodies"},
    "rockets": {"core", "rotations", "bodies"},
    "gyros": {"core", "rotations"},
    "mechanics": {"core"},
    "scene": {"core", "bodies"},
    "solvers": {"core"},
    "integration": {"core", "solvers"},
    "simulation": {"core", "solvers", "integration"},
    # Rockets in air, put together from the physics into missions.
    "vehicles": {
        *("core", "rotations", "bodies", "orbits", "rockets", "mechanics", "scene", "simulation"),
    },
    "studies": {"core", "solvers", "integration", "simulation", "scene"},
    # Loops drive whatever has a command; the tasks of the environments are made of physics.
    "control": {
        *("core", "rotations", "bodies", "orbits", "attitude", "scene"),
        *("solvers", "integration", "simulation", "studies"),
    },
    # Statistics are of plain arrays: who has some needs no campaign.
    "statistics": {"core"},
    "stores": {"core", "statistics"},
    "sampling": {"core"},
    # They compute runs by their numbers, and know nothing of what a run simulates.
    "engines": {"core", "statistics", "stores"},
    "dispersion": {
        *("core", "integration", "simulation", "sampling", "statistics", "stores", "engines"),
    },
    # Searches for a minimum, which know nothing of what is minimised.
    "minimisation": {"core"},
    "optimization": {"core", "orbits", "rockets", "simulation", "minimisation"},
    "robust": {
        *("core", "integration", "simulation", "statistics", "dispersion", "minimisation"),
    },
    "estimation": {"core", "simulation", "studies"},
    # The packages of physics, whose public names scene files may use, and what runs them.
    "io": {
        *("core", "rotations", "bodies", "orbits", "attitude", "rockets", "gyros", "mechanics"),
        *("scene", "solvers", "simulation", "sampling", "statistics", "stores", "dispersion"),
        *("optimization", "vehicles", "control", "robust", "integration"),
    },
    "plots": {"core", "rotations"},
    # Hard cases of every package.
    "verification": {
        *("core", "rotations", "bodies", "orbits", "attitude", "rockets", "gyros", "scene"),
        *("solvers", "simulation", "studies", "sampling", "optimization"),
    },
}
ALLOWED["cli"] = set(ALLOWED)
ALLOWED["__init__"] = set(ALLOWED) - {"cli"}

# Folders of a package, from the bottom up, and what each may import of it: folders, and files that
# stand beside them. The other files there put these together, and no folder imports them.
FOLDERS = {
    "io": {
        "_kinds": {"units"},
        "_catalog": {"_kinds"},
        "_mission": {"_kinds", "_catalog"},
        "_requests": {"units", "_kinds", "_catalog", "_mission"},
        "_runs": {
            *("units", "by_numpy", "_kinds", "_catalog", "_mission", "_requests", "_file_content"),
        },
        "_search": {"units", "_kinds", "_mission", "_requests", "_file_content", "_runs"},
        "reports": {
            *("units", "by_numpy", "_kinds", "_mission", "_requests", "_search", "_scene_file"),
        },
    },
}

# Imports of the library within functions, by who makes them, with the reason: any other would hide
# a circle.
WITHIN_FUNCTIONS = {
    "_jax_settings": "the root of the library imports no package",
    "_load": "the root of the library imports no package",
    "cli": "a command imports what it needs, and answers sooner",
}
# Annotations of parameters and results that hold `Any`: they may only become fewer.
MOST_ANY = 88

# A result that draws itself imports its figure inside a function; the figure imports the class of
# the result for its types alone.
ON_REQUEST = {
    "simulation": {"plots"},
    "studies": {"plots"},
    "minimisation": {"plots"},
    "robust": {"plots"},
    "plots": {"simulation", "studies", "statistics", "dispersion"},
}

# What a package may import at all, of the world outside.
FLOOR = {"jax", "jaxtyping", "equinox", "numpy"}
OUTSIDE = {
    "solvers": FLOOR | {"diffrax", "lineax", "optimistix"},
    "integration": FLOOR | {"diffrax", "lineax", "optimistix"},
    "simulation": FLOOR | {"diffrax", "lineax", "optimistix"},
    "studies": FLOOR | {"diffrax"},
    "control": FLOOR | {"diffrax"},
    "minimisation": FLOOR | {"optax"},
    "optimization": FLOOR | {"optax"},
    "estimation": FLOOR | {"lineax", "optimistix"},
}
# Plotting, tables, files and clusters: only where a person asks for them, inside the function that
# needs them.
HEAVY = {
    *("matplotlib", "plotly", "PIL", "imageio"),
    *("xarray", "zarr", "pandas", "h5py", "h5netcdf", "polars", "pyarrow"),
    *("pydantic", "pint", "typer", "click", "rich", "tqdm", "tomllib", "yaml"),
    *("dask", "distributed", "ray"),
    *("scipy", "mpmath", "hypothesis", "pytest"),
}
MAY_BE_HEAVY = {
    *("simulation", "studies", "sampling", "statistics", "stores", "engines", "dispersion"),
    *("io", "plots", "cli"),
    # Its cases are a table in TOML.
    "verification",
}
LIGHT = HEAVY - {"tomllib"}

# Names that the root of a package gives: what a user meets first. The rest stands in modules named
# by their subject.
MOST_NAMES = 40
# Of all roots, and of the package itself: sweeps, gravity fields, bundled examples and functions
# that are stored by a name came last.
MOST_OF_ALL = 355


def package_of(file: Path) -> str:
    """The package that a source file belongs to; `jaxspace/__init__.py` counts as one."""
    return file.relative_to(PACKAGE).parts[0].removesuffix(".py")


def sources() -> list[Path]:
    """Every source file of a package; a folder without an `__init__` is not one."""
    files = sorted(PACKAGE.rglob("*.py"))
    return [
        f
        for f in files
        if f.parent == PACKAGE or (PACKAGE / package_of(f) / "__init__.py").exists()
    ]


MODULES = sorted({package_of(f) for f in sources()} - {"__init__"})


def in_every_file(complaints) -> None:
    """Fail with every complaint about every source file, a line each with the file's name."""
    found = [
        f"{file.relative_to(PACKAGE).as_posix()}: {sentence}"
        for file in sources()
        for sentence in complaints(file)
    ]
    assert not found, "\n".join(["", *found])


@functools.cache
def imports(file: Path) -> list[tuple[str, bool]]:
    """The full dotted name of everything that a file imports, and whether it does so while it is
    imported itself. The package's own `__init__` imports on request: its imports for type checkers
    are the list of what it gives, and obey the same arrows."""
    tree = ast.parse(file.read_text())
    within = {
        id(n)
        for f in ast.walk(tree)
        if isinstance(f, ast.FunctionDef | ast.Lambda)
        for n in ast.walk(f)
    }
    within |= {
        id(n)
        for f in ast.walk(tree)
        if isinstance(f, ast.If) and "TYPE_CHECKING" in ast.unparse(f.test)
        for n in ast.walk(f)
    }
    package = ["jaxspace", *file.relative_to(PACKAGE).parts[:-1]]
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [(alias.name, id(node) not in within) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            base = [*base, *(node.module or "").split(".")] if node.module else base
            # `from .. import orbits` names a package, `from ..orbits import _kepler` a file of one.
            ours = base[:1] == ["jaxspace"] and len(base) < 3
            names = [[*base, a.name] for a in node.names] if ours else [base]
            found += [(".".join(name), id(node) not in within) for name in names]
    return found


def test_no_circle_of_imports_between_files():
    """Imports within functions and of types alone included, but for the types of the figures, which
    the results import when they draw themselves."""
    modules = {
        ".".join(("jaxspace", *f.relative_to(PACKAGE).with_suffix("").parts)): f for f in sources()
    }
    graph = {name: set() for name in modules}
    for name, file in modules.items():
        tree = ast.parse(file.read_text())
        # A root lists its modules for type checkers.
        left_out = file.name == "__init__.py" or package_of(file) == "plots"
        types = {
            id(n)
            for f in ast.walk(tree)
            if left_out and isinstance(f, ast.If) and "TYPE_CHECKING" in ast.unparse(f.test)
            for n in ast.walk(f)
        }
        package = name.split(".")[:-1]
        for node in ast.walk(tree):
            if not isinstance(node, ast.ImportFrom) or id(node) in types:
                continue
            base = package[: len(package) - node.level + 1] if node.level else []
            base = [*base, *(node.module or "").split(".")] if node.module else base
            for alias in node.names:
                name_of = ".".join([*base, alias.name])
                candidates = (
                    name_of,
                    f"{name_of}.__init__",
                    ".".join(base),
                    ".".join(base) + ".__init__",
                )
                graph[name] |= set([c for c in candidates if c in modules][:1])
    state, circles = {}, []

    def visit(name, path):
        state[name] = "open"
        for target in graph[name] - {name}:
            if state.get(target) == "open":
                circles.append([*path, name, target])
            elif target not in state:
                visit(target, [*path, name])
        state[name] = "done"

    for name in graph:
        if name not in state:
            visit(name, [])
    assert not circles


def test_files_that_words_name_are_there():
    """A name of a file in a docstring or a comment outlives the file where nobody reads it."""
    known = {file.relative_to(PACKAGE).as_posix() for file in sources()}
    ends = {path.rpartition("/")[2] for path in known}

    def complaints(file):
        for name in re.findall(r"`([a-z_/]+\.py)`", file.read_text()):
            if name not in known | ends and not (ROOT / name).exists():
                yield f"there is no {name}"

    in_every_file(complaints)


def test_functions_import_no_package_but_figures():
    def complaints(file):
        package = package_of(file)
        if package in WITHIN_FUNCTIONS or package == "__init__":
            return
        for node in ast.walk(ast.parse(file.read_text())):
            if not isinstance(node, ast.FunctionDef):
                continue
            for inner in ast.walk(node):
                if isinstance(inner, ast.ImportFrom) and inner.level:
                    if (inner.module or "").split(".")[0] not in ON_REQUEST.get(package, set()):
                        yield f"line {inner.lineno}: import {inner.module} where the file begins"

    in_every_file(complaints)


def test_few_signatures_hold_any():
    """A value that functions pass on as `Any` is a noun that is missing on a lower floor."""

    def held(file):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.FunctionDef):
                of = node.args
                named = (*of.posonlyargs, *of.args, *of.kwonlyargs, of.vararg, of.kwarg)
                for kind in (*(x.annotation for x in named if x is not None), node.returns):
                    names = ast.walk(kind) if kind is not None else ()
                    yield any(isinstance(x, ast.Name) and x.id == "Any" for x in names)

    assert sum(sum(held(file)) for file in sources()) <= MOST_ANY


def test_every_room_has_a_row():
    assert set(MODULES) <= set(ALLOWED), (
        "a new package needs a row in the table: which packages may it import?"
    )


def test_arrows_point_downwards():
    def complaints(file):
        package = package_of(file)
        for name, at_once in imports(file):
            parts = name.split(".")
            if parts[0] == "jaxspace" and len(parts) > 1:
                allowed = ALLOWED[package] | (set() if at_once else ON_REQUEST.get(package, set()))
                # Anything else is a name of `jaxspace/__init__.py`, whose import would import
                # everything.
                if parts[1] != package and parts[1] not in allowed:
                    yield f"{package} may not import {name}"

    in_every_file(complaints)


def test_arrows_point_downwards_within_a_package():
    def complaints(file):
        package, *rest = file.relative_to(PACKAGE).parts
        allowed = FOLDERS.get(package, {})
        if len(rest) < 2:
            return
        folder = rest[0]
        if folder not in allowed:
            yield f"{folder} needs a row in the table: which folders may it import?"
        for name, _ in imports(file):
            parts = name.split(".")
            if parts[:2] == ["jaxspace", package] and len(parts) > 2:
                if parts[2] != folder and parts[2] not in allowed.get(folder, set()):
                    yield f"{package}/{folder} may not import {name}"

    in_every_file(complaints)


def test_no_package_imports_a_private_file_of_another():
    def complaints(file):
        package = package_of(file)
        for name, _ in imports(file):
            parts = name.split(".")
            if parts[0] == "jaxspace" and len(parts) > 2 and parts[1] != package:
                if parts[2].startswith("_"):
                    yield f"{name} is a private file of another package"

    in_every_file(complaints)


def test_outside_libraries_stay_where_they_belong():
    def complaints(file):
        package = package_of(file)
        for name, at_once in imports(file):
            top = name.split(".")[0]
            if top in HEAVY:
                if package not in MAY_BE_HEAVY:
                    yield f"{package} may not import {name}"
                elif at_once and top in LIGHT:
                    yield f"{name} has to be imported inside the function that needs it"
            elif top in sys.stdlib_module_names or top == "jaxspace" or package in MAY_BE_HEAVY:
                continue
            elif top not in OUTSIDE.get(package, FLOOR):
                yield f"{package} may not import {name}"

    in_every_file(complaints)


def test_optax_drives_searches_alone():
    """A search takes any optimiser of optax, and `optimization` those with names; no other package
    imports it, and nothing does before one is used."""
    users = {
        (package_of(file), at_once)
        for file in sources()
        for name, at_once in imports(file)
        if name.split(".")[0] == "optax"
    }
    assert users == {("minimisation", False), ("optimization", False)}


def test_a_public_file_lists_its_names_or_another_package_imports_it():
    """What users need stands in `__all__`. What the floors of the engine take of each other has the
    name of its file too, and nothing else has one."""
    taken = {
        tuple(name.split(".")[1:3])
        for file in sources()
        for name, _ in imports(file)
        if name.startswith("jaxspace.") and name.split(".")[1] != package_of(file)
    }

    def complaints(file):
        parts = file.relative_to(PACKAGE).parts
        # A file of a private folder is private, whatever its name.
        private = any(part.startswith("_") for part in parts[1:])
        if len(parts) > 1 and not private and not listed(file):
            if (parts[0], parts[1].removesuffix(".py")) not in taken:
                yield "name it _x.py, or list its public names in __all__"

    in_every_file(complaints)


# What `FixedSteps` wraps is a method; the rest of these names are the interface of solvers.
METHODS = {"DOP853", "Tsit5", "RKN1210", "Stormer", "Splitting", "MuntheKaas"}
METHODS |= {"AdaptiveRegularised", "Regularised", "ExponentialRosenbrock"}
# The cases and laws hold methods by their names.
MAY_NAME_METHODS = ("solvers/", "verification/", "integration/methods.py")


def test_no_other_file_names_a_concrete_method():
    """What depends on a method asks for its traits."""
    named = set()
    for file in sources():
        path = file.relative_to(PACKAGE).as_posix()
        if not path.startswith(MAY_NAME_METHODS):
            tree = ast.parse(file.read_text())
            names = {
                a.name for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) for a in n.names
            }
            named |= {(path, name) for name in names & METHODS}
    assert not named


def listed(file: Path) -> list[str]:
    """The names in `__all__` of a module."""
    for node in ast.parse(file.read_text()).body:
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "__all__":
            return ast.literal_eval(node.value)
    return []


def root_names(package: str) -> list[str]:
    """The names that the root of a package gives, without its modules."""
    file = PACKAGE / ("__init__.py" if package == "__init__" else f"{package}/__init__.py")
    return [
        alias.name
        for node in ast.walk(ast.parse(file.read_text()))
        # `from . import elements as elements` is a module; of the package itself a name.
        if isinstance(node, ast.ImportFrom) and (node.module or package == "__init__")
        for alias in node.names
        if alias.asname == alias.name
    ]


PACKAGES = [package for package in MODULES if (PACKAGE / package).is_dir()]


@pytest.mark.parametrize("package", ["__init__", *PACKAGES])
def test_the_root_of_a_package_gives_few_names(package):
    assert len(root_names(package)) <= MOST_NAMES


def test_the_whole_library_gives_few_names_first():
    # A name that the package itself, or another one of its packages, gives on is none to learn.
    packages = {name for package in PACKAGES for name in root_names(package)}
    further = set(root_names("__init__")) - packages - set(PACKAGES)
    assert len(packages) + len(further) <= MOST_OF_ALL


@pytest.mark.parametrize("package", PACKAGES)
def test_a_name_has_one_home(package):
    """The root, or one public module, which the root gives when it is asked for it."""
    names, modules = root_names(package), []
    for file in sorted((PACKAGE / package).glob("[a-z]*.py")):
        if listed(file):
            names += listed(file)
            modules.append(file.stem)
    assert not {name for name in names if names.count(name) > 1}
    # A module of the name of a root's function would hide it.
    assert not set(root_names(package)) & set(modules)
    root = importlib.import_module(f"jaxspace.{package}")
    for module in modules:
        assert getattr(root, module).__name__ == f"jaxspace.{package}.{module}"
        assert module in dir(root)
    shown = ast.parse((PACKAGE / package / "__init__.py").read_text()).body
    typed = {
        alias.name
        for block in shown
        if isinstance(block, ast.If)
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert typed == set(modules), "type checkers read the modules in the root"


@pytest.mark.parametrize("package", sorted(set(PACKAGES) - {"cli"}))
def test_every_public_name_stands_in_the_reference_a_page_or_an_example(package):
    page = (ROOT / "docs" / "api" / f"{package}.md").read_text()
    for file in sorted((PACKAGE / package).glob("[a-z]*.py")):
        if listed(file):
            assert f"::: jaxspace.{package}.{file.stem}\n" in page
    assert f"::: jaxspace.{package}\n" in page
    if "members: [" in page:
        # The reference names the members that it shows.
        texts = [*ROOT.glob("docs/**/*.md"), *ROOT.glob("examples/**/*.py"), ROOT / "README.md"]
        words = set(re.findall(r"\w+", " ".join(text.read_text() for text in texts)))
        assert not set(root_names(package)) - words


# What a value is made of that is read off an object, and not made from it.
VALUE = {
    *("Array", "Bool", "Complex", "Flag", "Float", "Int", "Matrix", "Scalar", "Vector"),
    *("NoneType", "bool", "float", "int"),
}
# Public methods without an argument that return numbers, and yet are methods.
NO_PROPERTY = {
    "the same thing in another form": "Quaternion.axis_angle "
    "Quaternion.matrix Quaternion.rotation_vector Quaternion.xyzw",
    "runs through the whole motion": "Trajectory.drift",
    "computes in many digits": "Case.conditioning Case.truth",
    "raises for a search that has not converged": "Optimum.sensitivities",
    "a time of the parameters, which a phase of a mission takes as its end": "Thrust.burnout "
    "GimballedThrust.burnout SteeredThrust.burnout",
}


def public_classes() -> list[type]:
    """The classes that the packages give their users."""
    packages = [
        importlib.import_module(f"jaxspace.{package}") for package in PACKAGES if package != "cli"
    ]
    found = [thing for package in packages for thing in public_names(package).values()]
    return [thing for thing in dict.fromkeys(found) if isinstance(thing, type)]


def is_value(annotation: object) -> bool:
    """Whether an annotation is that of numbers, or of tuples and dictionaries of them or of names.

    A text alone is another form of an object."""
    parts = typing.get_args(annotation)
    if parts:
        return all(part in (str, ...) or is_value(part) for part in parts)
    return getattr(annotation, "__name__", "").partition("[")[0] in VALUE


def test_what_needs_no_argument_is_a_property():
    """In every public class; what authors fill in is declared by an abstract class."""
    allowed = set(" ".join(NO_PROPERTY.values()).split())
    found = set()
    for cls in public_classes():
        abstract = [base for base in cls.__mro__ if base.__name__.startswith("Abstract")]
        filled_in = {name for base in abstract for name in vars(base)}
        for name, method in vars(cls).items():
            if name.startswith("_") or name in filled_in or not inspect.isfunction(method):
                continue
            signature = inspect.signature(method)
            if len(signature.parameters) == 1 and is_value(signature.return_annotation):
                found.add(f"{cls.__name__}.{name}")
    assert found == allowed


def test_arguments_stand_in_the_docstring():
    """Of every public function with more than one; and what it raises, where it raises."""
    packages = [
        importlib.import_module(f"jaxspace.{package}") for package in PACKAGES if package != "cli"
    ]
    things = [thing for package in packages for thing in public_names(package).values()]
    silent = []
    for thing in filter(inspect.isfunction, things):
        said, source = inspect.getdoc(thing) or "", inspect.getsource(inspect.unwrap(thing))
        several = len(inspect.signature(thing).parameters) > 1
        raises = re.search(r"^\s+raise (InputError|SimulationError|StoreError)", source, re.M)
        if (several and "**Arguments**" not in said) or (raises and "aise" not in said):
            silent.append(f"{thing.__module__}.{thing.__name__}")
    assert not silent


def test_plain_numbers_are_taken_wherever_arrays_are():
    """By every field of numbers in a public system, effect or state."""
    for cls in public_classes():
        state = cls.__name__.endswith("State") and dataclasses.is_dataclass(cls)
        if not issubclass(cls, AbstractParameters) and not state:
            continue
        taken = inspect.signature(cls).parameters
        for field in dataclasses.fields(cls):
            # Of an optional field, the array is one of the alternatives.
            one = field.type.__args__[0] if isinstance(field.type, types.UnionType) else field.type
            if field.name in taken and str(one).startswith("<class 'jaxtyping.Float[Array"):
                for plain in (0.5, [0.5, 1.0]):
                    root_names = field.metadata["converter"](plain)
                    assert isinstance(root_names, jax.Array), f"{cls.__name__}.{field.name}"


def run(code: str) -> str:
    """What a fresh interpreter prints."""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=PACKAGE.parent
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


# The libraries are imported once, and each package in a copy of that process: beneath an empty
# package, for the `__init__` of the real one imports most packages, in an order of its own.
ALONE = """
import os, sys, traceback, types
import jax, equinox, diffrax
root = sys.modules["jaxspace"] = types.ModuleType("jaxspace")
root.__path__ = ["jaxspace"]
for package in %r:
    child = os.fork()
    if child == 0:
        try:
            __import__("jaxspace." + package)
        except BaseException:
            traceback.print_exc()
            os._exit(1)
        os._exit(0)
    print(package, os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


def test_programs_in_texts_import_names_that_exist():
    """Benchmarks and examples start Python with programs that no checker of sources reads."""
    found = 0
    for file in [*ROOT.glob("benchmarks/*.py"), *ROOT.glob("examples/**/*.py")]:
        for text in ast.walk(ast.parse(file.read_text())):
            if not (isinstance(text, ast.Constant) and isinstance(text.value, str)):
                continue
            for line in re.findall(r"^from jaxspace.* import [\w, ]+$", text.value, re.MULTILINE):
                (statement,) = ast.parse(line).body
                module = importlib.import_module(statement.module)
                found += 1
                for name in statement.names:
                    assert hasattr(module, name.name), f"{file.name}: {line}"
    assert found >= 10


def test_each_room_imports_alone():
    """No package depends on what another one has imported before it."""
    assert run(ALONE % MODULES).splitlines() == [f"{package} 0" for package in MODULES]


WATCH = """
import sys
opened = []
sys.addaudithook(lambda event, args: opened.append(str(args[0])) if event == "open" else None)
libraries, packages = %r, %r
def loaded(names, prefix=""):
    return [name for name in names if prefix + name in sys.modules]
import jaxspace
dir(jaxspace)
print("at once:", loaded(libraries), loaded(packages, "jaxspace."))
import jax, equinox, diffrax
before = dict(jax.config.values)
jaxspace.orbits, jaxspace.simulate
print("on request:", loaded(libraries), loaded(packages, "jaxspace."))
opened[:] = []
for name in dir(jaxspace):
    getattr(jaxspace, name)
after = dict(jax.config.values)
print("settings:", sorted(k for k in {**before, **after} if before.get(k) != after.get(k)))
print("libraries:", loaded(libraries))
read = [f for f in opened if "jaxspace" in f]
ours = [f for f in read if not f.endswith((".py", ".pyc")) and ".pyc." not in f]
print("files:", ours)
print("backends:", sorted(jax._src.xla_bridge._backends))
"""


def test_importing_the_package_changes_nothing():
    """Nothing is loaded before it is used, and then only what that needs. When all is loaded, no
    setting of jax has changed, no heavy library is there, no file of ours is read, no device is
    touched."""
    floor = ["diffrax", "equinox", "jax", "numpy"]
    # Each row of the table holds what its packages import in their turn.
    needed = sorted({"orbits", "simulation"} | ALLOWED["orbits"] | ALLOWED["simulation"])
    libraries = [*floor, "optax", *sorted(LIGHT)]
    assert run(WATCH % (libraries, MODULES)).splitlines() == [
        "at once: [] []",
        f"on request: {floor} {needed}",
        "settings: []",
        f"libraries: {floor}",
        "files: []",
        "backends: []",
    ]
