"""Generated blocks of the pages say what the code declares."""

import json
import re
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import get_args

import boards
import fill
import made
import pytest
from markup import DOCS, IMAGES, MARK, RECORD, ROOT, digests

from pter_gym._commands.main import commands
from pter_gym.envs._single import PathFollowingEnv
from pter_gym.params import BASELINE
from pter_gym.scenarios import SCENARIOS
from pter_gym.tasks.path_following import Sensors, observation_layout

BLOCKS = list(fill.blocks())


@pytest.mark.parametrize("block", BLOCKS, ids=lambda block: f"{block.page.stem}: {block.asked}")
def test_a_block_is_up_to_date_and_has_its_pictures(block: fill.Block) -> None:
    """`python docs/make/fill.py` writes it."""
    if block.source == "board":
        assert block.asked.split()[0] in boards.BOARDS
        return
    assert block.make() == block.content
    for picture in re.findall(r"\]\((\S*images/\S+)\)", block.content):
        assert (block.page.parent / picture).is_file()


def test_a_picture_shows_the_policies_that_ship() -> None:
    """`python docs/make/pictures.py NAME` draws it and writes the record."""
    record = json.loads(RECORD.read_text("utf-8"))
    films = {f"moving/{path.name}" for path in (IMAGES / "moving").glob("*.webp")}
    still = {"policies", "error-against-pace.png", "worst-hand.png"}
    assert set(record) == films | still
    for name, shown in record.items():
        assert shown == digests(" ".join(shown)), name


NUMBER = re.compile(r'^(?:\||    (?!pter )| *").*\d\.\d.*$', re.MULTILINE)
"""A row of a table, or a line of what a command or a cell prints."""


@pytest.mark.parametrize(
    "page",
    [
        ROOT / "README.md",
        *sorted(DOCS.rglob("*.md")),
        *sorted((ROOT / "notebooks").glob("*.ipynb")),
    ],
    ids=lambda path: path.stem,
)
def test_what_a_page_prints_of_a_policy_is_of_the_file_that_ships(page: Path) -> None:
    """`python docs/make/fill.py --results FOLDER` writes boards; the rest is marked by hand."""
    text = page.read_text("utf-8")
    printed = digests("\n".join(NUMBER.findall(text)))
    marks = set(MARK.findall(text))
    assert {name for name, _ in marks} >= set(printed)
    assert all(digest == digests(name).get(name) for name, digest in marks)


@pytest.mark.parametrize(
    "name", ["observation", "telemetry", "parameters pter_gym.tasks.path_following.RewardWeights"]
)
def test_each_entry_has_a_unit_and_a_meaning(name: str) -> None:
    (content,) = {block.content for block in BLOCKS if block.asked == name}
    assert "|  |" not in content


def test_each_command_has_a_page() -> None:
    asked = {
        (block.page.stem, block.asked) for block in BLOCKS if block.page.parent.name == "commands"
    }
    assert asked == {(name, f"command {name}") for name in commands()}
    assert {path.stem for path in (DOCS / "commands").glob("*.md")} == set(commands())


def test_commands_of_another_branch_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    known = fill.registered(fill.COMMANDS)
    gone = EntryPoint("gone", "pter_gym.tools.gone.command:gone", fill.COMMANDS)
    for installed in (known | {"gone": gone}, {}):
        monkeypatch.setattr(fill, "registered", lambda _, found=installed: found)
        with pytest.raises(SystemExit, match="install again"):
            fill.main()


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_scenario_says_what_it_draws(name: str) -> None:
    rows = [line for line in made.scenario(name).splitlines() if line.startswith("| ")]
    for each in (SCENARIOS[name].draws.machine, SCENARIOS[name].draws.task):
        assert all(
            any(f": {field}" in row for row in rows) for field in getattr(each, "fields", {})
        )


def test_the_docstring_of_the_environment_names_every_entry_of_the_observation() -> None:
    (section,) = re.findall(
        r"## Observation Space(.*?)## ", PathFollowingEnv.__doc__ or "", re.DOTALL
    )
    rows = [line for line in section.splitlines() if line.strip().startswith("| `")]
    named = [name for row in rows for name in re.findall(r"`(\w+)`", row.split("|")[1])]
    assert tuple(named) == observation_layout(BASELINE, "force").names
    sizes = [len(observation_layout(BASELINE, sensors)) for sensors in get_args(Sensors)]
    prose = section[: section.index("|")].replace("±25", "").replace("-25, 25", "")
    assert [int(size) for size in re.findall(r"\b\d\d\b", prose)] == sizes


def test_scripts_of_the_pages_load() -> None:
    pytest.importorskip("pygame")
    for name in ("pictures", "store"):
        __import__(name)
