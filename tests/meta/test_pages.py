"""Tables of the pages: what the code declares is up to date, and results become the cells that they should."""

import json
import re
from pathlib import Path
from typing import get_args

import boards
import fill
import pages
import pytest

from pter_gym.benchmark.ranking import PRIVILEGED
from pter_gym.envs._single import PathFollowingEnv
from pter_gym.params import BASELINE
from pter_gym.scenarios import PACES
from pter_gym.tasks.path_following import Sensors, observation_layout


@pytest.mark.parametrize("table", fill.DECLARED, ids=lambda table: f"{Path(table.page).stem}: {table.name}")
def test_a_table_says_what_the_code_declares(table: fill.Table) -> None:
    """`python docs/make/fill.py` writes it."""
    content = table.make()
    assert pages.read_block(pages.ROOT / table.page, table.name) == content
    if table.page == fill.ENVIRONMENT:
        assert all(re.split(r"(?<!\\)\|", line)[1:-1] for line in content.splitlines())
        assert "|  |" not in content, "each entry has a unit and a meaning"


@pytest.mark.parametrize("table", [table for each in fill.OF_FOLDER.values() for table in each])
def test_a_page_has_the_table(table: fill.Table) -> None:
    assert pages.read_block(pages.ROOT / table.page, table.name)


def test_the_docstring_of_the_environment_names_every_entry_of_the_observation() -> None:
    (section,) = re.findall(r"## Observation Space(.*?)## ", PathFollowingEnv.__doc__ or "", re.DOTALL)
    rows = [line for line in section.splitlines() if line.strip().startswith("| `")]
    named = [name for row in rows for name in re.findall(r"`(\w+)`", row.split("|")[1])]
    assert tuple(named) == observation_layout(BASELINE, "force").names, (
        "the table in the docstring of PathFollowingEnv, in pter_gym/envs/_single.py, has a row for each entry"
    )
    sizes = [len(observation_layout(BASELINE, sensors)) for sensors in get_args(Sensors)]
    words = "`Box(-25, 25, ({},), float32)`, with torque sensors {} entries, with force sensors {}."
    assert words.format(*sizes) in section, "and says how many there are"


def test_a_block_is_replaced_and_nothing_else(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- a -->\nold \\1\n<!-- /a -->\nafter\n", "utf-8")
    pages.write_block(page, "a", "new \\2\n")
    assert page.read_text("utf-8") == "before\n<!-- a -->\nnew \\2\n<!-- /a -->\nafter\n"
    with pytest.raises(ValueError, match="must have one block 'c', but has 0"):
        pages.write_block(page, "c", "")


def scores(error: float, rank: int | None, arrives: float = 0.981) -> dict[str, object]:
    interval = {"value": error, "low": 0.9 * error, "high": 1.1 * error}
    means = {name: {"value": x} for name, x in (("completed", arrives), ("mean_pace_error", 0.1))}
    told = {"rank": rank, "reason": None if rank else "uneven", "privileged": False}
    return {"path_error_m": interval, **told, **means, "segment_pace_error": {"value": 0.16}}


def written(folder: Path, *policies: dict[str, dict[str, object]]) -> Path:
    """Write leaderboards of `standard` at all paces, on fresh episodes of one seed after another."""
    each = [
        {"scenario": "standard", "pace": pace, "episodes": 200, "fresh": fresh, "policies": found}
        for fresh, found in enumerate(policies)
        for pace in PACES
    ]
    folder.mkdir(exist_ok=True)
    (folder / "benchmark.json").write_text(json.dumps({"leaderboards": each}), "utf-8")
    return folder


def test_a_leaderboard_has_intervals_and_marks_what_is_below_the_line(tmp_path: Path) -> None:
    bound = scores(0.03, None) | {"reason": PRIVILEGED, "privileged": True}
    results = written(tmp_path, {"good": scores(0.01, 1), "bad": scores(0.02, None), "bound": bound})
    text = boards.by_pace(results, "standard", ["bad", "good", "bound", "other"]).replace("\u00a0", " ")
    assert text.splitlines()[2::2][0] == "| Policy | slow (0.12 m/s) | medium (0.25 m/s) | brisk (0.5 m/s) |"
    assert text.splitlines()[4:] == [
        f"| `good` |{' 10.0 (9.0 … 11.0) |' * 3}",
        f"| `bad` |{' 20.0 (18.0 … 22.0) † |' * 3}",
        f"| `bound` (privileged) |{' 30.0 (27.0 … 33.0) |' * 3}",
    ]
    detailed = boards.cell(scores(0.02, None), details=True).replace("\u00a0", " ")
    assert detailed == "20.0 (18.0 … 22.0) †; 98.1 %, ±10 %, ±16 %"
    with pytest.raises(ValueError, match="has no paths at slow, medium, brisk"):
        boards.by_pace(results, "paths")


def test_all_seeds_are_in_a_table_with_their_median(tmp_path: Path) -> None:
    first, second = {"ppo-0": scores(0.03, 1, 1.0)}, {"ppo-1": scores(0.05, None, 0.5), "law": scores(0.04, 1, 1.0)}
    assert boards.by_seed(written(tmp_path, first, second)).splitlines()[2:] == [
        "| `law` | 1 | 40.0 | 40.0 | 40.0 |",
        "| `law` | median | **40.0** | **40.0** | **40.0** |",
        "| `ppo` | 0 | 30.0 | 30.0 | 30.0 |",
        "| `ppo` | 1 | (50.0) 50 % | (50.0) 50 % | (50.0) 50 % |",
        "| `ppo` | median | **40.0** | **40.0** | **40.0** |",
    ]


@pytest.mark.parametrize(
    ("name", "needed"),
    [("classical", "numba"), ("contexts", "numba"), ("pictures", "pygame"), ("store", "numba"), ("trainings", "torch")],
)
def test_a_study_loads(name: str, needed: str) -> None:
    pytest.importorskip(needed)
    __import__(name)
