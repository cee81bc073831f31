"""What pages take from the code when the site is built."""

import re
from pathlib import Path

import made
import pytest
from pages import IMAGES

from pter_gym.scenarios import SCENARIOS

DOCS = Path(__file__).parents[2] / "docs"
ASKED = [
    tuple(asked.split())
    for page in DOCS.rglob("*.md")
    for asked in re.findall(r"^```\{made\} (.+)$", page.read_text("utf-8"), re.MULTILINE)
]


@pytest.mark.parametrize("asked", ASKED, ids=" ".join)
def test_what_a_page_asks_for_is_made(asked: tuple[str, ...]) -> None:
    name, *given = asked
    text = made.MADE[name](*given)
    assert text.strip()
    pictures = re.findall(r"\(/images/(\S+)\)", text)
    assert all((IMAGES / picture).exists() for picture in pictures)


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_scenario_says_what_it_draws(name: str) -> None:
    rows = [line for line in made.scenario(name).splitlines() if line.startswith("| ")]
    for each in (SCENARIOS[name].machine, SCENARIOS[name].task):
        assert all(any(f": {field}" in row for row in rows) for field in getattr(each, "fields", {}))
