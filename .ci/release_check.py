"""What a release has to pass besides the tests: `make release-check`. Nothing is published.

The tools (build, twine, check-jsonschema, towncrier) are those of the interpreter that runs this.
Each step prints what it has found; the first that fails ends it with 1.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DIST = ROOT / "dist"
LARGEST_WHEEL = 2_000_000
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
# What `make demo` and `make test` need of an unpacked sdist, besides the packages.
NEEDED = (
    *(".ci/python", ".ci/run", "CHANGELOG.md", "CONTRIBUTING.md", "LICENSE", "Makefile"),
    *("README.md", "mkdocs.yml", "pyproject.toml", "docs/index.md", "tests/conftest.py"),
    *("examples/scenes/kick_stage.toml", "benchmarks/results/avx512/kepler.json"),
)


def call(*command: object, where: Path = ROOT, status: int = 0, **more: str) -> str:
    """The output of a command, both streams; ends everything where its status is another one."""
    # The package is the one that is installed, and never the one beside this file.
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"} | more
    done = subprocess.run(
        [str(word) for word in command],
        cwd=where,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    if done.returncode != status:
        sys.exit(
            f"{' '.join(map(str, command))} ended with {done.returncode}:\n{done.stdout[-4000:]}"
        )
    return done.stdout


def require(fact: object, sentence: str) -> None:
    """End everything with the sentence where the fact does not hold."""
    if not fact:
        sys.exit(sentence)


def build() -> tuple[Path, Path]:
    """The sdist, and the wheel that is built from it."""
    shutil.rmtree(DIST, ignore_errors=True)
    call(sys.executable, "-m", "build", "--outdir", DIST)
    (sdist,), (wheel,) = DIST.glob("*.tar.gz"), DIST.glob("*.whl")
    call(sys.executable, "-m", "twine", "check", "--strict", sdist, wheel)
    size = wheel.stat().st_size
    require(size < LARGEST_WHEEL, f"{wheel.name} has {size} bytes: at most {LARGEST_WHEEL}.")
    with tarfile.open(sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    require(not set(NEEDED) - names, f"{sdist.name} lacks {sorted(set(NEEDED) - names)}.")
    print(f"built    {sdist.name} and {wheel.name} ({size / 1e6:.2f} MB)")
    return sdist, wheel


def metadata(wheel: Path) -> None:
    """The page of the index: no link that leads nowhere outside of the repository."""
    text = call(sys.executable, "-m", "zipfile", "-l", wheel)
    require("jaxspace/examples/kick_stage.toml" in text, f"{wheel.name} has no example scenes.")
    with tempfile.TemporaryDirectory() as folder:
        shutil.unpack_archive(wheel, folder, "zip")
        (page,) = Path(folder).glob("*.dist-info/METADATA")
        form = r"""\]\((?!https://|#)[^)]*\)|src(?:set)?="(?!https://)[^"]*"""
        relative = re.findall(form, page.read_text(encoding="utf-8"))
    require(not relative, f"README.md has links that stay relative: {relative}.")
    print("metadata valid, links absolute")


def interpreters() -> dict[str, str]:
    """The interpreters of this machine, by version: on the path, and behind pyenv's names."""
    found = {}
    folders = os.environ["PATH"].split(os.pathsep)
    folders += [str(path) for path in Path("~/.pyenv/versions").expanduser().glob("*/bin")]
    for version in PYTHONS:
        for folder in folders:
            candidate = shutil.which(f"python{version}", path=folder)
            probe = "import sys, venv, ensurepip; print('%d.%d' % sys.version_info[:2])"
            # A name on the path may have nothing behind it.
            if candidate and version not in found:
                done = subprocess.run([candidate, "-c", probe], capture_output=True, text=True)
                if done.stdout.strip() == version:
                    found[version] = candidate
    return found


def first_block(page: str) -> str:
    """The first block of Python of a page."""
    block = re.search(r"^```python\n(.*?)^```", (ROOT / page).read_text(), re.M | re.S)
    require(block, f"{page} has no block of Python.")
    return block[1] if block else ""


def try_wheel(version: str, interpreter: str, wheel: Path) -> None:
    """Install the wheel in a bare environment, and use it in an empty folder."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        call(interpreter, "-m", "venv", folder / "venv")
        scripts = next(x for x in (folder / "venv/bin", folder / "venv/Scripts") if x.is_dir())
        python, jaxspace = scripts / "python", scripts / "jaxspace"
        pip = (python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check")
        empty = folder / "empty"
        empty.mkdir()
        call(*pip, wheel)
        # The block of the README needs the extra.
        orbit = "docs/tutorials/getting_started.md"
        call(python, "-W", "error", "-c", first_block(orbit), where=empty)
        # Compiles in a fifth of the time of the kick stage, which the sdist's demo runs.
        call(jaxspace, "new", "intercept", where=empty)
        said = call(jaxspace, "run", "intercept.toml", where=empty, status=2)
        require('pip install "jaxspace[app]"' in said, f"No extra is named: {said}")
        call(*pip, f"{wheel}[app]")
        call(jaxspace, "new", "kick_stage", where=empty)
        call(python, "-W", "error", "-c", first_block("README.md"), where=empty)
        call(jaxspace, "run", "intercept.toml", where=empty)
        call(jaxspace, "disperse", "intercept.toml", "--runs", 256, where=empty)
        call(jaxspace, "report", "out/intercept.zarr", where=empty)
        require((empty / "out" / "intercept.html").is_file(), "The report has no page.")
        told = call(jaxspace, "--version", where=empty).split()[1]
        require(told in wheel.name, f"jaxspace --version is {told}, the file {wheel.name}.")
        print(f"Python {version}: README, new, run, disperse and report from the wheel")


def try_sdist(sdist: Path) -> None:
    """`make demo` in the unpacked sdist; of `make test` what it would call."""
    with tempfile.TemporaryDirectory() as name:
        shutil.unpack_archive(sdist, name)
        (folder,) = Path(name).iterdir()
        call("make", "demo", where=folder)
        call("make", "--dry-run", "test", where=folder)
    print("sdist    make demo")


def manual() -> None:
    """The manual is built, and each of its links is followed."""
    call("make", "docs")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    home = project["urls"]["Documentation"].rstrip("/") + "/"
    print("manual  ", call(sys.executable, ROOT / ".ci/links.py", "site", home).strip())


def manual_of_the_wheel(sdist: Path, wheel: Path) -> None:
    """The manual of a package that is installed elsewhere: no name may be missing without its
    sources beside the pages."""
    with tempfile.TemporaryDirectory() as name:
        package, sources = Path(name, "package"), Path(name, "sources")
        shutil.unpack_archive(wheel, package, "zip")
        shutil.unpack_archive(sdist, sources)
        (clone,) = sources.iterdir()
        shutil.rmtree(clone / "jaxspace")
        build = (sys.executable, "-m", "mkdocs", "build", "--quiet", "--strict")
        call(*build, where=clone, PYTHONPATH=str(package))
        require((clone / "site" / "llms.txt").is_file(), "The manual has no llms.txt.")
    print("manual   builds against the wheel")


def public_files() -> None:
    """The workflows by their schema, the changelog to be, and the address in one spelling."""
    flows = sorted((ROOT / ".github/workflows").glob("*.yml"))
    schema = ("--builtin-schema", "vendor.github-workflows")
    call(sys.executable, "-m", "check_jsonschema", *schema, *flows)
    call(sys.executable, "-m", "towncrier", "build", "--draft", "--version", "0.0.0")
    print(f"public   {len(flows)} workflows, changelog")


def main() -> int:
    public_files()
    sdist, wheel = build()
    metadata(wheel)
    there = interpreters()
    for version, interpreter in there.items():
        try_wheel(version, interpreter, wheel)
    for version in sorted(set(PYTHONS) - set(there)):
        print(f"Python {version}: none on this machine, not tried")
    try_sdist(sdist)
    manual()
    manual_of_the_wheel(sdist, wheel)
    print(json.dumps({"tried": sorted(there), "dist": [sdist.name, wheel.name]}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
