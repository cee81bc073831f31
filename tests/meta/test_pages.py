"""Tables of the pages: what the code declares is up to date, and results become the cells that they should."""

import itertools
import re
from pathlib import Path
from typing import get_args

import boards
import declared
import fill
import pages
import pytest

from pter_gym.envs._single import PathFollowingEnv
from pter_gym.params import BASELINE
from pter_gym.scenarios import PACES, SCENARIOS
from pter_gym.tasks.path_following import Sensors, observation_layout


@pytest.mark.parametrize("table", fill.DECLARED, ids=lambda table: f"{Path(table.page).stem}: {table.name}")
def test_a_table_says_what_the_code_declares(table: fill.Table) -> None:
    """`python docs/make/fill.py` writes it."""
    if table.make is declared.claims:
        pytest.importorskip("pter_gym.tools.paper")
    content = table.make()
    assert pages.read_block(pages.ROOT / table.page, table.name) == content
    if table.page in fill.NUMBERS:
        assert all(re.split(r"(?<!\\)\|", line)[1:-1] for line in content.splitlines())
        assert "|  |" not in content, "each entry has a unit and a meaning"


@pytest.mark.parametrize("table", [table for each in fill.OF_FOLDER.values() for table in each])
def test_a_page_has_the_table(table: fill.Table) -> None:
    assert pages.read_block(pages.ROOT / table.page, table.name)


def test_who_is_first_depends_on_the_error_and_only_ranks_count(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def scored(rank: int | None, **errors: float) -> dict[str, object]:
        every = dict.fromkeys(("path_error_m", *boards.ERRORS.values()), 0.02) | errors
        return {"rank": rank, **{name: {"value": value} for name, value in every.items()}}

    policies = {
        "a": scored(1, path_error_m=0.01),
        "b": scored(2, rms_error_m=0.01),
        "c": scored(None, path_error_m=0.0),
    }
    found = [
        {
            "scenario": scenario,
            "pace": pace,
            "fresh": 1,
            "episodes": 200,
            "policies": policies if pace != "slow" else {},
        }
        for scenario, pace in itertools.product(SCENARIOS, PACES)
    ]
    monkeypatch.setattr(boards, "summary", lambda _: {"leaderboards": found})
    rows = [re.findall(r"[`–]\w*`?(?:\xa0[\d.]+)?", line) for line in boards.first_by(tmp_path).splitlines()[2:]]
    assert len(rows) == len(found)
    assert [row[1:] for row in rows[:2]] == [5 * ["–"], ["`a`\xa010.0", *3 * ["`a`\xa020.0"], "`b`\xa010.0"]]


def test_the_docstring_of_the_environment_names_every_entry_of_the_observation() -> None:
    (section,) = re.findall(r"## Observation Space(.*?)## ", PathFollowingEnv.__doc__ or "", re.DOTALL)
    rows = [line for line in section.splitlines() if line.strip().startswith("| `")]
    named = [name for row in rows for name in re.findall(r"`(\w+)`", row.split("|")[1])]
    assert tuple(named) == observation_layout(BASELINE, "force").names, (
        "the table in the docstring of PathFollowingEnv, in pter_gym/envs/_single.py, has a row for each entry"
    )
    sizes = [len(observation_layout(BASELINE, sensors)) for sensors in get_args(Sensors)]
    prose = section[: section.index("|")].replace("±25", "").replace("-25, 25", "")
    assert [int(size) for size in re.findall(r"\b\d\d\b", prose)] == sizes, "its text says how many there are"


def test_a_block_is_replaced_and_nothing_else(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- a -->\nold \\1\n<!-- /a -->\nafter\n", "utf-8")
    pages.write_block(page, "a", "new \\2\n")
    assert page.read_text("utf-8") == "before\n<!-- a -->\nnew \\2\n<!-- /a -->\nafter\n"
    with pytest.raises(ValueError, match="must have one block 'c', but has 0"):
        pages.write_block(page, "c", "")


@pytest.mark.parametrize(
    ("name", "needed"),
    [
        ("arrangements_page", "numba"),
        ("bound_page", "numba"),
        ("classical", "numba"),
        ("contexts", "numba"),
        ("pictures", "pygame"),
        ("store", "numba"),
        ("trainings", "torch"),
    ],
)
def test_a_study_loads(name: str, needed: str) -> None:
    pytest.importorskip(needed)
    __import__(name)
