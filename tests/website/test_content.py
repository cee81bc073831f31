"""What pages take from the code when the site is built."""

import re
from pathlib import Path

import pytest

from pter_gym.params.preset import PRESET
from pter_gym.scenarios import SCENARIOS
from pter_gym.scenarios.randomisation import LogUniform, OneOf, Repeat, Uniform
from website import content

DOCS = Path(__file__).parents[2] / "docs"


def test_pages_ask_for_what_there_is() -> None:
    asked = {
        name
        for page in DOCS.rglob("*.md")
        for name in re.findall(r"^```\{made\} (\w+)", page.read_text("utf-8"), re.MULTILINE)
    }
    assert asked == content.MADE.keys()


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_scenario_says_what_it_draws(name: str) -> None:
    text = content.scenario(name)
    assert f'gymnasium.make("{SCENARIOS[name].id}")' in text
    rows = [line for line in text.splitlines() if line.startswith("| ")]
    drawn = {getattr(SCENARIOS[name], part) for part in ("machine", "task")}
    for each in drawn:
        for field in getattr(each, "fields", {}):
            assert any(f": {field}" in row for row in rows), field


@pytest.mark.parametrize(
    ("distribution", "words"),
    [
        (Uniform(-0.5, 1.0), "even in −0.5 … 1"),
        (Repeat(LogUniform(0.5, 8.0), 5), "5 values, each logarithm even in 0.5 … 8"),
        (OneOf((0, Uniform(1.0, 2.0))), "one of 0; even in 1 … 2"),
    ],
)
def test_a_distribution_in_words(distribution: object, words: str) -> None:
    assert content.described(distribution) == words


def test_a_number_has_value_unit_and_provenance() -> None:
    (row,) = [line for line in content.preset("clutch").splitlines() if "`time_constant`" in line]
    assert row == f"| `time_constant` | 0.105 | s | {PRESET.provenance['clutch.time_constant']} |"


def test_a_block_that_is_not_in_the_readme_is_refused() -> None:
    with pytest.raises(ValueError, match="not enough values"):
        content.readme("no such block")


def test_every_figure_of_the_paper_is_there_with_its_claims() -> None:
    text = content.paper()
    for name, product in content.PRODUCTS.items():
        assert f"## {product.place}: {product.title}" in text
        for stem in product.pictures:
            assert f"/images/paper/{stem}.png" in text
            assert (content.IMAGES / "paper" / f"{stem}.png").exists(), name


def test_every_policy_and_scenario_has_a_picture() -> None:
    for text in (content.policies(), content.scenarios()):
        pictures = re.findall(r"\(/images/(\S+)\)", text)
        assert len(pictures) > 4
        assert all((content.IMAGES / picture).exists() for picture in pictures)


def test_the_help_of_a_command_is_plain_text() -> None:
    text = content.help_of("verify")
    assert text.startswith("usage: pter verify")
    assert "\x1b" not in text
