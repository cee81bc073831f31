"""The package says the same about itself everywhere."""

import importlib.metadata
import importlib.resources
import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest

import pter_gym

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]


FOLDERS = {"agents", "docs", "notebooks", "pter_gym", "tests"}
FILES = {"CHANGELOG.md", "CITATION.cff", "CONTRIBUTING.md", "LICENSE", "README.md", "constraints.txt", "pyproject.toml"}


def names_of(requirements: list[str]) -> set[str]:
    found = (re.match(r"[\w-]+", requirement) for requirement in requirements)
    return {match.group().lower() for match in found if match} - {"pter-gym"}


@pytest.mark.skipif(not shutil.which("git") or not (ROOT / ".git").exists(), reason="no clone of the repository")
def test_the_top_level_has_nothing_else():
    told = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    top = {line.partition("/")[0] for line in told.splitlines() if not line.startswith(".")}
    assert top == FOLDERS | FILES


def test_version_stands_in_one_place():
    assert importlib.metadata.version("pter-gym") == pter_gym.__version__


def test_citation_has_the_version():
    citation = (ROOT / "CITATION.cff").read_text("utf-8")
    assert re.search(r"^version: (.+)$", citation, re.MULTILINE).group(1) == pter_gym.__version__


@pytest.mark.parametrize("package", ["pter_gym", "pter_agents"])
def test_packages_are_typed(package: str):
    assert importlib.resources.files(package).joinpath("py.typed").is_file()


def test_command_is_installed():
    (command,) = importlib.metadata.entry_points(group="console_scripts", name="pter")
    assert command.value == "pter_gym.commands.main:main"


def test_every_dependency_has_a_tested_version():
    pinned = {line.split("==")[0] for line in (ROOT / "constraints.txt").read_text("utf-8").splitlines()}
    extras = (names_of(requirements) for requirements in PROJECT["optional-dependencies"].values())
    assert names_of(PROJECT["dependencies"]).union(*extras) <= pinned


def test_constraints_are_exact_and_carry_no_local_label():
    lines = (ROOT / "constraints.txt").read_text("utf-8").splitlines()
    for line in (line for line in lines if not line.startswith("#")):
        assert re.fullmatch(r"[a-z0-9-]+==[0-9][0-9a-z.]*", line)


def test_all_names_every_extra():
    (everything,) = PROJECT["optional-dependencies"]["all"]
    named = set(re.fullmatch(r"pter-gym\[(.+)\]", everything).group(1).split(","))
    assert named == PROJECT["optional-dependencies"].keys() - {"all"}
