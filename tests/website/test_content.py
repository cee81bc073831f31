"""What pages take from the code when the site is built."""

import re
from pathlib import Path

import made
import pytest
from pages import IMAGES

from pter_gym.params._preset import PRESET
from pter_gym.scenarios import SCENARIOS
from pter_gym.scenarios.randomisation import LogUniform, OneOf, Repeat, Uniform

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


@pytest.mark.parametrize(
    ("distribution", "words"),
    [
        (Uniform(-0.5, 1.0), "even in −0.5 … 1"),
        (Repeat(LogUniform(0.5, 8.0), 5), "5 values, each logarithm even in 0.5 … 8"),
        (OneOf((0, Uniform(1.0, 2.0))), "one of 0; even in 1 … 2"),
    ],
)
def test_a_distribution_in_words(distribution: object, words: str) -> None:
    assert made.described(distribution) == words


def test_a_number_has_value_unit_and_provenance() -> None:
    (row,) = [line for line in made.preset("clutch").splitlines() if "`time_constant`" in line]
    assert row == f"| `time_constant` | 0.105 | s | {PRESET.provenance['clutch.time_constant']} |"


def test_a_block_that_is_not_in_the_readme_is_refused() -> None:
    with pytest.raises(ValueError, match="not enough values"):
        made.readme("no such block")
