"""`pter reproduce`: the files, their contracts, and what is refused."""

import csv
import json

import pytest

from pter_gym._commands import main as cli
from pter_gym.errors import ParameterError
from pter_gym.tools.paper import outputs
from pter_gym.tools.paper.experiments import Experiments
from pter_gym.tools.paper.figures import PICTURES
from pter_gym.tools.paper.outputs import OUTPUTS, find_outputs, make_outputs
from pter_gym.tools.paper.tables import COLUMNS, csv_text


@pytest.fixture(scope="module")
def files(experiments) -> dict[str, bytes]:
    return make_outputs(experiments, ["table1"])[0]


def rows_of(name: str, experiments: Experiments) -> list[dict[str, str]]:
    return list(csv.DictReader(csv_text(COLUMNS[name](experiments)).splitlines()))


@pytest.mark.long
def test_there_is_a_picture_and_a_table_for_everything(experiments):
    files, _ = make_outputs(experiments, OUTPUTS)
    pictures, tables = {f"{name}.png" for name in PICTURES}, {f"{name}.csv" for name in OUTPUTS}
    assert set(files) == {*pictures, *tables, "table1.json", "claims.json"}
    for name in pictures:
        assert files[name].startswith(b"\x89PNG\r\n")
        width, height = (int.from_bytes(files[name][k : k + 4]) for k in (16, 20))
        assert width >= 1000
        assert height >= 400


def test_table_1_keeps_its_contract(files, experiments):
    table = json.loads(files["table1.json"])
    assert list(table) == ["baseline", "delrin_experimental", "delrin_theoretical"]
    for name, row in table.items():
        assert list(row) == ["position_error_in", "tip_speed_in_s", "tip_acceleration_in_s2"]
        assert tuple(row.values()) == experiments.table1[name]


def test_data_of_a_figure_are_its_experiment(experiments):
    for name, sweep in experiments.sweeps.items():
        errors = [
            float(row["position_error_m"])
            for row in rows_of("fig7", experiments)
            if row["model"] == name
        ]
        assert errors == pytest.approx(sweep.position_error.tolist(), rel=1e-8)
    largest = max(float(row["clutch_torque_in_lbf"]) for row in rows_of("fig4", experiments))
    assert largest == pytest.approx(63.5, abs=0.2)
    measured = [
        float(row["volts_v"]) for row in rows_of("fig5", experiments) if row["bench_dynamic_nm"]
    ]
    assert min(measured) == 4.0


def test_the_same_experiments_give_the_same_bytes(files, experiments):
    again, _ = make_outputs(experiments, ["table1"])
    assert {name: files[name] for name in again if name != "claims.json"} == {
        name: content for name, content in again.items() if name != "claims.json"
    }


def test_one_figure_writes_its_files_alone(tmp_path, capsys):
    folder = str(tmp_path / "a" / "b")
    assert cli.main(["reproduce", "fig11", "step", "--pdf", "--out", folder]) == 0
    wanted = {f"{name}.{kind}" for name in ("step", "fig11") for kind in ("png", "pdf", "csv")}
    assert {path.name for path in (tmp_path / "a" / "b").iterdir()} == {*wanted, "claims.json"}
    assert (tmp_path / "a" / "b" / "fig11.pdf").read_bytes().startswith(b"%PDF-")
    printed = capsys.readouterr().out
    assert "calibration" in printed
    claims = json.loads((tmp_path / "a" / "b" / "claims.json").read_text("utf-8"))
    assert len(printed.splitlines()) <= 8 * len(claims)


def test_an_unknown_figure_is_refused_before_any_work(tmp_path):
    assert cli.main(["reproduce", "fig6", "--out", str(tmp_path / "out")]) == 2
    assert not (tmp_path / "out").exists()
    with pytest.raises(ParameterError, match="figures"):
        find_outputs(["fig3", "fig99", "fig6"])
    assert find_outputs(["all"]) == find_outputs(["fig11", "all"]) == list(OUTPUTS)
    assert find_outputs(["fig11", "fig3", "fig11"]) == ["fig3", "fig11"]


def test_a_folder_that_cannot_be_made_is_refused_before_any_work(tmp_path, monkeypatch):
    monkeypatch.setattr(
        outputs,
        "make_outputs",
        lambda *_, **__: pytest.fail("worked before it looked at the folder"),
    )
    blocked = tmp_path / "file"
    blocked.write_text("mine")
    assert cli.main(["reproduce", "step", "--out", str(blocked / "below")]) == 2
    assert blocked.read_text() == "mine"
