"""Leaderboards as one table for a paper."""

import csv
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib import get_data_path
from matplotlib.ft2font import FT2Font
from scipy import stats

from benchmark.handmade import with_error
from pter_gym._commands.main import main
from pter_gym.benchmark import Leaderboard, leaderboards, run_scenario
from pter_gym.benchmark.intervals import mean_interval
from pter_gym.benchmark.results import ResultsFolder
from pter_gym.benchmark.tables import write_table
from pter_gym.errors import ParameterError
from pter_gym.scenarios import PACES, SCENARIOS


@pytest.fixture
def boards() -> tuple[Leaderboard, ...]:
    runs = [with_error(name, error) for name, error in (("my_agent", 0.01), ("law", 0.02))]
    fast = with_error("fast", 0.001, mean_pace_error=0.3, mean_pace_m_s=9.0)
    errors = runs[0].scores["path_error_m"] * np.linspace(0.5, 1.5, 40)
    runs[0] = replace(runs[0], scores={**runs[0].scores, "path_error_m": errors})
    return leaderboards(
        [replace(run, scenario=name) for name in ("wall", "paths") for run in [*runs, fast]]
    )


def test_scenarios_are_in_their_own_order(boards: tuple[Leaderboard, ...]) -> None:
    assert [board.scenario for board in boards] == ["paths", "wall"]
    assert list(SCENARIOS).index("paths") < list(SCENARIOS).index("wall")


def test_markdown_has_the_best_bold_and_paired_differences(
    boards: tuple[Leaderboard, ...], tmp_path: Path
) -> None:
    path = write_table(tmp_path / "t.md", boards, baseline="law", command="pter benchmark")
    lines = [line.split(" | ") for line in path.read_text("utf-8").splitlines() if "|" in line]
    fast, agent, law = lines[2:5]
    assert agent[0] == "| "
    assert fast[0] == "| paths"
    assert fast[2].startswith("1.0†")
    assert agent[2].startswith("**10.2** (")
    means = {each.policy: each.errors.mean(0) for each in boards[0].standings}
    ends = mean_interval(means["my_agent"] - means["law"])
    assert ends.low is not None
    assert ends.high is not None
    low, high = (f"{1e3 * end:.1f}".replace("-", "−") for end in (ends.low, ends.high))
    assert law[1:] == ["law", "20.0 (19.6 – 20.4) |"]
    assert f"| my_agent | −9.8 ({low} – {high}) |" in path.read_text("utf-8")
    assert [line[1] for line in lines[8:]] == ["Policy", "---", *["fast", "my_agent"] * 2]
    assert "`pter benchmark`" in path.read_text("utf-8")


def test_a_difference_to_training_seeds_is_over_the_seeds(tmp_path: Path) -> None:
    seeds = [
        replace(with_error("trained", error), training_seed=number)
        for number, error in enumerate((0.010, 0.014, 0.015))
    ]
    board = leaderboards([*seeds, with_error("law", 0.012)])
    text = write_table(tmp_path / "t.csv", board, baseline="law").read_text("utf-8")
    (row,) = (row for row in csv.DictReader(text.splitlines()) if row["policy"] == "trained")
    margin = stats.t.ppf(0.975, 2) * np.sqrt(7e-6 / 3.0)
    found = [float(row[f"difference{end}_m"]) for end in ("", "_low", "_high")]
    assert found == pytest.approx([1e-3, 1e-3 - margin, 1e-3 + margin])


def test_latex_has_no_bare_sign(boards: tuple[Leaderboard, ...], tmp_path: Path) -> None:
    text = write_table(tmp_path / "t.tex", boards).read_text("utf-8")
    assert r"my\_agent & \textbf{10.2}" in text
    assert text.isascii()
    assert text.count("{") == text.count("}")
    rows = [line for line in text.splitlines() if line.endswith(r"\\")]
    assert {row.count("&") for row in rows} == {0, 1}
    assert [row for row in rows if "emph" in row] == [
        rf"\multicolumn{{2}}{{l}}{{\emph{{{name}}}}} \\" for name in ("paths", "wall")
    ]


LINE = 345.0
"""Width of a line of LaTeX's class article [pt], the narrowest of the usual ones."""

EIGHT_POINT = 0.85
"""Width of digits of cmr8, which \\footnotesize has, over those of cmr10: 4.25 pt and 5 pt."""


