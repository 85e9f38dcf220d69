"""What strangers meet first: workflows that call make, templates, one public address."""

import re
import tomllib
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[1]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
TARGETS = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_steps_are_those_of_make(path):
    """A step that a workflow runs can be run here by the same words."""
    flow = yaml.safe_load(path.read_text())
    # YAML 1.1 reads the key `on` as true.
    assert {"name", True, "jobs", "permissions"} <= set(flow)
    for job in flow["jobs"].values():
        for step in job["steps"]:
            # A version is named, and never a branch that moves.
            assert "run" in step or re.search(r"@(v\d+|release/v1)$", step["uses"])
            if "run" in step:
                make, target, *more = step["run"].split()
                assert make == "make" and target in TARGETS and more in ([], ["PYTHON=python"])
    # Else a job that hangs holds a machine for six hours.
    assert all("timeout-minutes" in job or "needs" in job for job in flow["jobs"].values())


def test_every_supported_python_is_tried():
    flow = yaml.safe_load((ROOT / ".github" / "workflows" / "tests.yml").read_text())
    tried = flow["jobs"]["quick"]["strategy"]["matrix"]
    minor = [c.rpartition(" ")[2] for c in PROJECT["classifiers"] if "Python :: 3." in c]
    assert tried["python"] == minor and len(tried["os"]) == 3
    assert PROJECT["requires-python"] == f">={minor[0]}"


def test_forms_and_settings_are_yaml():
    for name in (".pre-commit-config.yaml", "CITATION.cff", ".github/dependabot.yml"):
        assert yaml.safe_load((ROOT / name).read_text())
    for path in (ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml"):
        form = yaml.safe_load(path.read_text())
        assert "contact_links" in form or {"name", "description", "body"} <= set(form)


def test_the_public_address_is_one():
    """Its home is `[project.urls]`; whoever moves the project finds the others here."""
    urls = PROJECT["urls"]
    manual = yaml.load((ROOT / "mkdocs.yml").read_text(), yaml.BaseLoader)
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    (source,) = manual["extra"]["social"]
    assert source["link"] == cited["repository-code"] == urls["Source"] == urls["Homepage"]
    assert manual["site_url"].rstrip("/") == cited["url"] == urls["Documentation"]
    owner = urls["Source"].removeprefix("https://github.com/")
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["hatch"]
    for change in settings["metadata"]["hooks"]["fancy-pypi-readme"]["substitutions"]:
        assert f"/{owner}/" in change["replacement"]
    assert f"{owner}/security" in (ROOT / ".github/ISSUE_TEMPLATE/config.yml").read_text()


def test_the_changelog_of_a_release_is_short():
    assert len((ROOT / "CHANGELOG.md").read_text().splitlines()) <= 130
    kinds = {kind["directory"] for kind in _towncrier()["type"]}
    for path in (ROOT / "changes").glob("*.md"):
        assert path.name == "README.md" or path.name.split(".")[-2] in kinds, path.name


def _towncrier():
    return tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["towncrier"]
