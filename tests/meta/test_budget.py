"""No folder has more lines of Python than budget.toml allows."""

import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
BUDGET = tomllib.loads(Path(__file__).with_name("budget.toml").read_text("utf-8"))


def lines_of(place: str) -> int:
    """Count the lines of a file, or of all files in a folder."""
    path = ROOT / place
    files = [path] if path.is_file() else path.rglob("*.py")
    return sum(len(file.read_text("utf-8").splitlines()) for file in files)


@pytest.mark.parametrize("room", BUDGET["rooms"])
def test_a_room_is_within_its_budget(room: str) -> None:
    assert lines_of(room) <= BUDGET["rooms"][room]


@pytest.mark.parametrize("name", BUDGET["totals"])
def test_a_total_is_within_its_budget(name: str) -> None:
    total = BUDGET["totals"][name]
    assert (
        sum(map(lines_of, total["of"])) - sum(map(lines_of, total.get("without", [])))
        <= total["lines"]
    )


def test_each_room_has_a_budget() -> None:
    folders = [
        path for parent in ("pter_gym", "pter_gym/tools") for path in (ROOT / parent).iterdir()
    ]
    rooms = {
        path.relative_to(ROOT).as_posix()
        for path in folders
        if path.is_dir() and any(path.rglob("*.py"))
    }
    assert rooms - {"pter_gym/tools"} <= BUDGET["rooms"].keys()
