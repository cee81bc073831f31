"""What others list of the package says what `pyproject.toml` and `constraints.txt` say."""

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

import pter_gym

yaml = pytest.importorskip("yaml")

ROOT = Path(__file__).parents[2]
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
PROJECT = PYPROJECT["project"]
RECIPE: dict[str, Any] = yaml.safe_load((ROOT / "docs" / "conda" / "recipe.yaml").read_text("utf-8"))
OF_CONDA = {"matplotlib": "matplotlib-base"}
"""Packages that have another name there."""


def ranges(requirements: list[str]) -> dict[str, SpecifierSet]:
    """Accepted versions by conda's name."""
    found = [Requirement(requirement) for requirement in requirements]
    return {OF_CONDA.get(each.name, each.name): each.specifier for each in found}


def pins(path: Path) -> dict[str, str]:
    """Versions by name."""
    found = [Requirement(line) for line in path.read_text("utf-8").splitlines() if not line.startswith("#")]
    return {each.name: str(each.specifier).removeprefix("==") for each in found}


def test_the_recipe_is_of_this_version() -> None:
    assert RECIPE["context"]["version"] == pter_gym.__version__
    assert RECIPE["package"]["name"] == PROJECT["name"]
    assert RECIPE["build"]["python"]["entry_points"] == [
        f"{name} = {place}" for name, place in PROJECT["scripts"].items()
    ]


def test_the_recipe_needs_what_the_package_needs() -> None:
    least = {"python_min": RECIPE["context"]["python_min"]}
    needed = [re.sub(r"\$\{\{ (\w+) \}\}", lambda m: least[m[1]], each) for each in RECIPE["requirements"]["run"]]
    assert ranges(needed) == ranges([*PROJECT["dependencies"], f"python{PROJECT['requires-python']}"])
    built = [each for each in RECIPE["requirements"]["host"] if not each.startswith(("pip", "python "))]
    assert ranges(built) == ranges(PYPROJECT["build-system"]["requires"])


def test_the_recipe_is_about_the_same() -> None:
    about, urls = RECIPE["about"], PROJECT["urls"]
    assert about["license"] == PROJECT["license"]
    assert [about["license_file"]] == PROJECT["license-files"]
    assert about["summary"] == PROJECT["description"]
    assert (about["repository"], about["documentation"]) == (urls["Source"], urls["Documentation"])


def test_the_entry_for_gymnasium_follows_its_template() -> None:
    page = (ROOT / "docs" / "listing.md").read_text("utf-8")
    (entry,) = re.findall(r"<!-- entry -->\n```markdown\n(.*?)```\n<!-- /entry -->", page, re.DOTALL)
    name, badge, text = entry.strip().split("\n\n  ")
    assert re.fullmatch(rf"- \[pter_gym: .+\]\({PROJECT['urls']['Source']}\)", name)
    assert f"/Gymnasium-v{pins(ROOT / 'constraints.txt')['gymnasium']}-" in badge
    assert 2 <= len(re.findall(r"\.(?: |$)", text)) <= 5


def test_the_environment_of_ray_has_the_tested_versions_but_for_gymnasium() -> None:
    mine, rays = pins(ROOT / "constraints.txt"), pins(ROOT / "agents" / "at_scale" / "requirements.txt")
    assert {name for name in mine.keys() & rays.keys() if mine[name] != rays[name]} == {"gymnasium"}
    assert rays["gymnasium"] in ranges(PROJECT["dependencies"])["gymnasium"]


@pytest.mark.parametrize("script", sorted((ROOT / "agents" / "at_scale").glob("*.py")), ids=lambda path: path.stem)
def test_the_page_on_scale_shows_what_the_scripts_are(script: Path) -> None:
    block = f"<!-- {script.stem} -->\n```python\n{script.read_text('utf-8')}```\n<!-- /{script.stem} -->\n"
    assert block in (ROOT / "docs" / "at-scale.md").read_text("utf-8")
