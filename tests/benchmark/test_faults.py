"""The board of clutches that fail: the same episodes, the printed table, what is stored."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pter_gym import BASELINE
from pter_gym._commands.main import main
from pter_gym.benchmark import ResultsFolder, evaluate, find_policy
from pter_gym.benchmark.episodes import find_episodes
from pter_gym.benchmark.faults import faults
from pter_gym.params import MACHINES


def test_each_clutch_of_a_machine_fails_in_each_way() -> None:
    found = faults(BASELINE)
    assert len(found) == 12
    assert len(faults(MACHINES["two-brakes"])) == 6
    assert (found[", clutch 2 dead"].torque, found[", clutch 4 half"].torque) == (0.0, 0.5)
    stuck = found[", clutch 3 stuck on"]
    assert (stuck.clutch, stuck.torque, stuck.volts, stuck.after) == (3, 1.0, 6.0, 0.0)


def test_they_are_printed_tabulated_and_stored(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = "benchmark --policies impedance,free --paces brisk --episodes 2 --faults --no-film"
    table = tmp_path / "table.csv"
    assert main([*line.split(), "--table", str(table), "--out", str(tmp_path)]) == 0
    runs = {(run.scenario, run.policy): run for run in ResultsFolder(tmp_path).runs()}
    assert len(runs) == 2 * 13
    dead = replace(BASELINE, clutch_scale=(1.0, 0.0, 1.0, 1.0))
    usual = find_episodes("standard", "brisk").first(2)
    expected = evaluate(find_policy("impedance"), replace(usual, machines=(dead,) * 2))
    found = runs["standard, clutch 2 dead", "impedance"].scores
    np.testing.assert_allclose(found["path_error_m"], expected["path_error_m"], rtol=1e-9)
    healthy, impaired = runs["standard", "impedance"], runs["standard, clutch 2 dead", "impedance"]
    assert healthy.scores["path_error_m"].mean() < impaired.scores["path_error_m"].mean()

    printed = capsys.readouterr().out
    start = printed.index("path error [mm] if a clutch fails")
    lines = printed[start:].splitlines()[2:16]
    assert max(map(len, lines)) <= 80
    shown = dict(row.split("  ", 1) for row in lines[1:])
    assert list(shown)[:4] == ["healthy", "clutch 1 dead", "clutch 1 half", "clutch 1 stuck on"]
    share = 100 * found["completed"].mean()
    cell = f"{1e3 * found['path_error_m'].mean():.1f}{'' if share == 100 else f' ({share:.0f} %)'}"
    assert shown["clutch 2 dead"].strip().startswith(cell)
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert {row["scenario"] for row in rows} == {scenario for scenario, _ in runs}
