"""The manual runs: every Python block of every page, in one namespace a page, and each block of
the README in its own process.

A block of another library carries a title (```{.python title="SciPy"}), and is shown only.
"""

import ast
import builtins
import importlib
import inspect
import json
import os
import pkgutil
import re
import runpy
import subprocess
import symtable
import sys
from pathlib import Path

import jax
import nbformat
import numpy as np
import pytest
from nbclient import NotebookClient

import jaxspace
from jaxspace import cli
from jaxspace.core.modules import public_names

ROOT = Path(__file__).parents[1]
CODE = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\(([^)#:]+)(?:#[^)]*)?\)")
PICTURE = re.compile(r'src(?:set)?="([^":]+)"')
COPIED = re.compile(r"^jaxspace new (\w+)", re.MULTILINE)
MANUAL = ["README.md", "CONTRIBUTING.md"]
MANUAL += sorted(str(path.relative_to(ROOT)) for path in ROOT.glob("docs/**/*.md"))
PAGES = [page for page in MANUAL if CODE.search((ROOT / page).read_text())]
# The home page has the code of the README, each block of which runs in a process of its own.
HOME = "docs/index.md"
APART = HOME, "README.md"
# What a reader opens first is run always, of the other pages a sample.
FIRST = (
    "docs/tutorials/getting_started.md",
    "docs/tutorials/rocket_to_the_ground.md",
    "docs/tutorials/trained_controller.md",
    "docs/howto/extending.md",
)
# Which compile for half a minute each.
LONG = (
    # The README runs the same campaign.
    "docs/goals/disperse.md",
    "docs/howto/as_a_layer.md",
    "docs/howto/cookbook.md",
    "docs/howto/design_under_dispersion.md",
    "docs/howto/estimation.md",
    "docs/howto/what_accuracy_costs.md",
)
# The other tutorials run as notebooks.
AS_NOTEBOOKS = tuple(p for p in PAGES if p.startswith("docs/tutorials/") and p not in FIRST)
PACKAGES = [package.name for package in pkgutil.iter_modules(jaxspace.__path__) if package.ispkg]


# Tables, pictures, code, equations and addresses cannot be folded.
UNFOLDED = re.compile(
    r"^::: .*?(?=^\S|\Z)|^```.*?^ *```$|\$\$.*?\$\$|`[^`\n]*`|\]\([^)]*\)", re.MULTILINE | re.DOTALL
)
WHOLE_LINE = ("|", "!", "[!", "<")
WRITTEN_BY_PROGRAMS = {"benchmarks.md", "fuzz_testing.md", "requested.md", "validation.md"}


@pytest.mark.parametrize("page", MANUAL)
def test_prose_is_folded(page):
    """At a hundred columns, as code is."""
    if Path(page).name in WRITTEN_BY_PROGRAMS:
        return
    lines = UNFOLDED.sub("", (ROOT / page).read_text()).splitlines()
    prose = [line for line in lines if not line.lstrip().startswith(WHOLE_LINE)]
    assert not [line for line in prose if len(line) > 100]


README = (ROOT / "README.md").read_text()
EXAMPLES = CODE.findall(README)


def test_home_page_begins_as_the_readme():
    home, readme = [BLOCK.findall(text) for text in ((ROOT / HOME).read_text(), README)]
    # Installation, orbit, gradient and campaign with their outputs; the rest differs.
    kinds = ["sh", "python", "python", "text", "toml", "python", "text", "sh"]
    assert home[:8] == readme[:8] and [kind for kind, _ in home[:8]] == kinds


@pytest.mark.parametrize("block", range(3), ids=("orbit", "gradient", "campaign"))
def test_each_block_of_the_readme_runs_alone(block, tmp_path, request, settings_stay):
    """A reader copies one block into a new process, where JAX has its default settings."""
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    light = str(int(request.config.getoption("--sweep") == "sample"))
    settings = {"JAX_DISABLE_MOST_OPTIMIZATIONS": light, "MPLBACKEND": "agg", "PYTHONPATH": path}
    done = subprocess.run(
        # The same program with fewer runs.
        [sys.executable, "-W", "error", "-c", EXAMPLES[block].replace("10_000", "100")],
        cwd=tmp_path,
        env={**os.environ, **settings},
        capture_output=True,
        text=True,
        encoding="utf-8",
    )
    assert done.returncode == 0, done.stdout + done.stderr
    if block == 0:
        assert (tmp_path / "orbit.png").stat().st_size > 5000
    if block == 1:
        shown = BLOCK.findall(README)[3][1]
        printed, expected = (
            np.array(re.findall(r"-?\d+\.?\d*", text), float) for text in (done.stdout, shown)
        )
        # The last digit shown, which other roundings of a run at 1e-9 may move by one.
        within = np.array([1.5] + 3 * [0.015])
        assert printed.size == expected.size == 4
        assert np.all(np.abs(printed - expected) < within), (printed, expected)


def test_scene_of_the_readme_is_the_example():
    """Each line of its excerpt is a line of the file."""
    (scene,) = re.findall(r"^```toml\n(.*?)^```$", README, re.M | re.S)
    example = (ROOT / "examples" / "scenes" / "kick_stage.toml").read_text()
    for line in filter(None, scene.splitlines()):
        assert line.partition("  #")[0] in example


def test_there_is_something_to_run():
    assert "README.md" in PAGES
    assert len(PAGES) >= 25


def marks_of(page):
    if page in LONG:
        return pytest.mark.sweep
    return () if page.startswith(FIRST) else pytest.mark.slow


@pytest.mark.parametrize(
    "page", [pytest.param(p, marks=marks_of(p)) for p in PAGES if p not in APART + AS_NOTEBOOKS]
)
def test_code_of_the_page_runs(page, tmp_path, monkeypatch, settings_stay):
    monkeypatch.chdir(tmp_path)  # a page may write a file
    (tmp_path / "examples").symlink_to(ROOT / "examples")  # and read those of the examples
    # The same program, but for its length.
    text = (ROOT / page).read_text().replace("10_000", "100")
    for scene in dict.fromkeys(COPIED.findall(text)):
        assert cli.main(["new", scene]) == 0
    names = {"__name__": "page"}
    # A reader has JAX as it comes: of the settings that tests share only double precision is kept.
    with jax.numpy_dtype_promotion("standard"):
        for block in CODE.findall(text):
            exec(compile(block, page, "exec"), names)


HOW_DO_I = (ROOT / "docs" / "howto" / "how_do_i.md").read_text()
ROW = re.compile(r"^\| (.*?) ?\| `(.*)` \|$", re.MULTILINE)
GROUPS = [group.partition("\n")[::2] for group in HOW_DO_I.split("\n## ")[1:]]


def test_how_do_i_has_a_hundred_rows():
    assert len(ROW.findall(HOW_DO_I)) >= 100


@pytest.mark.parametrize(
    "group",
    [pytest.param(k, id=g[0], marks=pytest.mark.slow if k else ()) for k, g in enumerate(GROUPS)],
)
def test_every_line_of_how_do_i_runs(group, tmp_path, monkeypatch, settings_stay):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    names = {"__name__": "page"}
    with jax.numpy_dtype_promotion("standard"):
        exec(CODE.findall(HOW_DO_I)[0], names)
        for question, line in ROW.findall(GROUPS[group][1]):
            if line.startswith("$ jaxspace "):
                cli.parser().parse_args(line.split()[2:])
            else:
                exec(compile(line, f"how do I {question}?", "exec"), names)


@pytest.mark.parametrize("page", PAGES)
def test_page_imports_public_names_only(page):
    for block in CODE.findall((ROOT / page).read_text()):
        for node in ast.walk(ast.parse(block)):
            if isinstance(node, ast.ImportFrom):
                names = [node.module or "", *(alias.name for alias in node.names)]
            elif isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            else:
                continue
            private = [name for name in names if re.search(r"(^|\.)_", name)]
            assert not private, f"{page} imports {private}"


@pytest.mark.parametrize("page", MANUAL)
def test_links_of_the_page_lead_somewhere(page):
    text = (ROOT / page).read_text()
    for target in LINK.findall(text) + PICTURE.findall(text):
        there = ((ROOT / page).parent / target).exists()
        assert there, f"{page} points to {target}: a generated page needs its whole address"


@pytest.mark.parametrize("package", PACKAGES)
def test_every_public_name_has_a_docstring(package):
    module = importlib.import_module(f"jaxspace.{package}")
    assert inspect.getdoc(module), f"jaxspace.{package} has no docstring"
    for name, value in public_names(module).items():
        # An alias of a shape, such as `Scalar`, belongs to jaxtyping.
        ours = getattr(value, "__module__", "").startswith("jaxspace")
        if ours:
            assert value.__doc__, f"jaxspace.{package}.{name} has no docstring"


def test_pages_need_no_network():
    files = [ROOT / "mkdocs.yml", *(ROOT / "docs" / "assets").glob("**/*.css")]
    files += [path for path in ROOT.glob("docs/assets/*.js")]
    for path in files:
        # What a reader may follow is not fetched: the address of the manual, and of its sources.
        fetched = re.sub(r"^site_url: .*$|link: [^}]*", "", path.read_text(), flags=re.MULTILINE)
        assert not re.search(r"https?:|//cdn|repo_url", fetched.replace("`repo_url`", "")), path


def test_files_on_the_way_of_a_run_are_there():
    text = (ROOT / "docs" / "explanation" / "how_a_run_goes.md").read_text()
    files = re.findall(r"\b[a-z]+/[a-z_]+\.py", text)
    assert len(files) >= 25
    for name in files:
        assert (ROOT / "jaxspace" / name).exists(), f"how_a_run_goes.md names {name}"


@pytest.mark.parametrize("page", sorted(ROOT.glob("docs/tutorials/*.md")), ids=lambda p: p.stem)
def test_notebook_of_a_tutorial_has_its_blocks(page):
    make = runpy.run_path(str(ROOT / "docs" / "_notebooks.py"))["notebook"]
    made = json.loads(make(page.read_text()))
    install, *code = ["".join(c["source"]) for c in made["cells"] if c["cell_type"] == "code"]
    # A notebook that is opened elsewhere begins without the library.
    address = "https://github.com/jaxspace/jaxspace"
    assert install == f'%pip install --quiet "jaxspace[app] @ git+{address}"'
    # The same way as the README names until the first release.
    assert f"jaxspace[app] @ git+{address}" in README
    assert code == [block.strip("\n") for block in CODE.findall(page.read_text())]
    assert "```python" not in json.dumps(made)
    # A link of the manual leads nowhere from a notebook.
    assert not [target for target in LINK.findall(json.dumps(made)) if target.endswith(".md")]
    # What the format asks of a cell.
    for cell in made["cells"]:
        needed = {"id", "metadata", "source", "cell_type"}
        needed |= {"outputs", "execution_count"} if cell["cell_type"] == "code" else set()
        assert set(cell) == needed


@pytest.mark.slow
@pytest.mark.parametrize("page", sorted(ROOT.glob("docs/tutorials/*.md")), ids=lambda p: p.stem)
def test_notebook_of_a_tutorial_runs(page, tmp_path, monkeypatch):
    """In a kernel, from the first cell after the installation to the last one."""
    make = runpy.run_path(str(ROOT / "docs" / "_notebooks.py"))["notebook"]
    made = nbformat.reads(make(page.read_text().replace("10_000", "100")), 4)
    made.cells = [cell for cell in made.cells if not cell.source.startswith("%pip")]
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    monkeypatch.setenv("PYTHONPATH", path)
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    place = {"metadata": {"path": str(tmp_path)}}
    NotebookClient(made, timeout=600, kernel_name="python3", resources=place).execute()


def test_tasks_name_what_there_is(monkeypatch):
    """Each word of a task is a name of the root or a module, and each name stands in one group."""
    monkeypatch.syspath_prepend(ROOT / "docs")
    pages = importlib.import_module("_task_pages")
    uses = importlib.import_module("_uses")
    assert set(pages.TASKS) <= set(uses.packages())
    for package in uses.packages():
        rows = [row for group in pages.groups(package).values() for row in group]
        assert len(set(rows)) == len(rows) == sum(map(len, uses.public_names(package).values()))
        for names in uses.public_names(package).values():
            assert not any(map(inspect.ismodule, names.values()))


def test_first_sentence_of_a_docstring_is_whole(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "docs")
    first_line = importlib.import_module("_uses").first_line
    assert first_line("r . v, m^2/s: zero at\nboth apsides. More.") == (
        "r . v, m^2/s: zero at both apsides"
    )
    assert first_line("Dry air (U.S. Standard Atmosphere 1976).") == (
        "Dry air (U.S. Standard Atmosphere 1976)"
    )
    assert first_line("An orbit:\n\n- `mu`") == "An orbit"


def test_examples_of_an_object_are_named(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "docs")
    uses = importlib.import_module("_uses")
    code = "from jaxspace import orbits\nfrom jaxspace.attitude import Top as T\n"
    lines = "orbits.lambert.lambert(r, s, 1.0, mu)\nT(1.0, 2.0, 3.0).state([0, 0, 0], [0, 0, 0])"
    assert uses.used(code, lines) == ["attitude.Top", "orbits.lambert.lambert"]
    found = uses.examples()["orbits.lambert.lambert"]
    assert "gallery/orbits/#transfer-window" in {example.address for example in found}


def programs_of(page, monkeypatch):
    """For each block of a page, what its copy button copies."""
    monkeypatch.syspath_prepend(ROOT / "docs")
    hook = importlib.import_module("_complete_blocks")
    text = (ROOT / page).read_text()
    kinds = [kind for kind, _ in hook.FENCE.findall(text)]
    return list(zip(kinds, hook.programs(text), strict=True))


@pytest.mark.parametrize("page", [page for page in PAGES if page.startswith("docs/")])
def test_copied_blocks_need_nothing_else(page, monkeypatch):
    """Each name that a copied program reads at its top level is one that it defines before."""
    for kind, program in programs_of(page, monkeypatch):
        if kind != "python" and "jaxspace" not in program:
            continue
        table = symtable.symtable(program, page, "exec")
        defined = {x.get_name() for x in table.get_symbols() if x.is_assigned() or x.is_imported()}
        defined |= set(dir(builtins)) | {x.get_name() for x in table.get_children()}
        read, tables = set(), [table]
        while tables:
            inner = tables.pop()
            tables += inner.get_children()
            read |= {
                x.get_name()
                for x in inner.get_symbols()
                if x.is_referenced() and (inner is table or x.is_global())
            }
        assert read <= defined, read - defined


# Blocks that need definitions, functions that read names defined below them, changed containers and
# a name that is defined twice.
@pytest.mark.parametrize(
    "page, block",
    [
        ("docs/tutorials/first_scene.md", 3),
        ("docs/howto/derivatives.md", 7),
        ("docs/howto/cookbook.md", 3),
        ("docs/physics/central_force.md", 1),
    ],
)
def test_copied_blocks_run_alone(page, block, tmp_path, monkeypatch, settings_stay):
    monkeypatch.chdir(tmp_path)
    _, program = programs_of(page, monkeypatch)[block]
    with jax.numpy_dtype_promotion("standard"):
        exec(compile(program, page, "exec"), {"__name__": "page"})


def test_the_statements_that_a_block_needs_are_copied(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "docs")
    complete = importlib.import_module("_complete_blocks").complete
    blocks = [
        "import os\nimport numpy as np\n\nx = 1\nprint(x)\n",
        "def f(y):\n    return x + LATER\n\n\nLATER = {}\nLATER['k'] = 2\nx = x + 1\nz = 3\n",
        "print(f(2))\n",
    ]
    expected = "x = 1\n\n\ndef f(y):\n    return x + LATER\n\n\n"
    expected += "LATER = {}\nLATER['k'] = 2\nx = x + 1\n\n\nprint(f(2))\n"
    assert complete(blocks) == expected
    assert complete(blocks[:1]) == blocks[0]


def test_a_copied_block_writes_the_files_that_it_reads(monkeypatch):
    """Scene files that the page shows, and stores of campaigns with all that fills them."""
    monkeypatch.syspath_prepend(ROOT / "docs")
    programs = importlib.import_module("_complete_blocks").programs
    blocks = [
        '{.toml title="a.toml"}\nmu = 1\n',
        'python\njaxspace.enable_x64()\ndisperse(1, store="b.zarr")\n',
        'python\njaxspace.enable_x64()\nr = disperse(1, store="b.zarr", resume=True)\n',
        "python\nprint(r)\n",
        'python\nload("a.toml")\n',
    ]
    page = "\n".join(f"```{block}```\n" for block in blocks)
    *_, resumed, loaded = programs(page)
    lines = [line for line in resumed.splitlines() if line]
    assert lines == [
        "jaxspace.enable_x64()",
        'disperse(1, store="b.zarr")',
        'r = disperse(1, store="b.zarr", resume=True)',
        "print(r)",
    ]
    assert 'Path("a.toml").write_text("""\nmu = 1\n""")' in loaded
    assert loaded.startswith("from pathlib import Path\n") and "disperse" not in loaded