def width_of(text: str, bold: FT2Font, plain: FT2Font) -> float:
    """Return the width of a cell in LaTeX at ten points [pt], as its font file says it."""
    total = 0.0
    for part in re.findall(r"\\textbf\{.*?\}|[^\\]+|\\\w+", text.replace("$-$", "+")):
        font = bold if "textbf" in part else plain
        letters = "+" if part == r"\dagger" else re.sub(r"\\textbf|[{}$]", "", part)
        total += sum(font.load_char(ord(each)).linearHoriAdvance / 65536 for each in letters)
    return total


def test_tables_of_latex_fit_on_a_line(tmp_path: Path) -> None:
    errors = {"single-dof-tuned": 0.0999, "torque-feedback-tuned": 0.1999, "lost": 0.25}
    spread = np.linspace(0.4, 1.6, 40)
    boards: list[Leaderboard] = []
    for pace in PACES:
        runs = [replace(with_error(name, error), pace=pace) for name, error in errors.items()]
        runs[1] = replace(
            runs[1],
            scores=runs[1].scores | {"path_error_m": spread * runs[1].scores["path_error_m"]},
        )
        boards += leaderboards(runs)
    text = write_table(tmp_path / "t.tex", boards, baseline="single-dof-tuned").read_text()
    bold, plain = (
        FT2Font(f"{get_data_path()}/fonts/ttf/{name}.ttf") for name in ("cmb10", "cmr10")
    )
    for font in (bold, plain):
        font.set_size(10, 72)
    tables = text.split(r"\begin{table}")[1:]
    assert len(tables) == 2
    for table in tables:
        rows = [row[:-3].split(" & ") for row in table.splitlines() if row.count(" & ") == 3]
        widths = [
            max(width_of(cell, bold, plain) for cell in cells) for cells in zip(*rows, strict=True)
        ]
        assert EIGHT_POINT * sum(widths) + 4.0 * 2 * (len(widths) - 1) < LINE


def test_csv_has_all_digits(boards: tuple[Leaderboard, ...], tmp_path: Path) -> None:
    path = write_table(tmp_path / "t.csv", boards, baseline="law")
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 6
    for row, board in ((rows[0], boards[0]), (rows[3], boards[1])):
        assert row["scenario"] == board.scenario
        assert float(row["path_error_m"]) == board.standings[0].error.value
        assert row["rank"] == ""
        assert "too fast" in row["reason"]


@pytest.mark.parametrize(
    ("name", "baseline", "message"),
    [("t.txt", None, "table must end in .md, .tex, .csv"), ("t.md", "lwa", "baseline must be")],
)
def test_other_kinds_and_baselines_are_refused(
    boards: tuple[Leaderboard, ...], tmp_path: Path, name: str, baseline: str, message: str
) -> None:
    with pytest.raises(ParameterError, match=message):
        write_table(tmp_path / name, boards, baseline=baseline)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--scenario", "all", "--path", "sine"), "path must be given with one scenario"),
        (("--baseline", "impedance"), "with a table"),
        (("--table", "t.md", "--baseline", "residual"), "baseline must be among impedance"),
        (("--table", "t.doc"), "table must end in"),
    ],
)
def test_the_command_refuses_before_it_runs(
    arguments: tuple[str, ...],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["benchmark", "--policies", "impedance", *arguments]) == 2
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_all_scenarios_make_one_table(tmp_path: Path) -> None:
    told = ["--policies", "impedance", "--paces", "brisk", "--episodes", "2", "--out"]
    table = tmp_path / "t.csv"
    assert (
        main(["benchmark", "--scenario", "all", *told, str(tmp_path), "--table", str(table)]) == 0
    )
    with table.open(encoding="utf-8", newline="") as file:
        assert [row["scenario"] for row in csv.DictReader(file)] == list(SCENARIOS)


def test_a_run_says_what_made_it(tmp_path: Path) -> None:
    laws = {"impedance": "impedance", "locked": lambda obs: np.full((len(obs), 4), 24.0)}
    run_scenario("standard", laws, "brisk", episodes=2, results=tmp_path)
    by_name = {run.policy: run.origin for run in ResultsFolder(tmp_path).runs()}
    assert set(by_name["impedance"]) >= {"date", "numba", "numpy", "scipy", "policy"}
    assert by_name["locked"]["policy"] != by_name["impedance"]["policy"]
