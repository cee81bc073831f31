"""The scripts that write pages: blocks between comments, tables, and cells that say what the results hold."""

import re
from importlib import import_module
from pathlib import Path

import pages
import pytest

from pter_gym.benchmark.ranking import PRIVILEGED

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "classical-control.md"
SCRIPTS = sorted({path.stem for path in (ROOT / "docs" / "make").glob("*.py")} - {"pages"})
NEEDS = {
    "ablations": "torch",
    "algorithms": "torch",
    "data_stages": "torch",
    "images": "pygame",
    "seeds": "torch",
    "training_speed": "torch",
}
BLOCKS = ("board: standard", "separation", "bounds", "lag", "torque", "board: everything", "lost", "predictive")


def scores(error: float, rank: int | None) -> dict[str, object]:
    interval = {"value": error, "low": 0.9 * error, "high": 1.1 * error}
    means = {name: {"value": x} for name, x in (("completed", 0.981), ("mean_pace_error", 0.1))}
    told = {"rank": rank, "reason": None if rank else "uneven", "privileged": False}
    return {"path_error_m": interval, **told, **means, "segment_pace_error": {"value": 0.16}}


def boards() -> list[dict[str, object]]:
    policies = {"good": scores(0.01, 1), "bad": scores(0.02, None)}
    return [
        {"scenario": "standard", "pace": pace, "episodes": 200, "fresh": None, "policies": policies}
        for pace in ("slow", "medium", "brisk")
    ]


def test_a_block_is_replaced_and_nothing_else(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- a -->\nold \\1\n<!-- /a -->\nbetween\n<!-- b -->\n<!-- /b -->\n", "utf-8")
    pages.write_block(page, "a", "new \\2\n")
    pages.write_block(page, "b", "more\n")
    assert page.read_text("utf-8") == (
        "before\n<!-- a -->\nnew \\2\n<!-- /a -->\nbetween\n<!-- b -->\nmore\n<!-- /b -->\n"
    )
    with pytest.raises(ValueError, match="must have one block 'c', but has 0"):
        pages.write_block(page, "c", "")


def test_a_leaderboard_has_intervals_and_marks_what_is_below_the_line() -> None:
    text = pages.board_table(boards(), "standard", ["bad", "good", "other"]).replace("\u00a0", " ")
    head, _, good, bad = text.splitlines()[2:]
    assert head == "| Policy | slow (0.12 m/s) | medium (0.25 m/s) | brisk (0.5 m/s) |"
    assert good == f"| `good` |{' 10.0 (9.0 … 11.0) |' * 3}"
    assert bad == f"| `bad` |{' 20.0 (18.0 … 22.0) † |' * 3}"
    detailed = pages.error_cell(boards()[0]["policies"]["bad"], details=True).replace("\u00a0", " ")  # type: ignore[index]
    assert detailed == "20.0 (18.0 … 22.0) †; 98.1 %, ±10 %, ±16 %"
    bound = {**scores(0.03, None), "reason": PRIVILEGED, "privileged": True}
    assert pages.label("bound", bound) == "`bound` (privileged)"
    assert "†" not in pages.error_cell(bound, details=False)
    with pytest.raises(ValueError, match="no standard at brisk"):
        pages.board_table(boards()[:2], "standard", ["good"])


@pytest.mark.parametrize("name", BLOCKS)
def test_the_page_on_classical_control_has_all_tables_and_where_they_are_from(name: str) -> None:
    (block,) = re.findall(rf"<!-- {name} -->\n(.*?)<!-- /{name} -->", PAGE.read_text("utf-8"), re.DOTALL)
    assert "\n|---|" in block
    assert re.search(r"(?:stored|fresh) episodes|training draws of .*, seeds? \d+", block)
    rows = [line for line in block.splitlines() if line.startswith("|")]
    assert all(line.count("|") in {head.count("|") for head in rows} for line in rows)


def test_contexts_score_a_policy_on_drawn_episodes() -> None:
    episodes, found = import_module("contexts").run("torque-feedback", None, "standard", "brisk", 3)
    assert [len(values) for values in (episodes, found["path_error_m"])] == [3, 3]


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_script_loads_and_says_what_it_is_for(name: str) -> None:
    if name in NEEDS:
        pytest.importorskip(NEEDS[name])
    assert import_module(name).main.__doc__
