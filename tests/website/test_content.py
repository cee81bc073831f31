"""What pages take from the code."""

import re

import fill
import made
import pytest
from pages import DOCS, ROOT

from pter_gym._commands.main import commands
from pter_gym.scenarios import SCENARIOS


@pytest.mark.parametrize("table", [*fill.asked_for()], ids=lambda table: f"{table.page}: {table.name}")
def test_what_a_page_asks_for_has_its_pictures(table: fill.Table) -> None:
    text = table.make()
    assert text.strip()
    for picture in re.findall(r"\]\((\S*images/\S+)\)", text):
        assert ((ROOT / table.page).parent / picture).is_file()


def test_each_command_has_a_page() -> None:
    assert {path.stem for path in (DOCS / "commands").glob("*.md")} == set(commands())
    for name in commands():
        assert f"<!-- made: command {name} -->" in (DOCS / "commands" / f"{name}.md").read_text("utf-8")


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_scenario_says_what_it_draws(name: str) -> None:
    rows = [line for line in made.scenario(name).splitlines() if line.startswith("| ")]
    for each in (SCENARIOS[name].machine, SCENARIOS[name].task):
        assert all(any(f": {field}" in row for row in rows) for field in getattr(each, "fields", {}))
