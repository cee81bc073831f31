"""The package says the same about itself everywhere: metadata, constraints, conda's recipe."""

import importlib.metadata
import importlib.resources
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

import pter_gym

ROOT = Path(__file__).parents[2]
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
PROJECT = PYPROJECT["project"]
OF_CONDA = {"matplotlib": "matplotlib-base"}
"""Packages that have another name there."""


def pins(path: Path) -> dict[str, str]:
    """Versions by name."""
    found = [
        Requirement(line)
        for line in path.read_text("utf-8").splitlines()
        if not line.startswith("#")
    ]
    return {each.name: str(each.specifier).removeprefix("==") for each in found}


def ranges(requirements: list[str]) -> dict[str, SpecifierSet]:
    """Accepted versions by conda's name."""
    found = [Requirement(requirement) for requirement in requirements]
    return {OF_CONDA.get(each.name, each.name): each.specifier for each in found}


def test_version_and_date_are_the_same_everywhere():
    citation = (ROOT / "CITATION.cff").read_text("utf-8")
    entry = (ROOT / "docs" / "index.md").read_text("utf-8")
    assert importlib.metadata.version("pter-gym") == pter_gym.__version__
    assert re.search(r"^version: (.+)$", citation, re.MULTILINE).group(1) == pter_gym.__version__
    assert re.search(r"version = \{(.+)\}", entry).group(1) == pter_gym.__version__
    date = re.search(r"^date-released: (.+)$", citation, re.MULTILINE).group(1)
    assert f"\n## [{pter_gym.__version__}] - {date}\n" in (ROOT / "CHANGELOG.md").read_text("utf-8")


@pytest.mark.parametrize("package", ["pter_gym", "pter_agents"])
def test_packages_are_typed(package: str):
    assert importlib.resources.files(package).joinpath("py.typed").is_file()


def test_every_dependency_has_one_tested_version():
    lines = (ROOT / "constraints.txt").read_text("utf-8").splitlines()
    assert all(
        re.fullmatch(r"[a-z0-9-]+==[0-9][0-9a-z.]*", line)
        for line in lines
        if not line.startswith("#")
    )
    asked = [
        each for extra in PROJECT["optional-dependencies"].values() for each in extra
    ] + PROJECT["dependencies"]
    names = {Requirement(each).name.lower() for each in asked} - {"pter-gym"}
    assert names <= pins(ROOT / "constraints.txt").keys()


@pytest.mark.parametrize("name", ["build", "twine"])
def test_a_release_is_made_with_tested_versions_by_hash(name: str):
    _, *lines = re.sub(r" *\\\n *", " ", (ROOT / ".ci" / f"{name}.txt").read_text()).splitlines()
    assert all(re.fullmatch(r"[^#]*==[^#]*( --hash=sha256:[0-9a-f]{64})+", line) for line in lines)
    found = [Requirement(line.partition(" --hash")[0]) for line in lines]
    versions = {each.name: str(each.specifier).removeprefix("==") for each in found}
    tested = pins(ROOT / "constraints.txt")
    assert {
        name: versions[name] for name in versions.keys() & tested.keys()
    }.items() <= tested.items()
    if name == "build":
        for each in map(Requirement, PYPROJECT["build-system"]["requires"]):
            assert versions[each.name] in each.specifier


def test_links_of_the_readme_work_away_from_the_repository():
    """As hatch-fancy-pypi-readme makes them, but for the version."""
    hook = PYPROJECT["tool"]["hatch"]["metadata"]["hooks"]["fancy-pypi-readme"]
    text = (ROOT / "README.md").read_text("utf-8")
    relative = re.findall(r"(!?)\[[^\]]*\]\((?!http)(.+?)\)", text)
    for each in hook["substitutions"]:
        text = re.sub(each["pattern"], each["replacement"], text)
    assert relative
    for picture, place in relative:
        kind = "raw" if picture else "blob"
        assert f"]({PROJECT['urls']['Source']}/{kind}/v$HFPR_VERSION/{place})" in text
        assert f"]({place})" not in text


@pytest.mark.parametrize("name", ["gate", "docs", "publish"])
def test_actions_are_pinned_by_commit(name: str):
    text = (ROOT / ".github" / "workflows" / f"{name}.yml").read_text("utf-8")
    used = re.findall(r"uses: (.+)", text)
    assert used
    assert all(re.fullmatch(r"[\w-]+/[\w-]+@[0-9a-f]{40} # v[\d.]+", each) for each in used)


def test_the_extra_all_contains_every_extra():
    (everything,) = PROJECT["optional-dependencies"]["all"]
    assert Requirement(everything).extras == PROJECT["optional-dependencies"].keys() - {"all"}


def test_the_recipe_for_conda_says_the_same():
    yaml = pytest.importorskip("yaml")
    recipe: dict[str, Any] = yaml.safe_load(
        (ROOT / "docs" / "conda" / "recipe.yaml").read_text("utf-8")
    )
    assert recipe["context"]["version"] == pter_gym.__version__
    commands = [f"{name} = {place}" for name, place in PROJECT["scripts"].items()]
    assert recipe["build"]["python"]["entry_points"] == commands
    least = recipe["context"]["python_min"]
    needed = [each.replace("${{ python_min }}", least) for each in recipe["requirements"]["run"]]
    assert ranges(needed) == ranges(
        [*PROJECT["dependencies"], f"python{PROJECT['requires-python']}"]
    )
    host = [each for each in recipe["requirements"]["host"] if ">=" in each]
    assert ranges(host) == ranges(PYPROJECT["build-system"]["requires"])
    about = recipe["about"]
    assert (about["license"], about["summary"]) == (PROJECT["license"], PROJECT["description"])
    assert recipe["context"]["address"] == PROJECT["urls"]["Source"]
